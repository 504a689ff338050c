"""Planning methods that can be compared, and hashes of their code."""

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
    """A planning method for comparisons: changes of a problem's planner options, or an external planner.

    Attributes:
        name: name in tables and options.
        summary: description for people.
        options: changes of the problem's planner options, by name.
        make: function that returns an external planner; None if the options select the planner.
    """

    name: str
    summary: str
    options: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    make: Callable[[], Planner] | None = None

    def prepared(self, problem: Problem, time_limit: float | None = None) -> Problem:
        """Return a problem with this method's planner options, and with a CPU time limit [s] unless that is None."""
        options = dict(self.options)
        if time_limit is not None:
            options["time_limit"] = time_limit
        return replace(problem, planner=replace(problem.planner, **options))  # type: ignore[arg-type]

    def planner(self, prepared: Problem) -> Planner:
        """Return the planner for a problem returned by ``prepared``.

        Raises:
            ProblemError: the goals are in free order, or this method supports planar problems only.
        """
        from ccm_opt.driver.arguments import refuse_free_order  # noqa: PLC0415 - loads casadi

        refuse_free_order(prepared, "plans that are compared are")
        if self.make is not None:
            return self.make()
        from ccm_opt.driver.planning_run import default_planner  # noqa: PLC0415 - loads casadi

        options = prepared.planner
        if prepared.dimension == 3 and (options.method != "nlp" or options.retiming != "toppra"):
            raise ProblemError(f"the method {self.name} works in the plane only; in space use nlp or ompl")
        return default_planner(prepared, Stages())


def _ompl() -> Planner:
    from ccm_opt.cli.compare.ompl_peer import OmplPlanner  # noqa: PLC0415 - nobody else needs it

    return OmplPlanner()


def _rrt_connect() -> Planner:
    from ccm_opt.planning.planner import MotionPlanner  # noqa: PLC0415 - loads casadi

    return MotionPlanner(sampled=True)


_OF_THE_PAPER: Mapping[str, object] = {
    **{name: getattr(PlannerOptions(), name) for name in ("optimiser", "seed", "tries", "wanted_gap", "weights")},
    "method": "hill-climbing",
}
"""Planner options for the paper's planner; options that this planner does not support have their defaults."""

METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        Method("nlp", "curve planner, motion optimised", {"method": "nlp"}),
        Method("nlp-as-found", "curve planner, motion as found", {"method": "nlp", "optimiser": "none"}),
        Method("nlp-paul", "curve planner, timed by Paul's transitions", {"method": "nlp", "retiming": "paul"}),
        Method("hill-climbing", "planner of the paper", _OF_THE_PAPER),
        Method("rrt-connect", "our RRT-Connect alone, its way as found", {"optimiser": "none"}, _rrt_connect),
        Method("ompl", "RRT-Connect of OMPL, with this package's certificate (extra 'ompl')", make=_ompl),
        Method("hill-climbing-paul", "planner and timing of the paper", {**_OF_THE_PAPER, "retiming": "paul"}),
    )
}
"""Built-in methods, by name."""
DEFAULT = ("nlp", "hill-climbing")
"""Names of the methods compared by default."""


def method_named(name: str) -> Method:
    """Return a built-in method, or a method that wraps the planner given as ``module:attribute``.

    Args:
        name: name of a method, or reference to a planner, or to a class or function that returns a planner when called
            without arguments.

    Raises:
        ProblemError: no method has this name.
    """
    if name in METHODS:
        return METHODS[name]
    if ":" not in name:
        raise ProblemError(f"there is no method '{name}'; expected one of {', '.join(METHODS)}, or module:attribute")
    return Method(name, "external planner", make=lambda: _loaded(name))


def check_methods(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of methods without duplicates, after checking that all methods exist and their planners can be made.

    Raises:
        ProblemError: a method does not exist, or a planner cannot be made.
    """
    for method in map(method_named, names):
        if method.make is not None:
            method.make()
    # A dictionary keeps the order in which the methods were named.
    return tuple(dict.fromkeys(names))


def _made(name: str) -> Any:
    """Return the planner to which ``module:attribute`` refers; a class or function is called to make one."""
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
"""Number of digits of a hash that are kept."""
OURS = "ccm_opt"
"""Name of the package whose planners, timing and verifier are used in every run."""
NOT_MET = ("cli/", "viz/")
"""Parts of the package whose code is not hashed, since runs do not depend on it. Exceptions: the planner that uses OMPL
is hashed, and random suites have a version of their own (``suites.GENERATOR``)."""
_OMPL = "cli/compare/ompl_"
SOURCES = frozenset((".py", ".c", ".h", ".so", ".pyd"))
"""Suffixes of files that contain code."""


@cache
def code_of(method: str) -> str:
    """Return a hash of the code that a method runs on this machine, in hexadecimal digits.

    It covers this package. For an external planner it also covers that planner's package, for OMPL its version.

    Args:
        method: name of a method, or ``module:attribute``.
    """
    digest = hashlib.sha256(_package_digest(OURS, NOT_MET).encode())
    if method == "ompl":
        digest.update(metadata.version("ompl").encode())
    if method not in METHODS:
        # The whole top-level package: a planner also changes with the modules that it imports.
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
    """Yield relative path and path of every source file of a module or package, in order; none if it is absent."""
    spec = find_spec(name) if name not in sys.modules else sys.modules[name].__spec__
    if spec is None:
        return
    folders = list(spec.submodule_search_locations or ())
    if not folders and spec.origin is not None and Path(spec.origin).is_file():
        yield name, Path(spec.origin)
    for folder in map(Path, folders):
        files = (file for file in folder.rglob("*") if file.suffix in SOURCES and file.is_file())
        yield from sorted((file.relative_to(folder).as_posix(), file) for file in files)
