"""Heavy libraries are loaded when they are needed, not before."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ccm_opt.cli.commands import app

from .conftest import PROBLEMS

HEAVY = ("casadi", "toppra", "matplotlib")
PAPERS = "ccm_opt.planning.baseline.hill_climbing_planner"
"""The paper's planner, which few solves have a use for."""
SELDOM = (
    "ccm_opt.cli.compare",
    "ccm_opt.diagnosis.path_search",
    "ccm_opt.driver.pareto",
    "ccm_opt.ik.term_checks",
    "ccm_opt.viz.failure_page",
)
"""What only failures, users' terms and other commands need."""


def loaded_after(code: str) -> set[str]:
    """Modules that a fresh interpreter has loaded after running ``code``."""
    report = "\nimport sys; print('loaded:', *sorted(sys.modules))"
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


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_a_solve_loads_neither_the_papers_planner_nor_what_explains_failures(tmp_path: Path) -> None:
    """Plans in the plane and in space with their pictures are made, verified, simulated and written without any."""
    plane = command(["solve", str(PROBLEMS / "open-space.toml"), "--no-pictures", "--out", str(tmp_path)])
    assert CliRunner().invoke(app, ["new", "--space", str(tmp_path / "mine.toml")]).exit_code == 0
    space = command(["solve", str(tmp_path / "mine.toml"), "--out", str(tmp_path)])
    loaded = loaded_after(plane + space)
    assert (tmp_path / "open-space" / "solution.npz").is_file()
    assert (tmp_path / "mine" / "report.html").is_file()
    assert not loaded & {PAPERS, *SELDOM}


def test_what_the_laws_name_is_there() -> None:
    """A module that is renamed must not leave a law that holds of nothing."""
    assert [name for name in (PAPERS, *SELDOM) if find_spec(name) is None] == []


def test_loading_sets_aside_what_is_loaded_and_nothing_else() -> None:
    """Searches for cycles go on after loading; they leave out what was loaded, and nothing where nothing was."""
    code = """
import gc
from ccm_opt.cli.surroundings import no_search_for_cycles
before = gc.get_freeze_count()
with no_search_for_cycles():
    assert not gc.isenabled()
assert gc.isenabled() and gc.get_freeze_count() == before
with no_search_for_cycles():
    import wave
assert gc.isenabled() and gc.get_freeze_count() > before
"""
    assert "wave" in loaded_after(code)
