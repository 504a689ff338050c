"""What a public function was given where it expects something else, told as bad input, not as a missing attribute."""

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
        advice = f"; {hint}" if hint else ""
        raise ProblemError(f"expected {what}, got {_described(value)}{advice}")


def _described(value: object) -> str:
    """A value with its kind, in a few words."""
    if value is None:
        return "None"
    shown = repr(value)
    return f"{type(value).__name__} {shown}" if len(shown) < _LONG else f"a {type(value).__name__}"


_LONG = 60
"""Letters from which on a value itself says less than its kind."""
