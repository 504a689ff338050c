"""Frames carried along arcs without turning about them, and where directions lie in a frame: angle and azimuth."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.curve.rigid_motions import exponential


def polar(frame: FloatArray, direction: FloatArray) -> tuple[float, float]:
    """Angle between t and a direction, in [0, π], and the azimuth to which it lies: 0 is n1, a quarter turn n2.

    Args:
        frame: (t, n1, n2) as columns, shape (3, 3).
        direction: any length but 0, shape (3,).
    """
    along, left, up = frame.T @ direction
    return float(np.arctan2(np.hypot(left, up), along)), float(np.arctan2(up, left))


def turned_towards(frame: FloatArray, azimuth: float, angle: float) -> FloatArray:
    """The frame after an arc towards an azimuth that turns by an angle [rad], shape (3, 3)."""
    twist = np.array([0.0, -np.sin(azimuth), np.cos(azimuth), 0.0, 0.0, 0.0])
    return np.asarray(frame @ exponential(angle * twist)[0])


def transported(frame: FloatArray, direction: FloatArray) -> FloatArray:
    """The frame turned the shortest way, so that it points in a direction, shape (3, 3)."""
    angle, azimuth = polar(frame, direction)
    return turned_towards(frame, azimuth, angle)


def across(azimuth: float) -> FloatArray:
    """(cos ψ, sin ψ): the shares of κ1 and κ2 in a curvature towards an azimuth, shape (2,)."""
    return np.array([np.cos(azimuth), np.sin(azimuth)])
