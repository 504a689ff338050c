"""Where the simulated arm in space first touches a surface or itself, at the samples of its motion."""

import numpy as np

from ccm_opt.driver.seen_arm import Seen, Touch
from ccm_opt.driver.space_look_settings import DEFAULT_SPACE_LOOKS, SpaceLookSettings
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.frames import joint_positions_3d
from ccm_opt.solution import JointTrajectory, SimulatedMotion
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.room_at_samples import GapsAtSamples, NearestOfSamples


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
    """The least gap [m]; inf where nothing was near at any sample."""
    return float(np.min(near.gap, where=near.link > 0, initial=np.inf))


def _as_far_as_needed(problem: SpaceProblem, points: FloatArray, settings: SpaceLookSettings) -> GapsAtSamples:
    """The gaps of poses, looked for no farther than the least of them is: of walls up to a link's length."""
    few = points[:: max(1, len(points) // settings.first_looks)]
    arm = problem.arm
    known = GapsAtSamples.of(problem, few, arm.link_length, arm.length)
    # What is just as near as the reach counts as not found, and so would what is in contact for a reach of zero.
    least = settings.least_reach * arm.link_length
    walls = np.clip(1.001 * np.min(known.walls.gap), least, arm.link_length)
    itself = np.clip(1.001 * np.min(known.itself.gap), least, arm.length)
    return GapsAtSamples.of(problem, points, float(walls), float(itself))
