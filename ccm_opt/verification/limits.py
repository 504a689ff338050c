"""Checks of speeds and accelerations of joints and points, and of the share of the limits that a plan leaves.

The share σ holds for velocities, accelerations, jerks and efforts of all drives. Where holding the arm still takes the
share h of an effort's limit, the effort may take max(σ, h + ½ σ (1 − h)) of it. The rule stands in
``robot.coordinates`` too; the verifier reckons for itself, on purpose.
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
"""Values at some times, and the times."""


def check_limits(
    arm: Arm,
    limits: Limits,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check every limit of the problem.

    Velocities and accelerations are judged twice, by the reported values and by differences of the samples: a mean
    rate over a step can never pass a limit that holds at all times, so a false report cannot hide one.
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
    """Check the bends; between samples they are linear, so the samples decide."""
    # The joint at the base has a limit of its own.
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
    """Return the reported velocities of revolutes and bends, and mean velocities of the steps."""
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Mean rates carry the rounding of the angles, magnified by 1/h; that much is no violation.
    mean = np.diff(as_revolutes(trajectory.coordinates, trajectory.bend_angles), axis=0) / step
    return [
        (joints.velocities, time),
        (as_revolutes(trajectory.coordinates, trajectory.bend_velocities), time),
        (less_rounding(mean, largest_magnitude(trajectory.bend_angles), step), time[:-1]),
    ]


def _acceleration_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Reported accelerations, what velocities gain in a step, and what mean velocities gain from step to step."""
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Revolutes are differenced here and bends below, so that false reports of either are seen.
    gained = np.diff(joints.velocities, axis=0) / step
    return [
        (joints.accelerations, time),
        (as_revolutes(trajectory.coordinates, trajectory.bend_accelerations), time),
        (less_rounding(gained, largest_magnitude(joints.velocities), step), time[:-1]),
        (_second_differences(as_revolutes(trajectory.coordinates, trajectory.bend_angles), step), time[1:-1]),
    ]


def _jerk_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Differences of accelerations, reported and mean, and those at the ends, before and after which the arm rests."""
    time = trajectory.time
    reported = (joints.accelerations, as_revolutes(trajectory.coordinates, trajectory.bend_accelerations))
    return [
        *((finite_jerks(values, time), np.append(time, time[-1])) for values in reported),
        (_second_differences(joints.velocities, np.diff(time)[:, None]), time[1:-1]),
    ]


def finite_jerks(accelerations: FloatArray, time: FloatArray) -> FloatArray:
    """Differences of accelerations (T, …), and those at the ends, before and after which the arm rests, (T + 1, …)."""
    step = np.diff(time).reshape(-1, *[1] * (accelerations.ndim - 1))
    # Before the first sample and after the last the arm rests, for as long as the step beside it.
    around = np.concatenate((step[:1], step, step[-1:]))
    rest = np.zeros_like(accelerations[:1])
    jerks = np.diff(np.concatenate((rest, accelerations, rest)), axis=0) / around
    return less_rounding(jerks, largest_magnitude(accelerations), around)


def _second_differences(values: FloatArray, step: FloatArray) -> FloatArray:
    """Return the second difference quotients at the inner samples, shape (T − 2, 3 * links)."""
    mean = np.diff(values, axis=0) / step
    # Mean rates belong to the middles of their steps, which are this far apart in time.
    apart = 0.5 * (step[1:] + step[:-1])
    shortest = np.minimum(step[1:], step[:-1])
    return less_rounding(np.diff(mean, axis=0) / apart, largest_magnitude(values), shortest**2)


def largest_magnitude(values: FloatArray) -> float:
    """Return the greatest size of some values."""
    return float(np.max(np.abs(values)))


def less_rounding(quotient: FloatArray, size: float, step: FloatArray) -> FloatArray:
    """Return a difference quotient, drawn towards zero by what rounding of values of a size can have added to it."""
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
    """Check the values of several sources against the limit of every drive, or against one."""
    values, times = (np.concatenate(parts) for parts in zip(*sources, strict=True))
    return check_worst(name, unit, values, limit, sample_words(times, names), settings.limit_tolerance)


def check_points(
    arm: Arm, limits: Limits, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> list[Check]:
    """Check every limit on a point of the arm.

    Speeds are judged by the reported velocities, by the distances from sample to sample, and in the plane by the motion
    whose coordinates are linear between samples, at all its times; accelerations by the reported ones, by what reported
    velocities gain, and by second differences of places: means that no motion through the samples can be below.
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
    """What a point of the arm does at the samples.

    Attributes:
        arm: the arm.
        limit: says which point.
        trajectory: the motion of the arm.
        frames: of the links.
        rates: of the links, as they are reported.
    """

    arm: Arm
    limit: PointLimit
    trajectory: JointTrajectory
    frames: LinkFrames
    rates: LinkRates

    @cached_property
    def places(self) -> FloatArray:
        """Of the point, but for where the base stands, shape (T, 3) [m]."""
        return self._summed(self.frames.along) + self._carried(self.trajectory.positions)

    @cached_property
    def velocities(self) -> FloatArray:
        """By the reported ones, shape (T, 3) [m/s]."""
        swing = np.cross(self.rates.rate, self.frames.along)
        return self._summed(swing) + self._carried(self.trajectory.velocities)

    def mean_speeds(self) -> FloatArray:
        """Return the distance over time of every step, shape (T − 1,) [m/s]."""
        return self._quotient(self.places)

    def speeds_between(self) -> FloatArray:
        """Bound on the speed within every step while coordinates are linear in time, in the plane, (T − 1,) [m/s].

        Within a step the velocity leaves its chord by at most h² / 8 times the greatest third derivative.
        """
        steps = np.diff(self.trajectory.positions, axis=0) / self._step[:, None]
        turns = np.cumsum(bend_pairs(self.arm, steps)[..., 1], axis=1)
        axis = self.arm.base_rotation[:, 1]
        swings = np.cross(axis, self.frames.along)
        ends = [self._summed(turns[..., None] * some) + self._carried(steps) for some in (swings[:-1], swings[1:])]
        # At constant rates the third derivative of the place is at most Σ l |φ̇|³.
        third = np.abs(turns) ** 3 @ self._levers
        return np.asarray(np.maximum(*map(lengths_of, ends)) + self._step**2 / 8.0 * third)

    def reported_accelerations(self) -> FloatArray:
        """Return by the reported velocities and accelerations, shape (T,) [m/s²]."""
        # Between the middle of a link and its end the acceleration grows by half of what the link adds.
        added = 2.0 / self.arm.link_length * (self.rates.ends - self.rates.middles)
        return lengths_of(self._summed(added) + self._carried(self.trajectory.accelerations))

    def gained(self) -> FloatArray:
        """Return what reported velocities gain in every step, over its time, shape (T − 1,) [m/s²]."""
        return self._quotient(self.velocities)

    def second_differences(self) -> FloatArray:
        """Return what mean velocities gain from step to step, shape (T − 2,) [m/s²]."""
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
        """How much of every link lies before the point, shape (links,) [m]."""
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
        """Return what rounding can have added to a difference of values."""
        return float((16.0 + self.arm.links) * np.finfo(np.float64).eps * np.max(np.abs(values)))


def check_shares(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    of_limits: Sequence[Check],
    holding: FloatArray,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check the share that plans keep; nothing where they may use the limits in full.

    Args:
        problem: what was asked.
        trajectory: the motion.
        joints: the same for the drives, with their efforts.
        of_limits: the checks of the limits themselves, which know where the greatest share of each is taken.
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
        # More than all of it holds nothing still; the check of the limit itself says so.
        held = np.minimum(np.abs(holding) / limit, 1.0)
        axes = tuple(f"the {name} axis" for name in trajectory.coordinates.base_names)
        names = (*describe_revolute_joints(joints.names), *axes)
        checks.append(_effort_check(taken, held, sample_words(trajectory.time, names), share, settings))
    return checks


def _rate_check(kind: str, limited: Sequence[Check], share: float, settings: VerificationSettings) -> Check:
    """Return the check for velocities, accelerations or jerks, from those of their limits."""
    tightest = max(limited, key=lambda check: check.worst / check.limit)
    worst = tightest.worst / tightest.limit
    # The place of an axis that carries the base is a time alone.
    where = tightest.where if tightest.name.startswith("joint") else f"{tightest.name} at {tightest.where}"
    return Check(
        f"share of {kind}", worst, share, UNIT, where, passed=worst <= share * (1.0 + settings.limit_tolerance)
    )


def _effort_check(
    taken: FloatArray, held: FloatArray, place: Callable[..., str], share: float, settings: VerificationSettings
) -> Check:
    """Return the check for efforts; what may be taken depends on what holds the arm still at each sample."""
    allowed = allowed_share(held, share)

    def where(k: int, j: int) -> str:
        still = f", where holding the arm still takes {held[k, j]:.3g} of the limit" if allowed[k, j] > share else ""
        return f"{place(k, j)}{still}"

    return check_worst("share of effort", UNIT, taken, allowed, where, settings.limit_tolerance)


def allowed_share(held: FloatArray, share: float) -> FloatArray:
    """Share of an effort's limit that a plan may use where holding the arm still takes some of it, in [0, 1]."""
    return np.asarray(np.maximum(share, held + 0.5 * share * (1.0 - held)))


def effort_limits(problem: Problem) -> FloatArray:
    """Return limits on the torques of all revolutes and the forces of the base's axes; inf for what is not limited."""
    limits = problem.limits
    torque = np.full(3 * problem.arm.links, np.inf) if limits.torque is None else limits.torque
    return np.append(torque, [np.inf if limits.feed_force is None else limits.feed_force] * len(problem.arm.base_axes))


def holding_efforts(problem: Problem, positions: FloatArray) -> FloatArray:
    """Return the efforts of all drives that hold the arm still at poses (T, c), shape (T, drives).

    Zeros where none is limited.
    """
    limit = effort_limits(problem)
    if not np.any(np.isfinite(limit)):
        return np.zeros((len(positions), len(limit)))
    rest = np.zeros_like(positions)
    torques, force = drive_efforts(problem.arm, problem.simulation.gravity, positions, rest, rest)
    return np.column_stack((torques, *[force] * len(problem.arm.base_axes)))
