"""Timing of the paths of all legs of a motion, and verification of the whole motion."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.errors import Diagnosis, MotionNotFound, RetimingError, VerificationError
from ccm_opt.core.length_words import file_length
from ccm_opt.core.progress import Stages
from ccm_opt.driver.legs import Leg, Retimer, whole_path
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.dynamics import retiming
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.planning.leader import feed_limits
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import Check, JointPath, JointStates, JointTrajectory, Tour, TryRecord
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.verifier import verify

if TYPE_CHECKING:
    from ccm_opt.ik.compiled_terms import UserTerms


@dataclass(frozen=True)
class TermResults:
    """Checks of the user's constraints, and values of the user's costs, for a motion.

    Attributes:
        checks: one check for each constraint.
        figures: residuals of the constraints and values of the costs, by name.
    """

    checks: tuple[Check, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class VerifiedPlan:
    """A motion that passes every check.

    Attributes:
        path: the paths of all legs, joined.
        trajectory: the timed motion.
        joints: states of all revolute joints over the motion.
        checks: checks of the verifier.
        of_terms: checks of the user's constraints and values of the costs.
        tries: results of all planning attempts, if several were requested.
        tour: order in which goals in free order are visited, with the problem as posed; None for goals in given order.
    """

    path: JointPath
    trajectory: JointTrajectory
    joints: JointStates
    checks: tuple[Check, ...]
    of_terms: TermResults
    tries: tuple[TryRecord, ...] = ()
    tour: Tour | None = None


def evaluate_terms(
    terms: "UserTerms | None",
    path: JointPath,
    trajectory: JointTrajectory,
) -> TermResults:
    """Return the checks of the user's constraints, and the values of the costs, for a motion; empty without terms.

    Args:
        terms: the user's constraints and costs; None for none.
        path: the path of the motion.
        trajectory: the timed motion.
    """
    if terms is None:
        return TermResults()
    from ccm_opt.ik import term_checks  # noqa: PLC0415 - most problems have no constraints of the user

    return TermResults(*term_checks.evaluate_terms(terms, path, trajectory))


def worst_leg_checks(legs: Sequence[TermResults]) -> TermResults:
    """Return the checks of all legs, named with their goals, and the largest magnitude of each figure over the legs."""
    checks = [
        replace(check, name=f"{check.name}, goal {number}")
        for number, leg in enumerate(legs, start=1)
        for check in leg.checks
    ]
    # All legs share the same terms, so the figures of the first name those of all.
    figures = {name: float(np.max(np.abs([leg.figures[name] for leg in legs]))) for name in legs[0].figures}
    return TermResults(tuple(checks), figures)


def failed_checks(checks: Sequence[Check]) -> list[str]:
    """Return one message for each failed check."""
    return [f"{check.name}: {_value(check)} at {check.where}" for check in checks if not check.passed]


def _value(check: Check) -> str:
    """Return the worst value of a check as text; lengths are in the unit of the problem file."""
    return file_length(check.worst, 6) if check.unit == "m" else f"{check.worst:.6g} {check.unit}"


def verified(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
    tour: Tour | None = None,
) -> tuple[Check, ...]:
    """Return the checks of a motion, all of which passed.

    Args:
        problem: the problem.
        trajectory: the motion.
        joints: states of all revolute joints over the motion.
        settings: tolerances of the verifier.
        tour: order of the goals, with the problem as posed, which is then verified; None for goals in given order.

    Raises:
        VerificationError: a check failed; the message lists all failed checks.
    """
    checks = verify(problem if tour is None else tour.posed, trajectory, joints, settings, tour)
    if failures := failed_checks(checks):
        raise VerificationError(failures)
    return checks


def timed_and_verified(
    problem: Problem,
    legs: Sequence[Leg],
    stages: Stages,
    retimer: Retimer | None = None,
    terms: "UserTerms | None" = None,
    settings: Settings = DEFAULT_SETTINGS,
    tour: Tour | None = None,
) -> VerifiedPlan:
    """Return a verified plan made by timing the paths of all legs and verifying them as one motion.

    Args:
        problem: the problem that the legs solve.
        legs: one leg to each goal.
        stages: clock that names and times the stages of planning.
        retimer: method of timing a leg; None for the method that the problem names.
        terms: the user's constraints and costs, which apply to every leg separately; None for none.
        settings: settings of all stages of planning.
        tour: order of the goals, of which ``problem`` has those that are visited; None for goals in given order.

    Raises:
        NoPlanFound: a path cannot be timed within the limits, or the motion violates a constraint.
        VerificationError: the verifier rejects the plan.
    """
    # Built once for all legs: the first call may have to wait for the compiler.
    with stages("dynamics model"):
        dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    with stages("retiming"):
        timed = [_leg_in_time(leg, dynamics, retimer, terms, settings) for leg in legs]
        trajectory = retiming.joined(timed, [stop.pause for stop in problem.stops]) if len(timed) > 1 else timed[0]
        joints = joint_states(problem.arm, trajectory, dynamics)
        tour = None if tour is None else tour.lasting(sum(motion.duration for motion in timed))
    with stages("verification"):
        checks = verified(problem, trajectory, joints, settings.verification, tour)
        # Constraints apply to each leg by itself, because its path parameter runs from 0 to 1.
        found = [evaluate_terms(terms, leg.path, motion) for leg, motion in zip(legs, timed, strict=True)]
        of_terms = worst_leg_checks(found) if len(found) > 1 else found[0]
        if broken := failed_checks(of_terms.checks):
            raise MotionNotFound(_broken_constraint(broken))
    return VerifiedPlan(whole_path(legs), trajectory, joints, checks, of_terms, tour=tour)


def leg_timer(
    problem: Problem, retimer: Retimer | None, settings: Settings = DEFAULT_SETTINGS
) -> Callable[[Leg], float]:
    """Return a function that returns the duration of a leg of a problem's motion [s].

    Args:
        problem: the problem, for its arm and gravity.
        retimer: method of timing a leg; None for the method that the problem names.
        settings: settings of all stages of planning.
    """
    dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    return lambda leg: _leg_in_time(leg, dynamics, retimer, None, settings).duration


def _leg_in_time(
    leg: Leg,
    dynamics: InverseDynamics,
    retimer: Retimer | None,
    terms: "UserTerms | None",
    settings: Settings,
) -> JointTrajectory:
    """Return the timed motion of a leg; the arm comes to rest wherever two joined paths of the leg meet in a corner."""
    parts = leg.path.parts
    if not parts:
        return _timed(leg, dynamics, retimer, terms, settings)
    ends = [JointPose.from_configuration(part.spline(1.0), leg.problem.arm.coordinates) for part in parts]
    starts = [leg.problem.start, *ends[:-1]]
    timed = [
        _timed(Leg(replace(leg.problem, start=start, goal=end), part), dynamics, retimer, None, settings)
        for part, start, end in zip(parts, starts, (*ends[:-1], leg.problem.goal), strict=True)
    ]
    # Stops are the intermediate goals of a motion; corners are not listed among them.
    return replace(retiming.joined(timed), stops=())


def _timed(
    leg: Leg,
    dynamics: InverseDynamics,
    retimer: Retimer | None,
    terms: "UserTerms | None",
    settings: Settings,
) -> JointTrajectory:
    """Return the first timed motion of a leg that passes all checks.

    Raises:
        RetimingError: no timing within the limits was found.
    """
    problem = leg.problem
    if retimer is not None:
        return retimer.retime(problem, leg.path)
    failures: list[str] = []
    sampling = replace(settings.timing.sampling, min_chord_deviation=0.5 * problem.contact_tolerance)
    # A generator: the later timings are computed only if the earlier ones fail.
    for trajectory in retiming.timings(
        leg.path,
        feed_limits(problem.arm, problem.limits),
        dynamics,
        revolutes=partial(revolute_angles, problem.arm),
        method=problem.planner.retiming,
        link_lengths=problem.arm.lengths,
        coordinates=problem.arm.coordinates,
        arm=problem.arm,
        share=problem.planner.effort_share,
        settings=replace(settings.timing, sampling=sampling),
    ):
        # Paul's transitions leave the path and may hit walls, so they are checked here; TOPP-RA stays on the path.
        if problem.planner.retiming == "toppra":
            return trajectory
        checks = verify(problem, trajectory, joint_states(problem.arm, trajectory, dynamics), settings.verification)
        of_terms = evaluate_terms(terms, leg.path, trajectory)
        failures = failed_checks((*checks, *of_terms.checks))
        if not failures:
            return trajectory
    reason = f"even with the shortest transitions the motion fails a check: {failures[0]}"
    advice = ('use planner.retiming = "toppra", which stays on the path',)
    raise RetimingError(Diagnosis(reason, "retiming", advice, {"failures": failures}))


def _broken_constraint(broken: list[str]) -> Diagnosis:
    """Return the diagnosis for a motion that violates constraints of the user, given messages about the violations."""
    reason = f"the motion found violates a constraint: {broken[0]}"
    advice = ("relax the constraint, or make it soft", "move the goal")
    return Diagnosis(reason, "constraints", advice, {"failures": broken})
