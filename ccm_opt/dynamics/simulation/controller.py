"""Tracking laws and the conditions under which their sampled form is stable.

- Computed torque: τ = RNEA(q + ½ q̇ dt, q̇ + ½ a dt, a) with a = q̈_r + Kp e + Kd ė, the torque that makes the
  acceleration a at the middle of the step, for it is held over the whole of it. The feed axis is one more coordinate;
  where its force is at its limit the torques are those for the acceleration that the base can have.
- PD: τ = Kp e + Kd ė + RNEA(q, 0, 0), the gravity torques of the pose added (Takegaki and Arimoto, 1981). Those of the
  reference instead leave gravity's own stiffness in the loop, which soft gains cannot hold.

The control is computed at the start of a step and held over it. A mode of the joint errors with stiffness α = λ Kp dt²
and damping β = λ Kd dt then has the discrete characteristic polynomial z² − (2 − α/2 − β) z + (1 + α/2 − β), whose
roots lie inside the unit circle exactly when β < 2 and α < 2 β (Jury's test): Kd λ dt < 2 and Kp dt < 2 Kd. Computed
torque makes λ = 1; under PD λ is an eigenvalue of M⁻¹.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigvalsh

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.algorithms.mass_matrix import MassMatrix
from ccm_opt.dynamics.runtime.control_law import LoopSettings
from ccm_opt.errors import Diagnosis, SimulationError
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import Limits, SimulationOptions

POSES_CHECKED = 9  # poses along the motion at which the PD gains are checked
RUNGE_KUTTA_REACH = 2.78  # |λ dt| on the negative real axis up to which the classical method is stable


@dataclass(frozen=True)
class Gains:
    """Gains on joint error and joint speed error.

    Under computed torque they act on accelerations [1/s², 1/s], under PD on torques [N m/rad, N m s/rad].
    """

    proportional: float
    derivative: float


def gains(options: SimulationOptions) -> Gains:
    """Gains of the chosen law; computed torque is critically damped at ωn = bandwidth: Kp = ωn², Kd = 2 ωn."""
    if options.controller == "computed-torque":
        return Gains(options.bandwidth**2, 2.0 * options.bandwidth)
    return Gains(options.proportional_gain, options.derivative_gain)


def feed_gains(arm: Arm, options: SimulationOptions) -> Gains:
    """Gains of the feed axis: critically damped at ωn = bandwidth, under PD for the mass of the arm [N/m, N s/m]."""
    mass = 1.0 if options.controller == "computed-torque" else float(np.sum(arm.masses)) + arm.payload
    return Gains(mass * options.bandwidth**2, 2.0 * mass * options.bandwidth)


def loop_settings(arm: Arm, options: SimulationOptions, limits: Limits) -> LoopSettings:
    """The numbers of the closed loop; efforts saturate at their limits when there are any."""
    gain, feed = gains(options), feed_gains(arm, options)
    limit = np.full(3 * arm.links, np.inf) if limits.torque is None else limits.torque
    return LoopSettings(
        step=options.step,
        computed=options.controller == "computed-torque",
        proportional=gain.proportional,
        derivative=gain.derivative,
        feed_proportional=feed.proportional,
        feed_derivative=feed.derivative,
        limit=limit,
        feed_limit=np.inf if limits.feed_force is None else limits.feed_force,
    )


def check_stability(arm: Arm, angles: FloatArray, options: SimulationOptions, *, planar: bool) -> None:
    """Refuse gains that the sampled controller cannot hold.

    Args:
        arm: the arm.
        angles: reference motion, shape (T, 3 * links) [rad].
        options: controller, gains and step.
        planar: whether nothing moves the arm out of its plane, so that only the bends count.

    Raises:
        SimulationError: with the figures, when a condition of this module's docstring fails.
    """
    gain = gains(options)
    if not gain.proportional * options.step < 2.0 * gain.derivative:
        raise _refusal("Kp · dt < 2 Kd", gain.proportional * options.step, 2.0 * gain.derivative, gain, options)
    fastest = 1.0 if options.controller == "computed-torque" else fastest_mode(arm, angles, planar=planar)
    if not gain.derivative * fastest * options.step < 2.0:
        raise _refusal("Kd · λmax · dt < 2", gain.derivative * fastest * options.step, 2.0, gain, options, fastest)
    _check_feed(arm, angles, options, planar=planar)
    _check_friction(arm, angles, options, planar=planar)


def _check_feed(arm: Arm, angles: FloatArray, options: SimulationOptions, *, planar: bool) -> None:
    """Under PD the feed axis moves less than the whole arm at first; refuse damping that is too much for that."""
    if arm.feed is None or options.controller == "computed-torque":
        return
    rate = feed_gains(arm, options).derivative / _lightest_base(arm, angles, planar=planar)
    if not rate * options.step < 2.0:
        fits = 0.9 * 2.0 / (rate * options.step)
        value = f"{rate * options.step:.4g}"
        reason = f"PD of the feed axis is unstable: Kd · dt / m < 2 is needed, but the left side is {value}"
        advice = (
            f"simulation.bandwidth below {fits * options.bandwidth:.3g} 1/s",
            f"simulation.step below {fits * options.step:.3g} s",
            'simulation.controller = "computed-torque"',
        )
        raise SimulationError(Diagnosis(reason, "simulation", advice, {"value": rate * options.step, "bound": 2.0}))


def _check_friction(arm: Arm, angles: FloatArray, options: SimulationOptions, *, planar: bool) -> None:
    """Friction damps the fastest mode at a rate that the integrator must follow."""
    friction = float(np.max(arm.friction))
    if friction == 0.0:
        return
    value = friction * fastest_mode(arm, angles, planar=planar) * options.step
    if not value < RUNGE_KUTTA_REACH:
        fits = 0.9 * RUNGE_KUTTA_REACH / value
        reason = (
            f"friction of {friction:.4g} N m s/rad cannot be integrated at dt = {options.step:.4g} s: "
            f"b · λmax · dt < {RUNGE_KUTTA_REACH} is needed, but the left side is {value:.4g}"
        )
        advice = (
            f"simulation.step below {fits * options.step:.3g} s",
            f"friction below {fits * friction:.3g} N m s/rad",
        )
        raise SimulationError(Diagnosis(reason, "simulation", advice, {"value": value, "bound": RUNGE_KUTTA_REACH}))


def fastest_mode(arm: Arm, angles: FloatArray, *, planar: bool) -> float:
    """Largest eigenvalue of M⁻¹ [1/(kg m²)] at some poses of a motion; of its bends alone for a planar one."""
    mass_matrix, moving = MassMatrix(arm), _moving(planar=planar)
    smallest = min(eigvalsh(mass_matrix(q)[moving, moving], subset_by_index=[0, 0])[0] for q in _poses(angles))
    return float(1.0 / smallest) if smallest > 0.0 else float("inf")


def _lightest_base(arm: Arm, angles: FloatArray, *, planar: bool) -> float:
    """Least mass [kg] that the base moves at once when it is pushed and the joints are free, at some poses."""
    mass_matrix, moving = MassMatrix(arm), _moving(planar=planar)
    masses = []
    for q in _poses(angles):
        M = mass_matrix.with_feed(q)
        coupling, joints = M[0, 1:][moving], M[1:, 1:][moving, moving]
        masses.append(M[0, 0] - coupling @ np.linalg.solve(joints, coupling))
    return float(min(masses))


def _moving(*, planar: bool) -> slice:
    return slice(1, None, 3) if planar else slice(None)


def _poses(angles: FloatArray) -> FloatArray:
    rows = np.unique(np.linspace(0, len(angles) - 1, POSES_CHECKED).round().astype(int))
    return np.asarray(angles[rows], dtype=np.float64)


def _refusal(
    condition: str, value: float, bound: float, gain: Gains, options: SimulationOptions, fastest: float = 1.0
) -> SimulationError:
    law = (
        f"{options.controller} with Kp = {gain.proportional:.4g}, Kd = {gain.derivative:.4g}, dt = {options.step:.4g} s"
    )
    return SimulationError(
        Diagnosis(
            reason=f"{law} is unstable: {condition} is needed, but the left side is {value:.4g}, the right {bound:.4g}",
            stage="simulation",
            advice=_advice(options, bound / value if value > 0.0 else 0.0, damped=bound == 2.0),
            evidence={"condition": condition, "value": value, "bound": bound, "lambda_max": fastest},
        )
    )


def _advice(options: SimulationOptions, ratio: float, *, damped: bool) -> tuple[str, ...]:
    smaller_step = f"simulation.step below {0.9 * ratio * options.step:.3g} s"
    if options.controller == "computed-torque":
        return (f"simulation.bandwidth below {0.9 * ratio * options.bandwidth:.3g} 1/s", smaller_step)
    if damped:
        return (
            f"simulation.derivative_gain below {0.9 * ratio * options.derivative_gain:.3g} N m s/rad",
            smaller_step,
            'simulation.controller = "computed-torque"',
        )
    return (f"simulation.derivative_gain above {0.6 * options.proportional_gain * options.step:.3g} N m s/rad",)
