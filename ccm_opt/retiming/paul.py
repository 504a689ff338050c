"""Timing by Paul's transitions (Paul 1981, chapter 5): the paper's own trajectory planning (section 5.4).

Joints move at constant speed along the legs between keyframes and turn smoothly at each, see ``transitions``. The
times of the legs are found here: every leg is lengthened until speed, acceleration and torque keep their limits, then
shortened where they leave room. Transitions leave the polygon of keyframes, by less the smaller the window that they
may take of a leg; whoever calls this must verify the motion.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.problem import Limits
from ccm_opt.retiming.efforts import InverseDynamics, Revolutes
from ccm_opt.retiming.motion_limits import MotionLimit, limits_along
from ccm_opt.retiming.motion_samples import MotionSamples
from ccm_opt.retiming.path_limits import PathLimits, likely_coordinates
from ccm_opt.retiming.paul_settings import DEFAULT_PAUL, PaulSettings
from ccm_opt.retiming.timed_path import TimedPath
from ccm_opt.retiming.timing_settings import DEFAULT_TIMING
from ccm_opt.retiming.transitions import Legs
from ccm_opt.solution import JointPath, JointTrajectory


def retime_paul(
    path: JointPath,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    *,
    revolutes: Revolutes,
    window: float = DEFAULT_PAUL.windows[0],
    step: float = DEFAULT_TIMING.sampling.step,
    coordinates: Coordinates | None = None,
    arm: DrivenArm | None = None,
    share: float = 1.0,
    settings: PaulSettings = DEFAULT_PAUL,
) -> JointTrajectory:
    """A motion along the keyframes of a path by Paul's transitions, from rest to rest, within the limits.

    Args:
        path: its keyframes are the via points; the spline between them is not used.
        limits: of every revolute; ball i's bend is revolute 3 i + 1; of the feed axis; and of points of the arm.
        inverse_dynamics: (angles, velocities, accelerations), each (N, 3 * links), to torques of that shape [N m].
        revolutes: bends (N, links) to revolute angles (N, 3 * links); linear, so it serves rates too.
        window: largest half transition as a share of the shorter leg beside it, at most ½.
        step: largest time between two samples [s].
        coordinates: what the columns of the path are; when None, a bend a link, and a feed axis if one is left over.
        arm: whose points are limited; needed when the limits name some.
        share: of the limits of the drives that may be used, see ``jointed.drive_limits``.
        settings: numbers of the transitions.

    Returns:
        Samples at equal times, the first and last at rest at the path's ends. The motion leaves the polygon of
        keyframes at its corners; it is for the caller to verify it.

    Raises:
        RetimingError: a joint cannot even hold the arm at some point of the polygon, or no slower motion keeps the
            torque limits.
    """
    vias = _distinct(path.keyframes, settings.no_leg)
    columns = coordinates or likely_coordinates(limits, vias.shape[1])
    timed = TimedPath(_polygon(vias), limits, inverse_dynamics, revolutes, columns, arm, share)
    # Those on the coordinates' own velocities and accelerations are kept by the legs as they are made.
    others = [limit for limit in limits_along(timed) if not limit.kept_by_legs]
    for limit in others:
        limit.rows(timed.spline, np.linspace(0.0, 1.0, settings.static_points))  # an error where the arm cannot rest
    if len(vias) < 2:
        return _sampled(_standing(path.keyframes, step), step).trajectory(columns, "rest")

    axes = timed.bounds
    least = settings.least_samples * step
    legs = fastest_legs(vias, axes, window, least, settings)
    for attempt in range(settings.drive_rounds):
        stretch = _stretch_of_legs(legs, others, step, settings.longest)
        if np.max(stretch) <= 1.0:
            return _sampled(legs, step).trajectory(columns, "paul")
        # At first only the legs at fault are lengthened. Legs influence their neighbours, so this need not settle;
        # slowing the whole motion does.
        if 2 * attempt < settings.drive_rounds:
            legs = lengthened(vias, legs.times * np.maximum(stretch, 1.0), axes, window, least, settings)
        else:
            legs = legs.slowed(float(np.max(stretch)) * (1.0 + 1e-6))
    raise _no_speed(limits)


def fastest_legs(
    vias: FloatArray, axes: PathLimits, window: float, least: float, settings: PaulSettings = DEFAULT_PAUL
) -> Legs:
    """Legs as short as the limits on speed and acceleration let them be, nearly.

    Legs are lengthened until the limits hold, then shortened by turns wherever they still do.

    Args:
        vias: shape (K ≥ 2, n).
        axes: limits.
        window: largest half transition as a share of the shorter leg beside it.
        least: least half transition [s].
        settings: shares and rounds.
    """
    lengths = np.abs(np.diff(vias, axis=0))
    legs = lengthened(vias, np.max(lengths / (settings.share * axes.velocity), axis=1), axes, window, least, settings)
    for factor in settings.shortening:
        for sweep in range(settings.sweeps):
            legs = _shortened(legs, axes, window, least, settings, factor, sweep % 2)
    return legs


def lengthened(
    vias: FloatArray, times: FloatArray, axes: PathLimits, window: float, least: float, settings: PaulSettings
) -> Legs:
    """Legs of at least the given times, lengthened where a limit on speed or acceleration is passed."""
    legs = with_transitions(vias, np.maximum(times, least / window), axes, window, least, settings.share)
    for _ in range(settings.rounds):
        need = needed(legs, axes, settings.share)
        if np.max(need) <= 1.0:
            return legs
        legs = with_transitions(
            vias, legs.times * np.maximum(need, 1.0) * (1.0 + 1e-9), axes, window, least, settings.share
        )
    return legs.slowed(max(1.0, float(np.max(needed(legs, axes, settings.share)))))


def with_transitions(
    vias: FloatArray, times: FloatArray, axes: PathLimits, window: float, least: float, share: float
) -> Legs:
    """Give legs their transitions: as short as acceleration lets them be, but within the window."""
    # A half transition takes at most its share of the shorter leg beside it; beyond both ends there is no leg.
    most = window * np.minimum(np.append(times, np.inf), np.append(np.inf, times))
    legs = Legs(vias, times, most)
    change = np.abs(np.diff(legs.speeds, axis=0))
    # A transition peaks at ¾ |Δv| / τ, solved here for the half time τ at which that is the limit.
    wanted = 0.75 * np.max(change / (share * axes.acceleration), axis=1)
    return replace(legs, halves=np.minimum(np.maximum(wanted, least), most))


def needed(legs: Legs, axes: PathLimits, share: float) -> FloatArray:
    """Factor on the time of each leg that its speed and the transitions at its ends need, shape (K − 1,)."""
    # The first and the last speed are the rest before and after the motion, not those of legs.
    speed = np.max(np.abs(legs.speeds[1:-1]) / (share * axes.velocity), axis=1)
    change = np.abs(np.diff(legs.speeds, axis=0))
    growth = 0.75 * np.max(change / (share * axes.acceleration), axis=1) / legs.halves
    # Legs longer by λ lower |Δv| by λ and lengthen τ by λ: their peak falls by λ².
    turn = np.sqrt(growth)
    return np.asarray(np.maximum(speed, np.maximum(turn[:-1], turn[1:])))


def _shortened(
    legs: Legs, axes: PathLimits, window: float, least: float, settings: PaulSettings, factor: float, colour: int
) -> Legs:
    """Shorten every second leg where it and its neighbours still keep the limits; they share no via point."""
    times = legs.times.copy()
    # Never so short that the least half transition would not fit into the window.
    times[colour::2] = np.maximum(factor * times[colour::2], least / window)
    trial = with_transitions(legs.vias, times, axes, window, least, settings.share)
    fails = needed(trial, axes, settings.share) > 1.0 + 1e-12
    # A leg shares its transitions with its neighbours: where one of them fails, both sides go back.
    near = fails | np.append(fails[1:], False) | np.append(False, fails[:-1])
    return with_transitions(legs.vias, np.where(near, legs.times, times), axes, window, least, settings.share)


def _stretch_of_legs(legs: Legs, limits: Sequence[MotionLimit], step: float, longest: int) -> FloatArray:
    """Factor on the time of each leg that brings its samples within the limits, shape (K − 1,)."""
    stretch = np.zeros(len(legs.times))
    if not limits:
        return stretch
    # So slow a motion would fill the memory with samples, and is of no use.
    if legs.duration > longest * step:
        raise _too_slow(legs.duration)
    samples = _sampled(legs, step)
    need = np.max([limit.stretches(samples) for limit in limits], axis=0)

    # A sample in a turn is due to the legs on both sides of it.
    via, turning = legs.piece(samples.time)
    last = len(stretch) - 1
    np.maximum.at(stretch, np.minimum(via, last), need)
    np.maximum.at(stretch, np.maximum(via - turning, 0), need)
    return stretch


def _sampled(legs: Legs, step: float) -> MotionSamples:
    time = _sample_times(legs, step)
    q, qd, qdd = legs.at(time)
    # Both ends are free of rounding: the motion starts and ends exactly where it was asked to, at rest.
    q[[0, -1]] = legs.vias[[0, -1]]
    qd[[0, -1]] = 0.0
    qdd[[0, -1]] = 0.0
    return MotionSamples(time / time[-1], time, q, qd, qdd)


def _sample_times(legs: Legs, step: float) -> FloatArray:
    return np.linspace(0.0, legs.duration, max(1, int(np.ceil(legs.duration / step - 1e-9))) + 1)


def _distinct(keyframes: FloatArray, least: float) -> FloatArray:
    """The keyframes without those that repeat the one before; the last is kept."""
    kept = [keyframes[0]]
    for row in keyframes[1:]:
        if np.max(np.abs(row - kept[-1])) > least:
            kept.append(row)
    # The last one kept may be a hair beside the goal, but the motion must end at the goal itself.
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


def _too_slow(duration: float) -> RetimingError:
    return RetimingError(
        Diagnosis(
            reason=f"a motion of legs and turns that keeps the limits would take more than {duration:.4g} s",
            stage="retiming",
            advice=(
                "raise the limits",
                "raise planner.effort_share",
                'use planner.retiming = "toppra", which stays on the path',
            ),
            evidence={"duration": duration},
        )
    )
