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
from ccm_opt.planning.plane_in_space import needs_space, problem_in_space, rows_in_plane, rows_in_space
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.tip_reach import ReachQuestion, TipLooker
from ccm_opt.planning.tool_problem import own_coordinates, problem_with_tool_links, with_bodies
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
        if problem.dimension == 2 and (needs_space(problem.arm) or problem.arm.base_axes):
            plain = problem_in_space(plain)
        plain = problem_with_tool_links(plain)
        if plain.dimension == 3:
            plain = with_clamped_base(plain, plain.workspace.surface_tree)
        none = np.zeros((0, plain.dimension))
        return cls(problem.arm, ReachQuestion.about(plain, plain.arm.length, none).looker)

    @property
    def _in_space(self) -> bool:
        """Whether poses of an arm in space stand for those of a planar one."""
        return bool(self.looker.stepper.space.arm.dimension > self.arm.dimension)

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
        if self._in_space:
            tip, axis = in_link(tip), in_link(axis)
        return self.looker.led_from(poses, GoalPose(tip, axis, room=room), most)

    def safe(self, before: FloatArray, after: FloatArray) -> bool:
        """Return whether the straight motion between two configurations, each of shape (c,), has a certificate."""
        ends = np.stack((before, after))
        ends = rows_in_space(ends, self.arm.links) if self._in_space else ends
        return bool(self.looker.stepper.safe(*with_bodies(ends, self.looker.stepper.space.arm, 0.0)))

    def configuration(self, pose: Pose) -> FloatArray:
        """Return the configuration of the arm in a pose, shape (c,) [rad, m]."""
        q = pose.q[own_coordinates(self.looker.stepper.space.arm)]
        return rows_in_plane(q[None], self.arm.links)[0] if self._in_space else q
