"""A guide that ends as soon as it has led the arm to any member of a goal that is a set."""

from dataclasses import dataclass

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.continuation import Guide
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.pose import Pose, Term


@dataclass(frozen=True)
class GuideIntoSet:
    """Another guide, followed no farther than to the goal.

    Attributes:
        guide: to follow.
        goal: a set, of which the guide is led to one member.
    """

    guide: Guide
    goal: GoalPose

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """What draws the arm on from a pose."""
        return self.guide.terms(pose, jacobians)

    def progress(self, pose: Pose) -> bool:
        """Move the guide's target on if the arm keeps up; whether it did."""
        return self.guide.progress(pose)

    def finished(self, pose: Pose) -> bool:
        """Whether the goal is met, or the guide has ended."""
        return self.goal.met(pose) or self.guide.finished(pose)

    def describe(self, pose: Pose) -> str:
        """How far the guide has come."""
        return self.guide.describe(pose)
