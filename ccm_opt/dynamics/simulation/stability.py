"""Conditions under which the sampled closed loop is stable, checked before anything runs.

The control is computed at the start of a step and held over it. A mode of the joint errors with stiffness α = λ Kp dt²
and damping β = λ Kd dt then has the discrete characteristic polynomial z² − (2 − α/2 − β) z + (1 + α/2 − β), whose
roots lie inside the unit circle exactly when β < 2 and α < 2 β (Jury's test): Kd λ dt < 2 and Kp dt < 2 Kd. Computed
torque makes λ = 1; under PD λ is an eigenvalue of M⁻¹, and gravity torques are those of the measured pose, as those of
the reference would leave gravity's own stiffness in the loop, which soft gains cannot hold.
"""

import numpy as np
from scipy.linalg import eigvalsh

from ccm_opt.dynamics.algorithms.mass_matrix import MassMatrix
from ccm_opt.dynamics.simulation.controller import Gains, feed_gains, gains
from ccm_opt.dynamics.simulation.simulation_settings import DEFAULT_SIMULATION, SimulationSettings
from ccm_opt.errors import Diagnosis, SimulationError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import SimulationOptions

RUNGE_KUTTA_REACH = 2.78
"""|λ dt| on the negative real axis up to which the classical method is stable, where 1 + z + … + z⁴/24 reaches 1."""


def check_stability(
    arm: Arm,
    angles: FloatArray,
    options: SimulationOptions,
    *,
    planar: bool,
    settings: SimulationSettings = DEFAULT_SIMULATION,
) -> None:
    """Refuse gains that the sampled controller cannot hold, and friction that the integrator cannot follow.

    Args:
        arm: the arm.
        angles: reference motion, shape (T, 3 * links) [rad].
        options: controller, gains and step.
        planar: whether nothing moves the arm out of its plane, so that only the bends count.
        settings: at how many poses, and how far inside the bounds advised figures are.

    Raises:
        SimulationError: with the figures, when a condition of this module's docstring fails.
    """
    poses = _spread(angles, settings.checked_poses)
    _check_damping(options, settings)
    _check_fastest_mode(arm, poses, options, settings, planar=planar)
    for _ in arm.base_axes:
        _check_feed(arm, poses, options, settings, planar=planar)
    _check_friction(arm, poses, options, settings, planar=planar)


def fastest_mode(arm: Arm, poses: FloatArray, *, planar: bool) -> float:
    """Largest eigenvalue of M⁻¹ [1/(kg m²)] at some poses; of its bends alone for a planar motion.

    Args:
        arm: the arm.
        poses: shape (N, 3 * links) [rad].
        planar: whether the arm stays in its plane.
    """
    mass_matrix = MassMatrix(arm)
    moving = _moving(planar=planar)
    # λmax of M⁻¹ is 1 / λmin of M, for which one eigenvalue suffices.
    smallest = min(eigvalsh(mass_matrix(q)[moving, moving], subset_by_index=[0, 0])[0] for q in poses)
    return float(1.0 / smallest) if smallest > 0.0 else float("inf")


def _check_damping(options: SimulationOptions, settings: SimulationSettings) -> None:
    """Kp dt < 2 Kd."""
    gain = gains(options)
    value = gain.proportional * options.step
    bound = 2.0 * gain.derivative
    if value < bound:
        return
    advice: tuple[str, ...]
    if options.controller == "computed-torque":
        advice = _computed_torque_advice(options, settings, bound / value if value > 0.0 else 0.0)
    else:
        least = 0.5 * options.proportional_gain * options.step
        advice = (f"simulation.derivative_gain above {settings.advised_damping * least:.3g} N m s/rad",)
    raise _unstable("Kp · dt < 2 Kd", value, bound, gain, options, advice)


def _check_fastest_mode(
    arm: Arm, poses: FloatArray, options: SimulationOptions, settings: SimulationSettings, *, planar: bool
) -> None:
    """Kd λmax dt < 2."""
    gain = gains(options)
    # Computed torque divides M out of the loop, so that every mode has λ = 1.
    computed = options.controller == "computed-torque"
    fastest = 1.0 if computed else fastest_mode(arm, poses, planar=planar)
    value = gain.derivative * fastest * options.step
    if value < 2.0:
        return

    advice: tuple[str, ...]
    if computed:
        advice = _computed_torque_advice(options, settings, 2.0 / value)
    else:
        # The left side is linear in gain and step alike, so one share serves the advice on both.
        share = settings.advised_share * 2.0 / value
        advice = (
            f"simulation.derivative_gain below {share * options.derivative_gain:.3g} N m s/rad",
            f"simulation.step below {share * options.step:.3g} s",
            'simulation.controller = "computed-torque"',
        )
    raise _unstable("Kd · λmax · dt < 2", value, 2.0, gain, options, advice, fastest)


def _check_feed(
    arm: Arm, poses: FloatArray, options: SimulationOptions, settings: SimulationSettings, *, planar: bool
) -> None:
    """Under PD the feed axis moves less than the whole arm at first; refuse damping that is too much for that."""
    if options.controller == "computed-torque":
        return
    # The base has one mode: λ is the inverse of the mass that moves with it at once.
    rate = feed_gains(arm, options).derivative / _lightest_base(arm, poses, planar=planar)
    value = rate * options.step
    if value < 2.0:
        return
    share = settings.advised_share * 2.0 / value
    reason = f"PD of the feed axis is unstable: Kd · dt / m < 2 is needed, but the left side is {value:.4g}"
    advice = (
        f"simulation.bandwidth below {share * options.bandwidth:.3g} 1/s",
        f"simulation.step below {share * options.step:.3g} s",
        'simulation.controller = "computed-torque"',
    )
    raise SimulationError(Diagnosis(reason, "simulation", advice, {"value": value, "bound": 2.0}))


def _check_friction(
    arm: Arm, poses: FloatArray, options: SimulationOptions, settings: SimulationSettings, *, planar: bool
) -> None:
    """Friction damps the fastest mode at a rate that the integrator must follow."""
    friction = float(np.max(arm.friction))
    if friction == 0.0:
        return
    value = friction * fastest_mode(arm, poses, planar=planar) * options.step
    if value < RUNGE_KUTTA_REACH:
        return
    share = settings.advised_share * RUNGE_KUTTA_REACH / value
    reason = (
        f"friction of {friction:.4g} N m s/rad cannot be integrated at dt = {options.step:.4g} s: "
        f"b · λmax · dt < {RUNGE_KUTTA_REACH} is needed, but the left side is {value:.4g}"
    )
    advice = (
        f"simulation.step below {share * options.step:.3g} s",
        f"friction below {share * friction:.3g} N m s/rad",
    )
    raise SimulationError(Diagnosis(reason, "simulation", advice, {"value": value, "bound": RUNGE_KUTTA_REACH}))


def _lightest_base(arm: Arm, poses: FloatArray, *, planar: bool) -> float:
    """Least mass [kg] that the base moves at once when it is pushed and the joints are free, at some poses.

    The Schur complement of the joints in the mass matrix: what is left when they give way.
    """
    mass_matrix = MassMatrix(arm)
    moving = _moving(planar=planar)
    masses = []
    for q in poses:
        M = mass_matrix.with_feed(q)
        coupling = M[0, 1:][moving]
        joints = M[1:, 1:][moving, moving]
        masses.append(M[0, 0] - coupling @ np.linalg.solve(joints, coupling))
    return float(min(masses))


def _moving(*, planar: bool) -> slice:
    """The revolutes that move: of a planar motion the bends alone, the middle one of each ball."""
    return slice(1, None, 3) if planar else slice(None)


def _spread(angles: FloatArray, count: int) -> FloatArray:
    """Some poses of a motion, first and last among them."""
    rows = np.unique(np.linspace(0, len(angles) - 1, count).round().astype(int))
    return np.asarray(angles[rows], dtype=np.float64)


def _computed_torque_advice(options: SimulationOptions, settings: SimulationSettings, ratio: float) -> tuple[str, str]:
    """What would do when a condition's left side must shrink to ``ratio`` of itself."""
    share = settings.advised_share * ratio
    return (
        f"simulation.bandwidth below {share * options.bandwidth:.3g} 1/s",
        f"simulation.step below {share * options.step:.3g} s",
    )


def _unstable(
    condition: str,
    value: float,
    bound: float,
    gain: Gains,
    options: SimulationOptions,
    advice: tuple[str, ...],
    fastest: float = 1.0,
) -> SimulationError:
    law = (
        f"{options.controller} with Kp = {gain.proportional:.4g}, Kd = {gain.derivative:.4g}, dt = {options.step:.4g} s"
    )
    return SimulationError(
        Diagnosis(
            reason=f"{law} is unstable: {condition} is needed, but the left side is {value:.4g}, the right {bound:.4g}",
            stage="simulation",
            advice=advice,
            evidence={"condition": condition, "value": value, "bound": bound, "lambda_max": fastest},
        )
    )
