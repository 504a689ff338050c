"""Checks of function arguments that report defects as ``ProblemError``."""

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
    """Raise an error if a value has the wrong type.

    Args:
        value: the value to check.
        kind: the allowed type or types.
        what: text for the expected kind of value, with an article.
        hint: advice on what to pass instead; may be empty.

    Raises:
        ProblemError: the value has another type.
    """
    if not isinstance(value, kind):
        raise ProblemError(refusal(value, what, hint))


def expect_that(fits: Callable[[], bool], value: object, what: str, hint: str = "") -> None:
    """Raise an error if a value fails a test.

    Args:
        fits: the test; TypeError, ValueError and AttributeError raised by the test count as failure.
        value: the value to report if the test fails.
        what: text for the expected kind of value, with an article.
        hint: advice on what to pass instead; may be empty.

    Raises:
        ProblemError: the value fails the test.
    """
    try:
        passed = fits()
    except (TypeError, ValueError, AttributeError):
        passed = False
    if not passed:
        raise ProblemError(refusal(value, what, hint))


def expect_method(value: object, methods: Sequence[str], what: str, hint: str = "") -> None:
    """Raise an error if an object lacks a required method; None is accepted.

    Args:
        value: the object to check.
        methods: names of the required methods.
        what: text for the expected kind of value, with an article.
        hint: advice on what to pass instead; may be empty.

    Raises:
        ProblemError: the object lacks a method, or is a class instead of an instance.
    """
    if value is None:
        return
    if isinstance(value, type):
        raise ProblemError(f"expected {what}, got the class {value.__name__} itself; write {value.__name__}(…)")
    if not all(callable(getattr(value, method, None)) for method in methods):
        raise ProblemError(refusal(value, what, hint))


def expect_vector(value: object, size: int, what: str) -> FloatArray:
    """Return a vector of finite numbers given by the user, shape (size,).

    Args:
        value: the value given.
        size: number of coordinates.
        what: what is expected, for the message.

    Raises:
        ProblemError: the value is something else.
    """
    found = finite_array(value)
    if found is None or found.shape != (size,):
        raise ProblemError(refusal(value, what))
    return found


def refusal(value: object, what: str, hint: str = "") -> str:
    """Return the message that rejects a value: the expected kind, the actual value, and a hint if there is one."""
    advice = f"; {hint}" if hint else ""
    return f"expected {what}, got {in_words(value)}{advice}"


def in_words(value: object) -> str:
    """Return text for a value in messages: its type and, if short, the value itself."""
    if value is None:
        return "None"
    shown = repr(value)
    return f"{type(value).__name__} {shown}" if len(shown) < _LONG else f"a {type(value).__name__}"


_LONG = 60
"""Length of the text of a value from which on messages name only its type."""


LARGEST = 1e15
"""Largest magnitude of a coordinate or angle that is accepted.

Beyond, doubles have too few digits left for motions, and areas overflow single precision.
"""


@dataclass
class Arguments:
    """Collector of defects among the arguments of a call, which are then reported all at once.

    Attributes:
        subject: text for the object that the call creates.
        unit: unit of the lengths among the arguments: "m", "mm" or "in".
        metres: metres per unit.
        wrong: defects found so far, one line each.
    """

    subject: str
    unit: object = "m"
    metres: float = field(init=False, default=1.0)
    wrong: list[str] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.choice("unit", self.unit, METRES)
        if not self.wrong:
            self.metres = METRES[str(self.unit)]

    def number(self, name: str, value: object, *, least: float = -math.inf, above: float = -math.inf) -> float:
        """Return an argument that must be a finite number.

        Args:
            name: name of the argument.
            value: value of the argument.
            least: least value allowed.
            above: value that the argument must exceed.

        Returns:
            The number; NaN if the value is not acceptable, in which case a defect is recorded.
        """
        if is_number(value) and value >= least and value > above:
            return float(value)
        bound = f" greater than {above:g}" if math.isfinite(above) else ""
        self._refused(name, f"a number of at least {least:g}" if math.isfinite(least) else f"a number{bound}", value)
        return math.nan

    def length(self, name: str, value: object, *, least: float = -math.inf, above: float = -math.inf) -> float:
        """Return an argument that must be a length in ``unit``, converted to metres [m]; checks as for ``number``."""
        return self.metres * self.number(name, value, least=least, above=above)

    def whole(self, name: str, value: object, least: int) -> int:
        """Return an argument that must be an integer ≥ ``least``; otherwise record a defect and return ``least``."""
        if is_whole(value) and value >= least:
            return int(value)
        self._refused(name, f"a whole number of at least {least}", value)
        return least

    def numbers(self, name: str, value: object, count: int, what: str = "numbers") -> FloatArray:
        """Return an argument that must be ``count`` finite numbers; otherwise record a defect and return zeros."""
        found = finite_array(value)
        if found is None or found.shape != (count,):
            self._refused(name, f"{count} {what}", value)
            return np.zeros(count)
        return found

    def each(self, name: str, value: object, count: int, *, above: float = -math.inf) -> FloatArray:
        """Return an argument given as one common number or as one number per entry, as an array of shape (count,)."""
        if isinstance(value, (Sequence, np.ndarray)) and not isinstance(value, str):
            found = self.numbers(name, value, count)
            if np.any(found <= above) and np.any(found):
                self._refused(name, f"numbers greater than {above:g}", value)
            return found
        return np.full(count, self.number(name, value, above=above))

    def choice(self, name: str, value: object, choices: Collection[str]) -> None:
        """Record a defect unless an argument is one of the given words."""
        if not isinstance(value, str) or value not in choices:
            self._refused(name, f"one of {', '.join(choices)}", value)

    def flag(self, name: str, value: object) -> None:
        """Record a defect unless an argument is True or False."""
        if not isinstance(value, bool):
            self._refused(name, "True or False", value)

    def must(self, holds: bool, line: str) -> None:
        """Record the defect ``line`` unless a condition holds."""
        if not holds:
            self.wrong.append(line)

    def refuse(self) -> None:
        """Raise an error if any defect was recorded.

        Raises:
            ProblemError: a defect was recorded; the message has one line per defect.
        """
        if self.wrong:
            raise ProblemError(f"{self.subject} cannot be made:\n" + "\n".join(f"  {line}" for line in self.wrong))

    def _refused(self, name: str, expected: str, value: object) -> None:
        self.wrong.append(f"{name}: expected {expected}, got {in_words(value)}")


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite real number; booleans do not count."""
    if isinstance(value, (bool, np.bool_)):
        return False
    return isinstance(value, Real) and math.isfinite(value)


def is_whole(value: object) -> TypeGuard[int]:
    """Return whether a value is an integer; booleans do not count."""
    return isinstance(value, Integral) and not isinstance(value, (bool, np.bool_))


def finite_array(value: object) -> FloatArray | None:
    """Return a value as an array of floats; None if it is not an array of numbers up to ``LARGEST`` in magnitude."""
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
