"""The simulated motion held against the obstacles: what the arm does is checked as strictly as what was planned."""

from collections.abc import Mapping

import numpy as np

from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.dynamics.simulation.closed_loop_run import simulate
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.jointed.frames import bends_from_revolutes
from ccm_opt.problem import Problem
from ccm_opt.solution import Check, JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.verification.link_motion import ChainMotion
from ccm_opt.verification.selfcollision import check_self_collision
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.wall_clearance import check_walls

WALLS = "simulated_least_wall_clearance_m"
"""Figure of the least distance to walls."""
ITSELF = "simulated_least_self_clearance_m"
"""Figure of the least distance between links."""


def simulate_and_check(
    problem: Problem, trajectory: JointTrajectory, joints: JointStates, settings: Settings = DEFAULT_SETTINGS
) -> tuple[SimulatedMotion, Mapping[str, float]]:
    """Simulate a planned motion.

    Args:
        problem: arm, limits, obstacles, simulation options.
        trajectory: the plan.
        joints: the same for all revolutes.
        settings: of the simulation, and of the verifier that looks at what the arm did.

    Returns:
        What the arm does, and its figures of merit, named with their units.

    Raises:
        SimulationError: the simulation cannot run.
    """
    simulated = simulate(
        problem.arm, trajectory, joints, problem.simulation, problem.limits, settings=settings.simulation
    )
    return simulated, simulated_figures(problem, trajectory, simulated, settings.verification)


def simulated_figures(
    problem: Problem,
    trajectory: JointTrajectory,
    simulated: SimulatedMotion,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> Mapping[str, float]:
    """Tracking errors, and least clearances of the simulated motion at all times."""
    figures = {"tracking_error_rad": simulated.tracking_error}
    errors = np.abs(simulated.base_positions - trajectory.base_positions)
    for name, error in zip(trajectory.coordinates.base_names, errors.T, strict=True):
        figures[f"{name}_tracking_error_m"] = float(np.max(error))
    # The checks carry the same names for a plan; here they are figures, for a simulated motion promises nothing.
    names = {"wall clearance": WALLS, "self-collision": ITSELF}
    checks = simulated_checks(problem, trajectory, simulated, settings)
    return figures | {names[check.name]: check.worst for check in checks if check.name in names}


def simulated_checks(
    problem: Problem,
    trajectory: JointTrajectory,
    simulated: SimulatedMotion,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> tuple[Check, ...]:
    """Clearance of the simulated arm from walls and itself, linear between samples; nothing once it left its plane."""
    angles = simulated.angles
    # Obstacles are known in the plane alone, which yaws and rolls beyond rounding leave.
    if len(angles) < 2 or max(np.max(np.abs(angles[:, place::3])) for place in (0, 2)) > ROUNDING:
        return ()
    # The simulated motion is checked by the code that checks planned ones.
    positions = np.column_stack((bends_from_revolutes(angles), simulated.base_positions))
    motion = ChainMotion(problem.arm, trajectory.time, positions)
    walls = check_walls(motion, problem.workspace, settings)
    return (walls, check_self_collision(motion, settings)) if problem.arm.self_collision else (walls,)
