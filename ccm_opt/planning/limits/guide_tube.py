"""Limit on the motion of planar arms whose base is fed through a guide tube, which holds joints inside straight.

Joint j may bend once it has passed the end of the tube (the hole), f + j l ≥ hole, for the feed f and link length l. In
a QP step its bend may grow with its distance beyond the hole, |b| ≤ s (f + j l − hole − reserve), which is a convex
constraint: so an arm that is retracted straightens in time. In the optimisation every keyframe has a first joint that
may bend: the first that is outside at the keyframe and at the neighbouring ones that the smooth path mixes with it.
Equations keep the joints before that one straight, and an inequality on the feed keeps that joint outside.
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
"""Distance beyond the hole from which on planning lets joints bend, in addition to the travel of the base between two
samples, in link lengths; the smooth path uses up part of the distance near keyframes. Heuristic."""
_MIXED = 2
"""Number of keyframes on either side that the smooth path mixes with a keyframe: a joint may bend at a keyframe if it
is outside the tube at all of these. Derived: four control points shape every span of a cubic spline, and the first
three of them its start."""
_BEND_SHARE = 2.0
"""Bound on the bend of a joint in a QP step, as a fraction of its limit per link length of its distance beyond the
hole. Heuristic."""
_TINY_BEND = 1e-4
"""Bend of a joint that should be straight, up to which the bend counts as an inaccuracy of the QP [rad]. Derived: ten
times its tolerance."""
_ROUNDING = 1e-9
"""Rounding error of positions along the arm, in link lengths. Derived: about a thousand roundings of a position on a
long axis."""
_AT_END = 1e-3
"""Distance from an end of its range within which the base counts as being there, in link lengths. Heuristic."""


Number = TypeVar("Number", np.float64, np.intp)


@dataclass(frozen=True)
class GuideTubeLimit(Limit):
    """Limit that keeps joints inside the guide tube straight and the base within its range.

    Lengths inside this class are in link lengths.

    Attributes:
        arm: planar arm with axes that carry its base.
        travel: distance beyond the end of the tube (the hole) up to which an emerging joint stays straight, so that it
            never bends inside the tube between two samples of the timed motion [m].
    """

    arm: Arm
    travel: float = 0.0

    # ------------------------------------------------------------ the single step
    def linearised(self, space: LinkSpace, pose: Pose, turn: float) -> LimitRows:
        """Return constraints of a QP step: joints straight inside the guide tube, limited bends outside, base range.

        Args:
            space: map from the coordinates to configurations.
            pose: pose from which the step starts.
            turn: largest turn of a link in the step [rad].
        """
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
        """Return a pose whose tiny bends inside the guide tube are set to 0 and whose base is clipped to its range.

        Only errors of the size of the QP solver's accuracy are corrected.
        """
        del most
        snapped = self._snapped(space, pose.v[None])[0]
        return pose if np.array_equal(snapped, pose.v) else space.pose(snapped)

    # ------------------------------------------------------------ at the goal
    def keeps_at_goal(self, space: LinkSpace, near: Pose, final: Pose) -> bool:
        """Return whether a pose at the goal bends no joint inside the guide tube and has the base within its range.

        Args:
            space: unused.
            near: unused.
            final: the pose.
        """
        del space, near
        low, high = self._range_left(final.q)
        in_range = bool(low <= 0.0 <= high)
        return in_range and not np.any(self._held_bent(final.q[None]))

    # ------------------------------------------------------------ the optimisation of a motion
    def keyframe_equations(self, sweep: "PlanarSweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return equations that keep the joints before the first free one straight, at all keyframes but the first."""
        del u
        straight = np.arange(self.arm.links) < self._first_free(sweep.configurations)[:, None]
        straight[0] = False  # the start is fixed
        keyframe, joint = np.nonzero(straight)
        zero = np.zeros(len(keyframe))
        return (KeyframeRows(keyframe, sweep.space.bend_rows[joint], zero, zero),)

    def keyframe_rows(self, sweep: "PlanarSweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return bounds on the feed that keep the base in its range, and joints that may bend outside the guide tube.

        Joints that may bend at a neighbouring keyframe count too. There is one bound per keyframe but the first.
        """
        del u
        first = self._first_free(sweep.configurations)
        around = _least_around(first, _MIXED)
        base = self._base(sweep.configurations)
        # Where the first joint that may bend lies beyond the last joint, nothing bends and only the range counts.
        outside = np.where(around < self.arm.links, self._hole + self._reserve - self.arm.place_shares[around], -np.inf)
        low, high = self._range_left(sweep.configurations)
        least = np.minimum(np.maximum(low, outside - base), 0.0)
        keyframe = np.arange(1, len(base))
        rows = np.repeat(self._base_row(sweep.space), len(keyframe), axis=0)
        return (KeyframeRows(keyframe, rows, least[1:], np.maximum(high, 0.0)[1:]),)

    def restored_keyframes(self, space: LinkSpace, coordinates: FloatArray, u: FloatArray) -> FloatArray:
        """Return keyframes, shape (K + 1, p), with tiny bends inside the tube set to 0 and the base in its range.

        The first keyframe is unchanged.
        """
        del u
        snapped = self._snapped(space, coordinates)
        snapped[0] = coordinates[0]
        return snapped

    def holds(self, sweep: "PlanarSweep", before: "PlanarSweep", u: FloatArray) -> bool:
        """Return whether the base is within its range at every keyframe of a motion.

        Joints inside the tube are checked by ``failures``.
        """
        del before, u
        low, high = self._range_left(sweep.configurations)
        return bool(np.all((low <= ROUNDING) & (high >= -ROUNDING)))

    # ------------------------------------------------------------ between keyframes
    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the indices of the intervals of a motion q, (K, c), in which a bent joint is inside the guide tube."""
        del depth
        return np.flatnonzero(self._held_bent(q))

    # ------------------------------------------------------------ words
    def describe(self, q: FloatArray) -> str:
        """Return a message if the base is at an end of its range in a configuration (c,), else an empty string."""
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
        """Distance beyond the hole from which on planning lets joints bend [link lengths]."""
        return _RESERVE + self.travel / self.arm.link_length

    def _base(self, poses: FloatArray) -> FloatArray:
        """Return the displacement of the base, shape (...) [link lengths], in configurations of shape (..., c)."""
        return self.arm.coordinates.advance(poses) / self.arm.link_length

    def _base_row(self, space: LinkSpace) -> FloatArray:
        """Return the derivative of the base's displacement with respect to the coordinates, shape (1, p)."""
        return np.asarray(space.turns[self.arm.links :].sum(axis=0, keepdims=True))

    def _beyond(self, poses: FloatArray) -> FloatArray:
        """Return the distance of every joint beyond the hole in configurations (..., c), (..., links), in links."""
        return np.asarray(self._base(poses)[..., None] + self.arm.place_shares[:-1] - self._hole)

    def _range_left(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the range of the base minus its displacement, low and high, each of shape (...) [link lengths].

        Low is negative and high positive if the base is inside its range.
        """
        low, high = self.arm.base_range
        base = self._base(poses)
        return low / self.arm.link_length - base, high / self.arm.link_length - base

    def _first_free(self, poses: FloatArray) -> IntArray:
        """Return the index of the first joint that may bend at each of K keyframes, shape (K,).

        If no joint may bend, the index is the number of links.
        """
        base = self._base(poses)
        least = _least_around(base, _MIXED)
        beyond = self._hole + self._reserve - least - _ROUNDING
        outside = np.searchsorted(self.arm.place_shares[:-1], beyond)
        bent = self._bent(poses)
        first_bent = np.where(bent.any(axis=1), np.argmax(bent, axis=1), self.arm.links)
        # A joint that is bent already may stay bent: the motion is certified.
        first: IntArray = np.clip(np.minimum(outside, first_bent), 0, self.arm.links).astype(np.intp)
        return first

    def _bent(self, poses: FloatArray) -> BoolArray:
        """Return a mask of the joints bent by more than rounding, shape (K, links), in configurations (K, c)."""
        return np.asarray(np.abs(poses[:, : self.arm.links]) > TINY)

    def _held_bent(self, poses: FloatArray) -> BoolArray:
        """Return a mask of the intervals of a motion in which a joint inside the guide tube is bent, shape (K − 1,).

        ``poses`` are configurations, shape (K, c); for a single one, the result is a mask of that pose, shape (1,).
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
        """Return coordinates (K, p) with tiny bends of joints inside the tube set to 0 and the base in its range."""
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
    """Return the running minimum of values, shape (K,), over each value and ``reach`` neighbours on either side."""
    around = np.pad(values, reach, mode="edge")
    least: NDArray[Number] = np.lib.stride_tricks.sliding_window_view(around, 2 * reach + 1).min(axis=1)
    return least
