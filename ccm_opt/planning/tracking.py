"""The continuation where limits depend on how far the motion has come: a reference motion is tracked under them.

The path parameter u advances in small steps. At each the arm is drawn to the reference motion, which knows nothing of
these limits, while the limits at u are rows of every step; u goes on when they are met.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term
from ccm_opt.planning.settings import TrackingSettings
from ccm_opt.planning.step import AnyUnknowns, Stepper, StepperOf

_STILL_WEIGHT = 0.02
"""Weight of standing still. Taste."""


class Reference(Protocol):
    """A motion to be tracked."""

    def drawn(self, space: CurveUnknowns, u: float, pose: Pose, settings: TrackingSettings) -> tuple[list[Term], bool]:
        """What draws a pose to the motion at u, and whether it is as near as it has to come before u goes on."""
        ...


@dataclass(frozen=True)
class ReferenceMotion:
    """A motion in the plane to be tracked.

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

    def drawn(self, space: CurveUnknowns, u: float, pose: Pose, settings: TrackingSettings) -> tuple[list[Term], bool]:
        """What draws the links to their headings at u; how far they are from these does not count."""
        turn = np.clip(self.at(u) - pose.q, -settings.largest_turn, settings.largest_turn)
        return [
            Term(pose.slopes, turn, settings.pull_weight * space.nominal_per_link),
            Term(pose.slopes, np.zeros(len(turn)), _STILL_WEIGHT * space.nominal_per_link),
        ], True


@dataclass(frozen=True)
class TrackedPoses:
    """Poses on the way, and how far each has come.

    Attributes:
        poses: on the way.
        u: path parameter of each, increasing from 0 to 1.
    """

    poses: list[Pose]
    u: list[float]

    def append(self, poses: list[Pose], u: float) -> None:
        """Add poses, the path parameter growing evenly up to u."""
        self.u.extend(np.linspace(self.u[-1], u, len(poses) + 1)[1:].tolist())
        self.poses.extend(poses)


def tracked_to_arrival(
    stepper: StepperOf[AnyUnknowns],
    reference: Reference,
    start: Pose,
    deadline: Deadline,
    settings: TrackingSettings,
) -> TrackedPoses:
    """Poses from a start, along a reference motion bent to the stepper's limits, until the path parameter arrives.

    Args:
        stepper: with the limits on the way.
        reference: what to track.
        start: where the motion begins.
        deadline: when to stop.
        settings: steps of the path parameter.

    Raises:
        Stalled: naming the constraint that could not be met, and by how much it was missed.
    """
    tracked = TrackedPoses([start], [0.0])
    advance = settings.first_advance
    # No step passes by a place where a limit begins or ends.
    breaks = sorted({place for limit in stepper.limits for place in limit.breaks})
    while tracked.u[-1] < settings.arrival:
        u = min(settings.arrival, tracked.u[-1] + advance)
        u = next((at for at in breaks if tracked.u[-1] < at < u), u)
        poses = _advanced(stepper.at(u), reference, u, tracked.poses[-1], settings)
        if poses is None:
            # The arm stays where it was: rows that move a little with u may be met where a large step of u outruns the
            # arm.
            advance *= 0.5
            if advance < settings.least_advance or deadline.passed():
                raise Stalled(why_missed(stepper.at(u), tracked.poses[-1], u), tracked.poses)
            continue
        tracked.append(poses, u)
        advance = min(settings.largest_advance, settings.growth * advance)
    return tracked


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
    tracked = tracked_to_arrival(stepper, reference, start, deadline, stepper.settings.tracking)
    tracked.append(settle(stepper.at(1.0), goal, tracked.poses[-1], deadline)[1:], 1.0)
    return tracked


def _advanced(
    stepper: StepperOf[AnyUnknowns], reference: Reference, u: float, pose: Pose, settings: TrackingSettings
) -> list[Pose] | None:
    """Poses towards the reference at u, to one that meets the limits of the stepper; None when there is none."""
    poses = []
    kept = False
    for _ in range(settings.steps):
        before = pose
        # The last stretch of u belongs to settling, so the reference is run through by the time of arrival.
        terms, near = reference.drawn(stepper.space, u / settings.arrival, pose, settings)
        pose = stepper.step(pose, terms)
        if pose is not before:
            poses.append(pose)
        kept = stepper.miss(pose.q) <= 0.0
        if pose is before or (kept and near):
            break
    # The arm may stay where it is while u goes on.
    return (poses or [pose]) if kept else None


def why_missed(stepper: StepperOf[AnyUnknowns], pose: Pose, u: float) -> str:
    """Which constraint could not be met at u, in words."""
    name, miss = max((limit.worst(pose.q) for limit in stepper.limits), key=lambda worst: worst[1])
    if miss == 0.0:
        return f"at u = {u:.3f} the motion that was found cannot be bent to the constraints"
    return f"at u = {u:.3f} constraint '{name}' could not be met: missed by {miss:.3g}"
