"""The continuation where constraints depend on how far the motion has come: a reference motion is tracked under them.

The path parameter u advances in small steps. At each the arm is drawn to the reference motion, which knows nothing of
the user's constraints, while the constraints at u are rows of every step; u goes on when they are met.
"""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.geometry.polyline import arc_lengths
from ccm_opt.motion.constrained.rows import OwnRows
from ccm_opt.motion.continuation import BENDING, JERK, Deadline, Stalled, settle
from ccm_opt.motion.goal import OWN_MET, GoalPose
from ccm_opt.motion.step import Pose, Stepper, Term, smoothness_terms

FIRST_ADVANCE, LARGEST_ADVANCE, LEAST_ADVANCE = 1.0 / 80.0, 1.0 / 40.0, 1e-4
"""Steps of u."""
ARRIVAL = 0.98
"""Where tracking ends and the arm settles on the goal."""
TRACKING_STEPS = 24
"""Steps that may be needed to meet the constraints at a new u."""
PULL, STILL = 0.1, 0.02
"""Weights of the reference and of standing still, against a nominal link's distance."""
GROWTH = 1.5


@dataclass(frozen=True)
class Reference:
    """A motion to be tracked.

    Attributes:
        u: path parameter of its poses, increasing from 0 to 1, shape (K,).
        headings: shape (K, links) [rad].
    """

    u: FloatArray
    headings: FloatArray

    @classmethod
    def along(cls, headings: FloatArray) -> "Reference":
        """A motion with the path parameter even in the turns of its links."""
        way = arc_lengths(headings)
        if way[-1] <= 0.0:
            return cls(np.array([0.0, 1.0]), headings[[0, -1]])
        kept = np.append(np.diff(way) > 0.0, True)
        return cls(way[kept] / way[-1], headings[kept])

    def at(self, u: float) -> FloatArray:
        """Link headings at u, shape (links,) [rad]."""
        k = int(np.clip(np.searchsorted(self.u, u, side="right") - 1, 0, len(self.u) - 2))
        share = (u - self.u[k]) / (self.u[k + 1] - self.u[k])
        between: FloatArray = self.headings[k] + share * (self.headings[k + 1] - self.headings[k])
        return between


@dataclass(frozen=True)
class Tracked:
    """Poses on the way, and how far each has come.

    Attributes:
        poses: on the way.
        u: path parameter of each, increasing from 0 to 1.
    """

    poses: list[Pose]
    u: list[float]


def track(
    stepper: Stepper, own: OwnRows, reference: Reference, goal: GoalPose, start: Pose, deadline: Deadline
) -> Tracked:
    """The reference motion bent to the constraints, then settled on the goal.

    Args:
        stepper: of the link space.
        own: rows of the constraints on the way.
        reference: what to track.
        goal: where the motion ends.
        start: where it begins.
        deadline: when to stop.

    Raises:
        Stalled: naming the constraint that could not be met, and by how much it was missed.
    """
    tracked, advance = Tracked([start], [0.0]), FIRST_ADVANCE
    while tracked.u[-1] < ARRIVAL:
        u = min(ARRIVAL, tracked.u[-1] + advance)
        poses = _advanced(replace(stepper, own=own.at(u)), reference.at(u / ARRIVAL), tracked.poses[-1])
        if poses is None:
            advance *= 0.5
            if advance < LEAST_ADVANCE or deadline.passed():
                raise Stalled(_why(own.at(u), tracked.poses[-1], u), tracked.poses)
            continue
        _append(tracked, poses, u)
        advance = min(LARGEST_ADVANCE, GROWTH * advance)
    settled = settle(replace(stepper, own=own.at(1.0)), goal, tracked.poses[-1], deadline)[1:]
    _append(tracked, settled, 1.0)
    return tracked


def _append(tracked: Tracked, poses: list[Pose], u: float) -> None:
    """Add poses, the path parameter growing evenly up to u."""
    tracked.u.extend(np.linspace(tracked.u[-1], u, len(poses) + 1)[1:].tolist())
    tracked.poses.extend(poses)


def _advanced(stepper: Stepper, target: FloatArray, pose: Pose) -> list[Pose] | None:
    """Poses to one that meets the constraints of the stepper; None when there is none."""
    poses, space = [], stepper.space
    for _ in range(TRACKING_STEPS):
        turn = np.clip(target - pose.headings, -0.3, 0.3)
        terms = [
            Term(space.matrix, turn, PULL * space.share),
            Term(space.matrix, np.zeros(len(turn)), STILL * space.share),
            *smoothness_terms(space, pose.v, BENDING, JERK),
        ]
        before, pose = pose, stepper.step(pose, space.jacobians(pose.headings), terms)
        if pose is before:
            break
        poses.append(pose)
        if stepper.own is not None and stepper.own.values(pose.headings).violation <= OWN_MET:
            return poses
    return None


def _why(own: OwnRows, pose: Pose, u: float) -> str:
    name, miss = own.worst(pose.headings)
    return f"at u = {u:.3f} constraint '{name}' could not be met: missed by {miss:.3g}"
