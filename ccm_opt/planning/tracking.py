"""The continuation where limits depend on how far the motion has come: a reference motion is tracked under them.

The path parameter u advances in small steps. At each the arm is drawn to the reference motion, which knows nothing of
these limits, while the limits at u are rows of every step; u goes on when they are met.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.step import GoalPose, Stepper, smoothness_terms

_STILL_WEIGHT = 0.02
"""Weight of standing still. Taste."""


@dataclass(frozen=True)
class ReferenceMotion:
    """A motion to be tracked.

    Attributes:
        u: path parameter of its poses, increasing from 0 to 1, shape (K,).
        headings: shape (K, links) [rad].
    """

    u: FloatArray
    headings: FloatArray

    @classmethod
    def from_headings(cls, headings: FloatArray) -> "ReferenceMotion":
        """A motion, link headings of shape (K, links) [rad], with u even in the turns of its links."""
        way = arc_lengths(headings)
        if way[-1] <= 0.0:
            return cls(np.array([0.0, 1.0]), headings[[0, -1]])
        # Poses that repeat would make u stand still, and ``at`` divide by 0.
        kept = np.append(np.diff(way) > 0.0, True)
        return cls(way[kept] / way[-1], headings[kept])

    def at(self, u: float) -> FloatArray:
        """Link headings at u, shape (links,) [rad]."""
        k = int(np.clip(np.searchsorted(self.u, u, side="right") - 1, 0, len(self.u) - 2))
        share = (u - self.u[k]) / (self.u[k + 1] - self.u[k])
        between: FloatArray = self.headings[k] + share * (self.headings[k + 1] - self.headings[k])
        return between


@dataclass(frozen=True)
class TrackedPoses:
    """Poses on the way, and how far each has come.

    Attributes:
        poses: on the way.
        u: path parameter of each, increasing from 0 to 1.
    """

    poses: list[Pose]
    u: list[float]


def follow_reference(
    stepper: Stepper, reference: ReferenceMotion, goal: GoalPose, start: Pose, deadline: Deadline
) -> TrackedPoses:
    """The reference motion bent to the stepper's limits, then settled on the goal.

    Args:
        stepper: of the link space, with the limits on the way.
        reference: what to track.
        goal: where the motion ends.
        start: where it begins.
        deadline: when to stop.

    Raises:
        Stalled: naming the constraint that could not be met, and by how much it was missed.
    """
    settings = stepper.settings.tracking
    tracked = TrackedPoses([start], [0.0])
    advance = settings.first_advance
    while tracked.u[-1] < settings.arrival:
        # The last stretch of u belongs to settling, so the reference is run through by the time of arrival.
        u = min(settings.arrival, tracked.u[-1] + advance)
        there = stepper.at(u)
        poses = _advanced(there, reference.at(u / settings.arrival), tracked.poses[-1])
        if poses is None:
            # The arm stays where it was: rows that move a little with u may be met where a large step of u outruns the
            # arm.
            advance *= 0.5
            if advance < settings.least_advance or deadline.passed():
                raise Stalled(_why(there, tracked.poses[-1], u), tracked.poses)
            continue
        _append(tracked, poses, u)
        advance = min(settings.largest_advance, settings.growth * advance)

    settled = settle(stepper.at(1.0), goal, tracked.poses[-1], deadline)[1:]
    _append(tracked, settled, 1.0)
    return tracked


def _append(tracked: TrackedPoses, poses: list[Pose], u: float) -> None:
    """Add poses, the path parameter growing evenly up to u."""
    tracked.u.extend(np.linspace(tracked.u[-1], u, len(poses) + 1)[1:].tolist())
    tracked.poses.extend(poses)


def _advanced(stepper: Stepper, target: FloatArray, pose: Pose) -> list[Pose] | None:
    """Poses to one that meets the limits of the stepper; None when there is none."""
    space = stepper.space
    settings = stepper.settings.tracking
    smoothness = stepper.settings.continuation
    poses = []
    for _ in range(settings.steps):
        before = pose
        turn = np.clip(target - pose.headings, -settings.largest_turn, settings.largest_turn)
        terms = [
            Term(space.matrix, turn, settings.pull_weight * space.nominal_per_link),
            Term(space.matrix, np.zeros(len(turn)), _STILL_WEIGHT * space.nominal_per_link),
            *smoothness_terms(space, pose.v, smoothness.bending, smoothness.jerk),
        ]
        pose = stepper.step(pose, space.jacobians(pose.headings), terms)
        # No limit lets the arm step at this u.
        if pose is before:
            break
        poses.append(pose)
        if stepper.miss(pose.headings) <= 0.0:
            return poses
    return None


def _why(stepper: Stepper, pose: Pose, u: float) -> str:
    """Which constraint could not be met at u, in words."""
    name, miss = max((limit.worst(pose.headings) for limit in stepper.limits), key=lambda worst: worst[1])
    return f"at u = {u:.3f} constraint '{name}' could not be met: missed by {miss:.3g}"
