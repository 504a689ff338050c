"""The stages of solving, in their order."""

from collections.abc import Callable, Sequence
from typing import Any, overload

from ccm_opt.core.progress import Progress, Stages
from ccm_opt.diagnosis.explain import refuse_hopeless
from ccm_opt.driver.calls import expect_arguments
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.errors import ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.curve_planner import CurvePlanner
from ccm_opt.planning.legs import Planner, Retimer
from ccm_opt.planning.own_units import OwnUnitsPlanner
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.solution import Solution
from ccm_opt.solution.space_solution import AnySolution, SpaceSolution


@overload
def solve(
    problem: Problem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: "Settings | None" = None,
) -> Solution: ...


@overload
def solve(
    problem: SpaceProblem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: "Settings | None" = None,
) -> SpaceSolution: ...


def solve(
    problem: AnyProblem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: "Settings | None" = None,
) -> AnySolution:
    """Plan, time, verify and simulate a motion, in the plane or in space.

    Args:
        problem: what to solve.
        progress: told when a stage starts, and when the search begins with another candidate.
        planner: another planner; when None the feed planner for an arm on a feed axis, else the curve planner. For a
            problem in space, one that plans such problems; the space planner when None.
        retimer: another way to time the path; the one that the problem names when None.
        constraints: of the user; another planner is not given them, but its plan is held against them.
        costs: of the user; another planner is not given them.
        explain: whether the time left after a failure is used to find out why, and what change would help.
        settings: numbers of the stages that the problem does not set; the defaults when None.

    Returns:
        A verified solution; there is no unverified one.

    Raises:
        ProblemError: the problem cannot be used as it stands, or asks in space for what only the plane knows.
        NoPlanFound: with a diagnosis: there is no plan within the limits.
        VerificationError: the verifier refuses the plan; a defect of the planner.
        CancelledWithPlan: on Ctrl-C once there is a verified plan, which it holds; a ``KeyboardInterrupt``.
    """
    if not isinstance(problem, SpaceProblem):
        from ccm_opt.driver.plane_pipeline import solve_in_plane  # noqa: PLC0415 - each kind loads its own planners

        return solve_in_plane(
            problem,
            progress=progress,
            planner=planner,
            retimer=retimer,
            constraints=constraints,
            costs=costs,
            explain=explain,
            settings=settings,
        )
    from ccm_opt.driver.space_pipeline import solve_in_space  # noqa: PLC0415 - likewise

    expect_arguments(progress=progress, planner=planner, retimer=retimer, settings=settings, explain=explain)
    # What is given with a problem in space is for such problems: its methods have the same names.
    planner_in_space: Any = planner
    retimer_in_space: Any = retimer
    return solve_in_space(
        problem,
        progress=progress,
        planner=planner_in_space,
        retimer=retimer_in_space,
        constraints=constraints,
        costs=costs,
        explain=explain,
        settings=settings,
    )


def default_planner(
    problem: Problem, stages: Stages, terms: UserTerms | None = None, settings: Settings = DEFAULT_SETTINGS
) -> Planner:
    """The planner for a problem and the user's constraints and costs.

    Raises:
        ProblemError: hill climbing is asked to keep constraints.
    """
    if problem.planner.method == "hill-climbing":
        if terms is not None:
            raise ProblemError("hill climbing knows no constraints and costs of the user; use planner.method nlp")
        from ccm_opt.baseline.hill_climbing_planner import HillClimbingPlanner  # noqa: PLC0415 - most runs need none

        return OwnUnitsPlanner(HillClimbingPlanner(stages, settings.hill_climbing))
    if problem.arm.base_axes:
        from ccm_opt.planning.feed.feed_planner import FeedPlanner  # noqa: PLC0415 - likewise

        return OwnUnitsPlanner(FeedPlanner(stages, settings.feed, terms))
    return OwnUnitsPlanner(CurvePlanner(stages, terms, refuse_hopeless, settings.curve))
