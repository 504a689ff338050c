"""Plans problems that differ a little from the last one, each from the motion of the one before."""

from dataclasses import dataclass

from ccm_opt.motion.motion_task import Motion
from ccm_opt.planners.curve import CurvePlanner
from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath


@dataclass
class ResumingPlanner:
    """Plans by the continuous curve, from the motion that it planned last; satisfies the ``Planner`` protocol.

    Attributes:
        planner: plans what nothing is known of.
        known: the last motion; None before the first.
    """

    planner: CurvePlanner
    known: Motion | None = None

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion.

        Raises:
            NoPlanFound: with the reason and what would help; the last motion stays known.
        """
        path, self.known = self.planner.planned(problem, self.known)
        return path
