"""Methods that are compared."""

import hashlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ccm_opt.core.errors import ProblemError
from ccm_opt.core.progress import Stages
from ccm_opt.driver.legs import Planner
from ccm_opt.ik.terms import TIME_TO_LOAD, call_user_function
from ccm_opt.problem import Problem
from ccm_opt.problem.options import PlannerOptions


@dataclass(frozen=True)
class Method:
    """A way to solve problems: changes of a problem's planner options, or a planner from elsewhere.

    Attributes:
        name: in tables and options.
        summary: what it is, for people.
        options: changes of the problem's planner options.
        make: makes a planner from elsewhere; when None the options name the planner.
    """

    name: str
    summary: str
    options: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    make: Callable[[], Planner] | None = None

    def prepared(self, problem: Problem, time_limit: float | None = None) -> Problem:
        """Return the problem with this method's options, and a limit of CPU time [s] unless that is None."""
        options = dict(self.options)
        if time_limit is not None:
            options["time_limit"] = time_limit
        return replace(problem, planner=replace(problem.planner, **options))  # type: ignore[arg-type]

    def planner(self, prepared: Problem) -> Planner:
        """Return the planner for a problem that was prepared.

        Raises:
            ProblemError: this method knows the plane alone, and the problem is in space.
        """
        if self.make is not None:
            return self.make()
        from ccm_opt.driver.planning_run import default_planner  # noqa: PLC0415 - loads casadi

        options = prepared.planner
        if prepared.dimension == 3 and (options.method != "nlp" or options.retiming != "toppra"):
            raise ProblemError(f"the method {self.name} knows the plane alone; use nlp or ompl in space")
        return default_planner(prepared, Stages())


def _ompl() -> Planner:
    from ccm_opt.cli.compare.ompl_peer import OmplPlanner  # noqa: PLC0415 - nobody else needs it

    return OmplPlanner()


_OF_THE_PAPER: Mapping[str, object] = {
    **{name: getattr(PlannerOptions(), name) for name in ("optimiser", "seed", "tries", "wanted_gap", "weights")},
    "method": "hill-climbing",
}
"""What the paper's planner is asked: it knows none of the other options."""

METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        Method("nlp", "the curve planner, its motion optimised", {"method": "nlp"}),
        Method("nlp-as-found", "the curve planner, its motion as found", {"method": "nlp", "optimiser": "none"}),
        Method("nlp-paul", "the curve planner, timed by Paul's transitions", {"method": "nlp", "retiming": "paul"}),
        Method("hill-climbing", "the paper's planner", _OF_THE_PAPER),
        Method("ompl", "RRT-Connect of OMPL, under our certificate (extra 'ompl')", make=_ompl),
        Method("hill-climbing-paul", "the paper's planner and timing", {**_OF_THE_PAPER, "retiming": "paul"}),
    )
}
"""The methods of this package by name."""
DEFAULT = ("nlp", "hill-climbing")
"""Compared when no method is named."""


def method_named(name: str) -> Method:
    """Return a method of the table, or any planner as ``module:attribute``.

    Args:
        name: the attribute is a planner, or something that returns one when called without arguments.

    Raises:
        ProblemError: when there is no such method, or the planner cannot be loaded.
    """
    if name in METHODS:
        return METHODS[name]
    if ":" not in name:
        raise ProblemError(f"there is no method '{name}'; expected one of {', '.join(METHODS)}, or module:attribute")
    return Method(name, "a planner from elsewhere", make=lambda: _loaded(name))


def check_methods(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names, each once; a wrong name, or a planner that cannot be made, is refused before any work.

    Raises:
        ProblemError: when a planner cannot be made.
    """
    for method in map(method_named, names):
        if method.make is not None:
            method.make()
    # A dictionary keeps the order in which the methods were named.
    return tuple(dict.fromkeys(names))


def _made(name: str) -> Any:
    """Return the object that a name stands for; a class, or a function that makes a planner, is called."""
    module, _, attribute = name.partition(":")
    value: Any = import_module(module)
    for part in attribute.split("."):
        value = getattr(value, part)
    return value() if isinstance(value, type) or (callable(value) and not hasattr(value, "plan")) else value


def _loaded(name: str) -> Planner:
    value = call_user_function(partial(_made, name), f"loading the planner module:attribute {name}", TIME_TO_LOAD)
    if not callable(getattr(value, "plan", None)):
        raise ProblemError(f"{name} is a {type(value).__name__} without a method 'plan'; expected a planner")
    planner: Planner = value
    return planner


DIGITS = 16
"""Of the digest that is kept."""
OURS = "ccm_opt"
"""The package whose planners, timing and verifier every run meets."""
NOT_MET = ("cli/", "viz/")
"""Parts of the package that no run meets, but for planners of OMPL; suites of random problems count their own."""
_OMPL = "cli/compare/ompl_"
SOURCES = frozenset((".py", ".c", ".h", ".so", ".pyd"))
"""Endings of what is code."""


@cache
def code_of(method: str) -> str:
    """Return the digest of the code that a method runs on this machine, hexadecimal.

    That of a planner from elsewhere included.

    Args:
        method: of the table, or ``module:attribute``.
    """
    digest = hashlib.sha256(_package_digest(OURS, NOT_MET).encode())
    if method == "ompl":
        digest.update(metadata.version("ompl").encode())
    if method not in METHODS:
        # All of the top-level package: a planner may well be changed in a module that its own imports.
        digest.update(_package_digest(method.partition(":")[0].partition(".")[0], ()).encode())
    return digest.hexdigest()[:DIGITS]


@cache
def _package_digest(name: str, left_out: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for place, file in _sources(name):
        if place.startswith(left_out) and not place.startswith(_OMPL):
            continue
        digest.update(f"{place}\n".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _sources(name: str) -> Iterator[tuple[str, Path]]:
    """Yield every source file of a module or package, in order, with its place in it; none where it has no files."""
    spec = find_spec(name) if name not in sys.modules else sys.modules[name].__spec__
    if spec is None:
        return
    folders = list(spec.submodule_search_locations or ())
    if not folders and spec.origin is not None and Path(spec.origin).is_file():
        yield name, Path(spec.origin)
    for folder in map(Path, folders):
        files = (file for file in folder.rglob("*") if file.suffix in SOURCES and file.is_file())
        yield from sorted((file.relative_to(folder).as_posix(), file) for file in files)
