"""Constraints and costs that users write, and how they are loaded from modules and files."""

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module, util
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

import numpy as np

from ccm_opt.core.arguments import expect, expect_that, is_number
from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.errors import CcmError, ProblemError
from ccm_opt.core.threads import ANSWER, in_background

if TYPE_CHECKING:
    from ccm_opt.ik.quantities import ArmQuantities

Expression: TypeAlias = Callable[[Any], Any]
"""Builds a CasADi expression, a scalar or a vector, from the ``Quantities`` or ``SpaceQuantities`` of the arm."""
Bound: TypeAlias = float | Sequence[float]
"""One number for all entries of an expression, or one number per entry."""
PLACES = ("goal", "keyframes", "motion")
"""Parts of a motion, apart from intervals, at which a constraint or cost may apply."""


@dataclass(frozen=True)
class Interval:
    """Part of a motion between two values of the path parameter, which is 0 at the start and 1 at the goal.

    Attributes:
        first: path parameter at which the interval begins.
        last: path parameter at which the interval ends.
    """

    first: float
    last: float

    def __post_init__(self) -> None:
        numbers = is_number(self.first) and is_number(self.last)
        if not numbers or not 0.0 <= self.first <= self.last <= 1.0:
            raise ProblemError(
                f"an interval of the motion needs 0 <= first <= last <= 1, got {self.first!r} and {self.last!r}"
            )


Where: TypeAlias = Literal["goal", "keyframes", "motion"] | Interval
"""Part of a motion at which a constraint must hold or a cost counts."""


def applies_at(where: Where, u: FloatArray) -> BoolArray:
    """Return a mask of the samples of a motion at which a constraint or cost applies, shape (N,).

    Args:
        where: part of the motion; for ``"keyframes"`` all samples count, since callers then pass keyframes only.
        u: increasing path parameters, shape (N,); the last sample is the goal.
    """
    if isinstance(where, Interval):
        inside: BoolArray = (where.first <= u) & (u <= where.last)
        return inside
    if where == "goal":
        last: BoolArray = np.arange(len(u)) == len(u) - 1
        return last
    return np.ones(len(u), dtype=bool)


@dataclass(frozen=True)
class Constraint:
    """User's constraint ``lower <= expression <= upper`` on the motion; an equation if both bounds are equal.

    Attributes:
        name: name for messages, metrics and the record of the plan.
        expression: function that builds the expression, a scalar or a vector, from the quantities of the arm.
        lower: lower bound, one number or one per entry; minus infinity for none.
        upper: upper bound, one number or one per entry; infinity for none.
        where: part of the motion at which the constraint holds: the goal, every keyframe, the whole motion, or an
            interval.
        soft: whether the constraint may be violated; the squared violation is then a cost, and the violation is
            reported.
        weight: weight of half the squared violation of a soft constraint.
    """

    name: str
    expression: Expression
    lower: Bound = -math.inf
    upper: Bound = math.inf
    where: Where = "motion"
    soft: bool = False
    weight: float = 1.0

    def __post_init__(self) -> None:
        _check(self, "constraint")
        for side in ("lower", "upper"):
            bound = getattr(self, side)
            expect_that(partial(_is_bound, bound), bound, f"a number or a list of numbers for {side}=")
        expect(self.soft, bool, "True or False for soft=")

    def __call__(self, quantities: "ArmQuantities") -> Any:
        """Return the expression for the given quantities."""
        return self.expression(quantities)


@dataclass(frozen=True)
class Cost:
    """User's cost: a scalar expression whose mean over keyframes of the motion is minimised.

    Attributes:
        name: name for messages, metrics and the record of the plan.
        expression: function that builds the scalar expression from the quantities of the arm.
        weight: cost of one unit of the expression, relative to half a squared radian of joint travel.
        where: part of the motion that counts: the goal, the whole motion (represented by the keyframes), or an
            interval.
    """

    name: str
    expression: Expression
    weight: float = 1.0
    where: Where = "motion"

    def __post_init__(self) -> None:
        _check(self, "cost")

    def __call__(self, quantities: "ArmQuantities") -> Any:
        """Return the expression for the given quantities."""
        return self.expression(quantities)


def constraint(
    *,
    name: str | None = None,
    lower: Bound = -math.inf,
    upper: Bound = math.inf,
    where: Where = "motion",
    soft: bool = False,
    weight: float = 1.0,
) -> Callable[[Expression], Constraint]:
    """Return a decorator that turns a function of the arm's quantities into a constraint on the motion.

    Args:
        name: name for messages, metrics and the record of the plan; that of the function if None.
        lower: lower bound, one number or one per entry of the expression.
        upper: upper bound, one number or one per entry of the expression.
        where: part of the motion at which the constraint holds: the goal, every keyframe, the whole motion, or an
            interval.
        soft: whether the constraint may be violated, at a cost.
        weight: weight of half the squared violation of a soft constraint.
    """

    def decorate(expression: Expression) -> Constraint:
        return Constraint(name or _name_of(expression), expression, lower, upper, where, soft, weight)

    return decorate


def cost(*, name: str | None = None, weight: float = 1.0, where: Where = "motion") -> Callable[[Expression], Cost]:
    """Return a decorator that turns a function of the arm's quantities into a cost of the motion.

    Args:
        name: name for messages, metrics and the record of the plan; that of the function if None.
        weight: cost of one unit of the expression, relative to half a squared radian of joint travel.
        where: part of the motion that counts: the goal, the whole motion, or an interval.
    """

    def decorate(expression: Expression) -> Cost:
        return Cost(name or _name_of(expression), expression, weight, where)

    return decorate


def call_user_function(call: Callable[[], ANSWER], what: str, limit: float) -> ANSWER:
    """Return the result of a function written by a user, guarding against errors and endless loops.

    Args:
        call: the user's function.
        what: description of the function, for messages.
        limit: maximum time that the function may take [s].

    Raises:
        ProblemError: the function raised an error, or has not returned in time.
    """
    answer = in_background(call)
    try:
        error = answer.exception(limit)
    except TimeoutError:
        raise ProblemError(f"{what} has not returned after {limit:g} s; does it wait for something?") from None
    if error is not None:
        reason = str(error) if isinstance(error, CcmError) else f"{type(error).__name__}: {error}"
        raise ProblemError(f"{what} fails: {reason}") from error
    return answer.result()


def _is_bound(bound: object) -> bool:
    """Return whether a value is a number or an array of numbers, of any length."""
    return np.asarray(bound).dtype.kind in "iuf"


def _name_of(expression: Expression) -> str:
    name = getattr(expression, "__name__", type(expression).__name__)
    return name.replace("_", " ")


def _check(term: Constraint | Cost, kind: str) -> None:
    if not (isinstance(term.name, str) and term.name.strip()):
        raise ProblemError(f"a {kind} needs a name, got {term.name!r}")
    if not callable(term.expression):
        raise ProblemError(
            f"{kind} '{term.name}': expected a function of the quantities, got a {type(term.expression).__name__}"
        )
    if not (isinstance(term.where, Interval) or (isinstance(term.where, str) and term.where in PLACES)):
        raise ProblemError(
            f"{kind} '{term.name}': where must be one of {', '.join(PLACES)} or an Interval, got {term.where!r}"
        )
    if not (is_number(term.weight) and term.weight >= 0.0):
        raise ProblemError(f"{kind} '{term.name}': the weight must be finite and not negative, got {term.weight!r}")


TERM_TOLERANCE = 1e-6
"""Allowed violation of a hard constraint, in the unit of its expression. Heuristic: documented to users, and far above
the violations that planning leaves."""
COST_SHARES = (1.0, 0.1, 0.0)
"""Factors on the weights of users' costs with which a plan is sought, one after the other; the last drops the costs
altogether. Heuristic."""


TIME_TO_LOAD = 60.0
"""Maximum time for loading a user's module [s], which may import large libraries on a busy machine."""
Term = TypeVar("Term", Constraint, Cost)


def load_terms(references: Sequence[str], kind: type[Term]) -> tuple[Term, ...]:
    """Return the constraints, or the costs, that a user's references name, after importing their modules.

    Args:
        references: each ``module:name`` or ``path/to/file.py:name``; modules are also searched in the working
            directory. A name stands for one constraint or cost, or for a list.
        kind: ``Constraint`` or ``Cost``.

    Raises:
        ProblemError: a module cannot be loaded, or a name is missing or of another type.
    """
    return tuple(term for reference in references for term in _named(reference, kind))


def _named(reference: str, kind: type[Term]) -> tuple[Term, ...]:
    # Split from the right, because a Windows path begins with a drive and a colon.
    place, colon, name = reference.rpartition(":")
    if not (place and colon and name):
        raise ProblemError(f"'{reference}' names no {_word(kind)}; expected module:function or file.py:function")
    module = _module(reference, place)
    if not hasattr(module, name):
        raise ProblemError(f"'{reference}': module '{place}' has no '{name}'")
    found = getattr(module, name)
    terms = tuple(found) if isinstance(found, list | tuple) else (found,)
    for term in terms:
        if not isinstance(term, kind):
            raise ProblemError(
                f"'{reference}' is a {type(term).__name__}, expected a {kind.__name__}; decorate the function with "
                f"@ccm_opt.{_word(kind)}"
            )
    return terms


def _word(kind: type[Constraint] | type[Cost]) -> str:
    return kind.__name__.lower()


def _module(reference: str, place: str) -> ModuleType:
    load = partial(_from_file, Path(place)) if place.endswith(".py") else partial(_from_path, place)
    return call_user_function(load, f"loading '{reference}'", TIME_TO_LOAD)


def _from_path(name: str) -> ModuleType:
    # The command line does not put the working directory on the path, as ``python -m`` would. It goes last so that a
    # file there never shadows a module of Python or of this package.
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    return import_module(name)


def _from_file(path: Path) -> ModuleType:
    name = f"ccm_opt_terms_{path.stem}"
    spec = util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.exists():
        raise FileNotFoundError(f"there is no file {path}")
    module = util.module_from_spec(spec)
    # Registered before it runs: dataclasses and pickles in the module look it up by its name.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
