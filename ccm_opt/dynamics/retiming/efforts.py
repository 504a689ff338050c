"""What a motion along a path's columns asks of the drives: torques of the revolutes, force of the feed axis."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import Limits
from ccm_opt.robot.coordinates import Coordinates

InverseDynamics: TypeAlias = Callable[..., FloatArray]
"""(angles, velocities, accelerations), each (N, 3 * links), and with a feed axis its accelerations, (N,) [m/s²], to
torques (N, 3 * links) [N m]. It may have a method ``feed_forces``: the same arguments to forces on the axis [N]."""
Revolutes: TypeAlias = Callable[[FloatArray], FloatArray]
"""Bends (N, links) to revolute angles (N, 3 * links); linear, so it serves rates too."""


@dataclass(frozen=True)
class EffortParts:
    """Shares of the limits, apart by how they fall when time is λ times longer; each of shape (N, R).

    Attributes:
        moving: with λ².
        damping: with λ; viscous friction.
        static: not at all; they hold the arm still.
    """

    moving: FloatArray
    damping: FloatArray
    static: FloatArray

    def as_shares_of(self, usable: FloatArray) -> "EffortParts":
        """The same as shares of what may be used of the limits, shape (N, R)."""
        return EffortParts(self.moving / usable, self.damping / usable, self.static / usable)


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

    def parts(self, place: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> EffortParts:
        """The shares, apart by how they fall when time is longer."""
        rest = np.zeros_like(place)
        # All but friction and static load is linear in q̈ or quadratic in q̇, and falls with λ².
        static = self(place, rest, rest)
        damping = self.damping(velocity)
        return EffortParts(self(place, velocity, acceleration) - static - damping, damping, static)

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
