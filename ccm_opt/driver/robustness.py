"""Errors that a verified plan tolerates: errors of geometry by certificate, errors of load by simulation."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ccm_opt.core.arguments import expect
from ccm_opt.core.errors import ProblemError
from ccm_opt.driver.arguments import expect_arguments, refuse_sections
from ccm_opt.driver.closed_loop import simulated_once
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.problem import Disturbances, Problem
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulationVerdict, Solution, ToleratedError
from ccm_opt.problem.solution.records import FOLLOWED
from ccm_opt.problem.tool_rules import refuse_tool
from ccm_opt.verification.tolerance.error_model import joint_errors
from ccm_opt.verification.tolerance.tolerated_errors import tolerated_error, tolerated_errors

_MOST_AT_ONCE = 15_000
"""Number of samples times number of links up to which ``solve`` always computes the tolerated joint error. Measured on
the example problems: about 0.1 s."""
_DOUBLINGS = 6
"""Maximum number of times that a load is doubled in search of one that is not tolerated. Heuristic."""
_LOAD_STEPS = 12
"""Maximum number of bisection steps between a tolerated and an untolerated load. Heuristic."""
_LOAD_PRECISION = 0.05
"""Relative width of the load interval at which the bisection stops. Heuristic."""
_SMALL_LOAD = 0.1
"""Fraction of the smallest untolerated load that is tried next while 0 is the only load known to be tolerated.
Heuristic."""

FAILED = frozenset(("touched", "diverged", "not simulated"))
"""Outcomes of a simulation under a load that count as failure to tolerate the load; saturation of a drive does not."""
NOT_SIMULATED = "not simulated"
"""Outcome of a simulation whose step is too long for the load; it says nothing about how the arm would move."""


def tolerance_of(
    solution: Solution, *, simulated: bool = True, settings: Settings | None = None
) -> tuple[ToleratedError, ...]:
    """Return the maximum error of each kind that a plan tolerates while all other errors are 0.

    Args:
        solution: the plan.
        simulated: whether to compute maximum payload and friction too, by a few dozen simulations.
        settings: settings of all stages of planning; None for the defaults.

    Returns:
        Tolerated errors of joints, link lengths, base heading, base position and walls, all certified; then payload and
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
) -> tuple[ToleratedError, ...]:
    """Return the maximum error of each kind that a verified motion tolerates while all other errors are 0.

    Args:
        problem: the problem.
        trajectory: the motion.
        joints: states of all revolute joints over the motion.
        simulated: whether to compute maximum payload and friction too, by simulation.
        settings: settings of all stages of planning.
    """
    refuse_tool(problem.arm, "the search for tolerated errors")
    refuse_sections(problem.arm, "tolerated errors")
    if problem.arm.carrier:
        raise ProblemError("tolerated errors are not certified for arms on arm.base.axes")
    errors = tolerated_errors(problem, trajectory, settings.tolerance)
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
        _tolerated_load("payload", "kg", weight, problem, trajectory, joints),
        _tolerated_load("friction", "N m s/rad", drag, problem, trajectory, joints),
    )


def tolerance_at_once(
    problem: Problem, trajectory: JointTrajectory, settings: Settings = DEFAULT_SETTINGS
) -> tuple[ToleratedError, ...]:
    """Return the joint error that a motion tolerates, as the only entry; empty if it is not certified.

    That is for motions that are too long, for arms on other base axes than a feed axis, for arms with bodies, and for
    sections that bend evenly, whose joints do not err by themselves.
    """
    uncertified = bool(problem.arm.carrier) or problem.arm.drives is not None or bool(problem.arm.rigid_bodies)
    if uncertified or len(trajectory.time) * problem.arm.links > _MOST_AT_ONCE:
        return ()
    return (tolerated_error(problem, trajectory, joint_errors(problem.arm), settings.tolerance),)


def _tolerated_load(
    name: str,
    unit: str,
    first: float,
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
) -> ToleratedError:
    """Return the maximum load, unknown to the controller, that the simulated arm tolerates, found by bisection.

    The result is the largest load that was tried and tolerated; smaller loads that were not tried may still fail.

    Args:
        name: "payload" or "friction".
        unit: unit of the load.
        first: first load tried, which sets the order of magnitude.
        problem: the problem.
        trajectory: the planned motion.
        joints: states of all revolute joints over the planned motion.
    """
    failed = FOLLOWED

    def follows(load: float) -> bool:
        nonlocal failed
        known = problem.simulation.disturbances
        disturbed = replace(known, payload=load) if name == "payload" else replace(known, friction=load)
        verdict = _verdict(problem, disturbed, trajectory, joints)
        if verdict.outcome not in FAILED:
            return True
        failed = verdict
        return False

    if not follows(0.0):
        return ToleratedError(name, 0.0, unit, _limiting_error(failed, joints.names))
    low = 0.0
    high = first
    for _ in range(_DOUBLINGS):
        if not follows(high):
            break
        low = high
        high *= 2.0
    else:
        return ToleratedError(name, low, unit, "nothing; larger errors are not examined", limited=False)
    # Geometric bisection: the ends may differ by orders of magnitude.
    for _ in range(_LOAD_STEPS):
        middle = np.sqrt(low * high) if low > 0.0 else _SMALL_LOAD * high
        if follows(middle):
            low = middle
        else:
            high = middle
        if high - low <= _LOAD_PRECISION * high:
            break
    where = _limiting_error(failed, joints.names)
    return ToleratedError(name, float(low), unit, where, limited=failed.outcome != NOT_SIMULATED)


def _limiting_error(verdict: SimulationVerdict, names: Sequence[str]) -> str:
    """Return a description of where and when the simulated arm fails under a load that is not tolerated.

    Args:
        verdict: outcome of the simulation with that load.
        names: names of all revolute joints, three per ball joint.
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
    """Return the outcome of a simulation under disturbances."""
    changed = replace(problem, simulation=replace(problem.simulation, disturbances=disturbed))
    return simulated_once(changed, trajectory, joints).motion.verdict
