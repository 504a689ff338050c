"""Heavy libraries are loaded when they are needed, not before."""

import subprocess
import sys

import pytest

from .conftest import PROBLEMS

HEAVY = ("casadi", "toppra", "matplotlib")


def loaded_after(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after running ``code``."""
    report = "\nimport sys; print('loaded:', *sorted(name for name in sys.modules if '.' not in name))"
    done = subprocess.run([sys.executable, "-c", code + report], capture_output=True, text=True, check=True)
    return set(done.stdout.rsplit("loaded:", 1)[1].split())


def command(arguments: list[str]) -> str:
    """Python code that runs the command line and goes on after it."""
    return f"""
import sys
sys.argv = ["ccm-opt", *{arguments!r}]
from ccm_opt.cli import main
try:
    main()
except SystemExit:
    pass
"""


@pytest.mark.parametrize(
    "arguments",
    [["--version"], ["solve", "missing.toml"], ["solve", "--method", "x", "missing.toml"], ["check", "missing"]],
)
def test_commands_that_solve_nothing_load_nothing_heavy(arguments: list[str]) -> None:
    """Printing the version and refusing bad input must not wait for casadi, toppra or matplotlib."""
    assert not loaded_after(command(arguments)) & set(HEAVY)


def test_the_version_does_not_even_load_numpy() -> None:
    """``ccm-opt --version`` answers from the package's own text."""
    assert not loaded_after(command(["--version"])) & {"numpy", "pydantic", "shapely"}


def test_loading_a_problem_loads_nothing_heavy() -> None:
    """The public interface loads a problem without the optimisers."""
    path = str(PROBLEMS / "swan-neck.toml")
    loaded = loaded_after(f"import ccm_opt\nassert ccm_opt.load_problem({path!r}).name == 'swan-neck'")
    assert not loaded & set(HEAVY)
