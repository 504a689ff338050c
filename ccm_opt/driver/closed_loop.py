"""A planned motion simulated and judged: whatever comes of it, the plan is kept, and the verdict says what was seen."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.driver.seen_arm import Seen, Touch
from ccm_opt.dynamics.simulation.closed_loop_run import simulate
from ccm_opt.dynamics.simulation.simulation_settings import DEFAULT_SIMULATION, SimulationSettings
from ccm_opt.errors import SimulationError
from ccm_opt.solution import JointStates, JointTrajectory, SimulatedMotion, SimulationOutcome, SimulationVerdict
from ccm_opt.space.problem import AnyProblem, SpaceProblem
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

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
    problem: AnyProblem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: SimulationSettings = DEFAULT_SIMULATION,
    looks: VerificationSettings = DEFAULT_VERIFICATION,
) -> tuple[SimulatedMotion, Mapping[str, float]]:
    """Simulate a planned motion and judge it; a motion that is not followed is a result, never an error.

    An arm that does not follow is simulated with smaller steps, for the fault may be the step's. The first run in which
    it follows counts; else the one asked for, unless smaller steps take the arm farther.

    Args:
        problem: arm, limits, obstacles, simulation options.
        trajectory: the plan.
        joints: the same for all revolutes.
        settings: of the simulation.
        looks: of the verifier that looks at what the arm did in the plane.

    Returns:
        What the arm does, with the verdict on it, and its figures of merit, named with their units.
    """
    asked = simulated_once(problem, trajectory, joints, settings, looks)
    best = asked
    before = asked
    step = problem.simulation.step
    for _ in range(settings.step_halvings):
        if best.rank == 0:
            break
        step = 0.5 * step
        finer = replace(problem, simulation=replace(problem.simulation, step=step))
        judged = simulated_once(finer, trajectory, joints, settings, looks)
        # Among equals the smaller step is the more exact one.
        if judged.rank < asked.rank and judged.rank <= best.rank:
            best = judged
        if _alike(before, judged, settings.same_error):
            break
        before = judged
    motion = best.motion if best is asked else _at_a_smaller_step(best.motion, asked.motion.verdict)
    return motion, _figures(trajectory, motion, best.seen)


def simulated_once(
    problem: AnyProblem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: SimulationSettings = DEFAULT_SIMULATION,
    looks: VerificationSettings = DEFAULT_VERIFICATION,
) -> JudgedMotion:
    """Simulate a planned motion with the problem's own step and judge it; arguments as for ``simulate_and_check``."""
    options = problem.simulation
    try:
        motion = simulate(problem.arm, trajectory, joints, options, problem.limits, settings=settings)
    except SimulationError as error:
        diagnosis = error.diagnosis
        return JudgedMotion(
            not_simulated(trajectory, joints, options.step, diagnosis.reason, diagnosis.advice), seen=None
        )
    if isinstance(problem, SpaceProblem):
        from ccm_opt.driver.space_touch import seen_in_space  # noqa: PLC0415 - each kind of problem

        seen = seen_in_space(problem, trajectory, motion)
    else:
        from ccm_opt.driver.simulated_touch import seen_in_plane  # noqa: PLC0415 - has a verifier

        seen = seen_in_plane(problem, trajectory, motion, looks)
    if seen is None or seen.touch is None:
        return JudgedMotion(motion, seen)
    return JudgedMotion(replace(motion, verdict=_touched(motion.verdict, seen.touch)), seen)


def _figures(trajectory: JointTrajectory, simulated: SimulatedMotion, seen: Seen | None) -> Mapping[str, float]:
    """Tracking errors, time at limits, and least clearances at all times; where it touches, those of a contact."""
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
    """Whether half the step changed so little that the step is not what keeps the arm from following."""
    if fine.rank != coarse.rank or fine.motion.verdict.outcome in ("diverged", "not simulated"):
        return False
    error = coarse.motion.tracking_error
    return abs(error - fine.motion.tracking_error) <= share * error


def _touched(verdict: SimulationVerdict, touch: Touch) -> SimulationVerdict:
    """The verdict on a run in which the arm touches something, with what its drives did besides."""
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
    """A run with a smaller step than asked for, whose verdict says so."""
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
    """An arm that was not simulated: it stands where the plan begins.

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
