"""Coordinates of an arm's configuration: names, units, drives, and the limits of the drives.

A configuration q of an arm is one row of numbers: first the coordinates that bend its joints, then those that carry its
base. Planning, timing, simulation and verification exchange such rows; the layout, or the arm, tells them the meaning
of every entry. An arm with a fixed base has no coordinates of the second kind; their arrays then have shape (…, 0), so
that sums over them are zero and loops over them do nothing.

Plans use a fraction σ of the limits on velocities, accelerations, jerks and efforts, to leave a reserve for the
controller. Part of an effort does not depend on timing: the effort that holds the arm still under gravity. Let h be
that part as a fraction of the limit. A planned effort may then take max(σ, h + ½ σ (1 − h)) of the limit: normally σ;
and where gravity alone takes so much that hardly any of σ is left for moving, h and half of the usual fraction σ of the
rest. So an arm that can be held still can be moved, whatever σ is; and σ = 1 means the limits themselves.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray

FEED = "feed"
"""Name of the coordinate of a feed axis."""


@dataclass(frozen=True)
class Coordinates:
    """The layout of an arm's configuration: the meaning of each coordinate, and the drive that moves it.

    Attributes:
        names: name of each coordinate, for messages.
        units: unit of each coordinate, "rad" or "m".
        joints: number of coordinates that bend joints; these come first, and the others carry the base.
        drives: index of the drive that moves each coordinate. Revolutes are counted first, ball by ball, then the axes
            that carry the base.
        revolutes: number of revolutes.
        bends_a_joint: number of consecutive coordinates that bend the same joint: 1 in the plane, 2 in space.
        sense: 1 if a bend equals the angle of its revolute, -1 if it is its negative, as in the plane: there bends are
            counter-clockwise in (x, y), which is world x-z, while the revolutes turn about +y.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    joints: int
    drives: tuple[int, ...]
    revolutes: int
    bends_a_joint: int = 1
    sense: float = -1.0

    def __len__(self) -> int:
        return len(self.names)

    @property
    def bends(self) -> slice:
        """Slice of the coordinates that bend joints."""
        return slice(0, self.joints)

    @property
    def base(self) -> slice:
        """Slice of the coordinates that carry the base."""
        return slice(self.joints, len(self.names))

    @property
    def base_names(self) -> tuple[str, ...]:
        """Names of the coordinates that carry the base; empty if the base is fixed."""
        return self.names[self.base]

    @property
    def drive_numbers(self) -> IntArray:
        """Index of the drive of each coordinate, shape (c,)."""
        return np.array(self.drives, dtype=np.intp)

    @property
    def drive_count(self) -> int:
        """Number of drives, all revolutes, and the axes that carry the base."""
        return self.revolutes + len(self.base_names)

    def advance(self, q: FloatArray) -> FloatArray:
        """Return the displacement of the base along the base heading, shape (...) [m]; 0 if the base is fixed.

        The map is linear, so it also applies to velocities and accelerations.

        Args:
            q: configurations, shape (..., c).
        """
        return np.asarray(np.sum(q[..., self.base], axis=-1))

    def travel(self, change: FloatArray, link_length: float) -> FloatArray:
        """Return a bound on how far any point of the arm moves for a change of coordinates, shape (...) [m].

        A link that turns moves everything beyond it by at most its length times its turn. In the plane that turn is the
        sum of the bends up to the link; in space bends are about different axes, so opposite bends need not cancel.

        Args:
            change: change of the coordinates, shape (..., c) [rad, m].
            link_length: l [m].
        """
        bends = change[..., self.bends]
        if self.bends_a_joint > 1:
            bends = np.linalg.norm(bends.reshape(*bends.shape[:-1], -1, self.bends_a_joint), axis=-1)
        turned = np.abs(np.cumsum(bends, axis=-1)).sum(axis=-1)
        return np.asarray(link_length * turned + np.abs(change[..., self.base]).sum(axis=-1))


@lru_cache(maxsize=64)
def joint_coordinates(links: int, bends_a_joint: int = 1, axes: tuple[str, ...] = ()) -> Coordinates:
    """Return the coordinates of an arm: the bends of its joints, then the axes that carry its base.

    Ball i has the revolutes 3 i to 3 i + 2, in the order of ``joint_names``. The planar bend is the angle of the second
    revolute with opposite sign; the bends a and b in space are the angles of the first and the second. The remaining
    revolutes stay at zero.

    Args:
        links: number of links.
        bends_a_joint: 1 in the plane, 2 in space.
        axes: names of the axes that carry the base along its direction.
    """
    revolutes = 3 * links
    in_space = bends_a_joint == 2
    bent = (0, 1) if in_space else (1,)
    called = (" a", " b") if in_space else ("",)
    return Coordinates(
        names=(*(f"joint {number}{bend}" for number in range(1, links + 1) for bend in called), *axes),
        units=("rad",) * (bends_a_joint * links) + ("m",) * len(axes),
        joints=bends_a_joint * links,
        drives=(*(3 * ball + bend for ball in range(links) for bend in bent), *range(revolutes, revolutes + len(axes))),
        revolutes=revolutes,
        bends_a_joint=bends_a_joint,
        sense=1.0 if in_space else -1.0,
    )


@dataclass(frozen=True)
class PointLimit:
    """Bounds on the motion of a point of the arm.

    Attributes:
        at: arc length along the arm from its base [m]; None for the tip.
        velocity: greatest speed [m/s]; inf if it is not limited.
        acceleration: greatest acceleration in any direction [m/s²]; inf if it is not limited.
    """

    at: float | None = None
    velocity: float = np.inf
    acceleration: float = np.inf

    @property
    def name(self) -> str:
        """Name of the point in messages."""
        return "tip" if self.at is None else f"point at {self.at:g} m"


@dataclass(frozen=True)
class Limits:
    """Bounds on every revolute; each array has shape (3 * links,), with the three revolutes of a ball in a row.

    Attributes:
        velocity: greatest velocities of the revolutes [rad/s].
        acceleration: greatest accelerations of the revolutes [rad/s²].
        torque: greatest torques of the revolutes [N m], or None if torque is not limited.
        feed_velocity: greatest velocity of the feed axis [m/s], or None if there is no feed axis.
        feed_acceleration: greatest acceleration of the feed axis [m/s²], or None if there is no feed axis.
        feed_force: greatest force of the feed axis [N], or None if it is not limited.
        jerk: greatest jerks of the revolutes [rad/s³], or None if jerk is not limited.
        feed_jerk: greatest jerk of the feed axis [m/s³], or None if it is not limited.
        points: limits of points of the arm, such as its tip.
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
        """Return the limits of every drive of an arm, in the order of the drives."""
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
        """Return the limits of the drives that move an arm's coordinates, one per coordinate."""
        return self.of_drives(coordinates).of(coordinates.drive_numbers)


def planned_share(holding: FloatArray, share: float) -> FloatArray:
    """Return the fraction of its limit that a planned effort may take; the module's docstring gives the formula.

    Args:
        holding: effort that holds the arm still at each pose, as a signed fraction of the limit.
        share: σ, the fraction of the limits that plans normally use.

    Returns:
        Fractions in the shape of ``holding``, at most 1, and above the magnitude of ``holding`` wherever that is below
        1.
    """
    held = np.minimum(np.abs(holding), 1.0)
    return np.asarray(np.maximum(share, held + 0.5 * share * (1.0 - held)))


@dataclass(frozen=True)
class DriveLimits:
    """Limits of several drives, one entry per drive; ∞ where there is no limit.

    Attributes:
        velocity: greatest velocities, shape (n,) [rad/s, m/s].
        acceleration: greatest accelerations, shape (n,) [rad/s², m/s²].
        jerk: greatest jerks, shape (n,) [rad/s³, m/s³].
        effort: greatest efforts, shape (n,) [N m, N].
    """

    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    effort: FloatArray

    def rates_within(self, share: float) -> "DriveLimits":
        """Return the limits with velocities, accelerations and jerks scaled by a factor.

        Limits on efforts are not changed.
        """
        return DriveLimits(share * self.velocity, share * self.acceleration, share * self.jerk, self.effort)

    def of(self, drives: IntArray) -> "DriveLimits":
        """Return the limits of the drives that have the given indices."""
        return DriveLimits(self.velocity[drives], self.acceleration[drives], self.jerk[drives], self.effort[drives])
