"""Controller of a simulated arm, its reference, and disturbances.

The loop is computed by ``simulation.c``. Positions x = (q, x_b) and velocities ẋ are those of all revolutes, or of the
bends of sections that bend evenly, and, last, of the axes that carry the base; the efforts are their torques and those
of the axes, u = (τ, F). A step of length h has three parts.

1. *Measure.* q and q̇ with noise, x_b and ẋ_b without. With the reference x_r at the start of the step, the errors are
   e = x_r − x and ė = ẋ_r − ẋ, and the feedback is Kp e + Kd ė, with separate gains for the axes of the base.

2. *Control*, held over the step. While the brakes hold the arm, u = 0 and nothing moves. Otherwise

   - computed torque: a = ẍ_r + Kp e + Kd ė, u = ID(q + ½ h q̇, q̇ + ½ h a, a), the efforts that produce the
     acceleration a in the middle of the step. Where F exceeds its limit, a_b is changed to what the base can do, a_b +
     (clamp(F) − F) / m with m the mass that a feed axis moves, or a bound on the inertia that another axis moves, and u
     is computed once more, so that the joint torques fit the delayed base;
   - PD: τ = Kp e⁺ + Kd ė⁺ + ID(q, 0, 0), including the gravity torques of the measured pose (Takegaki and Arimoto,
     1981), with the errors at the end of the step, e⁺ = e + h ė and ė⁺ = ė + h (q̈_r − q̈): real drives close their
     loops many times per step, and errors of its start, held over the step, would destabilise a light link under gains
     that hold a heavy arm. The resulting q̈ is the forward dynamics FD of the modelled arm with rotor inertias
     increased by h Kd, under Kp e⁺ + Kd (ė + h q̈_r) + ID(q, 0, 0) (stable PD; Tan, Liu and Turk, 2011). The axes of the
     base have F = Kp e + Kd ė + ID(q, 0, 0).

   Both saturate. ID is the inverse dynamics (``rnea``) of the controller's model,
   which may differ from the plant.

3. *Move.* One classical Runge–Kutta step of ẍ = FD(x, ẋ, u), the forward dynamics (``aba``) of the plant, with u held.

``stability.py`` states the gains for which this sampled loop is stable.

PD gains are derived from the arm. With M(0) the mass matrix of the straight arm and D = diag(Σⱼ |M(0)ᵢⱼ|), Kp = ωn² D
and Kd = 2 ωn D. No lever is longer than along the straight arm, so that in the plane |M(q)ᵢⱼ| ≤ M(0)ᵢⱼ in every pose,
and D − M(q) is diagonally dominant: xᵀ D x ≥ xᵀ M(q) x. So every mode of the errors, M ë + Kd ė + Kp e = M q̈_r, is
damped critically or more, and while the arm moves slowly compared with ωn the errors of all joints are at most
max |q̈_r| / ωn², whatever the number and mass of the links. Sections that bend evenly have twice the row sums for D: a
bend of one may move the arm across that of another, by no longer lever than along the straight arm. The k axes of the
base have k times their own inertia at most, since xᵀ M x ≤ k Σ Mᵢᵢ xᵢ² for a positive definite M.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import NativeCall, native_constant
from ccm_opt.dynamics.algorithms.arm_model import ArmModel
from ccm_opt.dynamics.runtime.inverse_dynamics import MassMatrix, arm_for_c
from ccm_opt.problem import Disturbances, Limits, SimulationOptions
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import axis_reaches
from ccm_opt.robot.frames import drive_names, drive_torque_limits
from ccm_opt.robot.tool import RigidBody


def stiffened(model: ArmModel, step: float, kd: FloatArray) -> ArmModel:
    """Return a controller's model with rotor inertias raised by step length times Kd, as stable PD requires."""
    if model.coupling is not None:
        return replace(model, armature=step * kd[: model.coordinates])
    drives = model.drives.copy()
    drives[:, :3] += step * kd[: drives.size // 2].reshape(-1, 3)
    return replace(model, drives=drives)


class CompiledLoop:
    """Compiled simulation of an arm under its controller, as described in this module's docstring.

    Arrays have W columns, one for each drive that bends the arm and, last, those of the axes that carry the base, or of
    a feed axis, which stays at rest if there is none.

    Attributes:
        bending: number n of drives that bend the arm.

    Args:
        plant: model of the simulated arm.
        model: model of the arm that the controller uses.
        numbers: gains, limits and step of the loop, see ``loop_numbers``.
    """

    def __init__(self, plant: ArmModel, model: ArmModel, numbers: Mapping[str, Any]) -> None:
        believed = arm_for_c(model)
        self._width, self.bending = plant.coordinates + plant.of_base, plant.coordinates
        variant = plant.structure.variant
        self._call = NativeCall(
            f"simulate__{variant}",
            plant=arm_for_c(plant), model=believed,
            stiffened=believed if numbers["computed"] else arm_for_c(stiffened(model, numbers["step"], numbers["kd"])),
            work=np.zeros((native_constant(f"loop_rows__{variant}"), self._width)),
            **numbers,
        )  # fmt: skip

    def run(
        self, state: FloatArray, reference: FloatArray, noise: FloatArray, brake_steps: int
    ) -> tuple[FloatArray, FloatArray]:
        """Simulate N steps of the control loop.

        Args:
            state: positions and velocities before the first step, shape (2, W).
            reference: positions, velocities and accelerations of every step, shape (N, 3, W).
            noise: measurement noise of joint angles [rad] and velocities [rad/s], shape (N, 2, n) for n
                drives that bend the arm.
            brake_steps: number of steps at the beginning during which brakes hold the arm.

        Returns:
            States at the ends of the steps, shape (N, 2, W), and efforts held over them, shape (N, W).
        """
        count, _, width = reference.shape
        if width != self._width or reference.shape[1] != 3 or np.shape(state) != (2, width):
            raise ValueError(f"got shapes {np.shape(state)} and {reference.shape}; expected (N, 3, {self._width})")
        if noise.shape != (count, 2, self.bending):
            raise ValueError(f"noise has the shape {noise.shape}; expected {(count, 2, self.bending)}")
        states = np.empty((count, 2, width))
        efforts = np.empty((count, width))
        self._call.set(
            count=count, held=min(max(brake_steps, 0), count), reference=reference, noise=noise,
            x=np.array(state, dtype=np.float64, order="C"),  # a copy: C moves it on
            states=states, efforts=efforts,
        )  # fmt: skip
        self._call()
        return states, efforts


def gains(arm: Arm, options: SimulationOptions) -> tuple[FloatArray, FloatArray]:
    """Return the gains Kp and Kd of the drives that bend the arm for the chosen control law, each of shape (n,).

    For computed torque they act on accelerations [1/s², 1/s], critically damped at ωn = bandwidth: Kp = ωn², Kd = 2 ωn;
    for PD on torques [N m/rad, N m s/rad].
    """
    joints = np.ones(len(drive_names(arm)))
    bandwidth = options.bandwidth
    if options.controller == "computed-torque":
        return bandwidth**2 * joints, 2.0 * bandwidth * joints
    proportional = options.proportional_gain
    derivative = options.derivative_gain
    # If only one gain is given, the other follows from the bandwidth, as for gains derived from the arm.
    if proportional is None and derivative is None:
        inertia = inertia_at_most(arm)
        return bandwidth**2 * inertia, 2.0 * bandwidth * inertia
    if proportional is None:
        proportional = 0.5 * bandwidth * (derivative or 0.0)
    if derivative is None:
        derivative = 2.0 * proportional / bandwidth
    return proportional * joints, derivative * joints


def inertia_at_most(arm: Arm) -> FloatArray:
    """Return an upper bound on the inertia seen by each drive when all bends move, shape (n,) [kg m²].

    The bound is the row sum, over the bends, of the straight arm's mass matrix. Yaw and roll get the value of their
    ball joint's bend, since the arm beyond a ball joint has no greater inertia about any other axis through the joint.
    """
    straight = MassMatrix(arm)(np.zeros(3 * arm.links))
    if arm.drives is not None:
        return np.asarray(2.0 * np.sum(np.abs(straight), axis=1))
    bends = np.sum(np.abs(straight[1::3, 1::3]), axis=1)
    return np.repeat(bends, 3)


def moved_by_base(arm: Arm) -> FloatArray:
    """Return the inertia that each of the k axes of the base moves, at most, or a feed axis exactly [kg, kg m²]."""
    if not arm.carrier:
        return np.array([arm.moved_mass])
    reaches = axis_reaches(arm.carrier, arm.base_position, arm.length)
    return np.array(
        [arm.moved_mass * reach**2 + axis.inertia for reach, axis in zip(reaches, arm.carrier, strict=True)]
    )


def base_gains(arm: Arm, options: SimulationOptions) -> tuple[FloatArray, FloatArray]:
    """Return the gains Kp and Kd of the axes that carry the base, or of a feed axis, critically damped, each (k,).

    They have ωn = bandwidth. For computed torque they act on accelerations [1/s², 1/s], for PD, multiplied by the
    inertia, on efforts.
    """
    inertia = moved_by_base(arm)
    inertia = np.ones(len(inertia)) if options.controller == "computed-torque" else len(inertia) * inertia
    return inertia * options.bandwidth**2, 2.0 * inertia * options.bandwidth


def most_efforts(arm: Arm, limits: Limits) -> FloatArray:
    """Return the effort limits of the drives that bend the arm and, last, of the k axes of the base, (n + k,) [N m, N].

    A fixed base has a column without a limit.
    """
    efforts = limits.of_drives(arm.coordinates).effort
    revolutes = arm.coordinates.revolutes
    return np.append(drive_torque_limits(arm, efforts[:revolutes]), efforts[revolutes:] if arm.base_axes else np.inf)


def loop_numbers(arm: Arm, options: SimulationOptions, limits: Limits) -> dict[str, Any]:
    """Return the parameters of the control loop under their names in ``simulation.c``.

    The parameters are the step [s], whether the law is computed torque rather than PD, Kp, Kd and the effort limits of
    every drive that bends the arm and, last, of the axes of the base, shape (n + k,), see ``gains``, ``base_gains`` and
    ``most_efforts``, and the inertia that these axes move, shape (k,).
    """
    proportional, derivative = (
        np.concatenate(both) for both in zip(gains(arm, options), base_gains(arm, options), strict=True)
    )
    return {
        "step": options.step,
        "computed": options.controller == "computed-torque",
        "kp": proportional,
        "kd": derivative,
        "limit": most_efforts(arm, limits),
        "carried": moved_by_base(arm),
    }


def disturbed_arm(arm: Arm, disturbances: Disturbances) -> Arm:
    """Return the arm with the masses, payload and friction of the simulated arm, which differ by disturbances.

    The payload is at the tip: that of the tool, if there is one.
    """
    heavier = 1.0 + disturbances.mass_error
    bodies = tuple(body.scaled(heavier) for body in arm.bodies)
    payload = arm.payload + disturbances.payload
    if arm.tool is not None:
        bodies, payload = (*bodies, RigidBody(mass=payload, centre=arm.tool.tip)), 0.0
    rubbing = np.full(3 * arm.links, disturbances.friction)
    if arm.sections is not None:  # a section has that of all of its joints
        rubbing *= np.repeat(arm.sections.at_joints(arm.sections.counts.astype(np.float64)), 3)
    return replace(
        arm,
        bodies=bodies,
        tool=None if arm.tool is None else arm.tool.scaled(heavier),
        masses=heavier * arm.masses,
        inertia_axial=heavier * arm.inertia_axial,
        inertia_transverse=heavier * arm.inertia_transverse,
        payload=payload,
        friction=np.asarray(arm.friction) + rubbing,
    )


class Noise:
    """Gaussian noise on measured joint angles and velocities.

    Args:
        disturbances: standard deviations and seed.
        planar: whether the arm stays in its plane; if so, only the bends get noise, so that the arm does not leave it.
    """

    def __init__(self, disturbances: Disturbances, *, planar: bool) -> None:
        self._scale = np.array([[disturbances.angle_noise], [disturbances.velocity_noise]])
        self._random = np.random.default_rng(disturbances.seed)
        self._planar = planar

    def draw(self, count: int, joints: int) -> FloatArray:
        """Sample the noise on angles [rad] and velocities [rad/s] of ``count`` steps, shape (count, 2, joints)."""
        if not np.any(self._scale):
            return np.zeros((count, 2, joints))
        noise = self._scale * self._random.standard_normal((count, 2, joints))
        if self._planar:
            # All joints are sampled nevertheless, so that bends get equal noise in planar and spatial runs of one seed.
            noise[..., 0::3] = 0.0
            noise[..., 2::3] = 0.0
        return noise


@dataclass(frozen=True)
class StepReference:
    """Joint reference on a grid of equal time steps.

    Angles follow the cubic Hermite polynomial through the samples' angles and velocities, velocities follow its
    derivative. The acceleration of a step is the mean over the step, since the control is constant over a step.

    Attributes:
        angles: cubic Hermite spline of the angles of the joints that move.
        velocities: derivative of that spline.
        moving: indices of the M joints that move, shape (M,); all others stay at zero.
        joints: number of all joints.
        step: length of a step [s].
        steps: number of steps that cover the motion.
    """

    angles: CubicHermiteSpline
    velocities: CubicHermiteSpline
    moving: IntArray
    joints: int
    step: float
    steps: int

    def window(self, first: int, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the joint reference of ``count`` steps from step ``first`` on.

        Returns:
            Angles, velocities and accelerations at the start of each step, shape (count, 3, joints), and the angles at
            the end of each step, shape (count, joints). Steps past the end hold the last pose.
        """
        # The last step may extend past the end of the motion, where the splines would extrapolate.
        end = float(self.angles.x[-1])
        times = np.minimum(np.arange(first, first + count + 1) * self.step, end)
        angles = self.angles(times)
        velocities = self.velocities(times)
        accelerations = np.diff(velocities, axis=0) / self.step  # means over the steps: see the class
        reference = np.zeros((count, 3, self.joints))
        ends = np.zeros((count, self.joints))
        for k, values in enumerate((angles[:-1], velocities[:-1], accelerations)):
            reference[:, k, self.moving] = values
        ends[:, self.moving] = angles[1:]
        return reference, ends


def step_reference(time: FloatArray, angles: FloatArray, velocities: FloatArray, step: float) -> StepReference:
    """Return the joint reference of a sampled motion on a grid of equal steps.

    Args:
        time: sample times, strictly increasing from 0, shape (T,) [s].
        angles: angles at the samples, shape (T, joints) [rad].
        velocities: velocities at the samples, shape (T, joints) [rad/s].
        step: length of a step [s].
    """
    steps = max(1, int(np.ceil(time[-1] / step - 1e-9)))  # a last sample that rounding puts past a step needs no more
    # In the plane two of three revolutes never move.
    moving = np.flatnonzero(np.any(angles != 0.0, axis=0) | np.any(velocities != 0.0, axis=0))
    spline = CubicHermiteSpline(time, angles[:, moving], velocities[:, moving])
    return StepReference(spline, spline.derivative(), moving, angles.shape[1], step, steps)


def hermite(fraction: FloatArray, step: float, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return joint angles inside N time steps by cubic interpolation of angles and velocities at both ends.

    Args:
        fraction: time inside the step as a fraction of the step, in [0, 1], shape (N,).
        step: length of a step [s].
        start: angles and velocities at the start of each step, shape (N, 2, joints).
        end: angles and velocities at the end of each step, shape (N, 2, joints).

    Returns:
        Angles, shape (N, joints) [rad].
    """
    q0 = start[:, 0]
    v0 = start[:, 1]
    q1 = end[:, 0]
    v1 = end[:, 1]
    u = fraction[:, None]
    # The cubic Hermite basis: (3 − 2u) u² for the rise, u (1 − u)² and −u² (1 − u) for the slopes.
    rise = u * u * (3.0 - 2.0 * u)
    drop = 1.0 - u
    return q0 + rise * (q1 - q0) + step * u * drop * (drop * v0 - u * v1)
