"""Limits on what the arm's drives do and on how its points move, and what plans use of them.

Plans use a share σ of the limits on velocities, accelerations, jerks and efforts, so that the controller has something
left. Efforts have a part that no timing changes, what holds the arm still under gravity. With h that part as a share of
its limit, an effort of a plan may take max(σ, h + ½ σ (1 − h)) of the limit: σ as a rule, and where gravity alone takes
so much that hardly any of σ would be left for moving, half of the usual share of what gravity leaves. So an arm that
can be held still can be moved, whatever σ is; and σ = 1 means the limits themselves.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.coordinates import Coordinates


@dataclass(frozen=True)
class PointLimit:
    """Bounds on how a point of the arm moves.

    Attributes:
        at: arc length along the arm from its base [m]; None for the tip.
        velocity: greatest speed [m/s], inf where it is not limited.
        acceleration: greatest acceleration, in any direction [m/s²], inf where it is not limited.
    """

    at: float | None = None
    velocity: float = np.inf
    acceleration: float = np.inf

    @property
    def name(self) -> str:
        """What the point is called in messages."""
        return "tip" if self.at is None else f"point at {self.at:g} m"


@dataclass(frozen=True)
class Limits:
    """Bounds on every revolute joint; each array has shape (3 * links,), the three revolutes of a ball in a row.

    Attributes:
        velocity: [rad/s].
        acceleration: [rad/s²].
        torque: [N m], or None when torque is not limited.
        feed_velocity: of the feed axis [m/s], or None when there is none.
        feed_acceleration: of the feed axis [m/s²], or None when there is none.
        feed_force: of the feed axis [N], or None when it is not limited.
        jerk: [rad/s³], or None when jerk is not limited.
        feed_jerk: of the feed axis [m/s³], or None when it is not limited.
        points: of points of the arm, such as its tip.
    """

    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray | None = None
    feed_velocity: float | None = None
    feed_acceleration: float | None = None
    feed_force: float | None = None
    jerk: FloatArray | None = None
    feed_jerk: float | None = None
    points: tuple[PointLimit, ...] = ()

    def of_drives(self, coordinates: Coordinates) -> "DriveLimits":
        """The limits of every drive of an arm, drive by drive."""
        axes = len(coordinates.base_names)

        def both(of_revolutes: FloatArray | None, of_axes: float | None) -> FloatArray:
            joints = np.full(coordinates.revolutes, np.inf) if of_revolutes is None else of_revolutes
            return np.append(joints, np.full(axes, np.inf if of_axes is None else of_axes))

        return DriveLimits(
            velocity=both(self.velocity, self.feed_velocity),
            acceleration=both(self.acceleration, self.feed_acceleration),
            jerk=both(self.jerk, self.feed_jerk),
            effort=both(self.torque, self.feed_force),
        )

    def of_coordinates(self, coordinates: Coordinates) -> "DriveLimits":
        """The limits of the drives that move an arm's coordinates, one for each coordinate."""
        return self.of_drives(coordinates).of(coordinates.drive_numbers)


def planned_share(holding: FloatArray, share: float) -> FloatArray:
    """Share of its limit that an effort of a plan may take: see the module's docstring.

    Args:
        holding: share of the limit that holds the arm still at that place, of either sign.
        share: σ, what plans use as a rule.

    Returns:
        Of the shape of ``holding``, at most 1; above its magnitude wherever that is below 1.
    """
    held = np.minimum(np.abs(holding), 1.0)
    return np.asarray(np.maximum(share, held + 0.5 * share * (1.0 - held)))


@dataclass(frozen=True)
class DriveLimits:
    """The limits of some drives in a row, ∞ where there is none; units of a revolute, and of an axis of the base.

    Attributes:
        velocity: shape (n,) [rad/s, m/s].
        acceleration: shape (n,) [rad/s², m/s²].
        jerk: shape (n,) [rad/s³, m/s³].
        effort: shape (n,) [N m, N].
    """

    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    effort: FloatArray

    def rates_within(self, share: float) -> "DriveLimits":
        """The same with a share of the limits on velocities, accelerations and jerks; efforts are not changed."""
        return DriveLimits(share * self.velocity, share * self.acceleration, share * self.jerk, self.effort)

    def of(self, drives: IntArray) -> "DriveLimits":
        """The limits of drives of given numbers."""
        return DriveLimits(self.velocity[drives], self.acceleration[drives], self.jerk[drives], self.effort[drives])
