"""Two arcs that join two places and directions, and how an arm leaves its guide tube.

With tangents of equal length a at both ends the arcs meet half-way between the tangents' tips (Bolton, "Biarc curves",
1975); a solves 2 (1 − t0·t1) a² + 2 v·(t0 + t1) a − v·v = 0 with v from one end to the other.

Every joint that comes out of the tube is straight as it passes the end, so a bend just beyond it has to be made, and
taken back, over a short way of the feed.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.bishop_curve import SpaceConfiguration
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS, across, polar, turned_towards


@dataclass(frozen=True)
class SpaceArc:
    """A circular arc, or a straight line.

    Attributes:
        azimuth: to which it bends, in the frame at its beginning [rad].
        turn: by how much, in [0, 2π) [rad].
        length: [m].
    """

    azimuth: float
    turn: float
    length: float

    @property
    def curvature(self) -> FloatArray:
        """κ1 and κ2, shape (2,) [1/m]."""
        return self.turn / self.length * across(self.azimuth)


@dataclass(frozen=True)
class Biarc:
    """Two arcs end to end; the azimuths are those of one frame that is carried along without turning about them.

    Attributes:
        base: where it begins, shape (3,) [m].
        frame: (t, n1, n2) there as columns, shape (3, 3).
        first: arc.
        second: arc.
    """

    base: FloatArray
    frame: FloatArray
    first: SpaceArc
    second: SpaceArc

    @classmethod
    def between(cls, base: FloatArray, frame: FloatArray, tip: FloatArray, direction: FloatArray) -> "Biarc":
        """The biarc from a frame to a place and a direction there.

        Raises:
            ProblemError: there is none, as where the tip lies behind the base and points the same way.
        """
        start = frame[:, 0]
        chord = tip - base
        square = float(chord @ chord)
        along = float(chord @ (start + direction))
        root = np.sqrt(along**2 + 2.0 * square * (1.0 - float(start @ direction)))
        if not along + root > ROUNDING * np.sqrt(square):
            raise ProblemError(
                "no two arcs of equal tangents join the poses: the tip lies behind the base and points the same way; "
                "turn one of the two, or move the tip aside"
            )
        tangent = square / (along + root)
        middle = 0.5 * (base + tip + tangent * (start - direction))
        first = _arc(frame, middle - base)
        second = _arc(turned_towards(frame, first.azimuth, first.turn), tip - middle)
        return cls(base, frame, first, second)

    @property
    def length(self) -> float:
        """Of both arcs [m]."""
        return self.first.length + self.second.length

    def configuration(self) -> SpaceConfiguration:
        """Both arcs as segments of constant curvature."""
        arcs = (self.first, self.second)
        values = [np.tile(arc.curvature, (5, 1)) for arc in arcs]
        return SpaceConfiguration.chain(self.base, self.frame, [arc.length for arc in arcs], values)


def _arc(frame: FloatArray, chord: FloatArray) -> SpaceArc:
    """The arc along t over a chord: it turns by twice the angle between the two."""
    half, azimuth = polar(frame, chord)
    length = float(np.linalg.norm(chord)) / float(np.sinc(half / np.pi))
    return SpaceArc(azimuth, 2.0 * half, length)


STRAIGHT_BEFORE = 0.3
"""Nominal links beyond a guide tube on which joints are straight: the less, the more places to stop at."""
FREE_AFTER = 2.0
"""Nominal links beyond it from where on they bend as they like."""


def free_before(arm: Arm) -> float:
    """Arc length beyond the end of the guide tube on which joints stay straight [m].

    Every joint that comes out stops there once, so that none begins to bend while the tube still holds it.
    """
    return STRAIGHT_BEFORE * arm.length / NOMINAL_LINKS


def free_shares_of_bends(arm: Arm, places: FloatArray) -> FloatArray:
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
    """A configuration without the bends of joints that stand where they stay straight just beyond a guide tube.

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
