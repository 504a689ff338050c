"""The arm under its controller: the closed loop compiled as a whole, no Python inside a step (section 5.4).

Each step holds the control computed at its start and integrates q̈ = ABA(q, q̇, τ) by the classical Runge–Kutta method.
A planar motion under gravity in its plane stays exactly planar: every term out of the plane is a product with zero.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.aba import build_aba
from ccm_opt.dynamics.compiled import BufferedFunction, load_functions
from ccm_opt.dynamics.controller import check_stability, control_law, gains
from ccm_opt.dynamics.model import ArmModel, Structure, arm_model
from ccm_opt.dynamics.reference import StepReference, hermite, step_reference
from ccm_opt.dynamics.rnea import build_rnea
from ccm_opt.errors import Diagnosis, ProblemError, SimulationError
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import ControllerName, Limits, SimulationOptions
from ccm_opt.solution import JointStates, JointTrajectory, SimulatedMotion

CHUNK = 100  # steps in one call of the compiled loop
LARGEST_BEND = 1.3  # rad: nearer 90° the Z-Y-X ball is too close to singular to be simulated in 3-D


def simulate(
    arm: Arm, trajectory: JointTrajectory, joints: JointStates, options: SimulationOptions, limits: Limits
) -> SimulatedMotion:
    """Simulate the arm tracking a trajectory.

    Args:
        arm: the arm.
        trajectory: gives the sample times.
        joints: the same motion for all revolutes; the arm starts on its first sample's angles and velocities.
        options: gravity, step, controller.
        limits: torques saturate at ``limits.torque`` when it is not None.

    Returns:
        Angles and applied torques at the trajectory's own samples.

    Raises:
        SimulationError: when the axes are singular on the motion, the gains are unstable at this step, or a joint
            angle stops being finite.
    """
    if trajectory.duration <= 0.0:
        return SimulatedMotion(joints.angles, joints.torques, tracking_error=0.0, saturated=False)
    planar = _is_planar(joints, options)
    if planar:
        arm = replace(arm, axes="zyx")  # in the plane only bends move, and both orders of axes are the same arm
    _check_axes(arm, joints.angles, planar=planar)
    check_stability(arm, joints.angles, options, planar=planar)
    reference = step_reference(trajectory.time, joints.angles, joints.velocities, options.step)
    loop = _closed_loop(arm, options, limits)
    record = _Record.empty(trajectory.time, joints, options.step)
    start = np.concatenate((joints.angles[0], joints.velocities[0]))
    for chunk in _chunks(loop, reference, start):
        _check_finite(chunk, joints.names, options.step)
        record.add(chunk)
    return record.motion(limits.torque)


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
        check_stability(arm, straight, options, planar=still)
    except SimulationError as error:
        raise ProblemError(f"the simulation cannot run: {error.diagnosis}") from error


@dataclass(frozen=True)
class _Chunk:
    """Some steps: states at their ends with the one before the first, torques held, reference angles at their ends."""

    first: int
    states: FloatArray
    torques: FloatArray
    targets: FloatArray


@dataclass
class _Record:
    """What is kept of the simulated motion, filled chunk by chunk."""

    step: float
    places: FloatArray  # samples in units of steps
    angles: FloatArray
    torques: FloatArray
    tracking_error: float = 0.0
    largest: FloatArray | float = 0.0  # torque of each joint

    @classmethod
    def empty(cls, time: FloatArray, joints: JointStates, step: float) -> "_Record":
        return cls(step, time / step, joints.angles.copy(), np.zeros_like(joints.torques))

    def add(self, chunk: _Chunk) -> None:
        """Interpolate a chunk at the samples inside it."""
        count, half = len(chunk.torques), chunk.targets.shape[1]
        local = self.places - chunk.first
        here = np.flatnonzero((local >= 0.0) & (local <= count + 1e-9))
        index = np.minimum((local[here] + 1e-9).astype(int), count - 1)
        self.angles[here] = hermite(local[here] - index, self.step, chunk.states[index], chunk.states[index + 1])
        self.torques[here] = chunk.torques[index]
        error = float(np.max(np.abs(chunk.states[1:, :half] - chunk.targets)))
        self.tracking_error = max(self.tracking_error, error)
        self.largest = np.maximum(self.largest, np.max(np.abs(chunk.torques), axis=0))

    def motion(self, limit: FloatArray | None) -> SimulatedMotion:
        saturated = limit is not None and bool(np.any(self.largest >= limit))
        return SimulatedMotion(self.angles, self.torques, self.tracking_error, saturated)


def _closed_loop(arm: Arm, options: SimulationOptions, limits: Limits) -> BufferedFunction:
    """The compiled loop with the arm's numbers in its inputs."""
    model, controller = arm_model(arm, options.gravity), options.controller
    key = f"simulation {controller} {CHUNK} {model.structure}"
    function = load_functions(key, ("simulate",), lambda: [build_closed_loop(model.structure, controller)])["simulate"]
    loop = BufferedFunction(function)
    _fill(loop, model, options, limits)
    return loop


def _fill(loop: BufferedFunction, model: ArmModel, options: SimulationOptions, limits: Limits) -> None:
    gain = gains(options)
    _, _, settings, limit, bodies, drives, world = loop.inputs
    settings[...] = (gain.proportional, gain.derivative, options.step)
    limit[...] = np.inf if limits.torque is None else limits.torque
    bodies[...] = model.bodies
    drives[...] = model.drives
    world[...] = model.world


def build_closed_loop(structure: Structure, controller: ControllerName) -> Any:
    """CasADi function ``simulate(x, references, settings, limit, bodies, drives, world) -> (states, torques)``.

    One call makes CHUNK steps. ``x`` is (q, q̇); ``references`` holds q_r, q̇_r, q̈_r of every step, shape
    (joints, 3 * CHUNK); ``settings`` are Kp, Kd and dt.
    """
    step = _step_function(structure, controller)
    constants = [ca.MX.sym(step.name_in(i), *step.size_in(i)) for i in range(2, step.n_in())]
    x, references = ca.MX.sym("x", *step.size_in(0)), ca.MX.sym("references", structure.joints, 3 * CHUNK)
    many = step.mapaccum("steps", CHUNK, {"base": 10})
    outputs = many(x, references, *(ca.repmat(constant, 1, CHUNK) for constant in constants))
    names = ["x", "references", *(step.name_in(i) for i in range(2, step.n_in()))]
    return ca.Function("simulate", [x, references, *constants], list(outputs), names, ["states", "torques"])


def _step_function(structure: Structure, controller: ControllerName) -> Any:
    """One step (x, reference, settings, limit, bodies, drives, world) -> (x, torques)."""
    n = structure.joints
    x, reference, settings = ca.MX.sym("x", 2 * n), ca.MX.sym("reference", n, 3), ca.MX.sym("settings", 3)
    limit, bodies, drives = (
        ca.MX.sym("limit", n),
        ca.MX.sym("bodies", 4, structure.links),
        ca.MX.sym("drives", 6, structure.links),
    )
    world = ca.MX.sym("world", 5)
    law, aba = control_law(controller, build_rnea(structure), n), build_aba(structure)
    torques = law(x[:n], x[n:], reference, settings, limit, bodies, drives, world)
    after = _runge_kutta(lambda q, qd: aba(q, qd, torques, 0, bodies, drives, world)[0], x[:n], x[n:], settings[2])
    names = ["x", "reference", "settings", "limit", "bodies", "drives", "world"]
    inputs = [x, reference, settings, limit, bodies, drives, world]
    return ca.Function("step", inputs, [after, torques], names, ["x_next", "torques"])


def _runge_kutta(acceleration: Any, q: Any, qd: Any, dt: Any) -> Any:
    """Classical Runge–Kutta step of q̈ = f(q, q̇), (q, q̇) stacked."""
    half = 0.5 * dt
    a1 = acceleration(q, qd)
    v2 = qd + half * a1
    a2 = acceleration(q + half * qd, v2)
    v3 = qd + half * a2
    a3 = acceleration(q + half * v2, v3)
    v4 = qd + dt * a3
    a4 = acceleration(q + dt * v3, v4)
    return ca.vertcat(q + dt / 6 * (qd + 2 * v2 + 2 * v3 + v4), qd + dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4))


def _chunks(loop: BufferedFunction, reference: StepReference, start: FloatArray) -> Iterator[_Chunk]:
    state = start
    for first in range(0, reference.steps, CHUNK):
        count = min(CHUNK, reference.steps - first)
        window, targets = reference.window(first, CHUNK)
        states, torques = loop(state, window.reshape(3 * CHUNK, -1))
        kept = np.vstack((state, states[:count]))
        yield _Chunk(first, kept, torques[:count].copy(), targets[:count])
        state = kept[-1]


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
    row, column = np.argwhere(~finite)[0]
    time, name = (chunk.first + row) * step, names[column % len(names)]
    raise SimulationError(
        Diagnosis(
            reason=f"the simulated state of joint {name} is not finite at {time:.4g} s",
            stage="simulation",
            advice=("a smaller simulation.step", "smaller gains", 'simulation.controller = "computed-torque"'),
            evidence={"joint": name, "time": float(time)},
        )
    )
