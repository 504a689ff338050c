"""One mistake, in a process of its own: the module is loaded with it, and the tests that run its line are run."""

import ast
import importlib.abc
import importlib.machinery
import importlib.util
import os
import resource
import signal
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import HealthCheck, Phase
from hypothesis import settings as hypothesis_settings

HEAVY = (
    "numpy",
    "scipy.interpolate",
    "scipy.sparse",
    "shapely",
    "casadi",
    "matplotlib.pyplot",
    "networkx",
    "rich.console",
)
"""What is loaded before the processes part, since all of them need it."""
MOST_MEMORY = 6 * 2**30
"""Of one trial [bytes]."""
FAILED = frozenset({1, 2})
"""Exit codes of pytest for a test that fails, and for modules that cannot be loaded."""
PROFILE = "mutation"


def prepare() -> None:
    """Load what all trials need, once."""
    for name in HEAVY:
        import_module(name)
    # A failing example is enough; to make it smaller takes far longer than to find it.
    phases = (Phase.explicit, Phase.generate)
    quiet = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
    hypothesis_settings.register_profile(
        PROFILE, phases=phases, database=None, deadline=None, suppress_health_check=quiet
    )


def is_found(path: Path, tree: ast.Module, tests: Sequence[str], time_limit: float) -> bool:
    """Whether the tests find a mistake: one fails, or none comes to an end.

    Args:
        path: of the module, from the root of the package.
        tree: the module with the mistake.
        tests: that are run, in this order, until one fails.
        time_limit: for all of them [s].
    """
    child = os.fork()
    if child == 0:
        _run(".".join(path.with_suffix("").parts), str(path), tree, tests)
    ends = time.monotonic() + time_limit
    while time.monotonic() < ends:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return _judged(os.waitstatus_to_exitcode(status))
        time.sleep(0.02)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return True


def _judged(code: int) -> bool:
    """Whether an exit code means that a mistake was found; a negative one is that of a signal."""
    if code != 0 and code not in FAILED and code > 0:
        raise RuntimeError(f"pytest ended with {code}: these are not the tests that were listed")
    return code != 0


def _run(module: str, path: str, tree: ast.Module, tests: Sequence[str]) -> None:
    """Run tests and end the process; it never returns."""
    code = 1
    try:
        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        sys.meta_path.insert(0, _Finder(module, path, tree))
        options = ["-x", "-q", "-n0", "--no-header", "-p", "no:cacheprovider", "--hypothesis-seed=1"]
        options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # Hypothesis is here already
        code = int(pytest.main([*options, f"--hypothesis-profile={PROFILE}", *tests]))
    finally:
        os._exit(code)


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Loads one module from a tree."""

    def __init__(self, module: str, path: str, tree: ast.Module) -> None:
        self._module = module
        self._path = str(Path(path).resolve())
        self._tree = tree

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        del path, target
        if fullname != self._module:
            return None
        return importlib.util.spec_from_file_location(fullname, self._path, loader=self)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> None:
        del spec

    def exec_module(self, module: ModuleType) -> None:
        exec(compile(self._tree, self._path, "exec"), module.__dict__)  # noqa: S102 - that is what it is for
