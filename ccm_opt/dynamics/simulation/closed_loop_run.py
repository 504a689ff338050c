"""Simulation of an arm under its controller, and the verdict on how well the arm followed its plan.

Each step holds the control computed at its start and integrates q̈ = ABA(q, q̇, τ) by the classical Runge–Kutta method;
the axes that carry the base are additional, last coordinates. A planar motion under gravity in its plane stays exactly
planar, since all out-of-plane terms are products with zero.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.algorithms.arm_model import arm_model, in_plane_alone
from ccm_opt.dynamics.simulation.controller import (
    CompiledLoop,
    Noise,
    StepReference,
    disturbed_arm,
    loop_numbers,
    most_efforts,
    step_reference,
)
from ccm_opt.dynamics.simulation.simulation_record import (
    FEED_AXIS,
    PlanNeeds,
    SimulatedSteps,
    SimulationRecord,
    check_axes,
    check_finite,
    column_names,
    effort_units,
    falls_in_plane,
    largest_need,
)
from ccm_opt.dynamics.simulation.stability import check_stability
from ccm_opt.problem import Limits, SimulationOptions
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulatedMotion, SimulationOutcome, SimulationVerdict
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import angles_from_drives, drive_torques, drive_values

_LARGE_ERROR = 0.1
"""Tracking error of a joint above which the arm counts as not following its plan [rad]. Heuristic."""
_DIVERGED = 1.0
"""Tracking error of a joint at which the arm counts as having diverged, and the run is stopped [rad]. Heuristic."""

_CHUNK_STEPS = 200
"""Number of simulation steps per call of the compiled loop.

Heuristic: a call costs microseconds, and non-finite states are noticed only after the call.
"""


@dataclass(frozen=True)
class RunFault:
    """The first fault of a simulation run: a large or non-finite tracking error, or a saturated drive.

    Attributes:
        column: index of the faulty coordinate: of a drive that bends the arm, or behind these of an axis of the base.
        step: index of the state from the start of the run; state k is at the end of k steps.
        error: tracking error of the revolute in that state [rad]; not finite if the state is not finite.
    """

    column: int
    step: int
    error: float = 0.0


def first_large_error(steps: SimulatedSteps, most: float) -> RunFault | None:
    """Return the first state that is not finite, or in which a joint's tracking error exceeds ``most`` [rad].

    The result is None if there is no such state.
    """
    # If an error is NaN, the first comparison fails, too.
    if steps.worst_error <= most and steps.is_finite:
        return None
    # The axes of the base, last, may have errors in metres, for which there is no such bound.
    errors = np.pad(steps.errors, ((0, 0), (0, steps.efforts.shape[1] - steps.errors.shape[1])))
    bad = (errors > most) | ~np.isfinite(steps.states[1:]).all(axis=1)
    row, column = np.argwhere(bad)[0]
    return RunFault(int(column), steps.first + int(row) + 1, float(errors[row, column]))


def first_saturation(steps: SimulatedSteps, limit: FloatArray) -> RunFault | None:
    """Return the first drive whose effort is at its limit, with the state at which this effort starts to act.

    The result is None if no effort is at its limit.

    Args:
        steps: steps of the run.
        limit: effort limits of all drives, shape (W,) [N m, N].
    """
    full = np.abs(steps.efforts) >= limit
    if not full.any():
        return None
    row, column = np.argwhere(full)[0]
    return RunFault(int(column), steps.first + int(row))


def steps_before(steps: SimulatedSteps, fault: RunFault) -> SimulatedSteps:
    """Return the simulation steps that end before a faulty state; there may be none."""
    count = fault.step - steps.first - 1
    return replace(
        steps, states=steps.states[: count + 1], efforts=steps.efforts[:count], targets=steps.targets[:count]
    )


SATURATED_ADVICE = (
    "a smaller planner.effort_share, which leaves the controller more of the limits",
    "smaller disturbances",
)
CONTROL_ADVICE = (
    "a smaller simulation.step",
    "another simulation.bandwidth, or other simulation.gains",
    "the other simulation.controller",
)


def judge_run(
    record: SimulationRecord,
    names: tuple[str, ...],
    full: RunFault | None,
    large_error: RunFault | None,
    divergence: RunFault | None,
    needs: PlanNeeds | None,
) -> SimulationVerdict:
    """Return the verdict on a simulation run from saturated drives and tracking errors; contacts are not checked here.

    Args:
        record: record of the run.
        names: names of all drives that bend the arm, and of the axes of its base.
        full: first effort that reached its limit; None if there was none.
        large_error: first large tracking error; None if there was none.
        divergence: fault at which the run was stopped because the arm diverged; None if the run was not stopped.
        needs: greatest effort that the plan requires of the simulated arm; None if no drive has a limit.
    """
    step = record.step
    fault = divergence or large_error
    first = fault or full
    if first is None:
        return SimulationVerdict("followed", step)
    name = names[first.column]
    time = first.step * step
    met = "" if full is None else _describe_limit(full, record, names)
    # Once a drive is saturated, the controller has lost control of the arm, so saturation is the cause.
    saturated = full is not None and full.step <= first.step
    status: SimulationOutcome = "saturated"
    if fault is not None:
        status = "strayed" if divergence is None else "diverged"
        far = f"is {fault.error:.3g} rad off the plan" if np.isfinite(fault.error) else "is not finite"
        off = f"the simulated {name} {far} at {time:.4g} s"
        if divergence is None:
            off = f"{off}, and joints are up to {record.tracking_error:.3g} rad off in all"
        met = f"{off}; before that, {met}" if saturated else f"{off}, though no drive was at its limit before"
    # If the drives could follow the plan, the controller is to blame for saturating them.
    too_weak = needs is not None and needs.share > 1.0
    advice = _drive_advice(needs, names) if saturated or too_weak else CONTROL_ADVICE
    return SimulationVerdict(
        status, step, f"{met}{_describe_needs(needs, names)}", joint=name, time=time, advice=advice
    )


def _describe_needs(needs: PlanNeeds | None, names: tuple[str, ...]) -> str:
    """Return a clause on whether the drives could follow the plan, to append to the reason of a verdict."""
    if needs is None:
        return ""
    unit, name = needs.unit, names[needs.column]
    most = f"{needs.effort:.4g} {unit} of {name} at {needs.time:.4g} s, of which {needs.held:.4g} {unit} to hold still"
    plan = "follow this plan with the simulated arm"
    if needs.share > 1.0:
        return f"; the drives cannot {plan}: it takes {most}, and the limit is {needs.limit:.4g} {unit}"
    return f"; the drives could {plan}, at {100.0 * needs.share:.3g} % of a limit at most: {most}"


def _drive_advice(needs: PlanNeeds | None, names: tuple[str, ...]) -> tuple[str, ...]:
    if needs is None or needs.share <= 1.0:
        return SATURATED_ADVICE
    if names[needs.column] == FEED_AXIS:
        return (f"limits.feed_force above {needs.effort:.4g} N", *SATURATED_ADVICE)
    if needs.column >= needs.bending:
        kind = "force" if needs.unit == "N" else "torque"
        return (
            f"a {kind} in arm.base.axes above {needs.effort:.4g} {needs.unit} for {names[needs.column]}",
            *SATURATED_ADVICE,
        )
    return (f"a torque limit above {needs.effort:.4g} N m for {names[needs.column]}", *SATURATED_ADVICE)


def _describe_limit(full: RunFault, record: SimulationRecord, names: tuple[str, ...]) -> str:
    limit = float(record.limit[full.column])
    unit = record.units[full.column]
    kind = f"{'force' if unit == 'N' else 'torque'} limit of {limit:.4g} {unit}"
    met = f"the drive of {names[full.column]} reaches its {kind} at {full.step * record.step:.4g} s"
    return f"{met}; in all, drives are at limits for {record.full_steps * record.step:.3g} s"


def simulate(
    arm: Arm,
    trajectory: JointTrajectory,
    joints: JointStates,
    options: SimulationOptions,
    limits: Limits,
) -> SimulatedMotion:
    """Simulate an arm that tracks a planned trajectory under its controller.

    Args:
        arm: the arm as modelled by its controller; ``options.disturbances`` define how the simulated one differs.
        trajectory: trajectory with the sample times, and the motion of the feed axis if there is one.
        joints: motion of the trajectory for all revolutes; the arm starts with the angles and velocities of its first
            sample.
        options: gravity, step, controller and disturbances.
        limits: limits of the drives; efforts saturate at ``limits.torque`` and ``limits.feed_force`` where not None.

    Returns:
        Angles, base positions and applied torques at the trajectory's own samples, with a verdict on saturation and
        tracking errors. The run stops when the arm diverges; contacts are not checked here.

    Raises:
        SimulationError: before the run, if the axes are singular on the motion or the gains are unstable at this step.
    """
    if trajectory.duration <= 0.0:
        return SimulatedMotion(
            joints.angles,
            drive_torques(arm, joints.torques),
            tracking_error=0.0,
            saturated=False,
            base_positions=trajectory.base_positions,
            verdict=SimulationVerdict("followed", options.step),
        )
    run, state = _prepared(arm, trajectory, joints, options, limits)
    most = most_efforts(arm, limits)
    record = SimulationRecord.from_plan(trajectory.time, state[0], options.step, most, effort_units(arm))
    full: RunFault | None = None
    large_error: RunFault | None = None
    divergence: RunFault | None = None
    for steps in run.steps(state, options, _CHUNK_STEPS):
        divergence = first_large_error(steps, _DIVERGED)
        sound = steps if divergence is None else steps_before(steps, divergence)
        full = full or first_saturation(sound, most)
        large_error = large_error or first_large_error(sound, _LARGE_ERROR)
        record.add(sound)
        if divergence is not None:
            break
    needs = None
    if full or large_error or divergence:
        plant = disturbed_arm(arm, options.disturbances)
        needs = largest_need(plant, trajectory, joints, options.gravity, most)
    return record.motion(arm, judge_run(record, column_names(arm), full, large_error, divergence, needs))


def simulated_states(
    arm: Arm,
    trajectory: JointTrajectory,
    joints: JointStates,
    options: SimulationOptions,
    limits: Limits,
    interval: float,
) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Yield states of a simulated arm at a fixed time interval, for live display (paper, section 5.1, steps 5 to 7).

    Args:
        arm: the arm as modelled by its controller; ``options.disturbances`` define how the simulated one differs.
        trajectory: trajectory that determines the duration.
        joints: the motion for all revolutes.
        options: gravity, step, controller and disturbances.
        limits: limits of the efforts.
        interval: time between two states, rounded to whole steps [s].

    Yields:
        Time [s], angles of all revolutes, shape (3 * links,) [rad], and positions of the axes that carry the base, (k,)
        [m, rad].
    """
    run, state = _prepared(arm, trajectory, joints, options, limits)
    for steps in run.steps(state, options, max(1, round(interval / options.step))):
        check_finite(steps, column_names(arm), options.step)
        last = steps.states[-1, 0]
        bent, base = last[: steps.bending], last[steps.bending :][: len(arm.base_axes)]
        yield (steps.first + steps.count) * options.step, angles_from_drives(arm, bent), base


def _prepared(
    arm: Arm,
    trajectory: JointTrajectory,
    joints: JointStates,
    options: SimulationOptions,
    limits: Limits,
) -> tuple["_Run", FloatArray]:
    """Return a simulation run and its initial state (2, W), after all checks that may reject the run."""
    planar = _is_planar(arm, joints, options)
    if planar:
        arm = replace(arm, axes="zyx")  # in the plane only bends move, and both orders of axes are equivalent
    plant = disturbed_arm(arm, options.disturbances)
    check_axes(arm, joints.angles, planar=planar)
    check_stability(plant, joints.angles, trajectory.base_positions, options, planar=planar, believed=arm)

    positions, velocities = _coordinates(arm, trajectory, joints)
    reference = step_reference(trajectory.time, positions, velocities, options.step)
    run = _Run(
        closed_loop(plant, arm, options, limits, planar=planar), reference, Noise(options.disturbances, planar=planar)
    )
    return run, np.stack((positions[0], velocities[0]))


def _coordinates(arm: Arm, trajectory: JointTrajectory, joints: JointStates) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities of the drives that bend the arm and, last, of its base, each (T, n + k)."""
    # A fixed base has a column in the loop, which stays at zero.
    still = np.zeros((len(joints.angles), 0 if arm.base_axes else 1))
    positions = np.column_stack((drive_values(arm, joints.angles), trajectory.base_positions, still))
    velocities = np.column_stack((drive_values(arm, joints.velocities), trajectory.base_velocities, still))
    return positions, velocities


def closed_loop(
    plant: Arm, arm: Arm, options: SimulationOptions, limits: Limits, *, planar: bool = False
) -> CompiledLoop:
    """Return the control loop of a simulated arm (plant) and a controller with its own model of the arm.

    Args:
        plant: the simulated arm.
        arm: the arm as modelled by its controller.
        options: gravity, step and controller.
        limits: limits of the efforts.
        planar: whether the arm starts in its plane and no input of the loop leads out of it.
    """
    plant_model = arm_model(plant, options.gravity)
    believed_model = arm_model(arm, options.gravity)
    if planar:
        plant_model = in_plane_alone(plant_model)
        believed_model = in_plane_alone(believed_model)
    return CompiledLoop(plant_model, believed_model, loop_numbers(arm, options, limits))


def _is_planar(arm: Arm, joints: JointStates, options: SimulationOptions) -> bool:
    """Return whether reference and gravity keep the simulated arm exactly in its plane."""
    if arm.drives is not None or arm.carrier:
        return False
    # Yaw and roll, the first and third revolutes of every ball, are at rest at zero throughout.
    still = all(not np.any(values[:, place::3]) for values in (joints.angles, joints.velocities) for place in (0, 2))
    return still and falls_in_plane(arm, options.gravity)


@dataclass(frozen=True)
class _Run:
    """A control loop with its reference and measurement noise, ready to be simulated."""

    loop: CompiledLoop
    reference: StepReference
    noise: Noise

    def steps(self, state: FloatArray, options: SimulationOptions, size: int) -> Iterator[SimulatedSteps]:
        """Yield all simulation steps from an initial state, shape (2, W), in batches of `size` steps."""
        # Brakes hold the arm for this many steps while the reference moves on.
        brake_steps = round(options.disturbances.start_delay / options.step)
        for first in range(0, self.reference.steps, size):
            count = min(size, self.reference.steps - first)
            window, targets = self.reference.window(first, count)
            noise = self.noise.draw(count, self.loop.bending)
            states, efforts = self.loop.run(state, window, noise, max(0, brake_steps - first))
            yield SimulatedSteps(first, np.concatenate((state[None], states)), efforts, targets, self.loop.bending)
            state = states[-1]
