"""Planning, timing and verification of one problem, with the figures that benchmarks report."""

import resource
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound, VerificationError
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.explain import refuse_closed
from ccm_opt.driver.legs import Leg
from ccm_opt.driver.verified_plan import timed_and_verified
from ccm_opt.dynamics import retiming
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath, JointStates, JointTrajectory
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.verification.verifier import verify

from .arms import joint_torques

Outcome = Literal["verified", "refused", "no plan", "crash"]


@dataclass(frozen=True)
class Run:
    """Result of planning, timing and verification for one problem.

    Attributes:
        name: name of the problem.
        outcome: whether a motion was found and verified.
        reason: reason of failure; empty for a verified motion.
        seconds: user CPU time of planning [s].
        candidate: name of the tactic that found the motion.
        duration: duration of the timed motion [s]; NaN without a motion.
        trajectory: the timed motion; None without a motion.
    """

    name: str
    outcome: Outcome
    reason: str
    seconds: float
    candidate: str = ""
    duration: float = np.nan
    trajectory: JointTrajectory | None = None


def user_seconds() -> float:
    """Return the user CPU time of this process [s]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


def run(problem: Problem, name: str = "", *, optimised: bool = True) -> Run:
    """Plan, time and verify a motion; exceptions are recorded with their location, so that a benchmark continues.

    Args:
        problem: the problem.
        name: name of the run; that of the problem if empty.
        optimised: whether the motion is optimised.
    """
    if not optimised:
        problem = replace(problem, planner=replace(problem.planner, optimiser="none"))
    planned, path = _planned(problem, Run(name or problem.name, "no plan", "", 0.0))
    if path is None:
        return planned
    try:
        return _judged(problem, path, planned)
    except NoPlanFound as failure:
        return replace(planned, outcome="no plan", reason=in_one_line(failure))
    except Exception as crash:  # noqa: BLE001 - whatever it is, it is reported as a defect
        return replace(planned, outcome="crash", reason=in_one_line(crash))


def _planned(problem: Problem, blank: Run) -> tuple[Run, JointPath | None]:
    """Return a run with the results of planning, and the joint path or None."""
    begin = user_seconds()
    try:
        path = MotionPlanner(refuse=refuse_closed).plan(problem)
    except NoPlanFound as failure:
        return replace(blank, reason=in_one_line(failure), seconds=user_seconds() - begin), None
    except Exception as crash:  # noqa: BLE001 - whatever it is, it is reported as a defect
        return replace(blank, outcome="crash", reason=in_one_line(crash), seconds=user_seconds() - begin), None
    return replace(blank, seconds=user_seconds() - begin, candidate=path.candidate), path


def _judged(problem: Problem, path: JointPath, planned: Run) -> Run:
    if problem.dimension == 3:
        try:
            trajectory = timed_and_verified(problem, (Leg(problem, path),), Stages()).trajectory
        except VerificationError as refusal:
            return replace(planned, outcome="refused", reason=in_one_line(refusal))
        return replace(planned, outcome="verified", duration=trajectory.duration, trajectory=trajectory)
    trajectory, states = timed(problem, path)
    checks = verify(problem, trajectory, states)
    refusals = [
        f"{check.name} {check.worst:.6g} for {check.limit:.6g} {check.unit}, {check.where}"
        for check in checks
        if not check.passed
    ]
    outcome: Outcome = "refused" if refusals else "verified"
    reason = "; ".join(refusals)
    return replace(planned, outcome=outcome, reason=reason, duration=trajectory.duration, trajectory=trajectory)


def in_one_line(error: Exception) -> str:
    """Return an exception in one line: the reason of a diagnosis, or the message and the location of another error."""
    if isinstance(error, NoPlanFound):
        return f"{type(error).__name__}: {error.diagnosis.reason}"
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({place.name}, line {place.lineno})"


def timed(problem: Problem, path: JointPath) -> tuple[JointTrajectory, JointStates]:
    """Return the timed motion along a joint path, with torques by the verifier, which needs no compilation."""
    arm = problem.arm
    revolutes = partial(revolute_angles, arm)

    def torques(angles: FloatArray, velocities: FloatArray, accelerations: FloatArray) -> FloatArray:
        bends = (0.0 - values[:, 1::3] for values in (angles, velocities, accelerations))
        return joint_torques(arm, problem.simulation.gravity, *bends)

    trajectory = retiming.retime(
        path,
        problem.limits,
        torques,
        revolutes=revolutes,
        link_lengths=arm.lengths,
        share=problem.planner.effort_share,
    )
    motion = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    angles, velocities, accelerations = (revolutes(values) for values in motion)
    needed = torques(angles, velocities, accelerations)
    return trajectory, JointStates(joint_names(arm), angles, velocities, accelerations, needed)


def quantile(values: Sequence[float], share: float) -> float:
    """Return a quantile of a sample; NaN for an empty sample."""
    return float(np.quantile(values, share)) if len(values) else np.nan
