"""Checks of the limits on joints and points of the arm, and of the fraction of the limits that a plan may use.

A plan may use the fraction σ of the limits on velocity, acceleration, jerk and effort of all drives. Where holding the
arm still takes the fraction h of an effort limit, the effort may use max(σ, h + ½ σ (1 − h)) of it.
``robot.coordinates`` implements the same rule; the verifier deliberately does not use that code.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Limits, PointLimit, Problem
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.base_motion import cross, lengths_of
from ccm_opt.verification.chain_motion import LinkFrames, base_displacement, bend_pairs
from ccm_opt.verification.drives import (
    as_revolutes,
    axis_limits,
    check_worst,
    describe_bend_joint,
    describe_drives,
    describe_revolute_joints,
    largest_bends,
    of_drives,
    sample_words,
    section_of,
    torque_limits,
)
from ccm_opt.verification.newton_euler import LinkRates, drive_efforts
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

UNIT = "of the limit"
_Source = tuple[FloatArray, FloatArray]
"""Sampled values (T, n) from one origin, reported or computed, and the times (T,) to which they belong."""


def check_limits(
    arm: Arm,
    limits: Limits,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check every limit of a problem on bends, velocities, accelerations, jerks and torques of the joints.

    Velocities and accelerations are checked twice, by the reported values and by differences of the samples. The mean
    rate over a step never exceeds a limit that holds at all times, so a false report cannot hide a violation.
    """
    names = describe_revolute_joints(joints.names)
    found = [
        ("velocity", "rad/s", limits.velocity, _velocity_sources),
        ("acceleration", "rad/s²", limits.acceleration, _acceleration_sources),
        ("jerk", "rad/s³", limits.jerk, _jerk_sources),
    ]
    checks = [
        check_bends(arm, trajectory, settings),
        *(
            check_sources(f"joint {kind}", unit, limit, sources(trajectory, joints), settings, names)
            for kind, unit, limit, sources in found
            if limit is not None
        ),
    ]
    if limits.torque is not None:
        torques = [(of_drives(arm, joints.torques), trajectory.time)]
        bound, names = torque_limits(arm, limits.torque), describe_drives(arm, joints.names)
        checks.append(check_sources("joint torque", "N m", bound, torques, settings, names))
    return checks


def check_bends(arm: Arm, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION) -> Check:
    """Check all bends against the joint limits at the samples, which suffices as bends are linear in between."""
    limit = largest_bends(arm)
    bends = np.abs(trajectory.bend_angles)
    # A locked joint that stays straight is not reported in place of the joint closest to its limit.
    straight = (limit == 0.0) & (bends <= settings.bend_tolerance)
    excess = np.where(straight, -np.inf, bends - limit)
    k, j = np.unravel_index(np.argmax(excess), excess.shape)
    joint = section_of(arm, int(j) // arm.bends_a_joint) or describe_bend_joint(arm.coordinates, int(j))
    where = f"{joint} at t = {trajectory.time[k]:.4f} s"
    worst = float(bends[k, j])
    bound = float(limit[j])
    return Check("joint limit", worst, bound, "rad", where, passed=worst <= bound + settings.bend_tolerance)


def _velocity_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Return velocities of the revolutes from several sources [rad/s].

    The sources are the reported velocities of the revolutes, those of the bends, and the mean velocities over the
    steps.
    """
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Mean rates carry the rounding of the angles, magnified by 1/h, which must not count as a violation.
    mean = np.diff(as_revolutes(trajectory.coordinates, trajectory.bend_angles), axis=0) / step
    return [
        (joints.velocities, time),
        (as_revolutes(trajectory.coordinates, trajectory.bend_velocities), time),
        (less_rounding(mean, largest_magnitude(trajectory.bend_angles), step), time[:-1]),
    ]


def _acceleration_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Return accelerations of the revolutes from several sources [rad/s²].

    The sources are the reported values (of revolutes and bends), difference quotients of the reported velocities, and
    second difference quotients of the angles.
    """
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Velocities of revolutes are differenced here and bends below, to detect false reports of either.
    gained = np.diff(joints.velocities, axis=0) / step
    return [
        (joints.accelerations, time),
        (as_revolutes(trajectory.coordinates, trajectory.bend_accelerations), time),
        (less_rounding(gained, largest_magnitude(joints.velocities), step), time[:-1]),
        (_second_differences(as_revolutes(trajectory.coordinates, trajectory.bend_angles), step), time[1:-1]),
    ]


def _jerk_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Return jerks of the revolutes from differences of accelerations and second differences of velocities [rad/s³].

    The jumps from and to rest at both ends count, since the arm is at rest before and after the motion.
    """
    time = trajectory.time
    reported = (joints.accelerations, as_revolutes(trajectory.coordinates, trajectory.bend_accelerations))
    return [
        *((finite_jerks(values, time), np.append(time, time[-1])) for values in reported),
        (_second_differences(joints.velocities, np.diff(time)[:, None]), time[1:-1]),
    ]


def finite_jerks(accelerations: FloatArray, time: FloatArray) -> FloatArray:
    """Return jerks as difference quotients of accelerations (T, …), shape (T + 1, …).

    The first and the last jerk are those from and to rest, each over a time as long as the adjacent step. Magnitudes
    are reduced by the largest possible rounding error.
    """
    step = np.diff(time).reshape(-1, *[1] * (accelerations.ndim - 1))
    # Before the first sample and after the last, the arm is taken to rest for as long as the adjacent step.
    around = np.concatenate((step[:1], step, step[-1:]))
    rest = np.zeros_like(accelerations[:1])
    jerks = np.diff(np.concatenate((rest, accelerations, rest)), axis=0) / around
    return less_rounding(jerks, largest_magnitude(accelerations), around)


def _second_differences(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return the second difference quotients of values (T, n) at the inner samples, shape (T − 2, n)."""
    mean = np.diff(values, axis=0) / step
    # Mean rates belong to the midpoints of their steps, which are this far apart in time.
    apart = 0.5 * (step[1:] + step[:-1])
    shortest = np.minimum(step[1:], step[:-1])
    return less_rounding(np.diff(mean, axis=0) / apart, largest_magnitude(values), shortest**2)


def largest_magnitude(values: FloatArray) -> float:
    """Return the greatest absolute value of an array."""
    return float(np.max(np.abs(values)))


def less_rounding(quotient: FloatArray, size: float, step: FloatArray) -> FloatArray:
    """Return difference quotients with magnitudes reduced by the largest possible error from rounding of the values.

    Args:
        quotient: the difference quotients, of any shape.
        size: greatest magnitude of the differenced values.
        step: steps by which the differences were divided, of a shape that broadcasts to that of the quotients.
    """
    noise = 16.0 * np.finfo(np.float64).eps * size / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))


def check_sources(
    name: str,
    unit: str,
    limit: FloatArray | float,
    sources: Sequence[_Source],
    settings: VerificationSettings,
    names: Sequence[str] = (),
) -> Check:
    """Check sampled values from all sources together against one limit per drive, or against a common limit.

    Args:
        name: name of the check.
        unit: unit of the values.
        limit: limit of the magnitude for each drive, shape (n,), or for all.
        sources: values of the same n drives, of shape (T, n), and their times, from one or more origins.
        settings: the tolerance of limits.
        names: names of the drives, for the location of the worst value.
    """
    values, times = (np.concatenate(parts) for parts in zip(*sources, strict=True))
    return check_worst(name, unit, values, limit, sample_words(times, names), settings.limit_tolerance)


def check_points(
    arm: Arm, limits: Limits, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> list[Check]:
    """Check every limit on the speed or acceleration of a point of the arm.

    Speeds are computed from the reported velocities, from the distances between samples and, in the plane, from the
    motion with coordinates linear between samples, at all times. Accelerations are computed from the reported values,
    from difference quotients of reported velocities, and from second differences of positions. Both quotients are
    means, which the peak of any motion through the samples reaches or exceeds.
    """
    if not limits.points:
        return []
    checks: list[Check] = []
    time = trajectory.time
    frames = LinkFrames.from_configurations(arm, trajectory.positions)
    states = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    rates = LinkRates.from_frames(arm, frames, *states)
    for limit in limits.points:
        motion = _PointMotion(arm, limit, trajectory, frames, rates)
        if np.isfinite(limit.velocity):
            speeds = [(lengths_of(motion.velocities), time), (motion.mean_speeds(), time[:-1])]
            if arm.dimension == 2:
                speeds.append((motion.speeds_between(), time[:-1]))
            checks.append(check_sources(f"{limit.name} velocity", "m/s", limit.velocity, speeds, settings))
        if np.isfinite(limit.acceleration):
            gains = [
                (motion.reported_accelerations(), time),
                (motion.gained(), time[:-1]),
                (motion.second_differences(), time[1:-1]),
            ]
            checks.append(check_sources(f"{limit.name} acceleration", "m/s²", limit.acceleration, gains, settings))
    return checks


@dataclass(frozen=True)
class _PointMotion:
    """Positions, velocities and accelerations of a point of the arm at T samples.

    Attributes:
        arm: the arm.
        limit: the limit, which defines the point.
        trajectory: the motion of the arm.
        frames: frames of the links at the samples.
        rates: rates of the links, from the reported velocities and accelerations.
    """

    arm: Arm
    limit: PointLimit
    trajectory: JointTrajectory
    frames: LinkFrames
    rates: LinkRates

    @cached_property
    def places(self) -> FloatArray:
        """Positions of the point relative to the base position at zero feed, shape (T, 3) [m]."""
        return self._summed(self.frames.along) + self._base_motion(self.trajectory.positions)

    @cached_property
    def velocities(self) -> FloatArray:
        """Velocities of the point from the reported coordinate velocities, shape (T, 3) [m/s]."""
        swing = cross(self.rates.rate, self.frames.along)
        return self._summed(swing) + self._base_motion(self.trajectory.velocities)

    def mean_speeds(self) -> FloatArray:
        """Return the mean speed of the point over every step, distance by duration, shape (T − 1,) [m/s]."""
        return self._quotient(self.places)

    def speeds_between(self) -> FloatArray:
        """Return bounds on the speed of a planar arm's point within every step, shape (T − 1,) [m/s].

        Coordinates are taken as linear in time. In a step of length h, the velocity deviates from linear interpolation
        by at most h² / 8 times the greatest third derivative of the position.
        """
        steps = np.diff(self.trajectory.positions, axis=0) / self._step[:, None]
        turns = np.cumsum(bend_pairs(self.arm, steps)[..., 1], axis=1)
        axis = self.arm.base_rotation[:, 1]
        swings = cross(axis, self.frames.along)
        ends = [self._summed(turns[..., None] * some) + self._base_motion(steps) for some in (swings[:-1], swings[1:])]
        # At constant rates, the third derivative of the position is at most Σ l |φ̇|³.
        third = np.abs(turns) ** 3 @ self._levers
        return np.asarray(np.maximum(*map(lengths_of, ends)) + self._step**2 / 8.0 * third)

    def reported_accelerations(self) -> FloatArray:
        """Return the magnitudes of the point's acceleration from the reported coordinate rates, shape (T,) [m/s²]."""
        # From the midpoint of a link to its end, the acceleration grows by half of the link's contribution.
        added = 2.0 / self.arm.lengths[:, None] * (self.rates.ends - self.rates.middles)
        return lengths_of(self._summed(added) + self._base_motion(self.trajectory.accelerations))

    def gained(self) -> FloatArray:
        """Return the magnitudes of difference quotients of the point's reported velocities, shape (T − 1,) [m/s²]."""
        return self._quotient(self.velocities)

    def second_differences(self) -> FloatArray:
        """Return the magnitudes of second difference quotients of the point's positions, shape (T − 2,) [m/s²]."""
        step = self._step
        means = np.diff(self.places, axis=0) / step[:, None]
        apart = 0.5 * (step[1:] + step[:-1])
        noise = self._noise(self.places) / np.minimum(step[1:], step[:-1]) ** 2
        return np.asarray(np.maximum(lengths_of(np.diff(means, axis=0)) / apart - noise, 0.0))

    @property
    def _step(self) -> FloatArray:
        return np.diff(self.trajectory.time)

    @cached_property
    def _levers(self) -> FloatArray:
        """Length of the part of each link that lies between the base and the point, shape (links,) [m]."""
        arm = self.arm
        at = arm.length if self.limit.at is None else self.limit.at
        return np.clip(at - arm.joint_places[:-1], 0.0, arm.lengths)

    def _summed(self, of_links: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("k,tkd->td", self._levers, of_links))

    def _base_motion(self, values: FloatArray) -> FloatArray:
        return np.asarray(base_displacement(self.arm, values)[:, None] * self.arm.base_rotation[:, 0])

    def _quotient(self, values: FloatArray) -> FloatArray:
        change = lengths_of(np.diff(values, axis=0))
        return np.asarray(np.maximum(change - self._noise(values), 0.0) / self._step)

    def _noise(self, values: FloatArray) -> float:
        """Return a bound on the rounding error of a difference of two of the values."""
        return float((16.0 + self.arm.links) * np.finfo(np.float64).eps * np.max(np.abs(values)))


def check_shares(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    of_limits: Sequence[Check],
    holding: FloatArray,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check that a plan uses only the allowed fraction of the limits; return [] if the limits may be used in full.

    Args:
        problem: the problem, with the allowed fraction ``planner.effort_share``.
        trajectory: sampled motion in the arm's coordinates.
        joints: angles, rates and efforts of the drives at the same samples, as the plan reports them.
        of_limits: the checks of the limits themselves, each with the greatest value and where it occurs.
        holding: efforts of all drives that hold the arm still at the T samples, shape (T, drives) [N m, N].
        settings: the tolerance of limits.
    """
    share = problem.planner.effort_share
    if share == 1.0:
        return []
    checks = []
    drives = ("joint", *trajectory.coordinates.base_names)
    for kind in ("velocity", "acceleration", "jerk"):
        limited = [check for check in of_limits if check.name in {f"{drive} {kind}" for drive in drives}]
        if limited:
            checks.append(_rate_check(kind, limited, share, settings))
    limit = effort_limits(problem)
    if np.any(np.isfinite(limit)):
        taken = np.column_stack((of_drives(problem.arm, joints.torques), joints.base_forces)) / limit
        # Fractions above 1 are clipped here; the check of the limit itself reports them.
        held = np.minimum(np.abs(holding) / limit, 1.0)
        axes = tuple(f"the {name} axis" for name in trajectory.coordinates.base_names)
        names = (*describe_drives(problem.arm, joints.names), *axes)
        checks.append(_effort_check(taken, held, sample_words(trajectory.time, names), share, settings))
    return checks


def _rate_check(kind: str, limited: Sequence[Check], share: float, settings: VerificationSettings) -> Check:
    """Return a check of the used fraction of velocity, acceleration or jerk limits, from the checks of the limits."""
    tightest = max(limited, key=lambda check: check.worst / check.limit)
    worst = tightest.worst / tightest.limit
    # Checks of a base axis give only a time as their location, so the name of the check is added.
    where = tightest.where if tightest.name.startswith("joint") else f"{tightest.name} at {tightest.where}"
    return Check(
        f"share of {kind}", worst, share, UNIT, where, passed=worst <= share * (1.0 + settings.limit_tolerance)
    )


def _effort_check(
    taken: FloatArray, held: FloatArray, place: Callable[..., str], share: float, settings: VerificationSettings
) -> Check:
    """Return a check of the used fraction of effort limits; holding the arm still raises the allowed fraction."""
    allowed = allowed_share(held, share)

    def where(k: int, j: int) -> str:
        still = f", where holding the arm still takes {held[k, j]:.3g} of the limit" if allowed[k, j] > share else ""
        return f"{place(k, j)}{still}"

    return check_worst("share of effort", UNIT, taken, allowed, where, settings.limit_tolerance)


def allowed_share(held: FloatArray, share: float) -> FloatArray:
    """Return the fraction of an effort limit that a plan may use, max(σ, h + ½ σ (1 − h)), in [0, 1].

    Args:
        held: fraction h of the limit that holding the arm still takes, in [0, 1].
        share: fraction σ of the limits that plans may use in general.
    """
    return np.asarray(np.maximum(share, held + 0.5 * share * (1.0 - held)))


def effort_limits(problem: Problem) -> FloatArray:
    """Return limits of the efforts of all drives: of those that bend the arm [N m], then of the base axes [N, N m].

    They are inf where unlimited.
    """
    limits = problem.limits
    torque = np.full(3 * problem.arm.links, np.inf) if limits.torque is None else limits.torque
    return np.append(torque_limits(problem.arm, torque), axis_limits(problem).effort)


def holding_efforts(problem: Problem, positions: FloatArray) -> FloatArray:
    """Return the efforts of all drives that hold the arm still in configurations (T, c), shape (T, drives) [N m, N].

    The result is zero if no effort is limited.
    """
    limit = effort_limits(problem)
    if not np.any(np.isfinite(limit)):
        return np.zeros((len(positions), len(limit)))
    rest = np.zeros_like(positions)
    torques, on_axes = drive_efforts(problem.arm, problem.simulation.gravity, positions, rest, rest)
    return np.column_stack((of_drives(problem.arm, torques), on_axes))
