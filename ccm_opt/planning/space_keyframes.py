"""Keyframes that keep users' terms and places to pass."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.limits.user_motion_rows import UserCosts
from ccm_opt.planning.space_step import SpaceStepper
from ccm_opt.planning.space_sweep import SpaceSweep
from ccm_opt.planning.space_tracking import moved_onto_terms


@dataclass(frozen=True, eq=False)
class UserKeyframes:
    """The user's terms over K + 1 keyframes; the first is the start, which is given.

    Attributes:
        user: constraints and costs.
        u: path parameters of the keyframes, shape (K + 1,).
    """

    user: UserLimit
    u: FloatArray

    @cached_property
    def costs(self) -> UserCosts:
        """The user's costs at these keyframes."""
        return UserCosts(self.user.terms, self.u)

    def _at(self, keyframe: int) -> UserLimit:
        """The constraints at a keyframe; the last is the goal."""
        if keyframe == len(self.u) - 1:
            return self.user.placed_at_goal()
        return self.user.placed(float(self.u[keyframe]))

    def equations(self, sweep: SpaceSweep) -> KeyframeRows:
        """Equations of every keyframe, as turns of the whole arm."""
        keyframes: list[int] = []
        slopes = [np.zeros((0, sweep.unknowns.shape[1]))]
        for k in range(1, len(self.u)):
            pose = sweep.poses[k]
            here = self._at(k)
            now = here.values(pose.q)
            keyframes.extend([k] * len(now.equation_slopes))
            slopes.append(now.equation_slopes @ pose.slopes / here.turns(now.equation_slopes)[:, None])
        zero = np.zeros(len(keyframes))
        return KeyframeRows(np.array(keyframes, dtype=np.intp), np.vstack(slopes), zero, zero)

    def gaps(self, sweep: SpaceSweep) -> KeyframeRows:
        """Gaps of every keyframe that are not far from closing, as turns of the whole arm."""
        settings = self.user.settings
        keyframes: list[int] = []
        slopes = [np.zeros((0, sweep.unknowns.shape[1]))]
        lower = [np.zeros(0)]
        for k in range(1, len(self.u)):
            pose = sweep.poses[k]
            here = self._at(k)
            now = here.values(pose.q)
            scale = here.turns(now.gap_slopes)
            near = now.gaps < settings.far * scale
            keyframes.extend([k] * int(np.sum(near)))
            slopes.append(now.gap_slopes[near] @ pose.slopes / scale[near, None])
            # Without slack: a gap inside its margin may only not shrink, or there would be no step at all.
            lower.append(np.minimum(settings.margin - now.gaps[near] / scale[near], 0.0))
        unbounded = np.full(len(keyframes), UNBOUNDED)
        return KeyframeRows(np.array(keyframes, dtype=np.intp), np.vstack(slopes), np.concatenate(lower), unbounded)

    # ------------------------------------------------------------ back onto what steps leave by their square
    def restored(self, stepper: SpaceStepper, unknowns: FloatArray) -> FloatArray:
        """Inner keyframes put on their equations and out of broken gaps; where that fails they stay as they are."""
        restored = unknowns.copy()
        for k in range(1, len(self.u) - 1):
            moved = moved_onto_terms(stepper, self._at(k), stepper.pose(restored[k]))
            if moved is not None:
                restored[k] = moved.v
        return restored

    def holds(self, sweep: SpaceSweep) -> bool:
        """Whether all equations are met, and no gap is broken."""
        return all(self._at(k).miss(sweep.configurations[k]) <= 0.0 for k in range(1, len(self.u)))


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
        away = np.linalg.norm(sweep.joints[keyframe, -1] - places, axis=1)
        return cls(keyframe, places, np.maximum(wanted, away))

    def rows(self, sweep: SpaceSweep) -> KeyframeRows:
        """Six rows a place: the tip stays in the cube that fits into the ball, or leaves it no farther on any axis."""
        moved = np.flatnonzero(self.keyframe > 0)
        keyframe = self.keyframe[moved]
        unit = sweep.stepper.unit
        off = (sweep.joints[keyframe, -1] - self.places[moved]) / unit
        most = np.maximum(self.reach[moved, None] / (np.sqrt(3.0) * unit), np.abs(off))
        slopes = sweep.moving[keyframe, sweep.curve.arm.links] / unit
        p = slopes.shape[-1]
        return KeyframeRows(
            np.repeat(keyframe, 6),
            np.concatenate((slopes, -slopes), axis=1).reshape(-1, p),
            np.concatenate((-most - off, off - most), axis=1).ravel(),
            np.full(6 * len(keyframe), UNBOUNDED),
        )

    def holds(self, sweep: SpaceSweep) -> bool:
        """Whether the tip is within reach of every place at its keyframe."""
        away = np.linalg.norm(sweep.joints[self.keyframe, -1] - self.places, axis=1)
        return bool(np.all(away <= self.reach * (1.0 + 1e-9)))
