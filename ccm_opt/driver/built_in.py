"""The package's own planner and timing as objects, for planners and retimers of users that build on them."""

from collections.abc import Sequence
from dataclasses import dataclass

from ccm_opt.core.expected import expect
from ccm_opt.core.progress import Stages
from ccm_opt.driver.calls import expect_arguments
from ccm_opt.driver.legs import Leg, Planner, Retimer
from ccm_opt.driver.planning_run import default_planner
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.timed_plan import timed_and_verified
from ccm_opt.driver.user_terms import compiled_terms
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath, JointTrajectory

__all__ = ["BuiltInPlanner", "BuiltInRetimer", "Planner", "Retimer"]


@dataclass(frozen=True)
class BuiltInPlanner:
    """The planner that ``solve`` takes when it is given none.

    Which one that is depends on the problem: the planner in space, and in the plane that of curves, that of arms on a
    feed axis, or the paper's own by hill climbing. A planner of your own may ask it for a path, for the same problem or
    for one that it changed::

        class Roomy:
            def plan(self, problem):
                wide = replace(problem, workspace=replace(problem.workspace, clearance=0.02))
                return ccm_opt.BuiltInPlanner().plan(wide)

        solution = ccm_opt.solve(problem, planner=Roomy())

    Attributes:
        constraints: of the user, which the paths keep. ``solve`` does not give its own to a planner that it is
            handed, so they are given here too.
        costs: of the user, likewise.
        settings: numbers of the stages.
    """

    constraints: Sequence[Constraint] = ()
    costs: Sequence[Cost] = ()
    settings: Settings = DEFAULT_SETTINGS

    def __post_init__(self) -> None:
        expect_arguments(settings=self.settings)

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified path.

        Args:
            problem: with one goal; goals in sequence are planned leg by leg.

        Raises:
            ProblemError: the planner cannot be used for this problem.
            NoPlanFound: with a diagnosis, when there is none within the limits.
        """
        Problem.expected(problem)
        terms = compiled_terms(problem.arm, self.constraints, self.costs)
        return default_planner(problem, Stages(), terms, self.settings).plan(problem)


@dataclass(frozen=True)
class BuiltInRetimer:
    """The timing that ``solve`` takes when it is given none: the one that ``problem.planner.retiming`` names.

    Attributes:
        settings: numbers of the stages.
    """

    settings: Settings = DEFAULT_SETTINGS

    def __post_init__(self) -> None:
        expect_arguments(settings=self.settings)

    def retime(self, problem: Problem, path: JointPath) -> JointTrajectory:
        """Lay time along a path, from rest to rest within the limits; the verifier accepts it.

        Args:
            problem: of which the path is a solution.
            path: from its start to its goal.

        Raises:
            RetimingError: with a diagnosis, when there is no timing within the limits.
            VerificationError: the path is no solution of the problem.
        """
        Problem.expected(problem)
        expect(path, JointPath, "a ccm_opt.JointPath", "planners make them")
        return timed_and_verified(problem, (Leg(problem, path),), Stages(), settings=self.settings).trajectory
