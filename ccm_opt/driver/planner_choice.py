"""Which planner a problem is given to when the user brings none."""

from ccm_opt.diagnosis.refusals_in_plane import refuse_hopeless
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.errors import ProblemError
from ccm_opt.ground.stages import Stages
from ccm_opt.planners.curve import CurvePlanner
from ccm_opt.planners.own_units import OwnUnitsPlanner
from ccm_opt.planners.protocols import Planner
from ccm_opt.problem import Problem
from ccm_opt.user_terms.compiled_terms import UserTerms


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
        from ccm_opt.planners.baseline.hill_climbing_planner import (  # noqa: PLC0415 - most runs need none
            HillClimbingPlanner,
        )

        return OwnUnitsPlanner(HillClimbingPlanner(stages, settings.hill_climbing))
    if problem.arm.base_axes:
        from ccm_opt.planners.feed.feed_planner import FeedPlanner  # noqa: PLC0415 - likewise

        return OwnUnitsPlanner(FeedPlanner(stages, settings.feed, terms))
    return OwnUnitsPlanner(CurvePlanner(stages, terms, refuse_hopeless, settings.curve))
