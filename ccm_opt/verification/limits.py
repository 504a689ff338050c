"""Checks of the limits on joints and points of the arm, and of the fraction of the limits that a plan may use.

The share σ applies to velocities, accelerations, jerks and efforts of all drives. Where holding the arm still takes the
share h of an effort limit, the effort may take max(σ, h + ½ σ (1 − h)) of it. ``robot.coordinates`` implements the same
rule; the verifier deliberately does not use that code.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Limits, PointLimit, Problem
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import LinkFrames, bend_pairs, carried, lengths_of
from ccm_opt.verification.drives import (
    as_revolutes,
    bends_a_ball,
    check_worst,
    describe_bend_joint,
    describe_revolute_joints,
    sample_words,
)
from ccm_opt.verification.newton_euler import LinkRates, drive_efforts
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

UNIT = "of the limit"
_Source = tuple[FloatArray, FloatArray]
"""Values, and the times to which they belong."""


def check_limits(
    arm: Arm,
    limits: Limits,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check every limit of the problem on bends, velocities, accelerations, jerks and torques.

    Velocities and accelerations are checked twice, by the reported values and by differences of the samples. The mean
    rate over a step can never exceed a limit that holds at all times, so a false report cannot hide a violation.
    """
    names = describe_revolute_joints(joints.names)
    found = [
        ("velocity", "rad/s", limits.velocity, _velocity_sources),
        ("acceleration", "rad/s²", limits.acceleration, _acceleration_sources),
        ("jerk", "rad/s³", limits.jerk, _jerk_sources),
        ("torque", "N m", limits.torque, lambda trajectory, joints: [(joints.torques, trajectory.time)]),
    ]
    return [
        check_bends(arm, trajectory, settings),
        *(
            check_sources(f"joint {kind}", unit, limit, sources(trajectory, joints), settings, names)
            for kind, unit, limit, sources in found
            if limit is not None
        ),
    ]


def check_bends(arm: Arm, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION) -> Check:
    """Check the bends against the joint limits; they are linear between samples, so checking the samples suffices."""
    # The joint at the base has its own limit.
    limit = np.full(arm.coordinates.joints, arm.joint_limit)
    limit[: bends_a_ball(arm.coordinates)] = arm.base_limit
    bends = np.abs(trajectory.bend_angles)
    excess = bends - limit
    k, j = np.unravel_index(np.argmax(excess), excess.shape)
    where = f"{describe_bend_joint(arm.coordinates, int(j))} at t = {trajectory.time[k]:.4f} s"
    worst = float(bends[k, j])
    bound = float(limit[j])
    return Check("joint limit", worst, bound, "rad", where, passed=worst <= bound + settings.bend_tolerance)


def _velocity_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Return the reported velocities of revolutes and bends, and the mean velocities over the steps."""
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
    """Return accelerations from three sources, in revolutes.

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
    """Return jerks from difference quotients of reported accelerations and from second differences of velocities.

    The steps into and out of the motion count, since the arm is at rest before and after it.
    """
    time = trajectory.time
    reported = (joints.accelerations, as_revolutes(trajectory.coordinates, trajectory.bend_accelerations))
    return [
        *((finite_jerks(values, time), np.append(time, time[-1])) for values in reported),
        (_second_differences(joints.velocities, np.diff(time)[:, None]), time[1:-1]),
    ]


def finite_jerks(accelerations: FloatArray, time: FloatArray) -> FloatArray:
    """Return difference quotients of accelerations (T, …), with those from and to rest at the ends (T + 1, …)."""
    step = np.diff(time).reshape(-1, *[1] * (accelerations.ndim - 1))
    # Before the first sample and after the last, the arm is taken to rest for as long as the adjacent step.
    around = np.concatenate((step[:1], step, step[-1:]))
    rest = np.zeros_like(accelerations[:1])
    jerks = np.diff(np.concatenate((rest, accelerations, rest)), axis=0) / around
    return less_rounding(jerks, largest_magnitude(accelerations), around)


def _second_differences(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return the second difference quotients at the inner samples, shape (T − 2, 3 * links)."""
    mean = np.diff(values, axis=0) / step
    # Mean rates belong to the midpoints of their steps, which are this far apart in time.
    apart = 0.5 * (step[1:] + step[:-1])
    shortest = np.minimum(step[1:], step[:-1])
    return less_rounding(np.diff(mean, axis=0) / apart, largest_magnitude(values), shortest**2)


def largest_magnitude(values: FloatArray) -> float:
    """Return the greatest absolute value."""
    return float(np.max(np.abs(values)))


def less_rounding(quotient: FloatArray, size: float, step: FloatArray) -> FloatArray:
    """Return difference quotients, with magnitudes reduced by the largest possible error from rounding of the values.

    Args:
        quotient: the difference quotients.
        size: greatest magnitude of the differenced values.
        step: the steps by which the differences were divided.
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
    """Check values from several sources against the limit of each drive, or against a single limit."""
    values, times = (np.concatenate(parts) for parts in zip(*sources, strict=True))
    return check_worst(name, unit, values, limit, sample_words(times, names), settings.limit_tolerance)


def check_points(
    arm: Arm, limits: Limits, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> list[Check]:
    """Check every limit on the speed or acceleration of a point of the arm.

    Speeds are checked by the reported velocities, by the distances between samples and, in the plane, by the motion
    with coordinates linear between samples at all times. Accelerations are checked by the reported ones, by difference
    quotients of reported velocities, and by second differences of positions. Both quotients are means, which the peak
    of any motion through the samples reaches or exceeds.
    """
    if not limits.points:
        return []
    checks: list[Check] = []
    time = trajectory.time
    frames = LinkFrames.of(arm, trajectory.positions)
    rates = LinkRates.of(arm, frames, trajectory.velocities, trajectory.accelerations)
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
    """Positions, velocities and accelerations of a point of the arm at the samples.

    Attributes:
        arm: the arm.
        limit: the limit, which defines the point.
        trajectory: the motion of the arm.
        frames: frames of the links.
        rates: rates of the links, from the reported velocities and accelerations.
    """

    arm: Arm
    limit: PointLimit
    trajectory: JointTrajectory
    frames: LinkFrames
    rates: LinkRates

    @cached_property
    def places(self) -> FloatArray:
        """Positions of the point relative to the arm's nominal base position, shape (T, 3) [m]."""
        return self._summed(self.frames.along) + self._carried(self.trajectory.positions)

    @cached_property
    def velocities(self) -> FloatArray:
        """Velocities of the point from the reported coordinate velocities, shape (T, 3) [m/s]."""
        swing = np.cross(self.rates.rate, self.frames.along)
        return self._summed(swing) + self._carried(self.trajectory.velocities)

    def mean_speeds(self) -> FloatArray:
        """Return the distance divided by the duration of every step, shape (T − 1,) [m/s]."""
        return self._quotient(self.places)

    def speeds_between(self) -> FloatArray:
        """Return a bound on the speed within every step for planar arms, shape (T − 1,) [m/s].

        Coordinates are taken as linear in time. Within a step, the velocity deviates from its chord by at most h² / 8
        times the greatest third derivative of the position.
        """
        steps = np.diff(self.trajectory.positions, axis=0) / self._step[:, None]
        turns = np.cumsum(bend_pairs(self.arm, steps)[..., 1], axis=1)
        axis = self.arm.base_rotation[:, 1]
        swings = np.cross(axis, self.frames.along)
        ends = [self._summed(turns[..., None] * some) + self._carried(steps) for some in (swings[:-1], swings[1:])]
        # At constant rates, the third derivative of the position is at most Σ l |φ̇|³.
        third = np.abs(turns) ** 3 @ self._levers
        return np.asarray(np.maximum(*map(lengths_of, ends)) + self._step**2 / 8.0 * third)

    def reported_accelerations(self) -> FloatArray:
        """Return the point's acceleration magnitudes from the reported coordinate rates, shape (T,) [m/s²]."""
        # From the midpoint of a link to its end, the acceleration grows by half of the link's contribution.
        added = 2.0 / self.arm.link_length * (self.rates.ends - self.rates.middles)
        return lengths_of(self._summed(added) + self._carried(self.trajectory.accelerations))

    def gained(self) -> FloatArray:
        """Return the magnitudes of difference quotients of the point's reported velocities, shape (T − 1,) [m/s²]."""
        return self._quotient(self.velocities)

    def second_differences(self) -> FloatArray:
        """Return the magnitudes of the second difference quotients of positions, shape (T − 2,) [m/s²]."""
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
        """Length of each link that lies between the base and the point, shape (links,) [m]."""
        arm = self.arm
        at = arm.length if self.limit.at is None else self.limit.at
        return np.clip(at - arm.link_length * np.arange(arm.links), 0.0, arm.link_length)

    def _summed(self, of_links: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("k,tkd->td", self._levers, of_links))

    def _carried(self, values: FloatArray) -> FloatArray:
        return np.asarray(carried(self.arm, values)[:, None] * self.arm.base_rotation[:, 0])

    def _quotient(self, values: FloatArray) -> FloatArray:
        change = lengths_of(np.diff(values, axis=0))
        return np.asarray(np.maximum(change - self._noise(values), 0.0) / self._step)

    def _noise(self, values: FloatArray) -> float:
        """Return a bound on the rounding error of a difference of values."""
        return float((16.0 + self.arm.links) * np.finfo(np.float64).eps * np.max(np.abs(values)))


def check_shares(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    of_limits: Sequence[Check],
    holding: FloatArray,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check that the plan uses only its share of the limits; return no checks if it may use them in full.

    Args:
        problem: the problem that the motion is to solve.
        trajectory: the motion in the arm's coordinates.
        joints: the motion in terms of the drives, with their efforts.
        of_limits: the checks of the limits themselves, each with the greatest value and where it occurs.
        holding: efforts of all drives that hold the arm still at the samples, shape (T, drives) [N m, N].
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
        taken = np.column_stack((joints.torques, joints.base_forces)) / limit
        # Shares above 1 are clipped here; the check of the limit itself reports them.
        held = np.minimum(np.abs(holding) / limit, 1.0)
        axes = tuple(f"the {name} axis" for name in trajectory.coordinates.base_names)
        names = (*describe_revolute_joints(joints.names), *axes)
        checks.append(_effort_check(taken, held, sample_words(trajectory.time, names), share, settings))
    return checks


def _rate_check(kind: str, limited: Sequence[Check], share: float, settings: VerificationSettings) -> Check:
    """Return the check of the share for velocities, accelerations or jerks, from the checks of their limits."""
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
    """Return the check of the share for efforts, which depends on the effort to hold the arm still at each sample."""
    allowed = allowed_share(held, share)

    def where(k: int, j: int) -> str:
        still = f", where holding the arm still takes {held[k, j]:.3g} of the limit" if allowed[k, j] > share else ""
        return f"{place(k, j)}{still}"

    return check_worst("share of effort", UNIT, taken, allowed, where, settings.limit_tolerance)


def allowed_share(held: FloatArray, share: float) -> FloatArray:
    """Return the fraction of an effort limit that a plan may use, in [0, 1].

    Args:
        held: fraction of the limit that holding the arm still takes, in [0, 1].
        share: fraction σ of the limits that plans may use in general.
    """
    return np.asarray(np.maximum(share, held + 0.5 * share * (1.0 - held)))


def effort_limits(problem: Problem) -> FloatArray:
    """Return the limits on the torques of all revolutes and the forces of the base axes; inf without a limit."""
    limits = problem.limits
    torque = np.full(3 * problem.arm.links, np.inf) if limits.torque is None else limits.torque
    return np.append(torque, [np.inf if limits.feed_force is None else limits.feed_force] * len(problem.arm.base_axes))


def holding_efforts(problem: Problem, positions: FloatArray) -> FloatArray:
    """Return the efforts of all drives that hold the arm still in poses (T, c), shape (T, drives) [N m, N].

    The result is zero if no effort is limited.
    """
    limit = effort_limits(problem)
    if not np.any(np.isfinite(limit)):
        return np.zeros((len(positions), len(limit)))
    rest = np.zeros_like(positions)
    torques, force = drive_efforts(problem.arm, problem.simulation.gravity, positions, rest, rest)
    return np.column_stack((torques, *[force] * len(problem.arm.base_axes)))
