"""Time series of a plan as data for the charts of its report.

Path length is measured in joint space, so that the path speed is the norm of the joint velocities. The used fraction of
a limit at a sample is the magnitude of the limited quantity divided by the limit, the maximum over all drives. The
limit with the largest fraction determines the speed. The velocity limits alone would allow the path speed divided by
their used fraction.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.problem.solution import Solution
from ccm_opt.robot.frames import bends_from_revolutes, drive_torque_limits, drive_torques
from ccm_opt.viz.document import NUMBER_STEP, PageUnits, coded, step_for

_MOST_NUMBERS = 70_000
"""Maximum number of values in a chart with all its curves; with more curves, each has fewer samples. Heuristic."""
_MOST_SAMPLES = 2000
"""Maximum number of samples of a chart. Heuristic."""
_LEAST_SAMPLES = 120
"""Number of samples that a chart may always have, even if its values then exceed the maximum number. Heuristic."""
_MOVING = 0.02
"""Used fraction of the velocity limits above which the path speed that they allow is well defined. Heuristic."""
_CURVE_ERROR = 2e-3
"""Maximum distance of a sample from its drawn curve, as a fraction of the chart's range."""
_POSE_ERROR = 1e-4
"""Maximum distance of a joint angle from its drawn curve, from which the arm is animated [rad]."""


def select_samples(time: FloatArray, columns: FloatArray, tolerance: float, most: int, always: IntArray) -> IntArray:
    """Return the indices, increasing, of samples whose piecewise linear interpolation approximates all curves.

    Samples are added one at a time, each time the one farthest from the interpolation in any column (Ramer 1972,
    Douglas and Peucker 1973). Unlike keeping the minimum and maximum of equal time intervals, this bounds the error,
    which the animation of the arm needs, and keeps only a tenth of the samples.

    Args:
        time: increasing times of the T samples, shape (T,).
        columns: values of C curves, one per column, shape (T, C).
        tolerance: maximum distance of a sample from the interpolation, unless ``most`` is reached first.
        most: maximum number of samples kept in addition to those that are always kept.
        always: indices of samples that are always kept; also kept are the first and the last sample, and the minimum
            and maximum of every column.
    """
    kept = {0, len(time) - 1, *np.argmin(columns, axis=0).tolist(), *np.argmax(columns, axis=0).tolist()}
    kept |= set(always.tolist())
    most += len(kept)
    queue = [worst for pair in pairwise(sorted(kept)) if (worst := _farthest(time, columns, *pair))]
    heapq.heapify(queue)
    while queue and len(kept) < most:
        error, middle, begin, end = heapq.heappop(queue)
        if -error <= tolerance:
            break
        kept.add(middle)
        for pair in ((begin, middle), (middle, end)):
            if worst := _farthest(time, columns, *pair):
                heapq.heappush(queue, worst)
    return np.array(sorted(kept), dtype=np.intp)


def _farthest(time: FloatArray, columns: FloatArray, begin: int, end: int) -> tuple[float, int, int, int] | None:
    """Return the sample between two others that is farthest from the line through those two.

    Returns:
        Minus the distance, the index of the sample, ``begin`` and ``end``; None if no sample lies between.
    """
    if end - begin < 2:
        return None
    share = ((time[begin + 1 : end] - time[begin]) / (time[end] - time[begin]))[:, None]
    line = columns[begin] + share * (columns[end] - columns[begin])
    away = np.max(np.abs(columns[begin + 1 : end] - line), axis=1)
    worst = int(np.argmax(away))
    return -float(away[worst]), begin + 1 + worst, begin, end


_STILL = 1e-9
"""Peak value of a revolute joint, as a fraction of the largest of all joints, up to which it gets no curve, since its
values are rounding errors."""


_LEAST_TRACKING = 0.01
"""Minimum extent of the axis of tracking errors, since smaller errors could not be measured [°]."""


@dataclass(frozen=True)
class SeriesGroup:
    """C curves of one quantity over T samples, for one chart.

    Attributes:
        key: name of the chart in the report's scripts.
        title: title above the chart.
        unit: unit of the values.
        names: names of the curves.
        values: values of the curves in ``unit``, shape (T, C).
        limits: limit of the magnitude of each curve, shape (C,); inf where there is none.
        error: maximum distance of a sample from its drawn curve, in ``unit``; None for a fraction of the range.
        least: minimum extent of the vertical axis, in ``unit``, so that negligible values look small.
    """

    key: str
    title: str
    unit: str
    names: tuple[str, ...]
    values: FloatArray
    limits: FloatArray
    error: float | None = None
    least: float = 0.0


def series_data(solution: Solution) -> list[dict[str, object]]:
    """Return all charts of a plan over time, with few samples and encoded, as data for the report's scripts.

    Args:
        solution: the plan.
    """
    trajectory = solution.trajectory
    always = np.array([0, *trajectory.stops, len(trajectory.time) - 1], dtype=np.intp)
    return [_coded_group(group, trajectory.time, always) for group in series_groups(solution)]


def series_groups(solution: Solution) -> Iterator[SeriesGroup]:
    """Yield the curves of all charts of a plan at every sample, joint angles first."""
    arm = solution.problem.arm
    trajectory = solution.trajectory
    joints = trajectory.coordinates.names[trajectory.coordinates.bends]
    bends = np.rad2deg(trajectory.bend_angles)
    yield SeriesGroup(
        "bends", "Joint bends", "°", joints, bends, np.rad2deg(arm.bend_limits), float(np.rad2deg(_POSE_ERROR))
    )
    yield from _base_groups(solution)
    yield from _drive_groups(solution)
    yield _tip_speed(solution)
    yield from _simulated_groups(solution, joints)


def _base_groups(solution: Solution) -> Iterator[SeriesGroup]:
    """Yield position, velocity and force of the feed axis, lengths in the report's unit; nothing for a fixed base."""
    trajectory = solution.trajectory
    limits = solution.problem.limits
    names = trajectory.coordinates.base_names
    if not names:
        return
    if solution.problem.arm.carrier:
        yield from _axis_groups(solution)
        return
    free = np.full(len(names), np.inf)
    speed = free if limits.feed_velocity is None else np.full(len(names), limits.feed_velocity)
    force = free if limits.feed_force is None else np.full(len(names), limits.feed_force)
    unit = PageUnits.of_page(solution.problem)
    yield SeriesGroup("feed", "Feed axis", unit.name, names, trajectory.base_positions / unit.metres, free)
    velocities = trajectory.base_velocities / unit.metres
    yield SeriesGroup("feed-velocity", "Feed velocity", f"{unit.name}/s", names, velocities, speed / unit.metres)
    yield SeriesGroup("feed-force", "Feed force", "N", names, solution.joints.base_forces, force)


def _axis_groups(solution: Solution) -> Iterator[SeriesGroup]:
    """Yield position, velocity and effort of the base axes, one kind of axes after the other."""
    trajectory, problem = solution.trajectory, solution.problem
    limits = problem.limits.of_drives(problem.arm.coordinates)
    for unit, kind, effort in (("m", "Prismatic", "N"), ("rad", "Revolute", "N m")):
        number = np.array([k for k, each in enumerate(trajectory.coordinates.base_units) if each == unit], dtype=int)
        if not len(number):
            continue
        names = tuple(trajectory.coordinates.base_names[k] for k in number)
        drives = trajectory.coordinates.revolutes + number
        key = kind.lower()
        free = np.full(len(names), np.inf)
        yield SeriesGroup(f"{key}-axes", f"{kind} base axes", unit, names, trajectory.base_positions[:, number], free)
        speeds = (trajectory.base_velocities[:, number], limits.velocity[drives])
        yield SeriesGroup(f"{key}-axes-velocity", f"{kind} base axes, velocity", f"{unit}/s", names, *speeds)
        efforts = (solution.joints.base_forces[:, number], limits.effort[drives])
        yield SeriesGroup(f"{key}-axes-effort", f"{kind} base axes, effort", effort, names, *efforts)


def _drive_groups(solution: Solution) -> Iterator[SeriesGroup]:
    """Yield velocities, accelerations and torques of the revolute joints that move or carry load."""
    states = solution.joints
    limits = solution.problem.limits
    coordinates = solution.trajectory.coordinates
    bending = dict(zip(coordinates.drives[coordinates.bends], coordinates.names, strict=False))
    unlimited = np.full(len(states.names), np.inf)
    torque = unlimited if limits.torque is None else limits.torque
    rates = (
        ("velocities", "Joint velocities", "rad/s", states.velocities, limits.velocity),
        ("accelerations", "Joint accelerations", "rad/s²", states.accelerations, limits.acceleration),
    )
    drives = solution.problem.arm.drives
    if drives is not None:
        torques = drive_torques(solution.problem.arm, states.torques)
        bounds = drive_torque_limits(solution.problem.arm, torque)
        title = "Torques of drives" if solution.problem.arm.sections is None else "Torques of sections"
        yield SeriesGroup("torques", title, "N m", drives.drive_names, torques, bounds)
    efforts = (("torques", "Joint torques", "N m", states.torques, torque),) if drives is None else ()
    for key, title, unit, values, bounds in (*rates, *efforts):
        peaks = np.max(np.abs(values), axis=0)
        moved = np.flatnonzero(peaks > _STILL * max(float(peaks.max(initial=0.0)), 1e-300))
        # Drives of bends always get a curve, so that every chart can show every joint.
        kept = np.union1d(moved, list(bending))
        names = tuple(bending.get(int(k)) or _drive_name(int(k)) for k in kept)
        yield SeriesGroup(key, title, unit, names, values[:, kept], np.asarray(bounds)[kept])


def _drive_name(number: int) -> str:
    """Return a name for a revolute joint that does not bend the arm, given its index (from 0) among all revolutes."""
    joint, axis = divmod(number, 3)
    return f"joint {joint + 1}, {('first', 'second', 'third')[axis]} revolute"


def _tip_speed(solution: Solution) -> SeriesGroup:
    """Return the curve of the tip speed, from finite differences and in the report's unit, with any limit."""
    time = solution.trajectory.time
    tips = solution.joint_positions[:, -1]
    velocity = np.gradient(tips, time, axis=0) if len(time) > 1 else np.zeros_like(tips)
    of_tip = [limit.velocity for limit in solution.problem.limits.points if limit.at is None]
    unit = PageUnits.of_page(solution.problem)
    bound = np.array([min(of_tip, default=np.inf)]) / unit.metres
    speed = np.linalg.norm(velocity, axis=1)[:, None] / unit.metres
    return SeriesGroup("tip-speed", "Tip speed", f"{unit.name}/s", ("tip",), speed, bound)


def _simulated_groups(solution: Solution, joints: tuple[str, ...]) -> Iterator[SeriesGroup]:
    """Yield the tracking errors and the joint torques of the simulated arm."""
    simulated = solution.simulation
    if len(simulated.angles) != len(solution.trajectory.time):
        return
    bends = bends_from_revolutes(solution.problem.arm, simulated.angles)
    away = np.rad2deg(bends - solution.trajectory.bend_angles)
    arm, coordinates = solution.problem.arm, solution.trajectory.coordinates
    names, torques = joints, simulated.torques
    torque = solution.problem.limits.torque
    bounds = drive_torque_limits(arm, np.full(coordinates.revolutes, np.inf) if torque is None else torque)
    if arm.drives is not None:
        names = arm.drives.drive_names
    else:
        drives = coordinates.drive_numbers[coordinates.bends]
        torques, bounds = torques[:, drives], bounds[drives]
    free = np.full(len(joints), np.inf)
    yield SeriesGroup("tracking", "Simulated minus planned bends", "°", joints, away, free, least=_LEAST_TRACKING)
    yield SeriesGroup("simulated-torques", "Torques in simulation", "N m", names, torques, bounds)


def _coded_group(group: SeriesGroup, time: FloatArray, always: IntArray) -> dict[str, object]:
    values = np.nan_to_num(group.values)
    extent = max(float(np.ptp(values)) if values.size else 0.0, 1e-300)
    error = _CURVE_ERROR * extent if group.error is None else group.error
    fewest = _MOST_NUMBERS // max(values.shape[1], 1)
    most = int(np.clip(fewest, _LEAST_SAMPLES, _MOST_SAMPLES))
    kept = select_samples(time, values, error, most, always)
    step = step_for(values, NUMBER_STEP if group.error is None else 0.1 * group.error / extent)
    return {
        "key": group.key,
        "title": group.title,
        "unit": group.unit,
        "least": group.least,
        "names": list(group.names),
        "time": coded(time[kept], 1e-5),
        "columns": [coded(column, step) for column in values[kept].T],
        "limits": [float(bound) if np.isfinite(bound) else None for bound in group.limits],
    }


@dataclass(frozen=True)
class LimitShare:
    """Fraction of one kind of limit that a motion uses at each of T samples.

    Attributes:
        name: name of the limit.
        share: maximum used fraction over all drives at each sample, shape (T,).
        drive: index of the drive with the maximum fraction at each sample, shape (T,).
        drives: names of the drives.
    """

    name: str
    share: FloatArray
    drive: IntArray
    drives: tuple[str, ...]


def limit_shares(solution: Solution) -> list[LimitShare]:
    """Return, for every kind of limit, the fraction that a plan uses at each sample."""
    states = solution.joints
    limits = solution.problem.limits
    trajectory = solution.trajectory
    joints = tuple(f"joint {k // 3 + 1}" for k in range(len(states.names)))
    found = [
        _share("velocity", states.velocities, limits.velocity, joints),
        _share("acceleration", states.accelerations, limits.acceleration, joints),
    ]
    if limits.torque is not None:
        arm = solution.problem.arm
        names = joints if arm.drives is None else arm.drives.drive_names
        bounds = drive_torque_limits(arm, limits.torque)
        found.append(_share("torque", drive_torques(arm, states.torques), bounds, names))
    if limits.jerk is not None and len(trajectory.time) > 1:
        jerk = np.gradient(states.accelerations, trajectory.time, axis=0)
        found.append(_share("jerk", jerk, limits.jerk, joints))
    axes = trajectory.coordinates.base_names
    if solution.problem.arm.carrier:
        of_axes = solution.problem.limits.of_drives(trajectory.coordinates)
        first = trajectory.coordinates.revolutes
        for name, values, bounds in (
            ("velocity of base axes", trajectory.base_velocities, of_axes.velocity),
            ("acceleration of base axes", trajectory.base_accelerations, of_axes.acceleration),
            ("effort of base axes", states.base_forces, of_axes.effort),
        ):
            if np.any(np.isfinite(bounds[first:])):
                found.append(_share(name, values, bounds[first:], axes))
    for name, values, bound in (
        ("feed velocity", trajectory.base_velocities, limits.feed_velocity),
        ("feed acceleration", trajectory.base_accelerations, limits.feed_acceleration),
        ("feed force", states.base_forces, limits.feed_force),
    ):
        if axes and bound is not None:
            found.append(_share(name, values, np.full(len(axes), bound), axes))
    tips = [limit.velocity for limit in limits.points if limit.at is None and np.isfinite(limit.velocity)]
    if tips and len(trajectory.time) > 1:
        speed = np.linalg.norm(np.gradient(solution.joint_positions[:, -1], trajectory.time, axis=0), axis=1)
        found.append(_share("tip speed", speed[:, None], np.array([min(tips)]), ("tip",)))
    return found


def _share(name: str, values: FloatArray, bounds: FloatArray, drives: tuple[str, ...]) -> LimitShare:
    shares = np.abs(values) / bounds
    drive = np.argmax(shares, axis=1)
    return LimitShare(name, shares[np.arange(len(shares)), drive], drive, drives)


def phase_data(solution: Solution) -> dict[str, object]:
    """Return path speed over path length, and the used fractions of all limits, as data for the report's scripts.

    Args:
        solution: the plan.
    """
    trajectory = solution.trajectory
    shares = limit_shares(solution)
    place, speed = path_and_speed(solution)
    possible = speed_at_velocity_limits(speed, shares, _MOVING)
    columns = np.column_stack([each.share for each in shares])
    scaled = np.column_stack((columns, place / max(float(place[-1]), 1e-300), speed / max(float(speed.max()), 1e-300)))
    always = np.array([0, *trajectory.stops, len(trajectory.time) - 1], dtype=np.intp)
    most = int(np.clip(_MOST_NUMBERS // scaled.shape[1], _LEAST_SAMPLES, _MOST_SAMPLES))
    kept = select_samples(trajectory.time, scaled, _CURVE_ERROR, most, always)
    return {
        "time": coded(trajectory.time[kept], 1e-5),
        "place": coded(np.rad2deg(place[kept]), step_for(np.rad2deg(place))),
        "speed": coded(speed[kept], step_for(speed)),
        "possible": [float(f"{value:.4g}") if np.isfinite(value) else None for value in possible[kept]],
        "kinds": [each.name for each in shares],
        "shares": [coded(each.share[kept], 1e-4) for each in shares],
        "drives": [each.drive[kept].tolist() for each in shares],
        "names": [list(each.drives) for each in shares],
        "planned": solution.problem.planner.effort_share,
    }


def path_and_speed(solution: Solution) -> tuple[FloatArray, FloatArray]:
    """Return path length in joint space [rad] and path speed [rad/s] at T samples of a plan, each of shape (T,)."""
    trajectory = solution.trajectory
    return arc_lengths(trajectory.bend_angles), np.linalg.norm(trajectory.bend_velocities, axis=1)


def speed_at_velocity_limits(speed: FloatArray, shares: list[LimitShare], moving: float) -> FloatArray:
    """Return the path speed that the velocity limits alone would allow at T samples, shape (T,) [rad/s].

    Args:
        speed: path speed in joint space, shape (T,) [rad/s].
        shares: used fractions of all limits.
        moving: used fraction of the velocity limits up to which the arm is nearly at rest and the result is NaN.
    """
    used = np.max([each.share for each in shares if "velocity" in each.name or "speed" in each.name], axis=0)
    return np.where(used > moving, speed / np.maximum(used, 1e-300), np.nan)
