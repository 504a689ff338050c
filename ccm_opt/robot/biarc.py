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
    """Return the biarc from a start frame to an end point with a given direction, or None if there is none.

    The frame is carried along the arcs without turning about the tangent. There is no biarc if the end lies straight
    behind the start and has the start's direction.

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
    """Return the circular arc with a given start frame and chord; it turns by twice the angle between t and the chord.

    Args:
        frame: (t, n1, n2) at the start as columns, shape (3, 3); the arc starts in the direction t.
        chord: vector from the start of the arc to its end, shape (3,) [m].
    """
    along, *aside = frame.T @ chord
    away = float(np.hypot(*aside))
    half = float(np.arctan2(away, along))
    side = np.array(aside) / away if away > 0.0 else np.array([1.0, 0.0])
    return SpaceArc(side, 2.0 * half, float(np.linalg.norm(chord)) / float(np.sinc(half / np.pi)))


STRAIGHT_BEFORE = 0.3
"""Length beyond the end of the guide tube on which joints stay straight, in nominal links (1/24 of the arm). A shorter
one needs more stops of the feed."""
FREE_AFTER = 2.0
"""Distance beyond the end of the guide tube at which joints may bend up to their limits, in nominal links (1/24 of the
arm)."""
_FEW_LINKS = 36
"""Number of links above which joints need only a part of the distance from ``STRAIGHT_BEFORE`` to ``FREE_AFTER``, as
they bend less. Measured: arms of 60 links need it in helical pipes; arms of 36 links lose clearance among baffles."""


def free_before(arm: Arm) -> float:
    """Return the arc length beyond the end of the guide tube on which joints stay straight [m].

    The feed stops once for every emerging joint within this length, so that no joint begins to bend while the tube
    still holds it.
    """
    return STRAIGHT_BEFORE * arm.length / NOMINAL_LINKS


def bend_shares(arm: Arm, places: FloatArray) -> FloatArray:
    """Return the fraction of its bend limit that each joint may use, given its distance from the guide tube.

    The fraction grows smoothly from 0 near the end of the tube to 1 farther out; without a tube all fractions are 1.

    Args:
        arm: the arm, with or without a guide tube.
        places: arc lengths from the end of the tube to the joints, shape (joints,) [m].

    Returns:
        Fractions from 0 to 1, shape (joints,).
    """
    if arm.feed is None:
        return np.ones(len(places))
    free_after = STRAIGHT_BEFORE + (FREE_AFTER - STRAIGHT_BEFORE) * (
        1.0 if arm.links <= _FEW_LINKS else NOMINAL_LINKS / arm.links
    )
    return smooth_step(places, free_before(arm), free_after * arm.length / NOMINAL_LINKS)


def smooth_step(places: FloatArray, first: float, last: float) -> FloatArray:
    """Return 3 x² − 2 x³ with x growing from 0 at ``first`` to 1 at ``last`` and clipped to [0, 1].

    The result has the shape of ``places`` and zero slope at both ends.
    """
    x = np.clip((places - first) / (last - first), 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


def straight_at_exit(arm: Arm, q: FloatArray) -> FloatArray:
    """Return a configuration in space with the bends of all joints inside or just outside the guide tube set to zero.

    Such a joint would have to bend within the short feed since it left the tube, which no smooth joint path can do.
    The caller has to restore the tip position afterwards. Without a tube the configuration is returned unchanged.

    Args:
        arm: the arm, with or without a guide tube.
        q: configuration, shape (c,) [rad, m].
    """
    if arm.feed is None:
        return q
    places = arm.joint_places[:-1] + float(np.sum(q[2 * arm.links :])) - arm.hole
    straight = q.copy()
    straight[: 2 * arm.links].reshape(-1, 2)[places <= free_before(arm)] = 0.0
    return straight
