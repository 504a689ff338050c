"""Tracking laws and the conditions under which their sampled form is stable.

The control is computed at the start of a step and held over it. A mode of the joint errors with stiffness α = λ Kp dt²
and damping β = λ Kd dt then has the discrete characteristic polynomial z² − (2 − α/2 − β) z + (1 + α/2 − β), whose
roots lie inside the unit circle exactly when β < 2 and α < 2 β (Jury's test): Kd λ dt < 2 and Kp dt < 2 Kd. Computed
torque makes λ = 1; under PD λ is an eigenvalue of M⁻¹.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import eigvalsh

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.mass_matrix import MassMatrix
from ccm_opt.errors import Diagnosis, SimulationError
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import ControllerName, SimulationOptions

POSES_CHECKED = 9  # poses along the motion at which the PD gains are checked


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


def control_law(controller: ControllerName, rnea: Any, joints: int) -> Any:
    """CasADi function ``control(q, qd, reference, settings, limit, bodies, drives, world) -> torques``.

    - ``computed-torque``: τ = RNEA(q + ½ q̇ dt, q̇ + ½ a dt, a) with a = q̈_r + Kp e + Kd ė: the torque that makes the
      acceleration a at the middle of the step, for it is held over the whole of it.
    - ``pd``: τ = Kp e + Kd ė + RNEA(q, 0, 0), the gravity torques of the pose added (Takegaki and Arimoto, 1981).
      Those of the reference instead leave gravity's own stiffness in the loop, which soft gains cannot hold.

    Args:
        controller: the law.
        rnea: the arm's inverse dynamics.
        joints: number of revolutes; ``reference`` has the columns q_r, q̇_r, q̈_r, shape (joints, 3); ``settings`` are
            Kp, Kd and dt.
    """
    q, qd, reference = ca.MX.sym("q", joints), ca.MX.sym("qd", joints), ca.MX.sym("reference", joints, 3)
    settings, limit = ca.MX.sym("settings", 3), ca.MX.sym("limit", joints)
    arm = [ca.MX.sym(rnea.name_in(i), *rnea.size_in(i)) for i in (4, 5, 6)]
    q_r, qd_r, qdd_r = ca.horzsplit(reference)
    feedback = settings[0] * (q_r - q) + settings[1] * (qd_r - qd)
    if controller == "computed-torque":
        wanted, half = qdd_r + feedback, 0.5 * settings[2]
        torques = rnea(q + half * qd, qd + half * wanted, wanted, 0, *arm)[0]
    else:
        torques = feedback + rnea(q, ca.DM.zeros(joints), ca.DM.zeros(joints), 0, *arm)[0]
    saturated = ca.fmax(-limit, ca.fmin(limit, torques))
    return ca.Function("control", [q, qd, reference, settings, limit, *arm], [saturated])


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


def fastest_mode(arm: Arm, angles: FloatArray, *, planar: bool) -> float:
    """Largest eigenvalue of M⁻¹ [1/(kg m²)] at some poses of a motion; of its bends alone for a planar one."""
    mass_matrix, moving = MassMatrix(arm), slice(1, None, 3) if planar else slice(None)
    poses = angles[np.unique(np.linspace(0, len(angles) - 1, POSES_CHECKED).round().astype(int))]
    smallest = min(eigvalsh(mass_matrix(q)[moving, moving], subset_by_index=[0, 0])[0] for q in poses)
    return float(1.0 / smallest) if smallest > 0.0 else float("inf")


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
