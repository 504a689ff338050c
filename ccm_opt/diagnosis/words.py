"""Figures in the words of messages."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray


def millimetres(length: float) -> str:
    """A length below a metre or so, in mm with three figures or more."""
    return f"{1e3 * length:.1f} mm" if abs(length) >= 1e-3 else f"{1e3 * length:.2g} mm"


def metres(length: float) -> str:
    """A length of the size of the arm."""
    return f"{length:.3f} m"


def degrees(angle: float) -> str:
    """An angle."""
    return f"{np.rad2deg(angle):.1f}°"


def at(place: FloatArray | tuple[float, float]) -> str:
    """A place in the plane."""
    return f"({place[0]:.3f}, {place[1]:.3f})"


def point(place: FloatArray) -> tuple[float, float]:
    """A place as a finding keeps it."""
    return float(place[0]), float(place[1])


def listed(names: tuple[str, ...]) -> str:
    """Names of walls, quoted: 'a', 'b' and 'c'."""
    quoted = [f"'{name}'" for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]]) if len(quoted) > 1 else "".join(quoted)
