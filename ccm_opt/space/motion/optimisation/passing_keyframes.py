"""The places that the tip passes on its way, over the keyframes of a motion: each has a keyframe that stays near it."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.motion.optimisation.keyframe_rows import KeyframeRows
from ccm_opt.space.motion.optimisation.space_sweep import SpaceSweep


@dataclass(frozen=True, eq=False)
class PassingKeyframes:
    """Keyframes at which the tip passes places.

    Attributes:
        keyframe: of each place, shape (m,).
        places: shape (m, 3) [m].
        reach: how far off the tip may be at that keyframe, shape (m,) [m].
    """

    keyframe: IntArray
    places: FloatArray
    reach: FloatArray

    @classmethod
    def of(cls, sweep: SpaceSweep, keyframe: IntArray, places: FloatArray, wanted: float) -> "PassingKeyframes":
        """Keyframes that stay as near as is wanted [m], or as near as they are."""
        away = np.linalg.norm(sweep.points[keyframe, -1] - places, axis=1)
        return cls(keyframe, places, np.maximum(wanted, away))

    def rows(self, sweep: SpaceSweep) -> KeyframeRows:
        """Six rows a place: the tip stays in the cube that fits into the ball, or leaves it no farther on any axis."""
        moved = np.flatnonzero(self.keyframe > 0)
        keyframe = self.keyframe[moved]
        unit = sweep.stepper.unit
        off = (sweep.points[keyframe, -1] - self.places[moved]) / unit
        most = np.maximum(self.reach[moved, None] / (np.sqrt(3.0) * unit), np.abs(off))
        slopes = sweep.moving[keyframe, -1] / unit
        p = slopes.shape[-1]
        return KeyframeRows(
            np.repeat(keyframe, 6),
            np.concatenate((slopes, -slopes), axis=1).reshape(-1, p),
            np.concatenate((-most - off, off - most), axis=1).ravel(),
            0,
        )

    def holds(self, sweep: SpaceSweep) -> bool:
        """Whether the tip is within reach of every place at its keyframe."""
        away = np.linalg.norm(sweep.points[self.keyframe, -1] - self.places, axis=1)
        return bool(np.all(away <= self.reach * (1.0 + 1e-9)))
