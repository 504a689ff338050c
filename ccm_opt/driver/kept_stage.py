"""Stages that follow the verification, in the plane and in space: whatever happens there, the plan is kept.

Nothing that they say can make a plan worse. A simulation that cannot be run is a verdict; a defect of this package in
one of them is logged with its traceback, and what it would have said is missing.
"""

import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeVar

from ccm_opt.driver.closed_loop import not_simulated, simulate_and_check
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.dynamics.simulation.simulation_settings import SimulationSettings
from ccm_opt.solution import SimulatedMotion
from ccm_opt.space.problem import AnyProblem
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

Result = TypeVar("Result")

logger = logging.getLogger(__name__)


def kept(stage: Callable[[], Result], what: str, instead: Callable[[Exception], Result]) -> Result:
    """What a stage makes of a verified plan.

    Args:
        stage: makes it.
        what: what is missing where it fails, in words.
        instead: what stands for it then.
    """
    try:
        return stage()
    except Exception as defect:
        logger.exception("%s: this is a bug in ccm-opt, please report it", what)
        return instead(defect)


def not_waited_for(problem: AnyProblem, plan: VerifiedPlan) -> SimulatedMotion:
    """What stands for the simulated motion of a plan until there is one."""
    return not_simulated(plan.trajectory, plan.joints, problem.simulation.step, "it was not waited for")


def simulated_motion(
    problem: AnyProblem,
    plan: VerifiedPlan,
    settings: SimulationSettings,
    looks: VerificationSettings = DEFAULT_VERIFICATION,
) -> tuple[SimulatedMotion, Mapping[str, float]]:
    """The simulated motion and its figures; one that stands still where a defect keeps it from being simulated.

    Settings as for ``simulate_and_check``.
    """
    stage = partial(simulate_and_check, problem, plan.trajectory, plan.joints, settings, looks)
    return kept(stage, "the plan was not simulated", partial(_stands_still, problem, plan))


def _stands_still(
    problem: AnyProblem, plan: VerifiedPlan, defect: Exception
) -> tuple[SimulatedMotion, Mapping[str, float]]:
    reason = f"a defect of ccm-opt: {type(defect).__name__}: {defect}"
    return not_simulated(plan.trajectory, plan.joints, problem.simulation.step, reason), {}
