"""Stability conditions of the sampled control loop, checked before a simulation.

The control is computed at the start of a step of length dt and held over the step, so that a mode x of the joint errors
moves by x' = x + dt v − ½ dt² a and v' = v − dt a.

Under computed torque a = Kp x + Kd v. With α = Kp dt² and β = Kd dt the roots of z² − (2 − α/2 − β) z + (1 + α/2 − β)
lie inside the unit circle exactly if β < 2 and α < 2 β (Jury's test); with Kp = ωn² and Kd = 2 ωn: if ωn dt < 1.

PD uses the errors at the end of the step, a = (κ (x + dt v) + v) ν / (1 + ν dt) with κ = Kp / Kd, equal for all joints,
and ν an eigenvalue of M⁻¹ Kd. Jury's test leaves one condition, ν dt (1 + κ dt) / (1 + ν dt) < 2, which holds for every
arm if κ dt < 1. Where the arm is lighter than its controller assumes, by a factor, the left side is larger by the
inverse of this factor. Gravity torques are those of the measured pose; those of the reference would leave the stiffness
of gravity in the loop, which low gains cannot stabilise.
"""

import numpy as np
from scipy.linalg import eigvalsh

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, SimulationError
from ccm_opt.dynamics.runtime.inverse_dynamics import MassMatrix
from ccm_opt.dynamics.simulation.controller import base_gains, gains
from ccm_opt.problem import SimulationOptions
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import coupling_of_revolutes, drive_names

_CHECKED_POSES = 9
"""Number of poses along the motion at which gains and friction are compared with the mass matrix.

Heuristic: the largest eigenvalue varies slowly along a motion, and a pose costs one mass matrix and one eigenvalue.
"""
_ADVISED_SHARE = 0.9
"""Fraction of a stability bound at which advised values are set. Heuristic."""

RUNGE_KUTTA_REACH = 2.78
"""Largest |λ dt| on the negative real axis for which the classical Runge-Kutta method is stable.

There 1 + z + … + z⁴/24 reaches 1.
"""


def check_stability(
    arm: Arm,
    angles: FloatArray,
    places: FloatArray,
    options: SimulationOptions,
    *,
    planar: bool,
    believed: Arm | None = None,
) -> None:
    """Raise an error for gains with which the sampled loop is unstable, or friction that the integrator cannot follow.

    Args:
        arm: the simulated arm.
        angles: reference motion, shape (T, 3 * links) [rad].
        places: positions of the axes that carry the base, shape (T, k) [m, rad].
        options: controller, gains and step.
        planar: whether the arm stays in its plane, so that only the bends matter.
        believed: the arm as modelled by its controller; the arm itself if None.

    Raises:
        SimulationError: a condition of this module's docstring is violated; the message states the values.
    """
    poses = _spread(angles, _CHECKED_POSES)
    if options.controller == "computed-torque":
        _check_computed_torque(options)
    else:
        _check_pd(believed or arm, poses, options, planar=planar)
    if arm.base_axes and options.controller == "pd":
        _check_base(arm, poses, _spread(places, _CHECKED_POSES), options, planar=planar)
    _check_friction(arm, poses, options, planar=planar)


def fastest_mode(arm: Arm, poses: FloatArray, *, planar: bool) -> float:
    """Return the largest eigenvalue of the inverse mass matrix M⁻¹ over several poses [1/(kg m²)].

    Args:
        arm: the arm.
        poses: angles of all revolutes, shape (N, 3 * links) [rad].
        planar: whether the arm stays in its plane, so that only the bends count.
    """
    return fastest_rate(arm, poses, np.ones(len(drive_names(arm))), planar=planar)


def fastest_rate(arm: Arm, poses: FloatArray, damping: FloatArray, *, planar: bool) -> float:
    """Return the largest eigenvalue of M⁻¹ diag(damping) over several poses, with mass matrix M [1/s].

    Args:
        arm: the arm.
        poses: angles of all revolutes, shape (N, 3 * links) [rad].
        damping: viscous damping of every drive that bends the arm, shape (n,) [N m s/rad].
        planar: whether the arm stays in its plane, so that only the bends count.
    """
    mass_matrix = MassMatrix(arm)
    moving = _moving(planar=planar)
    # M⁻¹ K has the eigenvalues of K^½ M⁻¹ K^½, whose inverse is symmetric: K^-½ M K^-½.
    scale = 1.0 / np.sqrt(damping[moving])
    smallest = min(
        eigvalsh(scale[:, None] * mass_matrix(q)[moving, moving] * scale, subset_by_index=[0, 0])[0] for q in poses
    )
    return float(1.0 / smallest) if smallest > 0.0 else float("inf")


def _check_computed_torque(options: SimulationOptions) -> None:
    """Raise an error for computed-torque gains that violate ωn dt < 1."""
    value = options.bandwidth * options.step
    if value < 1.0:
        return
    share = _ADVISED_SHARE / value
    reason = (
        f"computed-torque with a bandwidth of {options.bandwidth:.4g} 1/s, dt = {options.step:.4g} s, is unstable: "
        f"bandwidth · dt < 1 is needed, but the left side is {value:.4g}"
    )
    advice = (
        f"simulation.bandwidth below {share * options.bandwidth:.3g} 1/s",
        f"simulation.step below {share * options.step:.3g} s",
    )
    raise SimulationError(Diagnosis(reason, "simulation", advice, {"value": value, "bound": 1.0}))


def _check_pd(believed: Arm, poses: FloatArray, options: SimulationOptions, *, planar: bool) -> None:
    """Raise an error for PD gains unless ν dt (1 + κ dt) / (1 + ν dt) < 2 (1 + mass error).

    The mass error enters if the arm is lighter than modelled; the symbols are those of this module's docstring.
    """
    step = options.step
    proportional, derivative = gains(believed, options)
    ratio = float(np.max(proportional / derivative))
    rate = fastest_rate(believed, poses, derivative, planar=planar)
    value = rate * step * (1.0 + ratio * step) / (1.0 + rate * step)
    bound = 2.0 * (1.0 + min(options.disturbances.mass_error, 0.0))
    if value < bound:
        return

    reason = (
        f"pd with Kp / Kd = {ratio:.4g} 1/s, dt = {step:.4g} s, is unstable for this arm: "
        f"a dt (1 + Kp / Kd · dt) / (1 + a dt) < {bound:.4g} is needed, with a = {rate:.4g} 1/s the greatest "
        f"eigenvalue of M⁻¹ Kd, but the left side is {value:.4g}"
    )
    evidence = {"value": value, "bound": bound, "fastest_rate": rate}
    raise SimulationError(Diagnosis(reason, "simulation", _pd_advice(options, ratio, bound), evidence))


def _pd_advice(options: SimulationOptions, ratio: float, bound: float) -> tuple[str, ...]:
    """Return advice on how to make PD control stable.

    The advised values are sufficient for every eigenvalue ν of M⁻¹ Kd. If no gains are, because the arm is too much
    lighter than modelled, the advice is to reduce the mass error or to change the control law.

    Args:
        options: controller, gains and step.
        ratio: κ = Kp / Kd [1/s].
        bound: upper bound on ν dt (1 + κ dt) / (1 + ν dt).
    """
    computed = 'simulation.controller = "computed-torque"'
    # For ν → ∞ the condition is 1 + κ dt < bound.
    most = _ADVISED_SHARE * (bound - 1.0) / options.step
    if most <= 0.0:
        return ("simulation.disturbances.mass_error above -0.5", computed)
    shorter = f"simulation.step below {most / ratio * options.step:.3g} s"
    given = options.proportional_gain
    if given is None or options.derivative_gain is None:
        return (f"simulation.bandwidth below {2.0 * most:.3g} 1/s", shorter, computed)
    return (f"simulation.gains.derivative above {given / most:.3g} N m s/rad", shorter, computed)


def _check_base(arm: Arm, poses: FloatArray, places: FloatArray, options: SimulationOptions, *, planar: bool) -> None:
    """Raise an error for PD damping of the axes of the base that is too large for the effective mass of the base.

    Args:
        arm: the simulated arm.
        poses: angles of all revolutes, shape (N, 3 * links) [rad].
        places: positions of the axes, shape (N, k) [m, rad].
        options: gains and step.
        planar: whether the arm stays in its plane, so that only the bends move.
    """
    value = _fastest_base(arm, poses, places, base_gains(arm, options)[1], planar=planar) * options.step
    if value < 2.0:
        return
    share = _ADVISED_SHARE * 2.0 / value
    which = "the feed axis" if arm.feed is not None else "the axes of the base"
    reason = f"PD of {which} is unstable: Kd · dt / m < 2 is needed, but the left side is {value:.4g}"
    advice = (
        f"simulation.bandwidth below {share * options.bandwidth:.3g} 1/s",
        f"simulation.step below {share * options.step:.3g} s",
        'simulation.controller = "computed-torque"',
    )
    raise SimulationError(Diagnosis(reason, "simulation", advice, {"value": value, "bound": 2.0}))


def _check_friction(arm: Arm, poses: FloatArray, options: SimulationOptions, *, planar: bool) -> None:
    """Raise an error for friction that damps the fastest mode at a rate that the integrator cannot follow."""
    friction = float(np.max(arm.friction))
    coupling = coupling_of_revolutes(arm)
    if coupling is not None:
        friction = float(np.max(np.broadcast_to(arm.friction, len(coupling)) @ coupling**2))
    if friction == 0.0:
        return
    value = friction * fastest_mode(arm, poses, planar=planar) * options.step
    if value < RUNGE_KUTTA_REACH:
        return
    share = _ADVISED_SHARE * RUNGE_KUTTA_REACH / value
    reason = (
        f"friction of {friction:.4g} N m s/rad cannot be integrated at dt = {options.step:.4g} s: "
        f"b · λmax · dt < {RUNGE_KUTTA_REACH} is needed, but the left side is {value:.4g}"
    )
    advice = (
        f"simulation.step below {share * options.step:.3g} s",
        f"friction below {share * friction:.3g} N m s/rad",
    )
    raise SimulationError(Diagnosis(reason, "simulation", advice, {"value": value, "bound": RUNGE_KUTTA_REACH}))


def _fastest_base(arm: Arm, poses: FloatArray, places: FloatArray, damping: FloatArray, *, planar: bool) -> float:
    """Return the largest eigenvalue of m⁻¹ diag(damping) over poses, with the effective mass m of the base [1/s].

    The effective mass, with freely moving joints, is the Schur complement of the joints' block in the mass matrix.
    """
    mass_matrix = MassMatrix(arm)
    axes = len(damping)
    scale = 1.0 / np.sqrt(damping)
    smallest = []
    for q, place in zip(poses, places, strict=True):
        M = mass_matrix.with_base(q, place)
        coupling = M[:axes, axes:][:, _moving(planar=planar)]
        joints = M[axes:, axes:][_moving(planar=planar), _moving(planar=planar)]
        effective = M[:axes, :axes] - coupling @ np.linalg.solve(joints, coupling.T)
        smallest.append(eigvalsh(scale[:, None] * effective * scale, subset_by_index=[0, 0])[0])
    least = float(min(smallest))
    return 1.0 / least if least > 0.0 else float("inf")


def _moving(*, planar: bool) -> slice:
    """Return the indices of the revolutes that move: all, or in a planar motion the second of each ball joint."""
    return slice(1, None, 3) if planar else slice(None)


def _spread(angles: FloatArray, count: int) -> FloatArray:
    """Return evenly selected rows of a motion, including the first and the last, with the columns of the motion."""
    rows = np.unique(np.linspace(0, len(angles) - 1, count).round().astype(int))
    return np.asarray(angles[rows], dtype=np.float64)
