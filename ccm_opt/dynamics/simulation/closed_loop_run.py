"""The arm under its controller, step by step: the closed loop is compiled as a whole (section 5.4).

Each step holds the control computed at its start and integrates q̈ = ABA(q, q̇, τ) by the classical Runge–Kutta method; a
feed axis is one more coordinate, the last. A planar motion under gravity in its plane stays exactly planar: every term
out of the plane is a product with zero.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.algorithms.arm_model import arm_model
from ccm_opt.dynamics.runtime.back_end import choose_back_end
from ccm_opt.dynamics.runtime.control_law import ClosedLoop
from ccm_opt.dynamics.simulation.controller import loop_parameters
from ccm_opt.dynamics.simulation.disturbances import Noise, disturbed_arm
from ccm_opt.dynamics.simulation.reference import StepReference, hermite, step_reference
from ccm_opt.dynamics.simulation.stability import check_stability
from ccm_opt.errors import Diagnosis, ProblemError, SimulationError
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.problem import Limits, SimulationOptions
from ccm_opt.solution import JointStates, JointTrajectory, SimulatedMotion

CHUNK = 200  # steps in one call of the loop
LARGEST_BEND = 1.3  # rad: nearer 90° the Z-Y-X ball is too close to singular to be simulated in 3-D


def simulate(
    arm: Arm, trajectory: JointTrajectory, joints: JointStates, options: SimulationOptions, limits: Limits
) -> SimulatedMotion:
    """Simulate the arm tracking a trajectory.

    Args:
        arm: the arm as its controller knows it; ``options.disturbances`` tell how the simulated one differs.
        trajectory: gives the sample times, and the motion of the feed axis when there is one.
        joints: the same motion for all revolutes; the arm starts on its first sample's angles and velocities.
        options: gravity, step, controller, disturbances.
        limits: efforts saturate at ``limits.torque`` and ``limits.feed_force`` when they are not None.

    Returns:
        Angles, base and applied torques at the trajectory's own samples.

    Raises:
        SimulationError: when the axes are singular on the motion, the gains are unstable at this step, or a joint
            angle stops being finite.
    """
    if trajectory.duration <= 0.0:
        return SimulatedMotion(
            joints.angles,
            joints.torques,
            tracking_error=0.0,
            saturated=False,
            base_positions=trajectory.base_positions,
        )
    run, state = _prepared(arm, trajectory, joints, options, limits)
    record = _Record.empty(trajectory.time, _coordinates(trajectory, joints)[0], options.step)
    for chunk in run.chunks(state, options):
        _check_finite(chunk, joints.names, options.step)
        record.add(chunk)
    return record.motion(limits, arm.coordinates)


def simulated_states(
    arm: Arm,
    trajectory: JointTrajectory,
    joints: JointStates,
    options: SimulationOptions,
    limits: Limits,
    interval: float,
) -> Iterator[tuple[float, FloatArray, float]]:
    """The same simulation one time interval after the other, for those who watch it (section 5.1, steps 5 to 7).

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
    for chunk in run.chunks(state, options, max(1, round(interval / options.step))):
        _check_finite(chunk, joints.names, options.step)
        last = chunk.states[-1, 0]
        yield (chunk.first + len(chunk.efforts)) * options.step, last[:-1], float(last[-1])


def _prepared(
    arm: Arm, trajectory: JointTrajectory, joints: JointStates, options: SimulationOptions, limits: Limits
) -> tuple["_Run", FloatArray]:
    """What is run, and the state it starts from; everything that can be refused is refused here."""
    planar = _is_planar(joints, options)
    if planar:
        arm = replace(arm, axes="zyx")  # in the plane only bends move, and both orders of axes are the same arm
    plant = disturbed_arm(arm, options.disturbances)
    _check_axes(arm, joints.angles, planar=planar)
    check_stability(plant, joints.angles, options, planar=planar)
    positions, velocities = _coordinates(trajectory, joints)
    reference = step_reference(trajectory.time, positions, velocities, options.step)
    run = _Run(closed_loop(plant, arm, options, limits), reference, Noise(options.disturbances, planar=planar))
    return run, np.stack((positions[0], velocities[0]))


def _coordinates(trajectory: JointTrajectory, joints: JointStates) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities of all revolutes and, last, of the base along its heading, shape (T, 3 * links + 1)."""
    advance = trajectory.coordinates.advance
    positions = np.column_stack((joints.angles, advance(trajectory.positions)))
    velocities = np.column_stack((joints.velocities, advance(trajectory.velocities)))
    return positions, velocities


def closed_loop(plant: Arm, arm: Arm, options: SimulationOptions, limits: Limits) -> ClosedLoop:
    """The loop of a plant and of the arm that its controller believes in, compiled when the machine can."""
    plant_model = arm_model(plant, options.gravity)
    believed_model = arm_model(arm, options.gravity)
    parameters = loop_parameters(arm, options, limits)
    return choose_back_end(plant_model.structure).loop(plant_model, believed_model, parameters)


def check_options(arm: Arm, options: SimulationOptions) -> None:
    """Refuse what no motion of the arm could be simulated with, before one is planned.

    Args:
        arm: the arm; its straight pose stands for all.
        options: gravity, step, controller and gains.

    Raises:
        ProblemError: saying which setting is at fault and what would do.
    """
    straight, still = np.zeros((1, 3 * arm.links)), float(options.gravity[1]) == 0.0
    try:
        _check_axes(replace(arm, axes="zyx") if still else arm, straight, planar=still)
        check_stability(disturbed_arm(arm, options.disturbances), straight, options, planar=still)
    except SimulationError as error:
        raise ProblemError(f"the simulation cannot run: {error.diagnosis}") from error


@dataclass(frozen=True)
class _Chunk:
    """Some steps: states at their ends and the one before the first, efforts held, reference at their ends."""

    first: int
    states: FloatArray
    efforts: FloatArray
    targets: FloatArray


@dataclass(frozen=True)
class _Run:
    """A loop, what it follows, and what disturbs its sensors."""

    loop: ClosedLoop
    reference: StepReference
    noise: Noise

    def chunks(self, state: FloatArray, options: SimulationOptions, size: int = CHUNK) -> Iterator[_Chunk]:
        """All steps from a state on, shape (2, W), some at a time."""
        held = round(options.disturbances.start_delay / options.step)
        for first in range(0, self.reference.steps, size):
            count = min(size, self.reference.steps - first)
            window, targets = self.reference.window(first, count)
            noise = self.noise.draw(count, targets.shape[1] - 1)
            states, efforts = self.loop.run(state, window, noise, max(0, held - first))
            yield _Chunk(first, np.concatenate((state[None], states)), efforts, targets)
            state = states[-1]


@dataclass
class _Record:
    """What is kept of the simulated motion, filled chunk by chunk; the feed axis comes last."""

    step: float
    places: FloatArray  # samples in units of steps
    positions: FloatArray
    efforts: FloatArray
    tracking_error: float = 0.0
    largest: FloatArray | float = 0.0  # effort of each joint

    @classmethod
    def empty(cls, time: FloatArray, positions: FloatArray, step: float) -> "_Record":
        return cls(step, time / step, positions.copy(), np.zeros_like(positions))

    def add(self, chunk: _Chunk) -> None:
        """Interpolate a chunk at the samples inside it."""
        count = len(chunk.efforts)
        local = self.places - chunk.first
        here = np.flatnonzero((local >= 0.0) & (local <= count + 1e-9))
        index = np.minimum((local[here] + 1e-9).astype(int), count - 1)
        self.positions[here] = hermite(local[here] - index, self.step, chunk.states[index], chunk.states[index + 1])
        self.efforts[here] = chunk.efforts[index]
        error = float(np.max(np.abs(chunk.states[1:, 0, :-1] - chunk.targets[:, :-1])))
        self.tracking_error = max(self.tracking_error, error)
        self.largest = np.maximum(self.largest, np.max(np.abs(chunk.efforts), axis=0))

    def motion(self, limits: Limits, coordinates: Coordinates) -> SimulatedMotion:
        drives = coordinates.drive_count  # a fixed base has a column in the loop, but no drive
        largest = np.asarray(self.largest)[:drives]
        return SimulatedMotion(
            angles=self.positions[:, : coordinates.revolutes].copy(),
            torques=self.efforts[:, : coordinates.revolutes].copy(),
            tracking_error=self.tracking_error,
            saturated=bool(np.any(largest >= limits.of_drives(coordinates).effort)),
            base_positions=self.positions[:, coordinates.revolutes : drives].copy(),
        )


def _is_planar(joints: JointStates, options: SimulationOptions) -> bool:
    """Whether reference and gravity leave the arm exactly in its plane."""
    still = all(not np.any(values[:, place::3]) for values in (joints.angles, joints.velocities) for place in (0, 2))
    return still and float(options.gravity[1]) == 0.0


def _check_axes(arm: Arm, angles: FloatArray, *, planar: bool) -> None:
    """Refuse motions on which the ball joints are singular."""
    if arm.axes == "zyz":
        raise SimulationError(
            Diagnosis(
                reason="arm.axes = 'zyz' is singular where a joint is straight: no simulation out of the plane",
                stage="simulation",
                advice=('arm.axes = "zyx"', "gravity in the plane: simulation.gravity[1] = 0"),
            )
        )
    largest = float(np.max(np.abs(angles[:, 1::3])))
    if not planar and largest > LARGEST_BEND:
        raise SimulationError(
            Diagnosis(
                reason=f"a bend reaches {largest:.3g} rad while the arm moves in 3-D; Z-Y-X balls are singular at 90°",
                stage="simulation",
                advice=(f"bends within {LARGEST_BEND} rad, or gravity in the plane (gravity[1] = 0)",),
                evidence={"largest_bend": largest, "limit": LARGEST_BEND},
            )
        )


def _check_finite(chunk: _Chunk, names: tuple[str, ...], step: float) -> None:
    """Stop at the first state that is not finite, naming joint and time."""
    finite = np.isfinite(chunk.states)
    if finite.all():
        return
    row, _, column = np.argwhere(~finite)[0]
    time, name = float((chunk.first + row) * step), (*names, "feed")[column]
    raise SimulationError(
        Diagnosis(
            reason=f"the simulated state of joint {name} is not finite at {time:.4g} s",
            stage="simulation",
            advice=("a smaller simulation.step", "smaller gains", 'simulation.controller = "computed-torque"'),
            evidence={"joint": name, "time": time},
        )
    )
