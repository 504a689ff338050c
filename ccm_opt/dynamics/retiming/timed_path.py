"""What is to be timed: a path, its limits, the arm that they are limits of, and what motions ask of its drives."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, ProblemError, RetimingError
from ccm_opt.problem import Limits
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import FEED, Coordinates, DriveLimits, joint_coordinates

InverseDynamics: TypeAlias = Callable[..., FloatArray]
"""(angles, velocities, accelerations), each (N, 3 * links), and with a feed axis its accelerations, (N,) [m/s²], to
torques (N, 3 * links) [N m]. It may have a method ``feed_forces``: the same arguments to forces on the axis [N]."""
Revolutes: TypeAlias = Callable[[FloatArray], FloatArray]
"""Bends (N, links) to revolute angles (N, 3 * links); linear, so it serves rates too."""


class Efforts:
    """Torques, and the force on the feed axis, as shares of their limits.

    Args:
        limits: what is not limited takes no share.
        inverse_dynamics: of the arm.
        revolutes: from bends.
        coordinates: what the columns of the path are.

    Raises:
        ProblemError: when the feed force is limited and the dynamics cannot report it.
    """

    def __init__(
        self, limits: Limits, inverse_dynamics: InverseDynamics, revolutes: Revolutes, coordinates: Coordinates
    ) -> None:
        self._dynamics = inverse_dynamics
        self._revolutes = revolutes
        self._coordinates = coordinates
        bounds = limits.of_drives(coordinates).effort
        self._torque = bounds[: coordinates.revolutes]
        # Axes of the base whose force is limited; the others get no row.
        self._force = bounds[coordinates.revolutes :][np.isfinite(bounds[coordinates.revolutes :])]
        self._torque_limited = bool(np.any(np.isfinite(self._torque)))
        # Where no force is limited this is never called, so that any function will do.
        self._forces: InverseDynamics = getattr(inverse_dynamics, "feed_forces", inverse_dynamics)
        if len(self._force) and not hasattr(inverse_dynamics, "feed_forces"):
            raise ProblemError("limits.feed_force needs inverse dynamics with a method feed_forces; leave it out")
        self._friction = self._viscous() if self.limited else np.zeros(coordinates.revolutes)

    @property
    def limited(self) -> bool:
        """Whether any effort is."""
        return self._torque_limited or len(self._force) > 0

    @property
    def damped(self) -> bool:
        """Whether any revolute has viscous friction."""
        return bool(np.any(self._friction))

    def __call__(self, place: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Shares of the limits, shape (N, 3 * links), and one more column for a limited feed force.

        Args:
            place: columns of the path, shape (N, n) [rad, m].
            velocity: [rad/s, m/s].
            acceleration: [rad/s², m/s²].
        """
        bends = self._coordinates.bends
        motion = [self._revolutes(values[:, bends]) for values in (place, velocity, acceleration)]
        # One more argument for each axis that carries the base.
        motion += [np.ascontiguousarray(column) for column in acceleration[:, self._coordinates.base].T]
        torques = self._dynamics(*motion) / self._torque if self._torque_limited else np.zeros_like(motion[0])
        forces = [self._forces(*motion) / limit for limit in self._force]
        return np.column_stack((torques, *forces))

    def damping(self, velocity: FloatArray) -> FloatArray:
        """Shares that are proportional to velocity, of the shape of the result of a call."""
        shares = self._revolutes(velocity[:, self._coordinates.bends]) * self._friction
        return np.concatenate((shares, np.zeros((len(shares), len(self._force)))), axis=1)

    def parts(
        self, place: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The shares, apart by how they fall when time is λ times longer, of the shape of the result of a call each.

        Returns:
            What falls with λ²; viscous friction, with λ; what holds the arm still, which does not fall at all.
        """
        rest = np.zeros_like(place)
        # All but friction and static load is linear in q̈ or quadratic in q̇, and falls with λ².
        static = self(place, rest, rest)
        damping = self.damping(velocity)
        return self(place, velocity, acceleration) - static - damping, damping, static

    def _viscous(self) -> FloatArray:
        """Friction of every revolute over its torque limit: the odd part of the torques at unit velocities."""
        if not self._torque_limited:
            return np.zeros(self._coordinates.revolutes)
        place = np.zeros((2, self._coordinates.revolutes))
        ones = np.ones((1, self._coordinates.revolutes))
        base_at_rest = [np.zeros(2) for _ in self._coordinates.base_names]
        torques = self._dynamics(place, np.concatenate((ones, -ones)), place, *base_at_rest)
        # Velocity products are even in q̇ and friction is odd, so half the difference is friction alone.
        odd = 0.5 * (torques[0] - torques[1])
        return np.asarray(np.where(np.abs(odd) > 1e-9 * np.max(np.abs(torques)), odd, 0.0) / self._torque)


def likely_coordinates(limits: Limits, columns: int) -> Coordinates:
    """What the columns of a path are when nothing says so: a bend a link, and the feed axis in what is left over."""
    links = len(limits.velocity) // 3
    return joint_coordinates(links, 1, (FEED,) * min(columns - links, 1))


def _wrong_columns(columns: int, coordinates: Coordinates) -> RetimingError:
    links = coordinates.joints
    return RetimingError(
        Diagnosis(
            reason=f"the path has {columns} columns; expected {links} bends, or one more for a feed axis with limits "
            "on its velocity and acceleration",
            stage="retiming",
            advice=("give limits.feed_velocity and limits.feed_acceleration",),
            evidence={"columns": columns, "links": links},
        )
    )


@dataclass(frozen=True)
class TimedPath:
    """A path with its limits.

    Attributes:
        spline: of the arm's coordinates over [0, 1].
        limits: of the drives, and of points of the arm.
        inverse_dynamics: of the arm.
        revolutes: bends to revolute angles.
        coordinates: what the columns of the spline are.
        arm: whose points are limited; None when none are.
        share: of the limits of the drives that may be used; points of the arm may use theirs in full.
    """

    spline: BSpline
    limits: Limits
    inverse_dynamics: InverseDynamics
    revolutes: Revolutes
    coordinates: Coordinates
    arm: Arm | None = None
    share: float = 1.0

    @cached_property
    def bounds(self) -> DriveLimits:
        """What may be used of the limits on the columns of the path.

        Raises:
            RetimingError: the path has other columns, or one has no limit on velocity or acceleration.
        """
        columns = np.shape(self.spline(0.0))[-1]
        layout = self.coordinates
        if columns != len(layout) or len(self.limits.velocity) != layout.revolutes:
            raise _wrong_columns(columns, layout)
        found = self.limits.of_coordinates(layout).rates_within(self.share)
        if not np.all(np.isfinite(found.velocity) & np.isfinite(found.acceleration)):
            raise _wrong_columns(columns, layout)
        return found

    @property
    def weighed(self) -> BSpline:
        """The path with ways of the base in lengths of the arm, where it is given: they weigh alike at every size."""
        weights = np.ones(len(self.coordinates))
        if self.arm is not None:
            weights[self.coordinates.base] = 1.0 / self.arm.length
        return BSpline(self.spline.t, weights * self.spline.c, self.spline.k)

    @property
    def smooth(self) -> bool:
        """Whether jerk is limited."""
        return bool(np.any(np.isfinite(self.bounds.jerk)))
