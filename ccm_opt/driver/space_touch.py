"""Where the simulated arm in space first touches a surface or itself, at the samples of its motion."""

import numpy as np

from ccm_opt.driver.simulated_touch import Seen, Touch
from ccm_opt.jointed.frames import joint_positions_3d
from ccm_opt.solution import JointTrajectory, SimulatedMotion
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.room_at_samples import GapsAtSamples


def seen_in_space(problem: SpaceProblem, trajectory: JointTrajectory, simulated: SimulatedMotion) -> Seen | None:
    """What a simulated arm comes near to; None when no step was run.

    Rolls that the controller does not hold at zero count too: the arm is where its revolutes put it.

    Args:
        problem: surfaces and arm.
        trajectory: the plan, for its times.
        simulated: what the arm did.
    """
    if simulated.verdict.outcome == "not simulated" or len(simulated.angles) < 2:
        return None
    carried = np.sum(simulated.base_positions, axis=1)
    gaps = GapsAtSamples.of(problem, joint_positions_3d(problem.arm, simulated.angles, carried))
    walls = gaps.walls
    itself = gaps.itself
    touching = np.flatnonzero((walls.gap <= 0.0) | (itself.gap <= 0.0))
    touch = None
    if len(touching):
        first = int(touching[0])
        near = walls if walls.gap[first] <= 0.0 else itself
        touch = Touch(int(near.link[first]), gaps.other(near, first), float(trajectory.time[first]))
    own = float(np.min(itself.gap)) if problem.arm.self_collision else None
    return Seen(touch, float(np.min(walls.gap)), own)
