"""Users' constraints and costs."""

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
"""Makes a CasADi expression, a scalar or a vector, from the ``Quantities`` or ``SpaceQuantities`` of the arm."""
Bound: TypeAlias = float | Sequence[float]
"""One number for all entries of an expression, or one for each."""
PLACES = ("goal", "keyframes", "motion")
"""Where a term may apply, intervals aside."""


@dataclass(frozen=True)
class Interval:
    """A part of the motion, in the path parameter: 0 at the start, 1 at the goal.

    Attributes:
        first: where it begins.
        last: where it ends.
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
"""Where a constraint holds or a cost counts."""


def applies_at(where: Where, u: FloatArray) -> BoolArray:
    """At which places of a motion a term applies, shape (N,).

    Args:
        where: of the term; ``"keyframes"`` are all places, since who checks them hands in keyframes only.
        u: increasing path parameters, shape (N,); the last place is the goal.
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
    """Bounds on an expression: ``lower <= expression <= upper``; equal bounds make an equation.

    Attributes:
        name: for messages, metrics and the record.
        expression: makes the expression, a scalar or a vector.
        lower: least value, a number or one for each entry; minus infinity for none.
        upper: greatest value, likewise.
        where: at the goal, at every keyframe, over the whole motion, or over an interval of it.
        soft: whether it may be violated: then the square of the violation is a cost, and the violation is reported.
        weight: of that cost.
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
        """Return the expression."""
        return self.expression(quantities)


@dataclass(frozen=True)
class Cost:
    """A scalar expression to be made small, averaged over the keyframes it applies to.

    Attributes:
        name: for messages, metrics and the record.
        expression: makes the scalar expression.
        weight: what one unit of it is worth, against half a squared radian of joint travel.
        where: at the goal, over the whole motion (keyframes stand for it), or over an interval of it.
    """

    name: str
    expression: Expression
    weight: float = 1.0
    where: Where = "motion"

    def __post_init__(self) -> None:
        _check(self, "cost")

    def __call__(self, quantities: "ArmQuantities") -> Any:
        """Return the expression."""
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
    """Decorator: a function of the quantities as a constraint, named after the function unless a name is given.

    Args:
        name: for messages, metrics and the record.
        lower: least value, a number or one for each entry.
        upper: greatest value, likewise.
        where: at the goal, at every keyframe, over the whole motion, or over an interval of it.
        soft: whether it may be violated.
        weight: what the squared violation of a soft one costs.
    """

    def decorate(expression: Expression) -> Constraint:
        return Constraint(name or _name_of(expression), expression, lower, upper, where, soft, weight)

    return decorate


def cost(*, name: str | None = None, weight: float = 1.0, where: Where = "motion") -> Callable[[Expression], Cost]:
    """Return the decorator: a function of the quantities as a cost, named after the function unless a name is given.

    Args:
        name: for messages, metrics and the record.
        weight: what one unit of it is worth, against half a squared radian of joint travel.
        where: at the goal, over the whole motion, or over an interval of it.
    """

    def decorate(expression: Expression) -> Cost:
        return Cost(name or _name_of(expression), expression, weight, where)

    return decorate


def call_user_function(call: Callable[[], ANSWER], what: str, limit: float) -> ANSWER:
    """Call what a user wrote, which may raise anything, or never return, and return its result.

    Args:
        call: the user's function.
        what: it is, for messages.
        limit: time that it may take [s].

    Raises:
        ProblemError: it raised something, or has not returned in time.
    """
    answer = in_background(call)
    try:
        error = answer.exception(limit)
    except TimeoutError:
        raise ProblemError(f"{what} has not returned after {limit:g} s; does it wait for something?") from None
    if error is not None:
        told = str(error) if isinstance(error, CcmError) else f"{type(error).__name__}: {error}"
        raise ProblemError(f"{what} fails: {told}") from error
    return answer.result()


def _is_bound(bound: object) -> bool:
    """Return whether a value is a number or several; whether they make bounds is seen beside the expression."""
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
"""By which a hard constraint may be violated, in the unit of its expression. Taste: documented to users, and far above
what planning leaves."""
COST_SHARES = (1.0, 0.1, 0.0)
"""Shares of the weights of users' costs with which a plan is sought in turn; the last is none of them. Taste."""


TIME_TO_LOAD = 60.0
"""That a user's module may take [s]: it may load large libraries on a busy machine."""
Term = TypeVar("Term", Constraint, Cost)


def load_terms(references: Sequence[str], kind: type[Term]) -> tuple[Term, ...]:
    """Return the constraints, or costs, that references name.

    Args:
        references: each ``module:name`` or ``path/to/file.py:name``; modules are looked for in the working directory
            too. A name may stand for one term or for a list of them.
        kind: what is expected.

    Raises:
        ProblemError: a reference names nothing, or something else.
    """
    return tuple(term for reference in references for term in _named(reference, kind))


def _named(reference: str, kind: type[Term]) -> tuple[Term, ...]:
    # From the right, for a path on Windows begins with a drive and a colon.
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
    # The command line does not put the working directory on the path, as ``python -m`` would. It comes last, so that a
    # file there never stands in for a module of Python or of this package.
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
    # Before it runs: dataclasses and pickles in the module look it up by its name.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
