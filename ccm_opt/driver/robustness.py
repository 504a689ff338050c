"""Robustness of a verified plan: certified against errors of geometry, simulated against errors of load."""

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
"""Samples times links up to which every solve computes the survived joint error. Measured on the package's problems:
about 0.1 s."""
_DOUBLINGS = 6
"""Most doublings of a load in search of one that is not survived. Taste."""
_LOAD_STEPS = 12
"""Most bisection steps after that. Taste."""
_LOAD_PRECISION = 0.05
"""Relative width of the load interval at which bisection stops. Taste."""
_SMALL_LOAD = 0.1
"""Share of a load that is not survived, tried while no survived load is known. Taste."""

FAILED = frozenset(("touched", "diverged", "not simulated"))
"""Outcomes of a simulation that count as not survived; a drive at its limit that still follows survives."""
NOT_SIMULATED = "not simulated"
"""Outcome that says nothing about the arm: the simulation step is too long for the load."""


def tolerance_of(
    solution: Solution, *, simulated: bool = True, settings: Settings | None = None
) -> tuple[SurvivedError, ...]:
    """Return the largest error of each kind that a plan survives, one kind at a time.

    Args:
        solution: the plan.
        simulated: whether the survived payload and friction are computed too, by a few dozen simulations.
        settings: settings; the defaults when None.

    Returns:
        Survived errors of joints, link lengths, base heading, base position and walls, all certified; then payload and
        friction.
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
    """Return the largest errors that a verified motion survives; see ``tolerance_of``."""
    errors = survived_errors(problem, trajectory, settings.tolerance)
    if not simulated:
        return errors
    weight = float(np.sum(problem.arm.masses))
    coordinates = problem.arm.coordinates
    torques = np.abs(joints.torques[:, coordinates.drive_numbers[coordinates.bends]])
    speeds = np.abs(trajectory.bend_velocities)
    # Initial guess: friction whose torque at the highest speed equals the plan's peak torque.
    drag = float(torques.max(initial=0.0) / max(float(speeds.max(initial=0.0)), settings.tolerance.least))
    return (
        *errors,
        _survived_load("payload", "kg", weight, problem, trajectory, joints),
        _survived_load("friction", "N m s/rad", drag, problem, trajectory, joints),
    )


def tolerance_at_once(
    problem: Problem, trajectory: JointTrajectory, settings: Settings = DEFAULT_SETTINGS
) -> tuple[SurvivedError, ...]:
    """Return the joint error that a motion survives, or an empty tuple if computing the error would be slow."""
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
    """Return the largest load unknown to the controller that the arm survives, by bisection.

    ``first`` sets the order of magnitude. Only the loads tried are known to be survived: nothing is claimed about those
    between them.
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
        return SurvivedError(name, low, unit, "nothing; larger errors are not examined", limited=False)
    # Geometric bisection: the ends may differ by orders of magnitude.
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
    """Return a short description of where and when a plan fails under too great a load.

    Args:
        verdict: verdict on a simulation with too great a load.
        names: names of all revolutes, three to a joint.
    """
    if verdict.outcome == NOT_SIMULATED:
        return "the simulation; a smaller simulation.step allows larger values"
    when = "" if verdict.time is None else f" at t = {verdict.time:.4f} s"
    if verdict.outcome == "touched":
        return f"link {verdict.link} touches {verdict.obstacle}{when}"
    known = verdict.joint in names
    joint = f"joint {names.index(verdict.joint) // 3 + 1} ({verdict.joint})" if known else verdict.joint
    return f"{joint} departs from its plan for good{when}"


def _verdict(
    problem: Problem, disturbed: Disturbances, trajectory: JointTrajectory, joints: JointStates
) -> SimulationVerdict:
    """Return the verdict on a simulation under disturbances."""
    changed = replace(problem, simulation=replace(problem.simulation, disturbances=disturbed))
    return simulated_once(changed, trajectory, joints).motion.verdict
