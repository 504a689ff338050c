"""The continuation where limits depend on how far the motion has come: a reference motion is tracked under them.

The path parameter u advances in small steps. At each the arm is drawn to the reference motion, which knows nothing of
these limits, while the limits at u are rows of every step; u goes on when they are met.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.settings import TrackingSettings
from ccm_opt.planning.step import Stepper

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


AnyPose = TypeVar("AnyPose")


@dataclass(frozen=True)
class TrackedPoses(Generic[AnyPose]):
    """Poses on the way, and how far each has come.

    Attributes:
        poses: on the way.
        u: path parameter of each, increasing from 0 to 1.
    """

    poses: list[AnyPose]
    u: list[float]

    def append(self, poses: list[AnyPose], u: float) -> None:
        """Add poses, the path parameter growing evenly up to u."""
        self.u.extend(np.linspace(self.u[-1], u, len(poses) + 1)[1:].tolist())
        self.poses.extend(poses)


def tracked_to_arrival(
    start: AnyPose,
    advanced: Callable[[float, AnyPose], list[AnyPose] | None],
    refused: Callable[[float, list[AnyPose]], Exception],
    deadline: Deadline,
    settings: TrackingSettings,
    breaks: Sequence[float] = (),
) -> TrackedPoses[AnyPose]:
    """Poses from a start until the path parameter arrives.

    Args:
        start: where the motion begins.
        advanced: poses from one to another that keeps the limits at a path parameter; None where there are none.
        refused: the error for a path parameter at which there are none after the poses so far.
        deadline: when to stop.
        settings: steps of the path parameter.
        breaks: path parameters that no step passes by, increasing.
    """
    tracked = TrackedPoses([start], [0.0])
    advance = settings.first_advance
    while tracked.u[-1] < settings.arrival:
        u = min(settings.arrival, tracked.u[-1] + advance)
        u = next((at for at in breaks if tracked.u[-1] < at < u), u)
        poses = advanced(u, tracked.poses[-1])
        if poses is None:
            # The arm stays where it was: rows that move a little with u may be met where a large step of u outruns the
            # arm.
            advance *= 0.5
            if advance < settings.least_advance or deadline.passed():
                raise refused(u, tracked.poses)
            continue
        tracked.append(poses, u)
        advance = min(settings.largest_advance, settings.growth * advance)
    return tracked


def follow_reference(
    stepper: Stepper, reference: ReferenceMotion, goal: GoalPose, start: Pose, deadline: Deadline
) -> TrackedPoses[Pose]:
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

    def advanced(u: float, pose: Pose) -> list[Pose] | None:
        # The last stretch of u belongs to settling, so the reference is run through by the time of arrival.
        return _advanced(stepper.at(u), reference.at(u / settings.arrival), pose)

    def refused(u: float, poses: list[Pose]) -> Stalled:
        return Stalled(_why(stepper.at(u), poses[-1], u), poses)

    tracked = tracked_to_arrival(start, advanced, refused, deadline, settings)
    tracked.append(settle(stepper.at(1.0), goal, tracked.poses[-1], deadline)[1:], 1.0)
    return tracked


def _advanced(stepper: Stepper, target: FloatArray, pose: Pose) -> list[Pose] | None:
    """Poses to one that meets the limits of the stepper; None when there is none."""
    space = stepper.space
    settings = stepper.settings.tracking
    poses = []
    for _ in range(settings.steps):
        before = pose
        turn = np.clip(target - pose.q, -settings.largest_turn, settings.largest_turn)
        terms = [
            Term(space.matrix, turn, settings.pull_weight * space.nominal_per_link),
            Term(space.matrix, np.zeros(len(turn)), _STILL_WEIGHT * space.nominal_per_link),
        ]
        pose = stepper.step(pose, terms)
        # No limit lets the arm step at this u.
        if pose is before:
            break
        poses.append(pose)
        if stepper.miss(pose.q) <= 0.0:
            return poses
    return None


def _why(stepper: Stepper, pose: Pose, u: float) -> str:
    """Which constraint could not be met at u, in words."""
    name, miss = max((limit.worst(pose.q) for limit in stepper.limits), key=lambda worst: worst[1])
    return f"at u = {u:.3f} constraint '{name}' could not be met: missed by {miss:.3g}"
