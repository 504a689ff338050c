"""Figures in the words of messages."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray


def degrees(angle: float) -> str:
    """An angle."""
    return f"{np.rad2deg(angle):.1f}°"


def point(place: FloatArray) -> tuple[float, ...]:
    """A place as a finding keeps it."""
    return tuple(float(coordinate) for coordinate in place)


def listed(names: tuple[str, ...]) -> str:
    """Names of walls, quoted: 'a', 'b' and 'c'."""
    quoted = [f"'{name}'" for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]]) if len(quoted) > 1 else "".join(quoted)
