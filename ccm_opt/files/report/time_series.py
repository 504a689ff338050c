"""The curves of the page over time, joint by joint: bends, velocities, accelerations, torques, the base, the tip."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.files.report.delta_coding import coded, step_for
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.files.report.thinning import kept_samples
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.frames import bends_from_revolutes
from ccm_opt.space.space_solution import AnySolution

_STILL = 1e-9
"""Revolutes that do no more than this share of the greatest are rounding, and have no curve."""


_LEAST_TRACKING = 0.01
"""No instrument tells an arm that is less off its plan from one that is on it [°]."""


@dataclass(frozen=True)
class SeriesGroup:
    """Curves of one quantity over time.

    Attributes:
        key: by which the page's script knows it.
        title: above the chart.
        unit: of the values.
        names: of the curves.
        values: shape (T, C), in ``unit``.
        limits: bound on the magnitude of each curve, shape (C,); inf where there is none.
        error: distance that a sample may have from its drawn curve, in ``unit``; None for a share of the range.
        least: what the axis reaches at least, in ``unit``: what is far below is nothing to people.
    """

    key: str
    title: str
    unit: str
    names: tuple[str, ...]
    values: FloatArray
    limits: FloatArray
    error: float | None = None
    least: float = 0.0


def series_data(solution: AnySolution, settings: ReportSettings = REPORT) -> list[dict[str, object]]:
    """All groups of a plan, thinned and coded, as the page's script reads them.

    Args:
        solution: the plan.
        settings: how many numbers, how exact.
    """
    trajectory = solution.trajectory
    always = np.array([0, *trajectory.stops, len(trajectory.time) - 1], dtype=np.intp)
    return [_coded_group(group, trajectory.time, always, settings) for group in series_groups(solution, settings)]


def series_groups(solution: AnySolution, settings: ReportSettings = REPORT) -> Iterator[SeriesGroup]:
    """All groups of a plan at every sample, those of the joints first."""
    arm = solution.problem.arm
    trajectory = solution.trajectory
    joints = trajectory.coordinates.names[trajectory.coordinates.bends]
    bends = np.rad2deg(trajectory.bend_angles)
    yield SeriesGroup(
        "bends", "Joint bends", "°", joints, bends, np.rad2deg(arm.bend_limits), float(np.rad2deg(settings.pose_error))
    )
    yield from _base_groups(solution)
    yield from _drive_groups(solution)
    yield _tip_speed(solution)
    yield from _simulated_groups(solution, joints)


def _base_groups(solution: AnySolution) -> Iterator[SeriesGroup]:
    """What carries the base: its place and speed in the page's unit, and its force; nothing for a fixed base."""
    trajectory = solution.trajectory
    limits = solution.problem.limits
    names = trajectory.coordinates.base_names
    if not names:
        return
    free = np.full(len(names), np.inf)
    speed = free if limits.feed_velocity is None else np.full(len(names), limits.feed_velocity)
    force = free if limits.feed_force is None else np.full(len(names), limits.feed_force)
    unit = PageUnits.of_page(solution.problem)
    yield SeriesGroup("feed", "Feed axis", unit.name, names, trajectory.base_positions / unit.metres, free)
    velocities = trajectory.base_velocities / unit.metres
    yield SeriesGroup("feed-velocity", "Feed velocity", f"{unit.name}/s", names, velocities, speed / unit.metres)
    yield SeriesGroup("feed-force", "Feed force", "N", names, solution.joints.base_forces, force)


def _drive_groups(solution: AnySolution) -> Iterator[SeriesGroup]:
    """Velocities, accelerations and torques of the revolutes that move or bear anything."""
    states = solution.joints
    limits = solution.problem.limits
    coordinates = solution.trajectory.coordinates
    bending = dict(zip(coordinates.drives[coordinates.bends], coordinates.names, strict=False))
    unlimited = np.full(len(states.names), np.inf)
    torque = unlimited if limits.torque is None else limits.torque
    for key, title, unit, values, bounds in (
        ("velocities", "Joint velocities", "rad/s", states.velocities, limits.velocity),
        ("accelerations", "Joint accelerations", "rad/s²", states.accelerations, limits.acceleration),
        ("torques", "Joint torques", "N m", states.torques, torque),
    ):
        peaks = np.max(np.abs(values), axis=0)
        moved = np.flatnonzero(peaks > _STILL * max(float(peaks.max(initial=0.0)), 1e-300))
        # The bends' own drives have a curve in any case, so that every chart can show every joint.
        kept = np.union1d(moved, list(bending))
        names = tuple(bending.get(int(k)) or _drive_name(int(k)) for k in kept)
        yield SeriesGroup(key, title, unit, names, values[:, kept], np.asarray(bounds)[kept])


def _drive_name(number: int) -> str:
    """A revolute that does not bend the arm by its place in the ball joint."""
    joint, axis = divmod(number, 3)
    return f"joint {joint + 1}, {('first', 'second', 'third')[axis]} revolute"


def _tip_speed(solution: AnySolution) -> SeriesGroup:
    """Speed of the tip by differences between samples, in the page's unit, with its limit where there is one."""
    time = solution.trajectory.time
    tips = solution.joint_positions[:, -1]
    velocity = np.gradient(tips, time, axis=0) if len(time) > 1 else np.zeros_like(tips)
    of_tip = [limit.velocity for limit in solution.problem.limits.points if limit.at is None]
    unit = PageUnits.of_page(solution.problem)
    bound = np.array([min(of_tip, default=np.inf)]) / unit.metres
    speed = np.linalg.norm(velocity, axis=1)[:, None] / unit.metres
    return SeriesGroup("tip-speed", "Tip speed", f"{unit.name}/s", ("tip",), speed, bound)


def _simulated_groups(solution: AnySolution, joints: tuple[str, ...]) -> Iterator[SeriesGroup]:
    """How far the simulated arm is from its plan, and what its drives gave."""
    simulated = solution.simulation
    if len(simulated.angles) != len(solution.trajectory.time):
        return
    bends = bends_from_revolutes(solution.problem.arm, simulated.angles)
    away = np.rad2deg(bends - solution.trajectory.bend_angles)
    coordinates = solution.trajectory.coordinates
    drives = coordinates.drive_numbers[coordinates.bends]
    free = np.full(len(joints), np.inf)
    torque = solution.problem.limits.torque
    bounds = free if torque is None else torque[drives]
    yield SeriesGroup("tracking", "Simulated less planned bends", "°", joints, away, free, least=_LEAST_TRACKING)
    yield SeriesGroup(
        "simulated-torques", "Torques in the simulation", "N m", joints, simulated.torques[:, drives], bounds
    )


def _coded_group(group: SeriesGroup, time: FloatArray, always: IntArray, settings: ReportSettings) -> dict[str, object]:
    values = np.nan_to_num(group.values)
    extent = max(float(np.ptp(values)) if values.size else 0.0, 1e-300)
    error = settings.curve_error * extent if group.error is None else group.error
    fewest = settings.most_numbers // max(values.shape[1], 1)
    most = int(np.clip(fewest, settings.least_samples, settings.most_samples))
    kept = kept_samples(time, values, error, most, always)
    step = step_for(values, settings.number_step if group.error is None else 0.1 * group.error / extent)
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
