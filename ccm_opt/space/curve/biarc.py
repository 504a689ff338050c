"""Two circular arcs that join two poses in space, in closed form.

With tangents of equal length a at both ends the arcs meet half-way between the tangents' tips (Bolton, "Biarc curves",
1975); a solves 2 (1 − t0·t1) a² + 2 v·(t0 + t1) a − v·v = 0 with v from one end to the other.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.space.curve.space_configuration import SpaceConfiguration
from ccm_opt.space.curve.transported_frames import across, polar, turned_towards


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
