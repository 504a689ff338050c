"""Timing by Paul's transitions (Paul 1981, chapter 5): the paper's own trajectory planning (section 5.4).

Joints move at constant speed along the legs between keyframes and turn smoothly at each, see ``transitions``. The
times of the legs are found here: every leg is lengthened until speed, acceleration and torque keep their limits, then
shortened where they leave room. Transitions leave the polygon of keyframes, by less the smaller the window that they
may take of a leg; whoever calls this must verify the motion.
"""

from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.problem import Limits
from ccm_opt.retiming.efforts import InverseDynamics, Revolutes
from ccm_opt.retiming.path_limits import PathLimits, likely_coordinates
from ccm_opt.retiming.path_rows import path_rows
from ccm_opt.retiming.static_load import check_static_load
from ccm_opt.retiming.transitions import Legs
from ccm_opt.solution import JointPath, JointTrajectory

WINDOWS = (0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625)
"""Largest half transition as a share of the shorter leg beside it, in the order in which they are worth a try."""
SHARE = 0.995
"""Share of every limit that is used."""
LEAST_SAMPLES = 2
"""Samples in half a transition, at least, so that the samples show what happens in it."""
ROUNDS = 60
"""Most rounds of lengthening legs; what is left after them is met by stretching time."""
TORQUE_ROUNDS = 24
"""Most rounds of slowing down where torques are too great: legs by themselves in the first half, then all of them."""
LONGEST = 1_000_000
"""Most samples of a motion; a motion that needs more time than that is given up."""
SHORTENING = (0.8, 0.9, 0.95, 0.98, 0.99)
"""Factors by which legs are shortened where the limits leave room."""
SWEEPS = 12
"""Sweeps with each factor."""
STATIC_POINTS = 400
"""Places along the polygon at which the joints must be able to hold the arm."""
NO_LEG = 1e-9
"""Legs shorter than this in joint space [rad] are left out."""


def retime_paul(
    path: JointPath,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    *,
    revolutes: Revolutes,
    window: float = WINDOWS[0],
    step: float = 4e-3,
    coordinates: Coordinates | None = None,
) -> JointTrajectory:
    """A motion along the keyframes of a path by Paul's transitions, from rest to rest, within the limits.

    Args:
        path: its keyframes are the via points; the spline between them is not used.
        limits: of every revolute; ball i's bend is revolute 3 i + 1; and of the feed axis.
        inverse_dynamics: (angles, velocities, accelerations), each (N, 3 * links), to torques of that shape [N m].
        revolutes: bends (N, links) to revolute angles (N, 3 * links); linear, so it serves rates too.
        window: largest half transition as a share of the shorter leg beside it, at most ½.
        step: largest time between two samples [s].
        coordinates: what the columns of the path are; when None, a bend a link, and a feed axis if one is left over.

    Returns:
        Samples at equal times, the first and last at rest at the path's ends. The motion leaves the polygon of
        keyframes at its corners; it is for the caller to verify it.

    Raises:
        RetimingError: a joint cannot even hold the arm at some point of the polygon, or no slower motion keeps the
            torque limits.
    """
    vias = _distinct(path.keyframes)
    columns = coordinates or likely_coordinates(limits, vias.shape[1])
    dynamics = (limits, inverse_dynamics, revolutes, columns)
    polygon = _polygon(vias)
    if limits.torque is not None:
        check_static_load(path_rows(polygon, np.linspace(0.0, 1.0, STATIC_POINTS), *dynamics), limits, columns)
    if len(vias) < 2:
        return _sampled(_standing(path.keyframes, step), columns, step)
    axes = PathLimits.from_limits(limits, columns, vias.shape[1])
    least = LEAST_SAMPLES * step
    legs = fastest_legs(vias, axes, window, least)
    for attempt in range(TORQUE_ROUNDS):
        stretch = _torque_stretch(legs, *dynamics, step)
        if np.max(stretch) <= 1.0:
            return _sampled(legs, columns, step)
        if 2 * attempt < TORQUE_ROUNDS:
            legs = lengthened(vias, legs.times * np.maximum(stretch, 1.0), axes, window, least)
        else:
            legs = legs.slowed(float(np.max(stretch)) * (1.0 + 1e-6))
    raise _no_speed(limits)


def fastest_legs(vias: FloatArray, axes: PathLimits, window: float, least: float) -> Legs:
    """Legs as short as the limits on speed and acceleration let them be, nearly.

    Legs are lengthened until the limits hold, then shortened by turns wherever they still do.

    Args:
        vias: shape (K ≥ 2, n).
        axes: limits.
        window: largest half transition as a share of the shorter leg beside it.
        least: least half transition [s].
    """
    lengths = np.abs(np.diff(vias, axis=0))
    legs = lengthened(vias, np.max(lengths / (SHARE * axes.velocity), axis=1), axes, window, least)
    for factor in SHORTENING:
        for sweep in range(SWEEPS):
            legs = _shortened(legs, axes, window, least, factor, sweep % 2)
    return legs


def lengthened(vias: FloatArray, times: FloatArray, axes: PathLimits, window: float, least: float) -> Legs:
    """Legs of at least the given times, lengthened where a limit on speed or acceleration is passed."""
    legs = with_transitions(vias, np.maximum(times, least / window), axes, window, least)
    for _ in range(ROUNDS):
        need = needed(legs, axes)
        if np.max(need) <= 1.0:
            return legs
        legs = with_transitions(vias, legs.times * np.maximum(need, 1.0) * (1.0 + 1e-9), axes, window, least)
    return legs.slowed(max(1.0, float(np.max(needed(legs, axes)))))


def with_transitions(vias: FloatArray, times: FloatArray, axes: PathLimits, window: float, least: float) -> Legs:
    """Give legs their transitions: as short as acceleration lets them be, but within the window."""
    most = window * np.minimum(np.append(times, np.inf), np.append(np.inf, times))
    legs = Legs(vias, times, most)
    change = np.abs(np.diff(legs.speeds, axis=0))
    wanted = 0.75 * np.max(change / (SHARE * axes.acceleration), axis=1)
    return replace(legs, halves=np.minimum(np.maximum(wanted, least), most))


def needed(legs: Legs, axes: PathLimits) -> FloatArray:
    """Factor on the time of each leg that its speed and the transitions at its ends need, shape (K − 1,)."""
    speed = np.max(np.abs(legs.speeds[1:-1]) / (SHARE * axes.velocity), axis=1)
    change = np.abs(np.diff(legs.speeds, axis=0))
    growth = 0.75 * np.max(change / (SHARE * axes.acceleration), axis=1) / legs.halves
    turn = np.sqrt(growth)
    return np.asarray(np.maximum(speed, np.maximum(turn[:-1], turn[1:])))


def _shortened(legs: Legs, axes: PathLimits, window: float, least: float, factor: float, colour: int) -> Legs:
    """Shorten every second leg where it and its neighbours still keep the limits; they share no via point."""
    times = legs.times.copy()
    times[colour::2] = np.maximum(factor * times[colour::2], least / window)
    trial = with_transitions(legs.vias, times, axes, window, least)
    fails = needed(trial, axes) > 1.0 + 1e-12
    near = fails | np.append(fails[1:], False) | np.append(False, fails[:-1])
    return with_transitions(legs.vias, np.where(near, legs.times, times), axes, window, least)


def _torque_stretch(
    legs: Legs,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    revolutes: Revolutes,
    coordinates: Coordinates,
    step: float,
) -> FloatArray:
    """Factor on the time of each leg that brings the torques of its samples within their limits, shape (K − 1,)."""
    stretch = np.zeros(len(legs.times))
    if limits.torque is None:
        return stretch
    if legs.duration > LONGEST * step:
        raise _no_speed(limits)
    time = _sample_times(legs, step)
    q, qd, qdd = (revolutes(values[:, coordinates.bends]) for values in legs.at(time))
    static = inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q)) / limits.torque
    moving = inverse_dynamics(q, qd, qdd) / limits.torque - static
    via, turning = legs.piece(time)
    if np.max(np.abs(static)) >= 1.0:
        raise _no_speed(limits)
    need = np.sqrt(np.max(np.abs(moving) / (1.0 - np.sign(moving) * static), axis=1))
    last = len(stretch) - 1
    np.maximum.at(stretch, np.minimum(via, last), need)
    np.maximum.at(stretch, np.maximum(via - turning, 0), need)
    return stretch


def _sampled(legs: Legs, coordinates: Coordinates, step: float) -> JointTrajectory:
    time = _sample_times(legs, step)
    q, qd, qdd = legs.at(time)
    q[[0, -1]], qd[[0, -1]], qdd[[0, -1]] = legs.vias[[0, -1]], 0.0, 0.0
    return JointTrajectory(time, q, qd, qdd, coordinates)


def _sample_times(legs: Legs, step: float) -> FloatArray:
    return np.linspace(0.0, legs.duration, max(1, int(np.ceil(legs.duration / step - 1e-9))) + 1)


def _distinct(keyframes: FloatArray) -> FloatArray:
    """The keyframes without those that repeat the one before; the last is kept."""
    kept = [keyframes[0]]
    for row in keyframes[1:]:
        if np.max(np.abs(row - kept[-1])) > NO_LEG:
            kept.append(row)
    if len(kept) > 1:
        kept[-1] = keyframes[-1]
    return np.array(kept)


def _standing(keyframes: FloatArray, step: float) -> Legs:
    """Standing still for one step."""
    ends = keyframes[[0, -1]]
    return Legs(np.array([ends[0], ends[0]]), np.array([0.5 * step]), np.array([0.25 * step, 0.25 * step]))


def _polygon(vias: FloatArray) -> BSpline:
    """The polygon as a spline of degree 1 over [0, 1]; one via point alone counts twice."""
    vias = vias if len(vias) > 1 else np.repeat(vias, 2, axis=0)
    knots = np.concatenate(([0.0], np.linspace(0.0, 1.0, len(vias)), [1.0]))
    return BSpline(knots, vias, 1)


def _no_speed(limits: Limits) -> RetimingError:
    torque = None if limits.torque is None else float(np.min(limits.torque))
    return RetimingError(
        Diagnosis(
            reason="however slow, a transition takes a pose that the joints cannot hold within their torque limits",
            stage="retiming",
            advice=("raise the torque limit", 'use planner.retiming = "toppra", which stays on the path'),
            evidence={"least_torque_limit": torque},
        )
    )
