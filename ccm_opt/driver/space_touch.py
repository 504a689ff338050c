"""Where the simulated arm in space first touches a surface or itself, at the samples of its motion."""

import numpy as np

from ccm_opt.driver.simulated_touch import Seen, Touch
from ccm_opt.driver.space_look_settings import DEFAULT_SPACE_LOOKS, SpaceLookSettings
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.frames import joint_positions_3d
from ccm_opt.solution import JointTrajectory, SimulatedMotion
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.room_at_samples import GapsAtSamples


def seen_in_space(
    problem: SpaceProblem,
    trajectory: JointTrajectory,
    simulated: SimulatedMotion,
    settings: SpaceLookSettings = DEFAULT_SPACE_LOOKS,
) -> Seen | None:
    """What a simulated arm comes near to; None when no step was run.

    Rolls that the controller does not hold at zero count too: the arm is where its revolutes put it.

    Args:
        problem: surfaces and arm.
        trajectory: the plan, for its times.
        simulated: what the arm did.
        settings: how far is looked.
    """
    if simulated.verdict.outcome == "not simulated" or len(simulated.angles) < 2:
        return None
    carried = np.sum(simulated.base_positions, axis=1)
    gaps = _as_far_as_needed(problem, joint_positions_3d(problem.arm, simulated.angles, carried), settings)
    walls = gaps.walls
    itself = gaps.itself
    touching = np.flatnonzero((walls.gap <= 0.0) | (itself.gap <= 0.0))
    touch = None
    if len(touching):
        first = int(touching[0])
        near = walls if walls.gap[first] <= 0.0 else itself
        touch = Touch(int(near.link[first]), gaps.other(near, first), float(trajectory.time[first]))
    own = float(np.min(itself.gap)) if problem.arm.self_collision else None
    least = float(np.min(walls.gap))
    return Seen(touch, least if least < gaps.reach else np.inf, own)


def _as_far_as_needed(problem: SpaceProblem, points: FloatArray, settings: SpaceLookSettings) -> GapsAtSamples:
    """The gaps of poses, looked for no farther than the least of them is, but up to a link's length."""
    most = problem.arm.link_length
    reach = most * settings.first_reach
    while True:
        gaps = GapsAtSamples.of(problem, points, min(reach, most))
        if float(np.min(gaps.walls.gap)) < gaps.reach or reach >= most:
            return gaps
        reach *= settings.farther
