"""What a verified plan survives: errors of its geometry, certified, and errors of its loads, by simulations."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ccm_opt.core.arguments import expect
from ccm_opt.driver.arguments import expect_arguments
from ccm_opt.driver.closed_loop import simulated_once
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.problem import Disturbances, Problem
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulationVerdict, Solution, SurvivedError
from ccm_opt.problem.solution.records import FOLLOWED
from ccm_opt.verification.tolerance.error_model import joint_errors
from ccm_opt.verification.tolerance.survived_errors import survived_error, survived_errors

_MOST_AT_ONCE = 15_000
"""Samples times links up to which every solve looks for the joints' error. Measured on the problems of the package:
some 0.1 s."""
_DOUBLINGS = 6
"""Of a load until it is not survived. Taste."""
_LOAD_STEPS = 12
"""Most bisections after that. Taste."""
_LOAD_PRECISION = 0.05
"""Share of a load that its bisection leaves open. Taste."""
_SMALL_LOAD = 0.1
"""Share of a load that is not survived, tried while no load is known that is. Taste."""

FAILED = frozenset(("touched", "diverged", "not simulated"))
"""Outcomes of a simulation that a plan does not survive; a drive at its limit that still follows is none of them."""
NOT_SIMULATED = "not simulated"
"""The outcome that says nothing of the arm: the step of the simulation is too long for the load."""


def tolerance_of(
    solution: Solution, *, simulated: bool = True, settings: Settings | None = None
) -> tuple[SurvivedError, ...]:
    """Return the largest errors that a plan survives, one kind of error at a time.

    Args:
        solution: the plan.
        simulated: whether the payload and the friction that it survives are sought too, by some dozens of simulations.
        settings: numbers; the defaults when None.

    Returns:
        Of joints, link lengths, base heading, base position and walls, certified; then of payload and friction.
    """
    expect(solution, Solution, "a ccm_opt.Solution", "ccm_opt.solve makes one")
    expect_arguments(settings=settings, simulated=simulated)
    numbers = settings or DEFAULT_SETTINGS
    return motion_tolerance(
        solution.problem, solution.trajectory, solution.joints, simulated=simulated, settings=numbers
    )


def motion_tolerance(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    *,
    simulated: bool = True,
    settings: Settings = DEFAULT_SETTINGS,
) -> tuple[SurvivedError, ...]:
    """Return the same of a motion that passes every check of its problem."""
    errors = survived_errors(problem, trajectory, settings.tolerance)
    if not simulated:
        return errors
    weight = float(np.sum(problem.arm.masses))
    coordinates = problem.arm.coordinates
    torques = np.abs(joints.torques[:, coordinates.drive_numbers[coordinates.bends]])
    speeds = np.abs(trajectory.bend_velocities)
    # Friction that takes as much torque at the highest speed as the plan does at most.
    drag = float(torques.max(initial=0.0) / max(float(speeds.max(initial=0.0)), settings.tolerance.least))
    return (
        *errors,
        _survived_load("payload", "kg", weight, problem, trajectory, joints),
        _survived_load("friction", "N m s/rad", drag, problem, trajectory, joints),
    )


def tolerance_at_once(
    problem: Problem, trajectory: JointTrajectory, settings: Settings = DEFAULT_SETTINGS
) -> tuple[SurvivedError, ...]:
    """Return the error of the joints that a motion survives, where that takes next to no time; else nothing."""
    if len(trajectory.time) * problem.arm.links > _MOST_AT_ONCE:
        return ()
    return (survived_error(problem, trajectory, joint_errors(problem.arm), settings.tolerance),)


def _survived_load(
    name: str,
    unit: str,
    first: float,
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
) -> SurvivedError:
    """Return the largest load that the controller may not know of, by bisection.

    ``first`` is of its order of magnitude.

    That a load is survived does not prove that every smaller one is; nothing between those tried is claimed.
    """
    failed = FOLLOWED

    def survives(load: float) -> bool:
        nonlocal failed
        known = problem.simulation.disturbances
        disturbed = replace(known, payload=load) if name == "payload" else replace(known, friction=load)
        verdict = _verdict(problem, disturbed, trajectory, joints)
        if verdict.outcome not in FAILED:
            return True
        failed = verdict
        return False

    if not survives(0.0):
        return SurvivedError(name, 0.0, unit, _limiting_error(failed, joints.names))
    low = 0.0
    high = first
    for _ in range(_DOUBLINGS):
        if not survives(high):
            break
        low = high
        high *= 2.0
    else:
        return SurvivedError(name, low, unit, "nothing; larger errors are not looked at", limited=False)
    # Small loads are told apart by their order of magnitude, so ends that are far apart are parted by their mean ratio.
    for _ in range(_LOAD_STEPS):
        middle = np.sqrt(low * high) if low > 0.0 else _SMALL_LOAD * high
        if survives(middle):
            low = middle
        else:
            high = middle
        if high - low <= _LOAD_PRECISION * high:
            break
    where = _limiting_error(failed, joints.names)
    return SurvivedError(name, float(low), unit, where, limited=failed.outcome != NOT_SIMULATED)


def _limiting_error(verdict: SimulationVerdict, names: Sequence[str]) -> str:
    """Return what a plan does not survive, in a few words: where and when it begins to go wrong.

    Args:
        verdict: on a simulation with too great a load.
        names: of all revolutes, three a joint.
    """
    if verdict.outcome == NOT_SIMULATED:
        return "the simulation: a smaller simulation.step can look at more"
    when = "" if verdict.time is None else f" at t = {verdict.time:.4f} s"
    if verdict.outcome == "touched":
        return f"link {verdict.link} touches {verdict.obstacle}{when}"
    known = verdict.joint in names
    joint = f"joint {names.index(verdict.joint) // 3 + 1} ({verdict.joint})" if known else verdict.joint
    return f"{joint} leaves its plan for good{when}"


def _verdict(
    problem: Problem, disturbed: Disturbances, trajectory: JointTrajectory, joints: JointStates
) -> SimulationVerdict:
    """Return what becomes of the arm under disturbances."""
    changed = replace(problem, simulation=replace(problem.simulation, disturbances=disturbed))
    return simulated_once(changed, trajectory, joints).motion.verdict
