"""A problem to a timed motion that the verifier accepts: plan every leg, time it, verify it, put the legs together."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ccm_opt import retiming, verification
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.errors import Diagnosis, MotionNotFound, ProblemError, VerificationError
from ccm_opt.jointed.frames import revolute_angles
from ccm_opt.planners.baseline import HillClimbingPlanner
from ccm_opt.planners.curve import CurvePlanner
from ccm_opt.planners.feed import FeedPlanner
from ccm_opt.planners.following.gating import feed_limits
from ccm_opt.planners.legs import Leg, plan_legs, whole_path
from ccm_opt.planners.protocols import Planner, Retimer
from ccm_opt.problem import Problem
from ccm_opt.solution import Check, JointPath, JointStates, JointTrajectory
from ccm_opt.stages import Stages
from ccm_opt.user_terms.compiled_terms import UserTerms
from ccm_opt.user_terms.term_checks import checks_of_terms, metrics_of_terms


@dataclass(frozen=True)
class VerifiedPlan:
    """A motion that passes every check.

    Attributes:
        path: the way, of all legs end to end.
        trajectory: the same in time.
        joints: the same for the revolutes.
        checks: of the verifier.
        user_checks: of the user's constraints.
        figures: residuals and values of the user's constraints and costs, by name.
    """

    path: JointPath
    trajectory: JointTrajectory
    joints: JointStates
    checks: tuple[Check, ...]
    user_checks: tuple[Check, ...]
    figures: dict[str, float]


def default_planner(problem: Problem, stages: Stages, terms: UserTerms | None = None) -> Planner:
    """The planner for a problem and the user's own terms."""
    if problem.planner.method == "hill-climbing":
        if terms is not None:
            raise ProblemError("hill climbing knows no constraints and costs of one's own; use planner.method nlp")
        return HillClimbingPlanner(stages)
    if problem.arm.feed is None:
        return CurvePlanner(stages, terms)
    return FeedPlanner(stages)


def verified_plan(
    problem: Problem, planner: Planner, stages: Stages, retimer: Retimer | None = None, terms: UserTerms | None = None
) -> VerifiedPlan:
    """A motion past all goals of a problem that passes every check.

    Args:
        problem: what to solve.
        planner: plans a leg.
        stages: names and times the stages.
        retimer: another way to time a leg; the one that the problem names when None.
        terms: the user's constraints and costs; they hold for every leg by itself.

    Raises:
        NoPlanFound: there is no plan within the limits.
        VerificationError: the verifier refuses the plan.
    """
    legs = plan_legs(problem, planner)
    with stages("dynamics model"):
        inverse_dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    timed = [timed_leg(leg, inverse_dynamics, stages, retimer, terms) for leg in legs]
    if len(timed) == 1:
        return timed[0]
    return _put_together(problem, legs, timed, inverse_dynamics, stages)


def _put_together(
    problem: Problem,
    legs: tuple[Leg, ...],
    timed: Sequence[VerifiedPlan],
    inverse_dynamics: InverseDynamics,
    stages: Stages,
) -> VerifiedPlan:
    """All legs as one motion, verified once more as a whole."""
    with stages("retiming"):
        trajectory = retiming.joined([leg.trajectory for leg in timed], [stop.pause for stop in problem.stops])
        joints = joint_states(problem.arm, trajectory, inverse_dynamics)
    with stages("verification"):
        checks = verified(problem, trajectory, joints)
    own = {name: [leg.figures[name] for leg in timed] for name in timed[0].figures}
    figures = {name: float(np.max(np.abs(values))) for name, values in own.items()}
    held = tuple(
        replace(check, name=f"{check.name}, goal {number}")
        for number, leg in enumerate(timed, start=1)
        for check in leg.user_checks
    )
    return VerifiedPlan(whole_path(legs), trajectory, joints, checks, held, figures)


def timed_leg(
    leg: Leg,
    inverse_dynamics: InverseDynamics,
    stages: Stages,
    retimer: Retimer | None = None,
    terms: UserTerms | None = None,
) -> VerifiedPlan:
    """The first timing of a leg that passes every check.

    Raises:
        NoPlanFound: the path cannot be timed within the limits.
        VerificationError: no timing passes; it names what the last of them fails.
    """
    arm, path = leg.problem.arm, leg.path
    timings, failures = timings_of(leg, inverse_dynamics, retimer), list[str]()
    while True:
        with stages("retiming"):
            trajectory = next(timings, None)
            if trajectory is None:
                raise VerificationError(failures)
            joints = joint_states(arm, trajectory, inverse_dynamics)
        with stages("verification"):
            checks = verification.verify(leg.problem, trajectory, joints)
            own = () if terms is None else checks_of_terms(terms, arm, path, trajectory)
        failures = failures_of((*checks, *own))
        if failures and arm.feed is not None and not failures_of(checks):
            raise MotionNotFound(_not_kept(failures_of(own)))
        if not failures:
            figures = {} if terms is None else dict(metrics_of_terms(terms, arm, path, trajectory))
            return VerifiedPlan(path, trajectory, joints, checks, own, figures)


def _not_kept(failures: list[str]) -> Diagnosis:
    """Why a motion of a fed arm is none: its planner knows nothing of the constraints that are held against it."""
    reason = f"the motion along the feed axis does not keep every constraint; by its miss: {failures[0]}"
    advice = ("widen the constraint", "move the goal", "leave arm.feed out: a fixed arm's motion is planned to keep it")
    return Diagnosis(reason, "constraints", advice, {"failures": failures})


def verified(problem: Problem, trajectory: JointTrajectory, joints: JointStates) -> tuple[Check, ...]:
    """The verifier's checks of a motion, all of which hold.

    Raises:
        VerificationError: naming those that do not.
    """
    checks = verification.verify(problem, trajectory, joints)
    if failures := failures_of(checks):
        raise VerificationError(failures)
    return checks


def failures_of(checks: Sequence[Check]) -> list[str]:
    """What the checks that do not hold say."""
    return [f"{check.name}: {check.worst:.6g} {check.unit} at {check.where}" for check in checks if not check.passed]


def timings_of(leg: Leg, inverse_dynamics: InverseDynamics, retimer: Retimer | None) -> Iterator[JointTrajectory]:
    """Timings of a leg, best first: those of the problem's method, or the only one of a user's own."""
    problem, path = leg.problem, leg.path
    if retimer is not None:
        yield retimer.retime(problem, path)
        return
    revolutes, method = partial(revolute_angles, problem.arm), problem.planner.retiming
    length = problem.arm.link_length
    limits = feed_limits(problem.arm, problem.limits)
    yield from retiming.timings(
        path,
        limits,
        inverse_dynamics,
        revolutes=revolutes,
        method=method,
        link_length=length,
        coordinates=problem.arm.coordinates,
    )
