"""What a public function was given where it expects something else, told as bad input, not as a missing attribute."""

from collections.abc import Callable, Sequence

from ccm_opt.errors import ProblemError


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
    """The sentence that refuses a value."""
    advice = f"; {hint}" if hint else ""
    return f"expected {what}, got {in_words(value)}{advice}"


def in_words(value: object) -> str:
    """A value with its kind, in a few words."""
    if value is None:
        return "None"
    shown = repr(value)
    return f"{type(value).__name__} {shown}" if len(shown) < _LONG else f"a {type(value).__name__}"


_LONG = 60
"""Letters from which on a value itself says less than its kind."""
