"""Biarcs that join two points with given directions, and limits on bends just beyond the end of the guide tube.

With tangents of equal length a at both ends, the two arcs meet half-way between the tips of the tangents (Bolton,
"Biarc curves", 1975); a solves 2 (1 − t0·t1) a² + 2 v·(t0 + t1) a − v·v = 0, where v leads from one end to the other.

Every joint is straight as it leaves the guide tube, so a bend just beyond the tube has to be made, or undone, within a
short length of feed.
"""

from typing import NamedTuple

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS, turn_towards


class SpaceArc(NamedTuple):
    """A circular arc, or a straight line.

    Attributes:
        side: direction of the bend, a unit vector of shape (2,) perpendicular to the tangent of the initial frame.
        turn: angle of the arc, in [0, 2π) [rad].
        length: arc length [m].
    """

    side: FloatArray
    turn: float
    length: float


def biarc(
    base: FloatArray, frame: FloatArray, tip: FloatArray, direction: FloatArray
) -> tuple[SpaceArc, SpaceArc] | None:
    """Return two arcs that lead from a frame to a point with a given direction, or None if no such arcs exist.

    Frames are carried along the arcs without turning about them. No such arcs exist if the tip lies behind the base and
    points the same way.

    Args:
        base: start of the first arc, shape (3,) [m].
        frame: (t, n1, n2) at the base as columns, shape (3, 3).
        tip: end of the second arc, shape (3,) [m].
        direction: direction at the tip, a unit vector, shape (3,).
    """
    start = frame[:, 0]
    chord = tip - base
    square = float(chord @ chord)
    along = float(chord @ (start + direction))
    root = np.sqrt(along**2 + 2.0 * square * (1.0 - float(start @ direction)))
    if not along + root > ROUNDING * np.sqrt(square):
        return None
    tangent = square / (along + root)
    middle = 0.5 * (base + tip + tangent * (start - direction))
    first = _arc(frame, middle - base)
    return first, _arc(frame @ turn_towards(first.side, first.turn), tip - middle)


def _arc(frame: FloatArray, chord: FloatArray) -> SpaceArc:
    """Return the arc that starts along t and spans a chord; the arc's angle is twice that between t and the chord."""
    along, *aside = frame.T @ chord
    away = float(np.hypot(*aside))
    half = float(np.arctan2(away, along))
    side = np.array(aside) / away if away > 0.0 else np.array([1.0, 0.0])
    return SpaceArc(side, 2.0 * half, float(np.linalg.norm(chord)) / float(np.sinc(half / np.pi)))


STRAIGHT_BEFORE = 0.3
"""Nominal links beyond the end of the guide tube on which joints are straight: the fewer, the more stops."""
FREE_AFTER = 2.0
"""Nominal links beyond the end of the guide tube after which joints bend freely."""


def free_before(arm: Arm) -> float:
    """Return the arc length beyond the end of the guide tube on which joints stay straight [m].

    Every emerging joint stops on this length once, so that no joint begins to bend while the tube still holds it.
    """
    return STRAIGHT_BEFORE * arm.length / NOMINAL_LINKS


def bend_shares(arm: Arm, places: FloatArray) -> FloatArray:
    """Return the fraction of its full bend that each joint may take at its position, shape (joints,).

    The fraction grows smoothly from 0 to 1 beyond the end of the guide tube.

    Args:
        arm: the arm, with or without a guide tube.
        places: arc lengths of the joints beyond the end of the tube, shape (joints,) [m].
    """
    if not arm.base_axes:
        return np.ones(len(places))
    return smooth_step(places, free_before(arm), FREE_AFTER * arm.length / NOMINAL_LINKS)


def smooth_step(places: FloatArray, first: float, last: float) -> FloatArray:
    """Return values that grow from 0 to 1 between two places, with zero slope at both, in the shape of ``places``."""
    x = np.clip((places - first) / (last - first), 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


def straight_at_exit(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the configuration with the joints just beyond the end of the guide tube straightened.

    A joint there would have to bend within the short feed since it left the tube, which no smooth path can do. The
    caller has to restore the tip position afterwards.

    Args:
        arm: the arm, with or without a guide tube.
        q: configuration, shape (c,) [rad, m].
    """
    if not arm.base_axes:
        return q
    places = arm.link_length * np.arange(arm.links) + float(np.sum(q[2 * arm.links :])) - arm.hole
    straight = q.copy()
    straight[: 2 * arm.links].reshape(-1, 2)[places <= free_before(arm)] = 0.0
    return straight
