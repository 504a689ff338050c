"""Free poses of an arm as it is, with any bodies, drives and base, found by steps of the arm that stands for it.

That arm has the bodies as links, its base is clamped where a wall clamps it, and it is in space where motions of a
planar arm are planned there. Poses are those of that arm, configurations those of the arm as it is.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.clamped_base import with_clamped_base
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.stand_in import own_configurations, stand_in, whole_configurations
from ccm_opt.planning.tip_reach import ReachQuestion, TipLooker
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import in_link


@dataclass(frozen=True, eq=False)
class PoseFinder:
    """Finds free poses of an arm.

    Attributes:
        arm: the arm.
        looker: finds poses of the arm that stands for it.
    """

    arm: Arm
    looker: TipLooker

    @classmethod
    def of(cls, problem: Problem) -> "PoseFinder":
        """Return what finds poses of a problem's arm among its obstacles.

        Raises:
            NoPlanFound: the start touches something, or exceeds a limit.
        """
        options = replace(problem.planner, order="given", end="free")
        plain = replace(problem, goal=problem.start, stops=(), coverage=None, planner=options)
        plain = stand_in(plain)
        if plain.dimension == 3:
            plain = with_clamped_base(plain, plain.workspace.surface_tree)
        none = np.zeros((0, plain.dimension))
        return cls(problem.arm, ReachQuestion.about(plain, plain.arm.length, none).looker)

    @property
    def start(self) -> Pose:
        """The pose of the start."""
        return self.looker.stepper.pose(self.looker.start)

    def drawn(self, count: int, number: int = 0) -> Iterator[Pose]:
        """Yield those of a number of randomly sampled poses that are free of contact and within all limits.

        Args:
            count: number of sampled poses.
            number: number of the sample; others consist of other poses.
        """
        return replace(self.looker, seed=self.looker.seed + number).drawn_free(count)

    def led_from(
        self, poses: Sequence[Pose], tip: FloatArray, axis: FloatArray, room: tuple[float, float], most: int
    ) -> Pose | None:
        """Return a free pose near a position of the tip, with a direction, reached by steps from known poses, or None.

        Args:
            poses: free poses.
            tip: position of the tip, shape (d,) [m].
            axis: direction of the tip, shape (d,).
            room: distance [m] and angle [rad] within which both suffice.
            most: number of poses from which it is tried.
        """
        if self.looker.stepper.space.arm.dimension > self.arm.dimension:
            tip, axis = in_link(tip), in_link(axis)
        return self.looker.led_from(poses, GoalPose(tip, axis, room=room), most)

    def safe(self, before: FloatArray, after: FloatArray) -> bool:
        """Return whether the straight motion between two configurations, each of shape (c,), has a certificate."""
        whole: Arm = self.looker.stepper.space.arm
        return bool(self.looker.stepper.safe(*whole_configurations(np.stack((before, after)), self.arm, whole)))

    def configuration(self, pose: Pose) -> FloatArray:
        """Return the configuration of the arm in a pose, shape (c,) [rad, m]."""
        whole: Arm = self.looker.stepper.space.arm
        found: FloatArray = own_configurations(pose.q[None], self.arm, whole)[0]
        return found
