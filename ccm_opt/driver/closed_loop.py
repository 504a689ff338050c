"""The simulation of a plan, and what the simulated arm touches."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import SimulationError
from ccm_opt.dynamics.simulation.closed_loop_run import simulate
from ccm_opt.planning.ends import GapsAtSamples, NearestOfSamples
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulatedMotion, SimulationOutcome, SimulationVerdict
from ccm_opt.robot.frames import bends_from_revolutes, joint_positions_3d

_FIRST_LOOKS = 40
"""Samples at which the simulated arm is looked at first, as far as a link; the others need only be looked at as far as
the nearest surface of these. Taste: on the elbow with 9500 samples, as long as a hundredth of looking so far at all of
them."""
_LEAST_REACH = 1.0 / 16.0
"""How far the others are looked at at least, in links. Taste."""
_STEP_HALVINGS = 4
"""How often the step is halved, at most, before the arm is said not to follow its plan. Taste: a sixteenth of the step
costs sixteen times the run."""
_SAME_ERROR = 0.1
"""Relative difference of two tracking errors, at a step and at half of it, below which the step is not what keeps the
arm from following, so that no smaller one is tried. Taste."""

WALLS = "simulated_least_wall_clearance_m"
"""Figure of the least distance to walls."""
ITSELF = "simulated_least_self_clearance_m"
"""Figure of the least distance between links."""
FROM_BEST_TO_WORST: tuple[SimulationOutcome, ...] = (
    "followed",
    "saturated",
    "strayed",
    "touched",
    "diverged",
    "not simulated",
)
"""Outcomes of simulations, by how much there is to be learned from them."""


@dataclass(frozen=True)
class Touch:
    """A link of the simulated arm in contact.

    Attributes:
        link: number of the link, counted from 1.
        obstacle: name of the wall, or "link 9".
        time: when [s].
    """

    link: int
    obstacle: str
    time: float

    def __str__(self) -> str:
        return f"link {self.link} touches {self.obstacle} at {self.time:.4g} s"


@dataclass(frozen=True)
class Seen:
    """What was seen of a simulated arm among its obstacles.

    Attributes:
        touch: where it first touches something; None where it touches nothing.
        walls: least distance from walls, inf where nothing is near [m]; of no matter beyond a contact.
        itself: least distance between links, inf where none are near; None where links may meet [m].
    """

    touch: Touch | None
    walls: float
    itself: float | None


@dataclass(frozen=True)
class JudgedMotion:
    """A simulated motion with its verdict, and how near it came to what it must not touch.

    Attributes:
        motion: what the arm did.
        seen: None when nothing was simulated, or what it came near to is not known.
    """

    motion: SimulatedMotion
    seen: Seen | None

    @property
    def rank(self) -> int:
        """Place of its outcome, 0 for the best."""
        return FROM_BEST_TO_WORST.index(self.motion.verdict.outcome)


def simulate_and_check(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
) -> tuple[SimulatedMotion, Mapping[str, float]]:
    """Simulate a planned motion and judge it; a motion that is not followed is a result, never an error.

    An arm that does not follow is simulated with smaller steps, for the fault may be the step's. The first run in which
    it follows counts; else the one asked for, unless smaller steps take the arm farther.

    Args:
        problem: arm, limits, obstacles, simulation options.
        trajectory: the plan.
        joints: the same for all revolutes.

    Returns:
        What the arm does, with the verdict on it, and its figures of merit, named with their units.
    """
    asked = simulated_once(problem, trajectory, joints)
    best = asked
    before = asked
    step = problem.simulation.step
    for _ in range(_STEP_HALVINGS):
        if best.rank == 0:
            break
        step = 0.5 * step
        finer = replace(problem, simulation=replace(problem.simulation, step=step))
        judged = simulated_once(finer, trajectory, joints)
        # Among equals the smaller step is the more exact one.
        if judged.rank < asked.rank and judged.rank <= best.rank:
            best = judged
        if _alike(before, judged, _SAME_ERROR):
            break
        before = judged
    motion = best.motion if best is asked else _at_a_smaller_step(best.motion, asked.motion.verdict)
    return motion, _figures(trajectory, motion, best.seen)


def simulated_once(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
) -> JudgedMotion:
    """Simulate a planned motion with the problem's own step and judge it; arguments as for ``simulate_and_check``."""
    options = problem.simulation
    try:
        motion = simulate(problem.arm, trajectory, joints, options, problem.limits)
    except SimulationError as error:
        diagnosis = error.diagnosis
        return JudgedMotion(
            not_simulated(trajectory, joints, options.step, diagnosis.reason, diagnosis.advice), seen=None
        )
    found = seen(problem, trajectory, motion)
    if found is None or found.touch is None:
        return JudgedMotion(motion, found)
    return JudgedMotion(replace(motion, verdict=_touched(motion.verdict, found.touch)), found)


def _figures(trajectory: JointTrajectory, simulated: SimulatedMotion, seen: Seen | None) -> Mapping[str, float]:
    """Return the tracking errors, time at limits, and least clearances at all times.

    Where it touches, those of a contact.
    """
    figures = {"tracking_error_rad": simulated.tracking_error, "saturated_time_s": simulated.saturated_time}
    errors = np.abs(simulated.base_positions - trajectory.base_positions)
    for name, error in zip(trajectory.coordinates.base_names, errors.T, strict=True):
        figures[f"{name}_tracking_error_m"] = float(np.max(error))
    if seen is not None:
        figures[WALLS] = seen.walls
        if seen.itself is not None:
            figures[ITSELF] = seen.itself
    return figures


def _alike(coarse: JudgedMotion, fine: JudgedMotion, share: float) -> bool:
    """Return whether half the step changed so little that the step is not what keeps the arm from following."""
    if fine.rank != coarse.rank or fine.motion.verdict.outcome in ("diverged", "not simulated"):
        return False
    error = coarse.motion.tracking_error
    return abs(error - fine.motion.tracking_error) <= share * error


def _touched(verdict: SimulationVerdict, touch: Touch) -> SimulationVerdict:
    """Return the verdict on a run in which the arm touches something, with what its drives did besides."""
    return replace(
        verdict,
        outcome="touched",
        reason=f"{touch}; besides, {verdict.reason}" if verdict.reason else str(touch),
        link=touch.link,
        obstacle=touch.obstacle,
        time=touch.time,
        advice=("a larger workspace.clearance or planner.wanted_gap", *verdict.advice),
    )


def _at_a_smaller_step(motion: SimulatedMotion, asked: SimulationVerdict) -> SimulatedMotion:
    """Return a run with a smaller step than asked for, whose verdict says so."""
    verdict = motion.verdict
    if verdict.followed:
        # Where a step that is too long leads says nothing of an arm that follows.
        failed = "the integration diverged" if asked.outcome == "diverged" else f"{asked.outcome}: {asked.reason}"
        reason = f"in steps of {verdict.step:g} s; in those asked for, of {asked.step:g} s, {failed}"
        return replace(motion, verdict=replace(verdict, reason=reason))
    before = f"at the step asked for, {asked.step:g} s, {asked.outcome}: {asked.reason}"
    return replace(motion, verdict=replace(verdict, reason=f"{verdict.reason}; {before}" if verdict.reason else before))


def not_simulated(
    trajectory: JointTrajectory, joints: JointStates, step: float, reason: str, advice: tuple[str, ...] = ()
) -> SimulatedMotion:
    """Return an arm that was not simulated: it stands where the plan begins.

    Args:
        trajectory: the plan.
        joints: the same for all revolutes.
        step: that was asked for [s].
        reason: why it was not simulated.
        advice: what would help.
    """
    samples = len(trajectory.time)
    return SimulatedMotion(
        angles=np.repeat(joints.angles[:1], samples, axis=0),
        torques=np.zeros_like(joints.torques),
        tracking_error=np.nan,
        saturated=False,
        base_positions=np.repeat(trajectory.base_positions[:1], samples, axis=0),
        verdict=SimulationVerdict("not simulated", step, reason, advice=advice),
    )


def seen(
    problem: Problem,
    trajectory: JointTrajectory,
    simulated: SimulatedMotion,
) -> Seen | None:
    """Return what a simulated arm comes near to; None when no step was run, or an arm of the plane left it.

    In space rolls that the controller does not hold at zero count too: the arm is where its revolutes put it.

    Args:
        problem: walls or surfaces, and arm.
        trajectory: the plan, for its times.
        simulated: what the arm did.
    """
    angles = simulated.angles
    if simulated.verdict.outcome == "not simulated" or len(angles) < 2:
        return None
    arm = problem.arm
    if arm.dimension == 3:
        points = joint_positions_3d(arm, angles, np.sum(simulated.base_positions, axis=1))
    # Obstacles are known in the plane alone, which yaws and rolls beyond rounding leave.
    elif max(np.max(np.abs(angles[:, place::3])) for place in (0, 2)) > ROUNDING:
        return None
    else:
        points = arm.joint_positions_at(np.hstack((bends_from_revolutes(arm, angles), simulated.base_positions)))
    gaps = _as_far_as_needed(problem, points)
    walls = gaps.walls
    itself = gaps.itself
    # A plan may touch as deep as rounding goes, where its base stands flush on a floor; so may the arm.
    deep = -problem.contact_tolerance
    touching = np.flatnonzero((walls.gap < deep) | (itself.gap < deep))
    touch = None
    if len(touching):
        first = int(touching[0])
        near = walls if walls.gap[first] < deep else itself
        touch = Touch(int(near.link[first]), gaps.other(near, first), float(trajectory.time[first]))
    own = _least(itself) if problem.arm.self_collision else None
    return Seen(touch, _least(walls), own)


def _least(near: NearestOfSamples) -> float:
    """Return the least gap [m]; inf where nothing was near at any sample."""
    return float(np.min(near.gap, where=near.link > 0, initial=np.inf))


def _as_far_as_needed(problem: Problem, points: FloatArray) -> GapsAtSamples:
    """Return the gaps of poses, looked for no farther than the least of them is: of surfaces up to a link's length."""
    few = points[:: max(1, len(points) // _FIRST_LOOKS)]
    arm = problem.arm
    far = arm.length if arm.dimension == 2 else arm.link_length
    known = GapsAtSamples.of(problem, few, far, arm.length)
    # What is just as near as the reach counts as not found, and so would what is in contact for a reach of zero.
    least = _LEAST_REACH * arm.link_length
    walls = np.clip(1.001 * np.min(known.walls.gap), least, far)
    itself = np.clip(1.001 * np.min(known.itself.gap), least, arm.length)
    return GapsAtSamples.of(problem, points, float(walls), float(itself))
