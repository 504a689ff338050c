"""What a motion along a path's columns asks of the drives: torques of the revolutes, force of the feed axis."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.problem import Limits

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


class Efforts:
    """Torques, and the force on the feed axis, as shares of their limits.

    Args:
        limits: what is not limited takes no share.
        inverse_dynamics: of the arm.
        revolutes: from bends.
        columns: of the path.

    Raises:
        ProblemError: when the feed force is limited and the dynamics cannot tell it.
    """

    def __init__(self, limits: Limits, inverse_dynamics: InverseDynamics, revolutes: Revolutes, columns: int) -> None:
        self._torque, self._dynamics, self._revolutes = limits.torque, inverse_dynamics, revolutes
        self._links = len(limits.velocity) // 3
        self._columns, self._has_feed = columns, columns > self._links
        self._force = limits.feed_force if self._has_feed else None
        self._forces: InverseDynamics | None = getattr(inverse_dynamics, "feed_forces", None)
        if self._force is not None and self._forces is None:
            raise ProblemError("limits.feed_force needs inverse dynamics with a method feed_forces; leave it out")
        self._friction = self._viscous() if self.limited else np.zeros(3 * self._links)

    @property
    def limited(self) -> bool:
        """Whether any effort is."""
        return self._torque is not None or self._force is not None

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
        motion = [self._revolutes(values[:, : self._links]) for values in (place, velocity, acceleration)]
        if self._has_feed:
            motion.append(np.ascontiguousarray(acceleration[:, self._links]))
        torques = np.zeros_like(motion[0]) if self._torque is None else self._dynamics(*motion) / self._torque
        if self._force is None or self._forces is None:
            return torques
        return np.concatenate((torques, (self._forces(*motion) / self._force)[:, None]), axis=1)

    def damping(self, velocity: FloatArray) -> FloatArray:
        """Shares that are proportional to velocity, of the shape of the result of a call."""
        shares = self._revolutes(velocity[:, : self._links]) * self._friction
        return shares if self._force is None else np.concatenate((shares, np.zeros((len(shares), 1))), axis=1)

    def parts(self, place: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> EffortParts:
        """The shares, apart by how they fall when time is longer."""
        rest = np.zeros_like(place)
        static, damping = self(place, rest, rest), self.damping(velocity)
        return EffortParts(self(place, velocity, acceleration) - static - damping, damping, static)

    def _viscous(self) -> FloatArray:
        """Friction of every revolute over its torque limit: the odd part of the torques at unit velocities."""
        if self._torque is None:
            return np.zeros(3 * self._links)
        place, ones = np.zeros((2, 3 * self._links)), np.ones((1, 3 * self._links))
        motion = [place, np.concatenate((ones, -ones)), place]
        torques = self._dynamics(*motion, np.zeros(2)) if self._has_feed else self._dynamics(*motion)
        odd = 0.5 * (torques[0] - torques[1])
        return np.asarray(np.where(np.abs(odd) > 1e-9 * np.max(np.abs(torques)), odd, 0.0) / self._torque)
