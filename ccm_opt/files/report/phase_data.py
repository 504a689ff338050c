"""The phase plane of a timed motion: how far along its path, how fast, how fast it could be, and what limits it.

The path is taken in the space of the bends, so that the speed along it is the length of the vector of joint velocities.
For every sample each limit has a share: the greatest magnitude of its quantity by its bound. The limit with the
greatest share is the one that binds; the velocity limits alone would bind at the speed divided by their share.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.files.report.delta_coding import coded, step_for
from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.files.report.thinning import kept_samples
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.space_solution import AnySolution


@dataclass(frozen=True)
class LimitShare:
    """How much of one kind of limit a motion uses.

    Attributes:
        name: of the kind.
        share: greatest share of any drive at each sample, shape (T,).
        drive: number of that drive, shape (T,).
        drives: names of the drives.
    """

    name: str
    share: FloatArray
    drive: IntArray
    drives: tuple[str, ...]


def limit_shares(solution: AnySolution) -> list[LimitShare]:
    """How much of every kind of limit a plan uses at each of its samples."""
    states = solution.joints
    limits = solution.problem.limits
    trajectory = solution.trajectory
    joints = tuple(f"joint {k // 3 + 1}" for k in range(len(states.names)))
    found = [
        _share("velocity", states.velocities, limits.velocity, joints),
        _share("acceleration", states.accelerations, limits.acceleration, joints),
    ]
    if limits.torque is not None:
        found.append(_share("torque", states.torques, limits.torque, joints))
    if limits.jerk is not None and len(trajectory.time) > 1:
        jerk = np.gradient(states.accelerations, trajectory.time, axis=0)
        found.append(_share("jerk", jerk, limits.jerk, joints))
    axes = trajectory.coordinates.base_names
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


def phase_data(solution: AnySolution, settings: ReportSettings = REPORT) -> dict[str, object]:
    """The phase plane and the shares of the limits, as the page's script reads them.

    Args:
        solution: the plan.
        settings: how many samples, how exact.
    """
    trajectory = solution.trajectory
    shares = limit_shares(solution)
    place, speed = path_and_speed(solution)
    possible = speed_at_velocity_limits(speed, shares, settings.moving)
    columns = np.column_stack([each.share for each in shares])
    scaled = np.column_stack((columns, place / max(float(place[-1]), 1e-300), speed / max(float(speed.max()), 1e-300)))
    always = np.array([0, *trajectory.stops, len(trajectory.time) - 1], dtype=np.intp)
    most = int(np.clip(settings.most_numbers // scaled.shape[1], settings.least_samples, settings.most_samples))
    kept = kept_samples(trajectory.time, scaled, settings.curve_error, most, always)
    return {
        "time": coded(trajectory.time[kept], 1e-5),
        "place": coded(np.rad2deg(place[kept]), step_for(np.rad2deg(place), settings.number_step)),
        "speed": coded(speed[kept], step_for(speed, settings.number_step)),
        "possible": [float(f"{value:.4g}") if np.isfinite(value) else None for value in possible[kept]],
        "kinds": [each.name for each in shares],
        "shares": [coded(each.share[kept], 1e-4) for each in shares],
        "drives": [each.drive[kept].tolist() for each in shares],
        "names": [list(each.drives) for each in shares],
        "planned": solution.problem.planner.effort_share,
    }


def path_and_speed(solution: AnySolution) -> tuple[FloatArray, FloatArray]:
    """Length of the path of the bends so far [rad], and the speed along it [rad/s], each of shape (T,)."""
    trajectory = solution.trajectory
    steps = np.linalg.norm(np.diff(trajectory.bend_angles, axis=0), axis=1)
    return np.concatenate(([0.0], np.cumsum(steps))), np.linalg.norm(trajectory.bend_velocities, axis=1)


def speed_at_velocity_limits(speed: FloatArray, shares: list[LimitShare], moving: float) -> FloatArray:
    """Speed along the path at which some velocity would be at its limit, shape (T,) [rad/s].

    Args:
        speed: along the path, shape (T,) [rad/s].
        shares: of all limits.
        moving: share of the velocity limits below which the direction of motion is too uncertain; NaN there.
    """
    used = np.max([each.share for each in shares if "velocity" in each.name or "speed" in each.name], axis=0)
    return np.where(used > moving, speed / np.maximum(used, 1e-300), np.nan)
