"""The methods that can be compared, in one table; and planners of others, named by module and attribute."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from types import MappingProxyType
from typing import Any, cast

from ccm_opt.errors import ProblemError
from ccm_opt.planner import Planner
from ccm_opt.problem import Problem


@dataclass(frozen=True)
class Method:
    """A planner, and the planner options it runs with.

    Attributes:
        name: in tables and options.
        summary: what it is, for people.
        make: makes the planner; heavy modules are imported here.
        options: changes of the problem's planner options.
    """

    name: str
    summary: str
    make: Callable[[], Planner]
    options: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))

    def prepared(self, problem: Problem, time_limit: float | None = None) -> Problem:
        """The problem with this method's options, and a time limit [s] unless that is None."""
        limit = {} if time_limit is None else {"time_limit": time_limit}
        return replace(problem, planner=replace(problem.planner, **self.options, **limit))  # type: ignore[arg-type]


def _curve_planner() -> Planner:
    from ccm_opt.curve_planner import CurvePlanner  # noqa: PLC0415 - loads casadi

    return CurvePlanner()


def _hill_climbing() -> Planner:
    module = import_module("ccm_opt.hill_climbing_planner")
    return cast("Planner", module.HillClimbingPlanner())


METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        Method("nlp", "the curve planner, its motion optimised", _curve_planner),
        Method("nlp-as-found", "the curve planner, its motion as found", _curve_planner, {"optimiser": "none"}),
        Method("nlp-paul", "the curve planner, timed by Paul's transitions", _curve_planner, {"retiming": "paul"}),
        Method("hill-climbing", "the paper's planner", _hill_climbing),
        Method(
            "hill-climbing-paul", "the paper's planner and its timing by transitions", _hill_climbing,
            {"retiming": "paul"},
        ),
    )
}  # fmt: skip
"""The methods of this package by name."""
DEFAULT = ("nlp", "hill-climbing")


def method_named(name: str) -> Method:
    """A method of the table, or somebody's planner as ``module:attribute``.

    Args:
        name: the attribute is a planner, or something that returns one when called without arguments.

    Raises:
        ProblemError: when there is no such method, or the planner cannot be loaded.
    """
    if name in METHODS:
        return METHODS[name]
    if ":" not in name:
        raise ProblemError(f"there is no method '{name}'; expected one of {', '.join(METHODS)}, or module:attribute")
    return Method(name, "a planner from elsewhere", lambda: _loaded(name))


def check_methods(names: Sequence[str]) -> tuple[str, ...]:
    """The names, each once, after making each planner: so that a name that is wrong is told before any work.

    Raises:
        ProblemError: when a planner cannot be made.
    """
    for name in names:
        method = method_named(name)
        try:
            method.make()
        except ImportError as error:
            raise ProblemError(f"the method '{name}' cannot be loaded: {error}") from error
    return tuple(dict.fromkeys(names))


def _loaded(name: str) -> Planner:
    module, _, attribute = name.partition(":")
    try:
        value: Any = import_module(module)
        for part in attribute.split("."):
            value = getattr(value, part)
    except (ImportError, AttributeError) as error:
        raise ProblemError(f"the planner {name} cannot be loaded: {error}; expected module:attribute") from error
    if isinstance(value, type) or (callable(value) and not hasattr(value, "plan")):
        value = value()
    if not callable(getattr(value, "plan", None)):
        raise ProblemError(f"{name} is a {type(value).__name__} without a method 'plan'; expected a planner")
    return cast("Planner", value)
