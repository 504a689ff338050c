"""The guide tube of a feed axis, which holds links straight, as a limit on the motion.

Joint j may bend once it has passed the hole, f + j l ≥ hole. In a step its bend may grow with its distance beyond the
hole, |b| ≤ s (f + j l − hole − reserve), which is convex where it applies: so an arm that is drawn back straightens in
time. In the optimisation every keyframe has a first joint that may bend: the first that is outside at this keyframe and
at the neighbouring ones, as far as the smooth path mixes them. The joints before it have equations, and a row on the
feed keeps it outside.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from ccm_opt.core.arrays import ROUNDING, TINY, BoolArray, FloatArray, IntArray
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, Limit, LimitRows
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import Pose
from ccm_opt.robot.arm import Arm

if TYPE_CHECKING:
    from ccm_opt.planning.swept_motion import PlanarSweep

_RESERVE = 0.1
"""Distance beyond the hole from which planning lets joints bend, on top of the base's travel between two samples, in
link lengths; the smooth path uses up some of it near the keyframes. Taste."""
_MIXED = 2
"""Number of keyframes to either side that the smooth path mixes with one: a joint may bend at a keyframe where it is
outside at all of these. Derived: four control points shape every span of a cubic spline, and the start of a span the
first three."""
_BEND_SHARE = 2.0
"""Share of its limit by which the bend of a joint may grow, in a step, per link length that the joint is beyond the
hole. Taste."""
_TINY_BEND = 1e-4
"""Bends below this, of joints that should be straight, are the accuracy of a QP [rad]. Derived: ten times its
tolerance."""
_ROUNDING = 1e-9
"""Rounding of places along the arm, in link lengths. Derived: some thousand roundings of a place on a long axis."""
_AT_END = 1e-3
"""Distance from an end of its range within which the base counts as being there, in link lengths. Taste."""


Number = TypeVar("Number", np.float64, np.intp)


@dataclass(frozen=True)
class GuideTubeLimit(Limit):
    """Keeps the joints in the guide tube straight.

    Lengths inside this class are in link lengths.

    Attributes:
        arm: arm with axes that carry its base.
        travel: distance beyond the hole up to which an emerging joint stays straight, so that it never bends inside the
            tube between two samples of the timed motion [m].
    """

    arm: Arm
    travel: float = 0.0

    # ------------------------------------------------------------ the single step
    def linearised(self, space: LinkSpace, pose: Pose, turn: float) -> LimitRows:
        """Return equations for joints held in the tube, cones for the other joints, and bounds on the base."""
        bends = space.bends(pose.q)
        room = self._beyond(pose.q) - self._reserve
        held = (room < 0.0) & (bends == 0.0)
        slope = _BEND_SHARE * space.bend_limits
        # s (f + j l − …) ∓ b ≥ 0; where that is violated already, it may not become worse.
        slack = slope * room - np.abs(bends)
        near = ~held & (slack < (2.0 + slope) * turn)
        cone = slope[near, None] * self._base_row(space)
        spare = np.maximum(slack[near], 0.0)
        sides = [
            (cone - sign * space.bend_rows[near], np.maximum(spare, slope[near] * room[near] - sign * bends[near]))
            for sign in (1.0, -1.0)
        ]
        low, high = self._range_left(pose.q)
        rows = [space.bend_rows[held], *(matrix for matrix, _ in sides), self._base_row(space)]
        straight = np.zeros(int(held.sum()))
        lower = [straight, *(-most for _, most in sides), np.atleast_1d(low)]
        upper = [straight, *(np.full(len(most), UNBOUNDED) for _, most in sides), np.atleast_1d(high)]

        def keeps(trial: Pose) -> bool:
            return not np.any(self._held_bent(np.stack((pose.q, trial.q))))

        return LimitRows(np.vstack(rows), np.concatenate(lower), np.concatenate(upper), len(straight), keeps=keeps)

    def restored(self, space: LinkSpace, pose: Pose, most: float) -> Pose:
        """Return the pose with the bends of held joints set to 0 and the base clipped to its range.

        Only errors of the size of the solver's accuracy are corrected.
        """
        del most
        snapped = self._snapped(space, pose.v[None])[0]
        return pose if np.array_equal(snapped, pose.v) else space.pose(snapped)

    # ------------------------------------------------------------ at the goal
    def keeps_at_goal(self, space: LinkSpace, near: Pose, final: Pose) -> bool:
        """Return whether the final pose bends no joint held in the tube and keeps the base within its range."""
        del space, near
        low, high = self._range_left(final.q)
        in_range = bool(low <= 0.0 <= high)
        return in_range and not np.any(self._held_bent(final.q[None]))

    # ------------------------------------------------------------ the optimisation of a motion
    def keyframe_equations(self, sweep: "PlanarSweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return equations that keep all joints straight up to the first joint that may bend."""
        del u
        straight = np.arange(self.arm.links) < self._first_free(sweep.configurations)[:, None]
        straight[0] = False  # the start is fixed
        keyframe, joint = np.nonzero(straight)
        zero = np.zeros(len(keyframe))
        return (KeyframeRows(keyframe, sweep.space.bend_rows[joint], zero, zero),)

    def keyframe_rows(self, sweep: "PlanarSweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return rows that keep the base within its range and bent joints outside the tube.

        Joints that bend at this keyframe or at a neighbouring one count.
        """
        del u
        first = self._first_free(sweep.configurations)
        around = _least_around(first, _MIXED)
        base = self._base(sweep.configurations)
        # Where the first joint that may bend lies beyond the last joint, nothing bends and only the range counts.
        outside = np.where(around < self.arm.links, self._hole + self._reserve - around, -np.inf)
        low, high = self._range_left(sweep.configurations)
        least = np.minimum(np.maximum(low, outside - base), 0.0)
        keyframe = np.arange(1, len(base))
        rows = np.repeat(self._base_row(sweep.space), len(keyframe), axis=0)
        return (KeyframeRows(keyframe, rows, least[1:], np.maximum(high, 0.0)[1:]),)

    def restored_keyframes(self, space: LinkSpace, coordinates: FloatArray, u: FloatArray) -> FloatArray:
        """Return all keyframes but the first corrected as by ``restored``."""
        del u
        snapped = self._snapped(space, coordinates)
        snapped[0] = coordinates[0]
        return snapped

    def holds(self, sweep: "PlanarSweep", before: "PlanarSweep", u: FloatArray) -> bool:
        """Return whether the base is in its range at every keyframe.

        Joints held between keyframes are checked by ``failures``.
        """
        del before, u
        low, high = self._range_left(sweep.configurations)
        return bool(np.all((low <= ROUNDING) & (high >= -ROUNDING)))

    # ------------------------------------------------------------ between keyframes
    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the intervals in which a bent joint is held by the tube at any time."""
        del depth
        return np.flatnonzero(self._held_bent(q))

    # ------------------------------------------------------------ words
    def describe(self, q: FloatArray) -> str:
        """Return a phrase that says that the base is at an end of its range, or an empty string if it is not."""
        low, high = self._range_left(q)
        if min(-float(low), float(high)) > _AT_END:
            return ""
        return "the feed is at the end of its range"

    # ------------------------------------------------------------ distances in link lengths
    @property
    def _hole(self) -> float:
        return self.arm.hole / self.arm.link_length

    @property
    def _reserve(self) -> float:
        """Distance beyond the hole from which rows let joints bend [link lengths]."""
        return _RESERVE + self.travel / self.arm.link_length

    def _base(self, poses: FloatArray) -> FloatArray:
        """Return the advance of the base, shape (..., c) to (...) [link lengths]."""
        return self.arm.coordinates.advance(poses) / self.arm.link_length

    def _base_row(self, space: LinkSpace) -> FloatArray:
        """Return the derivative of the base's advance with respect to the coordinates, shape (1, p)."""
        return np.asarray(space.turns[self.arm.links :].sum(axis=0, keepdims=True))

    def _beyond(self, poses: FloatArray) -> FloatArray:
        """Return the distance of every joint beyond the hole, shape (..., links) [link lengths]."""
        return np.asarray(self._base(poses)[..., None] + np.arange(self.arm.links) - self._hole)

    def _range_left(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far the base may still move back (≤ 0 within its range) and forward (≥ 0) [link lengths]."""
        low, high = self.arm.base_range
        base = self._base(poses)
        return low / self.arm.link_length - base, high / self.arm.link_length - base

    def _first_free(self, poses: FloatArray) -> IntArray:
        """Return the index of the first joint that may bend at each keyframe, shape (K,).

        The number of links is returned where no joint may bend.
        """
        base = self._base(poses)
        least = _least_around(base, _MIXED)
        outside = np.ceil(self._hole + self._reserve - least - _ROUNDING)
        bent = self._bent(poses)
        first_bent = np.where(bent.any(axis=1), np.argmax(bent, axis=1), self.arm.links)
        # A joint that is bent already may stay bent: the motion is certified.
        first: IntArray = np.clip(np.minimum(outside, first_bent), 0, self.arm.links).astype(np.intp)
        return first

    def _bent(self, poses: FloatArray) -> BoolArray:
        """Return a mask of the joints bent by more than the rounding of splines, shape (K, c) to (K, links)."""
        return np.asarray(np.abs(poses[:, : self.arm.links]) > TINY)

    def _held_bent(self, poses: FloatArray) -> BoolArray:
        """Return the intervals between poses in which a held joint is bent, as a mask, shape (K, c) to (K − 1,).

        For a single pose, return whether a held joint is bent, shape (1,).
        """
        bent = self._bent(poses)
        beyond = self._beyond(poses)
        # A joint that is bent closer to the hole than that at the start or end of the motion has not just emerged.
        ends = np.where(bent[[0, -1]], beyond[[0, -1]], np.inf).min(axis=0)
        least = np.clip(self.travel / self.arm.link_length, 0.0, np.maximum(ends, 0.0)) - _ROUNDING
        if len(poses) == 1:
            return np.asarray(np.any(bent & (beyond < least), axis=1))
        bent_within = bent[:-1] | bent[1:]
        nearest = np.minimum(beyond[:-1], beyond[1:])
        return np.asarray(np.any(bent_within & (nearest < least), axis=1))

    def _snapped(self, space: LinkSpace, coordinates: FloatArray) -> FloatArray:
        """Return the coordinates, shape (K, p), with the base clipped to its range.

        Tiny bends of joints within the reserve are set to 0.
        """
        poses = space.configurations(coordinates)
        bends = space.bends(poses)
        inside = self._beyond(poses) < self._reserve + _ROUNDING
        tiny = inside & (np.abs(bends) < _TINY_BEND)
        snapped = coordinates.copy()
        snapped[:, : self.arm.links][tiny] = 0.0
        low, high = self.arm.base_range
        first = self.arm.links
        snapped[:, first] = np.clip(snapped[:, first], low / self.arm.link_length, high / self.arm.link_length)
        return snapped


def _least_around(values: NDArray[Number], reach: int) -> NDArray[Number]:
    """Return, for each value, the minimum over the value and ``reach`` neighbours on either side, shape (K,)."""
    around = np.pad(values, reach, mode="edge")
    least: NDArray[Number] = np.lib.stride_tricks.sliding_window_view(around, 2 * reach + 1).min(axis=1)
    return least
