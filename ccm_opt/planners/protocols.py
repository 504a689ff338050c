"""What a planner and a timing method have to offer; those of the package and those that users write."""

from typing import Protocol

from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath, JointTrajectory


class Planner(Protocol):
    """Finds a certified joint path for a problem."""

    def plan(self, problem: Problem) -> JointPath:
        """Plan a motion.

        Raises:
            NoPlanFound: with a diagnosis, when there is none within the limits.
        """
        ...


class Retimer(Protocol):
    """Lays time along a joint path."""

    def retime(self, problem: Problem, path: JointPath) -> JointTrajectory:
        """Time a path from rest to rest within ``problem.limits``; what it returns is verified.

        Of the limits of the drives a plan may use ``problem.planner.effort_share``, see ``jointed.drive_limits``.

        Raises:
            RetimingError: with a diagnosis, when there is no timing within the limits.
        """
        ...
