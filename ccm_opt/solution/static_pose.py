"""The answer to the static question: the best pose at the goal that was found, and what else was tried."""

from collections.abc import Mapping
from dataclasses import dataclass

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.solution.goal_pose_record import GoalPoseRecord


@dataclass(frozen=True)
class BindingSide:
    """A side of a link's region that a pose leans on: with the side farther away the pose would cost less.

    Attributes:
        link: number of the link, from 1 at the base.
        place: the end of the link that leans on it, (x, y) [m].
        towards: unit normal of the side, from the link outwards.
        multiplier: how much the objective would fall for one arm's length.
    """

    link: int
    place: tuple[float, float]
    towards: tuple[float, float]
    multiplier: float


@dataclass(frozen=True)
class PoseOutcome:
    """What came of one beginning from which a pose at the goal was looked for.

    Attributes:
        start: where the search began, in words.
        cost: of the pose found; None when none was.
        gap: its least room beyond radius and clearance, at most the wanted gap [m]; likewise.
        reason: why there is none; empty when there is one.
    """

    start: str
    cost: float | None = None
    gap: float | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class StaticPose:
    """The best pose that was found at a problem's goal, whatever motion would lead to it.

    Attributes:
        problem: what was asked.
        pose: the pose, its curve, and what the NLP said about it.
        nearest: link and wall, or two links, that are nearest to each other, with their gap, in words.
        binding: sides of regions that the pose leans on, the largest multiplier first.
        residuals: by how much the pose misses each of the user's constraints at the goal, soft ones too, by name.
        outcomes: of every beginning, the best first; the pose is that of the first.
        timings: CPU time of every stage [s].
    """

    problem: Problem
    pose: GoalPoseRecord
    nearest: str
    binding: tuple[BindingSide, ...]
    residuals: Mapping[str, float]
    outcomes: tuple[PoseOutcome, ...]
    timings: Mapping[str, float]

    @property
    def bends(self) -> FloatArray:
        """Of the joints, the first against the base heading, shape (links,) [rad]."""
        return self.problem.arm.bends(self.pose.headings)

    @property
    def joint_positions(self) -> FloatArray:
        """Positions of the joints and the tip, shape (links + 1, 2) [m]."""
        return self.problem.arm.joint_positions(self.pose.headings)
