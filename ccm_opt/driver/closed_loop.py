"""Closed-loop simulation of a plan, and detection of contacts of the simulated arm."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import SimulationError
from ccm_opt.dynamics.simulation.closed_loop_run import simulate
from ccm_opt.planning.ends import GapsAtSamples, NearestOfSamples
from ccm_opt.planning.tool_problem import problem_with_tool_links
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulatedMotion, SimulationOutcome, SimulationVerdict
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import bends_from_revolutes, drive_names, joint_positions_3d
from ccm_opt.scene.tool_links import own_joints, points_with_tool

_FIRST_LOOKS = 40
"""Number of samples at which clearances of the simulated arm are measured first, to determine the search distance for
all samples. Heuristic: for 9500 samples of an example problem in space, this first pass takes a hundredth of the time
of searching all samples up to one link length."""
_LEAST_REACH = 1.0 / 16.0
"""Minimum search distance for clearances at all samples, in link lengths. Heuristic."""
_STEP_HALVINGS = 4
"""Maximum number of times that the integration step is halved before the arm is reported not to follow the plan.
Heuristic: a sixteenth of the step takes sixteen times as long."""
_SAME_ERROR = 0.1
"""Maximum relative change of the tracking error, when the step is halved, for which the step size is not blamed for a
failure to follow the plan; no smaller step is tried then. Heuristic."""

WALLS = "simulated_least_wall_clearance_m"
"""Name of the figure of merit for the minimum distance to obstacles."""
ITSELF = "simulated_least_self_clearance_m"
"""Name of the figure of merit for the minimum distance between links."""
FROM_BEST_TO_WORST: tuple[SimulationOutcome, ...] = (
    "followed",
    "saturated",
    "strayed",
    "touched",
    "diverged",
    "not simulated",
    "not modelled",
)
"""Outcomes of simulations, from best to worst."""


@dataclass(frozen=True)
class Touch:
    """A contact of a link of the simulated arm with an obstacle or another link.

    Attributes:
        link: number of the link, from 1.
        name: name of the link, of its section, or of the body on it, for example "link 3".
        obstacle: name of the obstacle; for contact with another link "link" and its number, for example "link 9".
        time: time of the contact [s].
    """

    link: int
    name: str
    obstacle: str
    time: float

    def __str__(self) -> str:
        return f"{self.name} touches {self.obstacle} at {self.time:.4g} s"


@dataclass(frozen=True)
class Seen:
    """First contact and minimum distances of a simulated arm.

    Attributes:
        touch: first contact; None without contact.
        walls: minimum distance to obstacles [m]; inf if no obstacle is within the search distance. Without meaning
            if there is a contact.
        itself: minimum distance between links [m]; inf if none are within the search distance of each other; None if
            the problem allows links to touch.
    """

    touch: Touch | None
    walls: float
    itself: float | None


@dataclass(frozen=True)
class JudgedMotion:
    """A simulated motion with its outcome, first contact and minimum distances.

    Attributes:
        motion: motion of the simulated arm.
        seen: first contact and minimum distances; None if nothing was simulated, or they are unknown.
    """

    motion: SimulatedMotion
    seen: Seen | None

    @property
    def rank(self) -> int:
        """Index of the outcome in ``FROM_BEST_TO_WORST``, 0 for the best."""
        return FROM_BEST_TO_WORST.index(self.motion.verdict.outcome)


def simulate_and_check(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
) -> tuple[SimulatedMotion, Mapping[str, float]]:
    """Return the simulation of a plan and its figures of merit; an arm that does not follow the plan raises no error.

    If the arm does not follow the plan, the simulation is repeated with smaller steps, since the integration may be at
    fault, until it follows twice in a row. The result is the last run in which the arm follows, else the run with the
    problem's step, unless a smaller step gives a better outcome.

    Args:
        problem: the problem, which gives arm, limits, obstacles and simulation options.
        trajectory: the planned motion.
        joints: states of all revolute joints over the planned motion.

    Returns:
        The simulated motion with its outcome, and figures of merit by names that end in their unit.
    """
    if problem.arm.unsimulated:
        return not_simulated(problem.arm, trajectory, joints, problem.simulation.step), {}
    requested = simulated_once(problem, trajectory, joints)
    best = requested
    before = requested
    step = problem.simulation.step
    # A step with which the arm only just follows may amplify rounding, so it has to follow with half of that too.
    for _ in range(_STEP_HALVINGS if requested.rank else 0):
        step = 0.5 * step
        finer = replace(problem, simulation=replace(problem.simulation, step=step))
        judged = simulated_once(finer, trajectory, joints)
        # Among equals the smaller step is the more exact one.
        if judged.rank < requested.rank and judged.rank <= best.rank:
            best = judged
        if before.rank == judged.rank == 0 or _alike(before, judged, _SAME_ERROR):
            break
        before = judged
    motion = best.motion if best is requested else _at_a_smaller_step(best.motion, requested.motion.verdict)
    return motion, _figures(trajectory, motion, best.seen)


def simulated_once(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
) -> JudgedMotion:
    """Return the simulation of a plan with the problem's integration step, with outcome and contacts.

    Arguments are those of ``simulate_and_check``.
    """
    options = problem.simulation
    try:
        motion = simulate(problem.arm, trajectory, joints, options, problem.limits)
    except SimulationError as error:
        diagnosis = error.diagnosis
        return JudgedMotion(
            not_simulated(problem.arm, trajectory, joints, options.step, diagnosis.reason, diagnosis.advice), seen=None
        )
    found = seen(problem, trajectory, motion)
    if found is None or found.touch is None:
        return JudgedMotion(motion, found)
    return JudgedMotion(replace(motion, verdict=_touched(motion.verdict, found.touch)), found)


def _figures(trajectory: JointTrajectory, simulated: SimulatedMotion, seen: Seen | None) -> Mapping[str, float]:
    """Return the figures of merit of a simulation: tracking errors, time at effort limits, and minimum clearances.

    After a contact, the clearances are those at the contact.
    """
    figures = {"tracking_error_rad": simulated.tracking_error, "saturated_time_s": simulated.saturated_time}
    errors = np.abs(simulated.base_positions - trajectory.base_positions)
    coordinates = trajectory.coordinates
    for name, unit, error in zip(coordinates.base_names, coordinates.base_units, errors.T, strict=True):
        figures[f"{name}_tracking_error_{unit}"] = float(np.max(error))
    if seen is not None:
        figures[WALLS] = seen.walls
        if seen.itself is not None:
            figures[ITSELF] = seen.itself
    return figures


def _alike(coarse: JudgedMotion, fine: JudgedMotion, share: float) -> bool:
    """Return whether halving the step gave the same outcome and nearly the same tracking error.

    The step size then does not explain why the arm fails to follow the plan. The result is False if the run with half
    of the step diverged or was not simulated.

    Args:
        coarse: run with the larger step.
        fine: run with half of that step.
        share: maximum relative change of the tracking error.
    """
    if fine.rank != coarse.rank or fine.motion.verdict.outcome == "diverged" or not fine.motion.verdict.is_run:
        return False
    error = coarse.motion.tracking_error
    return abs(error - fine.motion.tracking_error) <= share * error


def _touched(verdict: SimulationVerdict, touch: Touch) -> SimulationVerdict:
    """Return the outcome of a simulation with a contact, with a reason that also describes the drives."""
    return replace(
        verdict,
        outcome="touched",
        reason=f"{touch}; also, {verdict.reason}" if verdict.reason else str(touch),
        link=touch.link,
        obstacle=touch.obstacle,
        time=touch.time,
        advice=("a larger workspace.clearance or planner.wanted_gap", *verdict.advice),
    )


def _at_a_smaller_step(motion: SimulatedMotion, requested: SimulationVerdict) -> SimulatedMotion:
    """Return a run with a smaller step than the problem's, with an outcome that states both steps.

    Args:
        motion: the run with the smaller step.
        requested: outcome with the problem's step.
    """
    verdict = motion.verdict
    if verdict.followed:
        # Details of the run at too long a step say nothing about an arm that follows, and are not reproducible.
        reason = f"with steps of {verdict.step:g} s, but not with simulation.step = {requested.step:g} s"
        return replace(motion, verdict=replace(verdict, reason=reason))
    before = f"with simulation.step = {requested.step:g} s, {requested.outcome}: {requested.reason}"
    return replace(motion, verdict=replace(verdict, reason=f"{verdict.reason}; {before}" if verdict.reason else before))


def not_simulated(
    arm: Arm,
    trajectory: JointTrajectory,
    joints: JointStates,
    step: float,
    reason: str = "skipped",
    advice: tuple[str, ...] = (),
) -> SimulatedMotion:
    """Return the result for an arm that was not simulated, which rests in the start pose, without samples if it cannot.

    Args:
        arm: the arm.
        trajectory: the planned motion.
        joints: states of all revolute joints over the planned motion.
        step: integration step that was requested [s].
        reason: reason why the arm was not simulated, unless arms of its kind are not modelled.
        advice: changes that would make a simulation possible.
    """
    unmodelled = arm.unsimulated
    samples = 0 if unmodelled else len(trajectory.time)
    return SimulatedMotion(
        angles=np.repeat(joints.angles[:1], samples, axis=0),
        torques=np.zeros((samples, len(drive_names(arm)))),
        tracking_error=np.nan,
        saturated=False,
        base_positions=np.repeat(trajectory.base_positions[:1], samples, axis=0),
        verdict=SimulationVerdict(
            "not modelled" if unmodelled else "not simulated", step, unmodelled or reason, advice=advice
        ),
    )


def seen(
    problem: Problem,
    trajectory: JointTrajectory,
    simulated: SimulatedMotion,
) -> Seen | None:
    """Return first contact and minimum distances of a simulated arm.

    The angles of all revolute joints determine the pose. In space these include the roll of each ball joint, which the
    controller does not hold at exactly zero.

    Args:
        problem: the problem, which gives arm and obstacles.
        trajectory: the planned motion, which gives the times of the samples.
        simulated: motion of the simulated arm.

    Returns:
        First contact and minimum distances; None if nothing was simulated, or a planar arm left its plane.
    """
    angles = simulated.angles
    if not simulated.verdict.is_run or len(angles) < 2:
        return None
    arm = problem.arm
    if arm.dimension == 3:
        points = joint_positions_3d(arm, angles, simulated.base_positions)
    # Obstacles of planar problems exist in the plane only; yaws and rolls beyond rounding leave it.
    elif max(np.max(np.abs(angles[:, place::3])) for place in (0, 2)) > ROUNDING:
        return None
    else:
        points = arm.joint_positions_at(np.hstack((bends_from_revolutes(arm, angles), simulated.base_positions)))
    if arm.rigid_bodies:
        # The roll, which hardly differs from zero, counts for the links, but not for bodies on them.
        q = np.hstack((bends_from_revolutes(arm, angles), simulated.base_positions))
        whole = points_with_tool(arm, q)
        whole[:, own_joints(arm)] = points
        points = whole
        problem = problem_with_tool_links(problem)
    gaps = _as_far_as_needed(problem, points)
    walls = gaps.walls
    itself = gaps.itself
    # Where the base stands flush on a floor, the plan may penetrate to rounding; the arm is granted as much.
    deep = -problem.contact_tolerance
    touching = np.flatnonzero((walls.gap < deep) | (itself.gap < deep))
    touch = None
    if len(touching):
        first = int(touching[0])
        near = walls if walls.gap[first] < deep else itself
        link, arm = int(near.link[first]) - 1, problem.arm
        touch = Touch(
            arm.link_number(link), arm.link_name(link), gaps.other(near, first), float(trajectory.time[first])
        )
    own = _least(itself) if problem.arm.self_collision else None
    return Seen(touch, _least(walls), own)


def _least(near: NearestOfSamples) -> float:
    """Return the minimum clearance over all samples [m]; inf if nothing was within the search distance."""
    return float(np.min(near.gap, where=near.link > 0, initial=np.inf))


def _as_far_as_needed(problem: Problem, points: FloatArray) -> GapsAtSamples:
    """Return the clearances in all poses, capped at a search distance at which the minimum clearance is exact.

    A first pass over a few poses, with a large search distance, gives an upper bound on the minimum clearance. This
    bound is the search distance of the second pass, over all poses.

    Args:
        problem: the problem, which gives arm and obstacles.
        points: positions of joints and tip of n links at T samples, shape (T, n + 1, d) with d = 2 or 3 [m].
    """
    few = points[:: max(1, len(points) // _FIRST_LOOKS)]
    arm = problem.arm
    far = arm.length if arm.dimension == 2 else arm.link_length
    known = GapsAtSamples.from_poses(problem, few, far, arm.length)
    # Bodies exactly at the search distance are not found, so a distance of zero would not find contacts.
    least = _LEAST_REACH * arm.link_length
    walls = np.clip(1.001 * np.min(known.walls.gap), least, far)
    itself = np.clip(1.001 * np.min(known.itself.gap), least, arm.length)
    return GapsAtSamples.from_poses(problem, points, float(walls), float(itself))
