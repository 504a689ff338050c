"""Times and verifies the legs of a plan.

Nothing that they say can make a plan worse. A simulation that cannot be run is a verdict; a defect of this package in
one of them is logged with its traceback, and what it would have said is missing.
"""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TypeVar

from ccm_opt import retiming
from ccm_opt.core.progress import Stages
from ccm_opt.driver.closed_loop import not_simulated, simulate_and_check
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.verified_motion import VerifiedPlan, failed_checks, results_of_terms, with_hair, worst_of_legs
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.dynamics.simulation.simulation_record import SimulationSettings
from ccm_opt.errors import CcmError, Diagnosis, MotionNotFound, RetimingError, VerificationError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.following.leader import feed_limits
from ccm_opt.planning.legs import Leg, Retimer, whole_path
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import AnyProblem
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.solution import Check, JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.verifier import verify


def timed_and_verified(
    problem: Problem,
    legs: tuple[Leg[Problem], ...],
    stages: Stages,
    retimer: Retimer | None = None,
    terms: UserTerms | None = None,
    settings: Settings = DEFAULT_SETTINGS,
) -> VerifiedPlan:
    """The paths of all legs as one motion in time that passes every check.

    Args:
        problem: what they solve.
        legs: one to each goal.
        stages: names and times the stages.
        retimer: another way to time a leg; the one that the problem names when None.
        terms: the user's constraints and costs; they hold for every leg by itself.
        settings: of all stages.

    Raises:
        NoPlanFound: a path cannot be timed within the limits.
        VerificationError: the verifier refuses the plan.
    """
    # Made once for all legs: the first call may have to wait for the compiler.
    with stages("dynamics model"):
        inverse_dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    timed = [timed_leg(leg, inverse_dynamics, stages, retimer, terms, settings) for leg in legs]
    if len(timed) == 1:
        return timed[0]
    return _put_together(problem, legs, timed, inverse_dynamics, stages, settings)


def _put_together(
    problem: Problem,
    legs: tuple[Leg[Problem], ...],
    timed: Sequence[VerifiedPlan],
    inverse_dynamics: InverseDynamics,
    stages: Stages,
    settings: Settings,
) -> VerifiedPlan:
    """All legs as one motion, verified once more as a whole."""
    with stages("retiming"):
        trajectory = retiming.joined([leg.trajectory for leg in timed], [stop.pause for stop in problem.stops])
        joints = joint_states(problem.arm, trajectory, inverse_dynamics)
    with stages("verification"):
        checks = verified(problem, trajectory, joints, settings.verification)
    # A leg's constraints hold for the leg by itself: its path parameter runs from 0 to 1.
    of_terms = worst_of_legs([leg.of_terms for leg in timed])
    return VerifiedPlan(whole_path(legs), trajectory, joints, checks, of_terms)


def timed_leg(
    leg: Leg[Problem],
    inverse_dynamics: InverseDynamics,
    stages: Stages,
    retimer: Retimer | None = None,
    terms: UserTerms | None = None,
    settings: Settings = DEFAULT_SETTINGS,
) -> VerifiedPlan:
    """The first timing of a leg that passes every check.

    Raises:
        NoPlanFound: the path cannot be timed within the limits.
        VerificationError: the only timing does not pass; it names what that fails.
    """
    arm = leg.problem.arm
    timings = timings_of(leg, inverse_dynamics, retimer, settings)
    failures: list[str] = []
    # Paul's transitions leave the path, so the first timings may be refused for walls; TOPP-RA's only one is not.
    while True:
        with stages("retiming"):
            # Timings are made one by one, so that what is not needed is never computed.
            trajectory = next(timings, None)
            if trajectory is None:
                raise _no_timing(failures, by_transitions=retimer is None and leg.problem.planner.retiming == "paul")
            joints = joint_states(arm, trajectory, inverse_dynamics)
        with stages("verification"):
            checks = verify(leg.problem, trajectory, joints, settings.verification)
            of_terms = results_of_terms(terms, arm, leg.path, trajectory, settings.user_terms)

        broken_terms = failed_checks(of_terms.checks)
        failures = [*failed_checks(checks), *broken_terms]
        if not failures:
            return VerifiedPlan(leg.path, trajectory, joints, checks, of_terms)
        # No planner of an arm whose base moves knows the user's constraints: that they fail is no defect of it.
        if arm.base_axes and failures == broken_terms:
            raise MotionNotFound(_not_kept(failures))


def _no_timing(failures: list[str], *, by_transitions: bool) -> CcmError:
    """What is wrong where no timing passes: that turns leave the path is the method's nature, all else is a defect."""
    if not by_transitions:
        return VerificationError(failures)
    reason = f"even with its narrowest turns a motion of legs and turns fails; the first that does: {failures[0]}"
    advice = ('use planner.retiming = "toppra", which stays on the path',)
    return RetimingError(Diagnosis(reason, "retiming", advice, {"failures": failures}))


def _not_kept(failures: list[str]) -> Diagnosis:
    """Why a motion of a fed arm is none: its planner knows nothing of the constraints that are held against it."""
    reason = f"the motion along the feed axis does not keep every constraint; the first that fails: {failures[0]}"
    advice = ("widen the constraint", "move the goal", "leave arm.feed out: a fixed arm's motion is planned to keep it")
    return Diagnosis(reason, "constraints", advice, {"failures": failures})


def verified(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> tuple[Check, ...]:
    """The verifier's checks of a motion, all of which hold.

    Raises:
        VerificationError: naming those that do not.
    """
    checks = verify(problem, trajectory, joints, settings)
    if failures := failed_checks(checks):
        raise VerificationError(failures)
    return checks


def timings_of(
    leg: Leg[Problem], inverse_dynamics: InverseDynamics, retimer: Retimer | None, settings: Settings = DEFAULT_SETTINGS
) -> Iterator[JointTrajectory]:
    """Timings of a leg, best first: those of the problem's method, or the only one of the user's retimer."""
    if retimer is not None:
        yield retimer.retime(leg.problem, leg.path)
    elif leg.problem.arm.base_axes:
        yield from _timings_in_units(leg, inverse_dynamics, settings)
    else:
        yield from _timings(leg, inverse_dynamics, settings)


def _timings_in_units(
    leg: Leg[Problem], inverse_dynamics: InverseDynamics, settings: Settings
) -> Iterator[JointTrajectory]:
    """The same in units of the arm, for arms with coordinates that are lengths: timing weighs them against angles."""
    arm = leg.problem.arm
    units = OwnUnits(arm.length)
    scaled = Leg(units.scaled(leg.problem), units.path_in_units(leg.path, arm))
    try:
        dynamics = InverseDynamics(scaled.problem.arm, scaled.problem.simulation.gravity)
        for trajectory in _timings(scaled, dynamics, settings):
            yield units.trajectory_in_metres(trajectory, arm)
    except RetimingError:
        # It says why in these units; in metres it is said to people.
        yield from _timings(leg, inverse_dynamics, settings)


def _timings(leg: Leg[Problem], inverse_dynamics: InverseDynamics, settings: Settings) -> Iterator[JointTrajectory]:
    """Timings by the problem's method."""
    problem = leg.problem
    arm = problem.arm
    yield from retiming.timings(
        leg.path,
        feed_limits(arm, problem.limits, settings.feed.following),
        inverse_dynamics,
        revolutes=partial(revolute_angles, arm),
        method=problem.planner.retiming,
        link_length=arm.link_length,
        coordinates=arm.coordinates,
        arm=arm,
        share=problem.planner.effort_share,
        settings=with_hair(settings.timing, 0.5 * problem.contact_tolerance),
        paul=settings.transitions,
    )


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
