"""The track of the tip: where the arm lay at first, then the way that its tip shall take."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class SpaceTipTrack:
    """A polyline from behind the arm's base along the arm to its tip, and on along a way.

    Attributes:
        corners: shape (m, 3) [m].
        start: arc length of the tip when the motion begins [m].
    """

    corners: FloatArray
    start: float

    @classmethod
    def along(cls, points: FloatArray, way: FloatArray) -> "SpaceTipTrack":
        """The track of an arm with joints and tip at points, shape (links + 1, 3), along a way, (k, 3), of its tip.

        The way may begin anywhere on the arm: what of the arm lies beyond is not part of the track then, and the tip
        is drawn back to it.
        """
        corners = np.concatenate((points, way))
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        apart = np.concatenate(([True], lengths > 1e-9 * max(float(np.sum(lengths)), 1e-9)))
        along = float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
        return cls(corners[apart], along)

    @cached_property
    def arcs(self) -> FloatArray:
        """Arc lengths of the corners, shape (m,) [m]."""
        return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(self.corners, axis=0), axis=1))))

    @property
    def end(self) -> float:
        """Arc length of its end [m]."""
        return float(self.arcs[-1])

    def at(self, s: FloatArray | float) -> FloatArray:
        """Places at arc lengths, shape (..., 3) [m]; before its beginning it runs on straight."""
        s = np.asarray(s, dtype=float)
        places = np.stack([np.interp(s, self.arcs, column) for column in self.corners.T], axis=-1)
        first = self.corners[1] - self.corners[0]
        first = first / np.linalg.norm(first)
        return np.asarray(places + np.minimum(s, 0.0)[..., None] * first)
