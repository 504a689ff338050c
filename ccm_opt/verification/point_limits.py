"""Limits on how points of the arm move in the plane: speed and acceleration, at the samples and between them.

The plane is taken as that of complex numbers here: a point is base + Σ lᵢ exp(i φᵢ) over the links before it.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import Limits, PointLimit
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification.link_motion import advance, link_headings
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


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
