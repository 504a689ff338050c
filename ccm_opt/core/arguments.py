"""What functions are given: what is wrong with it is told as bad input."""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import TypeGuard

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import METRES


def expect(value: object, kind: type | tuple[type, ...], what: str, hint: str = "") -> None:
    """Refuse a value of another kind than a function is made for.

    Args:
        value: what it was given.
        kind: of what it is made for.
        what: that is, in words, with its article.
        hint: what to do instead, or empty.

    Raises:
        ProblemError: it is of another kind.
    """
    if not isinstance(value, kind):
        raise ProblemError(refusal(value, what, hint))


def expect_that(fits: Callable[[], bool], value: object, what: str, hint: str = "") -> None:
    """Refuse a value that does not pass a test; a test that cannot even look at it has not passed.

    Raises:
        ProblemError: it does not.
    """
    try:
        passed = fits()
    except (TypeError, ValueError, AttributeError):
        passed = False
    if not passed:
        raise ProblemError(refusal(value, what, hint))


def expect_method(value: object, methods: Sequence[str], what: str, hint: str = "") -> None:
    """Refuse an object that lacks methods which are called of it; None may stand for such an object.

    Raises:
        ProblemError: it lacks one, or is a class where an object of it is meant.
    """
    if value is None:
        return
    if isinstance(value, type):
        raise ProblemError(f"expected {what}, got the class {value.__name__} itself; write {value.__name__}(…)")
    if not all(callable(getattr(value, method, None)) for method in methods):
        raise ProblemError(refusal(value, what, hint))


def expect_callable(value: object, what: str, hint: str = "") -> None:
    """Refuse what cannot be called; None may stand for nobody who is.

    Raises:
        ProblemError: it cannot.
    """
    if value is not None and not callable(value):
        raise ProblemError(refusal(value, what, hint))


def refusal(value: object, what: str, hint: str = "") -> str:
    """Return the sentence that refuses a value."""
    advice = f"; {hint}" if hint else ""
    return f"expected {what}, got {in_words(value)}{advice}"


def in_words(value: object) -> str:
    """Return a value with its kind, in a few words."""
    if value is None:
        return "None"
    shown = repr(value)
    return f"{type(value).__name__} {shown}" if len(shown) < _LONG else f"a {type(value).__name__}"


_LONG = 60
"""Letters from which on a value itself says less than its kind."""


LARGEST = 1e15
"""Places and angles beyond have no digits left for what moves, and areas of them none in single precision."""


@dataclass
class Arguments:
    """Arguments that are looked at one after the other; what is wrong is collected, and refused in the end.

    Attributes:
        of: what they make, in words.
        unit: of the lengths among them: "m", "mm" or "in".
        metres: in that unit.
        wrong: what is wrong so far, a line each.
    """

    of: str
    unit: object = "m"
    metres: float = field(init=False, default=1.0)
    wrong: list[str] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.choice("unit", self.unit, METRES)
        if not self.wrong:
            self.metres = METRES[str(self.unit)]

    def number(self, name: str, value: object, *, least: float = -math.inf, above: float = -math.inf) -> float:
        """Return a finite number.

        Args:
            name: of the argument.
            value: what was given.
            least: that it may be.
            above: what it must be greater than.

        Returns:
            The number; not a number where it is none.
        """
        if is_number(value) and value >= least and value > above:
            return float(value)
        bound = f" greater than {above:g}" if math.isfinite(above) else ""
        self._refused(name, f"a number of at least {least:g}" if math.isfinite(least) else f"a number{bound}", value)
        return math.nan

    def length(self, name: str, value: object, *, least: float = -math.inf, above: float = -math.inf) -> float:
        """Return a length that is given in the unit, in metres."""
        return self.metres * self.number(name, value, least=least, above=above)

    def whole(self, name: str, value: object, least: int) -> int:
        """Return a whole number of at least so much; that where it is none."""
        if is_whole(value) and value >= least:
            return int(value)
        self._refused(name, f"a whole number of at least {least}", value)
        return least

    def numbers(self, name: str, value: object, count: int, what: str = "numbers") -> FloatArray:
        """Return the so many finite numbers, shape (count,); zeros where they are none."""
        found = finite_array(value)
        if found is None or found.shape != (count,):
            self._refused(name, f"{count} {what}", value)
            return np.zeros(count)
        return found

    def each(self, name: str, value: object, count: int, *, above: float = -math.inf) -> FloatArray:
        """Return one number for all of ``count``, or one for each, shape (count,)."""
        if isinstance(value, (Sequence, np.ndarray)) and not isinstance(value, str):
            found = self.numbers(name, value, count)
            if np.any(found <= above) and np.any(found):
                self._refused(name, f"numbers greater than {above:g}", value)
            return found
        return np.full(count, self.number(name, value, above=above))

    def choice(self, name: str, value: object, choices: Collection[str]) -> None:
        """One of some words."""
        if not isinstance(value, str) or value not in choices:
            self._refused(name, f"one of {', '.join(choices)}", value)

    def flag(self, name: str, value: object) -> None:
        """True or false."""
        if not isinstance(value, bool):
            self._refused(name, "True or False", value)

    def must(self, holds: bool, line: str) -> None:
        """A line about what is wrong unless something holds; what is no number is told already."""
        if not holds:
            self.wrong.append(line)

    def refuse(self) -> None:
        """Refuse them if anything is wrong.

        Raises:
            ProblemError: with a line for each.
        """
        if self.wrong:
            raise ProblemError(f"{self.of} cannot be made:\n" + "\n".join(f"  {line}" for line in self.wrong))

    def _refused(self, name: str, expected: str, value: object) -> None:
        self.wrong.append(f"{name}: expected {expected}, got {in_words(value)}")


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite number; true and false are none."""
    if isinstance(value, (bool, np.bool_)):
        return False
    return isinstance(value, Real) and math.isfinite(value)


def is_whole(value: object) -> TypeGuard[int]:
    """Return whether a value is a whole number; true and false are none."""
    return isinstance(value, Integral) and not isinstance(value, (bool, np.bool_))


def finite_array(value: object) -> FloatArray | None:
    """Return a value as an array of numbers of at most ``LARGEST``, or None where it is none."""
    if isinstance(value, (str, bytes)):
        return None
    try:
        found = np.asarray(value)
    except (TypeError, ValueError):
        return None
    if found.dtype.kind not in "iuf":
        return None
    numbers = found.astype(np.float64)
    return numbers if np.all(np.abs(numbers) <= LARGEST) else None
