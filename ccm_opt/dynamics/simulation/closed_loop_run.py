"""Simulates the controlled arm, and judges how it followed.

Each step holds the control computed at its start and integrates q̈ = ABA(q, q̇, τ) by the classical Runge–Kutta method; a
feed axis is one more coordinate, the last. A planar motion under gravity in its plane stays exactly planar: every term
out of the plane is a product with zero.
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
    step_reference,
)
from ccm_opt.dynamics.simulation.simulation_record import (
    PlanNeeds,
    SimulatedSteps,
    SimulationRecord,
    check_axes,
    check_finite,
    falls_in_plane,
    largest_need,
)
from ccm_opt.dynamics.simulation.stability import check_stability
from ccm_opt.problem import Limits, SimulationOptions
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulatedMotion, SimulationOutcome, SimulationVerdict
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Coordinates

_STRAYED = 0.1
"""Error of a joint above which the arm does not follow its plan [rad]. Taste."""
_LOST = 1.0
"""Error of a joint at which the arm has left its plan for good and the run is stopped [rad]. Taste: a joint that is off
by a whole radian follows nothing."""

_CHUNK_STEPS = 200
"""Steps in one call of the loop. Taste: a call costs microseconds, and a state that is not finite is noticed when its
call ends."""


@dataclass(frozen=True)
class RunFault:
    """Where a run first goes wrong.

    Attributes:
        column: of the state that is at fault: a revolute, or after them all the feed axis.
        step: number of the state from the run's begin; state k stands at k steps.
        error: of the revolute at that state [rad]; not finite when the state is not.
    """

    column: int
    step: int
    error: float = 0.0


def first_far_off(steps: SimulatedSteps, most: float) -> RunFault | None:
    """The first state that is not finite, or a revolute of which is farther from its reference than ``most`` [rad]."""
    # Where an error is no number, the first comparison fails, too.
    if steps.worst_error <= most and steps.is_finite:
        return None
    # The feed axis, last, has errors in metres, for which there is no such bound.
    errors = np.pad(steps.errors, ((0, 0), (0, 1)))
    bad = (errors > most) | ~np.isfinite(steps.states[1:]).all(axis=1)
    row, column = np.argwhere(bad)[0]
    return RunFault(int(column), steps.first + int(row) + 1, float(errors[row, column]))


def first_saturation(steps: SimulatedSteps, limit: FloatArray) -> RunFault | None:
    """Return the first effort at its limit, shape (W,) [N m, N]; it is held from that state on."""
    full = np.abs(steps.efforts) >= limit
    if not full.any():
        return None
    row, column = np.argwhere(full)[0]
    return RunFault(int(column), steps.first + int(row))


def steps_before(steps: SimulatedSteps, fault: RunFault) -> SimulatedSteps:
    """Return the steps of a run that end before the state at fault; there may be none."""
    count = fault.step - steps.first - 1
    return replace(
        steps, states=steps.states[: count + 1], efforts=steps.efforts[:count], targets=steps.targets[:count]
    )


SATURATED_ADVICE = ("a smaller planner.effort_share, which leaves the controller more", "smaller disturbances")
CONTROL_ADVICE = (
    "a smaller simulation.step",
    "another simulation.bandwidth, or other simulation.gains",
    "the other simulation.controller",
)


def judge_run(
    record: SimulationRecord,
    names: tuple[str, ...],
    full: RunFault | None,
    strayed: RunFault | None,
    lost: RunFault | None,
    needs: PlanNeeds | None,
) -> SimulationVerdict:
    """Return the verdict on a run, as far as drives and errors decide it; what the arm touches is not known here.

    Args:
        record: of the run.
        names: of all revolutes.
        full: where an effort first met its limit; None when none did.
        strayed: where a joint was first far off its reference; None when none was.
        lost: where the run was stopped, since the arm had left its plan for good; None when it was not.
        needs: what the plan takes of the drives of the simulated arm; None where no drive has a limit.
    """
    step = record.step
    fault = lost or strayed
    first = fault or full
    if first is None:
        return SimulationVerdict("followed", step)
    name = (*names, "the feed axis")[first.column]
    time = first.step * step
    met = "" if full is None else _describe_limit(full, record, names)
    # Once a drive has nothing left the controller does not decide any more what the arm does: that is the cause.
    saturated = full is not None and full.step <= first.step
    status: SimulationOutcome = "saturated"
    if fault is not None:
        status = "strayed" if lost is None else "diverged"
        far = f"is {fault.error:.3g} rad off the plan" if np.isfinite(fault.error) else "is not finite"
        off = f"the simulated {name} {far} at {time:.4g} s"
        if lost is None:
            off = f"{off}, and joints are up to {record.tracking_error:.3g} rad off in all"
        met = f"{off}; before that, {met}" if saturated else f"{off}, though no drive was at its limit before"
    # Drives that could follow the plan are not to blame for being full: the controller drove them there.
    too_weak = needs is not None and needs.share > 1.0
    advice = _drive_advice(needs, names) if saturated or too_weak else CONTROL_ADVICE
    return SimulationVerdict(
        status, step, f"{met}{_describe_needs(needs, names)}", joint=name, time=time, advice=advice
    )


def _describe_needs(needs: PlanNeeds | None, names: tuple[str, ...]) -> str:
    """Return what the drives could hold, to go on after the reason."""
    if needs is None:
        return ""
    unit = "N" if needs.column == len(names) else "N m"
    name = (*names, "the feed axis")[needs.column]
    most = f"{needs.effort:.4g} {unit} of {name} at {needs.time:.4g} s, of which {needs.held:.4g} {unit} to hold still"
    plan = "follow this plan with the simulated arm"
    if needs.share > 1.0:
        return f"; the drives cannot {plan}: it takes {most}, and the limit is {needs.limit:.4g} {unit}"
    return f"; the drives could {plan}, at {100.0 * needs.share:.3g} % of a limit at most: {most}"


def _drive_advice(needs: PlanNeeds | None, names: tuple[str, ...]) -> tuple[str, ...]:
    if needs is None or needs.share <= 1.0:
        return SATURATED_ADVICE
    if needs.column == len(names):
        return (f"limits.feed_force above {needs.effort:.4g} N", *SATURATED_ADVICE)
    return (f"a torque limit above {needs.effort:.4g} N m for {names[needs.column]}", *SATURATED_ADVICE)


def _describe_limit(full: RunFault, record: SimulationRecord, names: tuple[str, ...]) -> str:
    axis = full.column == len(names)
    limit = float(record.limit[full.column])
    kind = f"force limit of {limit:.4g} N" if axis else f"torque limit of {limit:.4g} N m"
    met = f"the drive of {(*names, 'the feed axis')[full.column]} meets its {kind} at {full.step * record.step:.4g} s"
    return f"{met}; in all, drives are at limits for {record.full_steps * record.step:.3g} s"


def simulate(
    arm: Arm,
    trajectory: JointTrajectory,
    joints: JointStates,
    options: SimulationOptions,
    limits: Limits,
) -> SimulatedMotion:
    """Simulate the arm tracking a trajectory.

    Args:
        arm: the arm as its controller knows it; ``options.disturbances`` say how the simulated one differs.
        trajectory: gives the sample times, and the motion of the feed axis when there is one.
        joints: the same motion for all revolutes; the arm starts on its first sample's angles and velocities.
        options: gravity, step, controller, disturbances.
        limits: efforts saturate at ``limits.torque`` and ``limits.feed_force`` when they are not None.

    Returns:
        Angles, base and applied torques at the trajectory's own samples, with a verdict on drives and errors. An arm
        that leaves its plan for good is not followed any further; what it touches is not looked at here.

    Raises:
        SimulationError: before the run, when the axes are singular on the motion or the gains are unstable at this
            step.
    """
    if trajectory.duration <= 0.0:
        return SimulatedMotion(
            joints.angles,
            joints.torques,
            tracking_error=0.0,
            saturated=False,
            base_positions=trajectory.base_positions,
            verdict=SimulationVerdict("followed", options.step),
        )
    run, state = _prepared(arm, trajectory, joints, options, limits)
    most = _most_efforts(limits, arm.coordinates)
    record = SimulationRecord.from_plan(trajectory.time, state[0], options.step, most)
    full: RunFault | None = None
    strayed: RunFault | None = None
    lost: RunFault | None = None
    for steps in run.steps(state, options, _CHUNK_STEPS):
        lost = first_far_off(steps, _LOST)
        sound = steps if lost is None else steps_before(steps, lost)
        full = full or first_saturation(sound, most)
        strayed = strayed or first_far_off(sound, _STRAYED)
        record.add(sound)
        if lost is not None:
            break
    needs = None
    if full or strayed or lost:
        plant = disturbed_arm(arm, options.disturbances)
        needs = largest_need(plant, trajectory, joints, options.gravity, most)
    return record.motion(arm.coordinates, judge_run(record, joints.names, full, strayed, lost, needs))


def simulated_states(
    arm: Arm,
    trajectory: JointTrajectory,
    joints: JointStates,
    options: SimulationOptions,
    limits: Limits,
    interval: float,
) -> Iterator[tuple[float, FloatArray, float]]:
    """Yield the same simulation one time interval after the other, for those who watch it (section 5.1, steps 5 to 7).

    Args:
        arm: as for ``simulate``, with the arguments that follow.
        trajectory: gives the duration.
        joints: the motion for all revolutes.
        options: gravity, step, controller, disturbances.
        limits: of the efforts.
        interval: time between two states, rounded to steps [s].

    Yields:
        Time [s], angles of all revolutes, shape (3 * links,) [rad], and position of the base on its feed axis [m].
    """
    run, state = _prepared(arm, trajectory, joints, options, limits)
    for steps in run.steps(state, options, max(1, round(interval / options.step))):
        check_finite(steps, joints.names, options.step)
        last = steps.states[-1, 0]
        yield (steps.first + steps.count) * options.step, last[:-1], float(last[-1])


def _most_efforts(limits: Limits, coordinates: Coordinates) -> FloatArray:
    """Limits of the efforts of all revolutes and, last, of the thrust along the feed axis, shape (3 * links + 1,)."""
    efforts = limits.of_drives(coordinates).effort
    # A fixed base has a column in the loop, but no drive.
    return np.append(efforts, np.full(coordinates.revolutes + 1 - len(efforts), np.inf))


def _prepared(
    arm: Arm,
    trajectory: JointTrajectory,
    joints: JointStates,
    options: SimulationOptions,
    limits: Limits,
) -> tuple["_Run", FloatArray]:
    """Return what is run, and the state it starts from; everything that can be refused is refused here."""
    planar = _is_planar(arm, joints, options)
    if planar:
        arm = replace(arm, axes="zyx")  # in the plane only bends move, and both orders of axes are the same arm
    plant = disturbed_arm(arm, options.disturbances)
    check_axes(arm, joints.angles, planar=planar)
    check_stability(plant, joints.angles, options, planar=planar, believed=arm)

    positions, velocities = _coordinates(trajectory, joints)
    reference = step_reference(trajectory.time, positions, velocities, options.step)
    run = _Run(
        closed_loop(plant, arm, options, limits, planar=planar), reference, Noise(options.disturbances, planar=planar)
    )
    return run, np.stack((positions[0], velocities[0]))


def _coordinates(trajectory: JointTrajectory, joints: JointStates) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities of all revolutes and, last, of the base along its heading, shape (T, 3 * links + 1)."""
    advance = trajectory.coordinates.advance
    positions = np.column_stack((joints.angles, advance(trajectory.positions)))
    velocities = np.column_stack((joints.velocities, advance(trajectory.velocities)))
    return positions, velocities


def closed_loop(
    plant: Arm, arm: Arm, options: SimulationOptions, limits: Limits, *, planar: bool = False
) -> CompiledLoop:
    """Return the loop of a plant and of the arm that its controller believes in.

    Args:
        plant: the arm that moves.
        arm: as its controller knows it.
        options: gravity, step, controller.
        limits: of the efforts.
        planar: whether the arm starts in its plane and nothing that the loop is given leads out of it.
    """
    plant_model = arm_model(plant, options.gravity)
    believed_model = arm_model(arm, options.gravity)
    if planar:
        plant_model = in_plane_alone(plant_model)
        believed_model = in_plane_alone(believed_model)
    return CompiledLoop(plant_model, believed_model, loop_numbers(arm, options, limits))


def _is_planar(arm: Arm, joints: JointStates, options: SimulationOptions) -> bool:
    """Return whether reference and gravity leave the arm exactly in its plane."""
    # Yaw and roll, the first and third revolutes of every ball, are at rest at zero throughout.
    still = all(not np.any(values[:, place::3]) for values in (joints.angles, joints.velocities) for place in (0, 2))
    return still and falls_in_plane(arm, options.gravity)


@dataclass(frozen=True)
class _Run:
    """A loop, what it follows, and what disturbs its sensors."""

    loop: CompiledLoop
    reference: StepReference
    noise: Noise

    def steps(self, state: FloatArray, options: SimulationOptions, size: int) -> Iterator[SimulatedSteps]:
        """Yield all steps from a state on, shape (2, W), so many at a time."""
        # Brakes hold the arm for this many steps while the reference moves on.
        held = round(options.disturbances.start_delay / options.step)
        for first in range(0, self.reference.steps, size):
            count = min(size, self.reference.steps - first)
            window, targets = self.reference.window(first, count)
            # The last column is the feed axis, which is measured exactly.
            noise = self.noise.draw(count, targets.shape[1] - 1)
            states, efforts = self.loop.run(state, window, noise, max(0, held - first))
            yield SimulatedSteps(first, np.concatenate((state[None], states)), efforts, targets)
            state = states[-1]
