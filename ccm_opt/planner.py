"""The protocol that every planner satisfies."""

from typing import Protocol

from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath


class Planner(Protocol):
    """Finds a certified joint path for a problem."""

    def plan(self, problem: Problem) -> JointPath:
        """Plan a motion.

        Raises:
            NoPlanFound: with a diagnosis, when there is none within the limits.
        """
        ...
