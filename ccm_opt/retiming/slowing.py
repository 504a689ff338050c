"""How much longer a motion must take for rows to keep their limits."""

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray


def share_allowed(static: FloatArray, allowed: float) -> FloatArray:
    """What a row may reach: ``allowed``, but never less than halfway from its static part to the true limit, 1."""
    share: FloatArray = np.maximum(allowed, 0.5 * (1.0 + np.abs(static)))
    return share


def slowing(moving: FloatArray, static: FloatArray, allowed: float, damping: FloatArray | None = None) -> float:
    """Least factor on time that brings all rows within what they may reach; arguments as for ``slowings``."""
    return float(np.max(slowings(moving, static, allowed, damping), initial=0.0))


def slowings(moving: FloatArray, static: FloatArray, allowed: float, damping: FloatArray | None = None) -> FloatArray:
    """Least factor on time that brings each row within what it may reach; below 1 when there is room.

    Time longer by λ makes of a row m / λ² + d / λ + c. Without d the least λ² is m / (L − c), with L what is allowed.
    With it λ = (d + √(d² + 4 m (L − c))) / 2 (L − c) is safe, and every longer time too.

    Args:
        moving: part m of the rows.
        static: part c, within ±1, of the same shape.
        allowed: share of the limit that may be used, see ``share_allowed``.
        damping: part d, None for none.
    """
    share = share_allowed(static, allowed)
    if damping is not None:
        return _damped_slowings(moving, damping, static, share)
    # The static part helps where it points against the moving one, and hinders where it does not; where it leaves no
    # room, a little keeps the quotient finite.
    room = np.maximum(share - np.sign(moving) * static, ROUNDING)
    return np.asarray(np.sqrt(np.abs(moving) / room))


def _damped_slowings(moving: FloatArray, damping: FloatArray, static: FloatArray, share: FloatArray) -> FloatArray:
    """The same with friction; rows that keep their limit ask for a longer time only where the others do."""
    if np.all(np.abs(moving + damping + static) <= share):
        return np.zeros_like(moving)
    factors = np.ones_like(moving)
    # Upper and lower side of a row; the lower one is the upper one of the row negated.
    for sign in (1.0, -1.0):
        room = np.maximum(share - sign * static, ROUNDING)
        root = damping * damping + 4.0 * sign * moving * room
        longer = sign * damping + np.sqrt(np.maximum(root, 0.0))
        # Without a real root the row keeps this side at every λ.
        factors = np.maximum(factors, np.where(root >= 0.0, longer, 0.0) / (2.0 * room))
    return factors
