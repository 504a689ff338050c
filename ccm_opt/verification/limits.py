"""Checks of speeds and accelerations of joints and points.

The plane is taken as that of complex numbers here: a point is base + Σ lᵢ exp(i φᵢ) over the links before it.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Limits, PointLimit
from ccm_opt.robot.arm import Arm
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.verification.checked_problem import as_revolutes, bends_a_ball, joint_of_bend
from ccm_opt.verification.link_motion import advance, link_headings
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

_Source = tuple[FloatArray, FloatArray, tuple[str, ...]]
"""Values of all revolutes at some times, the times, and the names of the revolutes."""


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
    checks = [check_bends(arm, trajectory, settings)]
    tolerance = settings.limit_tolerance
    velocities = _velocity_sources(trajectory, joints)
    checks.append(_worst("joint velocity", "rad/s", limits.velocity, velocities, tolerance))
    accelerations = _acceleration_sources(trajectory, joints)
    checks.append(_worst("joint acceleration", "rad/s²", limits.acceleration, accelerations, tolerance))
    if limits.jerk is not None:
        jerks = _jerk_sources(trajectory, joints)
        checks.append(_worst("joint jerk", "rad/s³", limits.jerk, jerks, tolerance))
    if limits.torque is not None:
        torques: _Source = (joints.torques, trajectory.time, joints.names)
        checks.append(_worst("joint torque", "N m", limits.torque, [torques], tolerance))
    return checks


def check_bends(arm: Arm, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION) -> Check:
    """Check the bends; between samples they are linear, so the samples decide."""
    # The joint at the base has a limit of its own.
    limit = np.full(arm.coordinates.joints, arm.joint_limit)
    limit[: bends_a_ball(arm.coordinates)] = arm.base_limit
    bends = np.abs(trajectory.bend_angles)
    excess = bends - limit
    k, j = np.unravel_index(np.argmax(excess), excess.shape)
    where = f"{joint_of_bend(arm.coordinates, int(j))} at t = {trajectory.time[k]:.4f} s"
    worst = float(bends[k, j])
    bound = float(limit[j])
    return Check("joint limit", worst, bound, "rad", where, passed=worst <= bound + settings.bend_tolerance)


def _velocity_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Reported velocities of revolutes and bends, and mean velocities of the steps."""
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Mean rates carry the rounding of the angles, magnified by 1/h; that much is no violation.
    mean = np.diff(as_revolutes(trajectory.coordinates, trajectory.bend_angles), axis=0) / step
    return [
        (joints.velocities, time, joints.names),
        (as_revolutes(trajectory.coordinates, trajectory.bend_velocities), time, joints.names),
        (_less_rounding(mean, trajectory.bend_angles, step), time[:-1], joints.names),
    ]


def _acceleration_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Reported accelerations, what velocities gain in a step, and what mean velocities gain from step to step."""
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Revolutes are differenced here and bends below, so that false reports of either are seen.
    gained = np.diff(joints.velocities, axis=0) / step
    sources: list[_Source] = [
        (joints.accelerations, time, joints.names),
        (as_revolutes(trajectory.coordinates, trajectory.bend_accelerations), time, joints.names),
        (_less_rounding(gained, joints.velocities, step), time[:-1], joints.names),
    ]
    if len(time) > 2:
        second = _second_differences(as_revolutes(trajectory.coordinates, trajectory.bend_angles), step)
        sources.append((second, time[1:-1], joints.names))
    return sources


def _jerk_sources(trajectory: JointTrajectory, joints: JointStates) -> list[_Source]:
    """Differences of accelerations, reported and mean, and those at the ends, before and after which the arm rests."""
    time = trajectory.time
    step = np.diff(time)[:, None]
    # Before the first sample and after the last the arm rests, for as long as the step beside it.
    around = np.concatenate((step[:1], step, step[-1:]))
    sources: list[_Source] = []
    for values in (joints.accelerations, as_revolutes(trajectory.coordinates, trajectory.bend_accelerations)):
        rest = np.zeros_like(values[:1])
        jerks = np.diff(np.concatenate((rest, values, rest)), axis=0) / around
        sources.append((_less_rounding(jerks, values, around), np.append(time, time[-1]), joints.names))
    if len(time) > 2:
        sources.append((_second_differences(joints.velocities, step), time[1:-1], joints.names))
    return sources


def _second_differences(values: FloatArray, step: FloatArray) -> FloatArray:
    """Second difference quotients at the inner samples, shape (T − 2, 3 * links)."""
    mean = np.diff(values, axis=0) / step
    # Mean rates belong to the middles of their steps, which are this far apart in time.
    apart = 0.5 * (step[1:] + step[:-1])
    shortest = np.minimum(step[1:], step[:-1])
    return _less_rounding(np.diff(mean, axis=0) / apart, values, shortest**2)


def _less_rounding(quotient: FloatArray, values: FloatArray, step: FloatArray) -> FloatArray:
    """A difference quotient, drawn towards zero by what rounding of the values can have added to it."""
    noise = 16.0 * np.finfo(np.float64).eps * np.max(np.abs(values)) / step
    return np.asarray(np.sign(quotient) * np.maximum(np.abs(quotient) - noise, 0.0))


def _worst(name: str, unit: str, limit: FloatArray, sources: list[_Source], tolerance: float) -> Check:
    """The check for the greatest share of its limit that any revolute takes, over all sources."""
    found = []
    for values, time, names in sources:
        share = np.abs(values) / limit
        k, j = np.unravel_index(np.argmax(share), share.shape)
        where = f"joint {j // 3 + 1} ({names[j]}) at t = {time[k]:.4f} s"
        found.append((float(share[k, j]), float(np.abs(values[k, j])), float(limit[j]), where))
    # Shares are compared, for the revolutes need not have the same limits.
    share_worst, worst, bound, where = max(found)
    return Check(name, worst, bound, unit, where, passed=share_worst <= 1.0 + tolerance)


def check_points(
    arm: Arm, limits: Limits, trajectory: JointTrajectory, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> list[Check]:
    """Check every limit on a point of the arm.

    Speeds are judged by the reported velocities, by the distances from sample to sample, and by the motion whose
    coordinates are linear between samples, at all its times; accelerations by the reported ones, by what reported
    velocities gain, and by second differences of places.
    """
    checks = []
    for limit in limits.points:
        motion = _PointMotion.of_limit(arm, limit, trajectory)
        if np.isfinite(limit.velocity):
            speeds = [motion.reported_speeds(), motion.mean_speeds(), motion.speeds_between()]
            checks.append(_check(f"{limit.name} velocity", limit.velocity, "m/s", speeds, trajectory.time, settings))
        if np.isfinite(limit.acceleration):
            gains = [motion.reported_accelerations(), motion.gained(), motion.second_differences()]
            checks.append(
                _check(f"{limit.name} acceleration", limit.acceleration, "m/s²", gains, trajectory.time, settings)
            )
    return checks


@dataclass(frozen=True)
class _PointMotion:
    """What a point does at the samples.

    Attributes:
        levers: length of every link before the point, shape (links,) [m].
        along: direction in which the base is carried, a complex number of length 1.
        headings: of the links, shape (T, links) [rad].
        trajectory: the motion of the arm.
        places: of the point, shape (T,), complex [m].
        step: time from sample to sample, shape (T − 1,) [s].
    """

    arm: Arm
    levers: FloatArray
    along: complex
    headings: FloatArray
    trajectory: JointTrajectory
    places: FloatArray
    step: FloatArray

    @classmethod
    def of_limit(cls, arm: Arm, limit: PointLimit, trajectory: JointTrajectory) -> "_PointMotion":
        at = arm.links * arm.link_length if limit.at is None else limit.at
        # Links before the point count in full, its own up to the point, those beyond it not at all.
        levers = np.array([min(max(at - k * arm.link_length, 0.0), arm.link_length) for k in range(arm.links)])
        along = complex(np.exp(1j * arm.base_heading))
        headings = link_headings(arm, trajectory.positions)
        places = np.exp(1j * headings) @ levers + advance(arm, trajectory.positions) * along
        return cls(arm, levers, along, headings, trajectory, places, np.diff(trajectory.time))

    def reported_speeds(self) -> FloatArray:
        """By the reported velocities, shape (T,) [m/s]."""
        return np.abs(self._velocities())

    def mean_speeds(self) -> FloatArray:
        """Distance over time of every step, shape (T − 1,) [m/s]."""
        return self._quotient(self.places, self.step)

    def speeds_between(self) -> FloatArray:
        """Bound on the speed within every step while coordinates are linear in time, shape (T − 1,) [m/s].

        Within a step the velocity leaves its chord by at most h² / 8 times the greatest third derivative.
        """
        rates = np.diff(self.headings, axis=0) / self.step[:, None]
        carried = np.diff(advance(self.arm, self.trajectory.positions)) / self.step
        first = self._turned(self.headings[:-1], rates) + carried * self.along
        last = self._turned(self.headings[1:], rates) + carried * self.along
        # At constant rates the third derivative of the place is at most Σ l |φ̇|³.
        third = np.abs(rates) ** 3 @ self.levers
        return np.asarray(np.maximum(np.abs(first), np.abs(last)) + self.step**2 / 8.0 * third)

    def reported_accelerations(self) -> FloatArray:
        """By the reported velocities and accelerations, shape (T,) [m/s²]."""
        rates = self._heading_rates(self.trajectory.velocities)
        gains = self._heading_rates(self.trajectory.accelerations)
        # The second derivative of exp(iφ) is (i φ̈ − φ̇²) exp(iφ).
        turned = ((1j * gains - rates**2) * np.exp(1j * self.headings)) @ self.levers
        return np.asarray(np.abs(turned + advance(self.arm, self.trajectory.accelerations) * self.along))

    def gained(self) -> FloatArray:
        """What reported velocities gain in every step, over its time, shape (T − 1,) [m/s²]."""
        return self._quotient(self._velocities(), self.step)

    def second_differences(self) -> FloatArray:
        """What mean velocities gain from step to step, shape (T − 2,), and nothing at the first sample [m/s²]."""
        means = np.diff(self.places) / self.step
        apart = 0.5 * (self.step[1:] + self.step[:-1])
        noise = _noise(self.places) / np.minimum(self.step[1:], self.step[:-1]) ** 2
        # A leading zero, so that entry k belongs to the time of sample k, as ``_check`` expects.
        return np.append(0.0, np.maximum(np.abs(np.diff(means)) / apart - noise, 0.0))

    def _velocities(self) -> FloatArray:
        turned = self._turned(self.headings, self._heading_rates(self.trajectory.velocities))
        return np.asarray(turned + advance(self.arm, self.trajectory.velocities) * self.along)

    def _turned(self, headings: FloatArray, rates: FloatArray) -> FloatArray:
        return np.asarray((1j * rates * np.exp(1j * headings)) @ self.levers)

    def _heading_rates(self, rates: FloatArray) -> FloatArray:
        return np.cumsum(rates[:, : self.arm.links], axis=1)

    @staticmethod
    def _quotient(values: FloatArray, step: FloatArray) -> FloatArray:
        return np.asarray(np.maximum(np.abs(np.diff(values)) - _noise(values), 0.0) / step)


def _noise(values: FloatArray) -> float:
    """What rounding can have added to a difference of values."""
    return float(16.0 * np.finfo(np.float64).eps * np.max(np.abs(values)))


def _check(
    name: str, limit: float, unit: str, sources: list[FloatArray], time: FloatArray, settings: VerificationSettings
) -> Check:
    """The check for the greatest value of all sources; entry k of each belongs to the time of sample k."""
    greatest = max(sources, key=np.max)
    k = int(np.argmax(greatest))
    worst = float(greatest[k])
    passed = worst <= limit * (1.0 + settings.limit_tolerance)
    return Check(name, worst, float(limit), unit, f"t = {time[k]:.4f} s", passed=passed)
