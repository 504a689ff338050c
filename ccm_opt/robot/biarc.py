"""Two arcs that join two places and directions, and how an arm leaves its guide tube.

With tangents of equal length a at both ends the arcs meet half-way between the tangents' tips (Bolton, "Biarc curves",
1975); a solves 2 (1 − t0·t1) a² + 2 v·(t0 + t1) a − v·v = 0 with v from one end to the other.

Every joint that comes out of the tube is straight as it passes the end, so a bend just beyond it has to be made, and
taken back, over a short way of the feed.
"""

from typing import NamedTuple

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS, turn_towards


class SpaceArc(NamedTuple):
    """A circular arc, or a straight line.

    Attributes:
        side: to which it bends, across the frame at its beginning, a unit vector of shape (2,).
        turn: by how much, in [0, 2π) [rad].
        length: [m].
    """

    side: FloatArray
    turn: float
    length: float


def biarc(
    base: FloatArray, frame: FloatArray, tip: FloatArray, direction: FloatArray
) -> tuple[SpaceArc, SpaceArc] | None:
    """Return two arcs from a frame to a place and a direction there; the frame is carried without turning about them.

    There are none where the tip lies behind the base and points the same way.

    Args:
        base: where they begin, shape (3,) [m].
        frame: (t, n1, n2) there as columns, shape (3, 3).
        tip: where they end, shape (3,) [m].
        direction: there, a unit vector, shape (3,).
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
    """Return the arc along t over a chord: it turns by twice the angle between the two."""
    along, *aside = frame.T @ chord
    away = float(np.hypot(*aside))
    half = float(np.arctan2(away, along))
    side = np.array(aside) / away if away > 0.0 else np.array([1.0, 0.0])
    return SpaceArc(side, 2.0 * half, float(np.linalg.norm(chord)) / float(np.sinc(half / np.pi)))


STRAIGHT_BEFORE = 0.3
"""Nominal links beyond a guide tube on which joints are straight: the less, the more places to stop at."""
FREE_AFTER = 2.0
"""Nominal links beyond it from where on they bend as they like."""


def free_before(arm: Arm) -> float:
    """Return the arc length beyond the end of the guide tube on which joints stay straight [m].

    Every joint that comes out stops there once, so that none begins to bend while the tube still holds it.
    """
    return STRAIGHT_BEFORE * arm.length / NOMINAL_LINKS


def bend_shares(arm: Arm, places: FloatArray) -> FloatArray:
    """Share of its bend that a joint at a place takes, which grows smoothly beyond a guide tube, shape (joints,).

    Args:
        arm: with or without a guide tube.
        places: arc lengths of joints beyond the end of the tube, shape (joints,) [m].
    """
    if not arm.base_axes:
        return np.ones(len(places))
    straight = free_before(arm)
    x = np.clip((places - straight) / (FREE_AFTER * arm.length / NOMINAL_LINKS - straight), 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


def straight_at_exit(arm: Arm, q: FloatArray) -> FloatArray:
    """Return a configuration without the bends of joints that stand where they stay straight just beyond a guide tube.

    A motion to such a bend would have to make it on the short way since the joint left the tube, and no smooth path
    does. The tip has to be put back to its place afterwards.

    Args:
        arm: with or without a guide tube.
        q: shape (c,) [rad, m].
    """
    if not arm.base_axes:
        return q
    places = arm.link_length * np.arange(arm.links) + float(np.sum(q[2 * arm.links :])) - arm.hole
    straight = q.copy()
    straight[: 2 * arm.links].reshape(-1, 2)[places <= free_before(arm)] = 0.0
    return straight
