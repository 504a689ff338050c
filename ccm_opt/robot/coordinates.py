"""Coordinates of an arm's configuration, with their names, units and drives, and the limits of the drives.

A configuration q of an arm is one row of numbers: first the coordinates that bend its joints, then those that carry its
base. Planning, timing, simulation and verification exchange such rows; the layout, or the arm, gives the meaning of
every entry. An arm with a fixed base has no coordinates of the second kind; their arrays then have shape (…, 0), so
that sums over them are zero and loops over them do nothing.

Plans use a fraction σ of the limits on velocities, accelerations, jerks and efforts, to leave a reserve for the
controller. Part of an effort does not depend on timing: the effort that holds the arm still under gravity. Let h be
that part as a fraction of the limit. A planned effort may then take max(σ, h + ½ σ (1 − h)) of the limit: normally σ,
but where gravity leaves little or nothing of σ for moving, h and half of the usual fraction σ of the rest. So for any σ
an arm that can be held still can be moved; σ = 1 means the full limits.
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
        reaches: bound on the displacement of any point of the arm by a unit of each coordinate that carries the base: 1
            for a prismatic axis, the greatest distance from its axis for a revolute one [m].
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
    reaches: tuple[float, ...] = ()

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
    def base_units(self) -> tuple[str, ...]:
        """Units of the coordinates that carry the base, "m" or "rad"."""
        return self.units[self.base]

    @property
    def drive_numbers(self) -> IntArray:
        """Index of the drive of each coordinate, shape (c,)."""
        return np.array(self.drives, dtype=np.intp)

    def advance(self, q: FloatArray) -> FloatArray:
        """Return the displacement of the base along the base heading, shape (...) [m]; 0 if the base is fixed.

        The map is linear, so it also applies to velocities and accelerations.

        Args:
            q: configurations, shape (..., c).

        Raises:
            ValueError: other axes than a feed axis carry the base.
        """
        if self.base_names not in {(), (FEED,)}:
            raise ValueError(f"the axes {', '.join(self.base_names)} do not just move the base along its heading")
        return np.asarray(np.sum(q[..., self.base], axis=-1))

    def travel(self, change: FloatArray, lengths: FloatArray | float) -> FloatArray:
        """Return an upper bound on the displacement of any point of the arm for a change of coordinates [m].

        A link that turns moves everything beyond it by at most its length times its turn. In the plane the turn is the
        absolute sum of the bend changes up to the link; in space joints bend about different axes, so opposite changes
        need not cancel, and the sum of their norms is taken.

        Args:
            change: change of the coordinates, shape (..., c) [rad, m].
            lengths: length of each link, shape (links,), or of every link [m].

        Returns:
            Bounds, shape (...).
        """
        bends = change[..., self.bends]
        if self.bends_a_joint > 1:
            bends = np.linalg.norm(bends.reshape(*bends.shape[:-1], -1, self.bends_a_joint), axis=-1)
        moved = (lengths * np.abs(np.cumsum(bends, axis=-1))).sum(axis=-1)
        carried = np.abs(change[..., self.base])
        return np.asarray(moved + (carried * self.reaches if self.reaches else carried).sum(axis=-1))


@lru_cache(maxsize=64)
def joint_coordinates(
    links: int,
    bends_a_joint: int = 1,
    axes: tuple[str, ...] = (),
    units: tuple[str, ...] = ("m",),
    reaches: tuple[float, ...] = (),
) -> Coordinates:
    """Return the layout of an arm's configurations: the bends of its joints, then the axes that carry its base.

    Ball joint i has the revolutes 3 i to 3 i + 2, in the order of ``joint_names``. The planar bend is the angle of the
    second revolute with opposite sign; the bends a and b in space are the angles of the first and the second. The
    remaining revolutes stay at zero.

    Args:
        links: number of links.
        bends_a_joint: 1 in the plane, 2 in space.
        axes: names of the axes that carry the base.
        units: units of these axes, "m" or "rad".
        reaches: how far a unit of each of these axes moves the arm at most; by default 1 each.
    """
    revolutes = 3 * links
    in_space = bends_a_joint == 2
    bent = (0, 1) if in_space else (1,)
    called = (" a", " b") if in_space else ("",)
    return Coordinates(
        names=(*(f"joint {number}{bend}" for number in range(1, links + 1) for bend in called), *axes),
        units=("rad",) * (bends_a_joint * links) + units[: len(axes)],
        joints=bends_a_joint * links,
        drives=(*(3 * ball + bend for ball in range(links) for bend in bent), *range(revolutes, revolutes + len(axes))),
        revolutes=revolutes,
        bends_a_joint=bends_a_joint,
        sense=1.0 if in_space else -1.0,
        reaches=reaches,
    )


@dataclass(frozen=True)
class PointLimit:
    """Bounds on the speed and acceleration of a point of the arm.

    Attributes:
        at: arc length along the arm from its base to the point [m]; None for the tip.
        velocity: upper bound on the speed [m/s]; inf for no limit.
        acceleration: upper bound on the magnitude of the acceleration [m/s²]; inf for no limit.
    """

    at: float | None = None
    velocity: float = np.inf
    acceleration: float = np.inf

    @property
    def name(self) -> str:
        """Name of the point for messages, "tip" or its arc length."""
        return "tip" if self.at is None else f"point at {self.at:g} m"


@dataclass(frozen=True)
class Limits:
    """Limits of an arm's revolutes, feed axis and points; every bound is on the absolute value.

    Arrays have shape (3 * links,), with the three revolutes of a ball joint in a row.

    Attributes:
        velocity: bounds on the velocities of the revolutes [rad/s].
        acceleration: bounds on the accelerations of the revolutes [rad/s²].
        torque: bounds on the torques of the revolutes [N m], or None for no limit.
        feed_velocity: bound on the velocity of the feed axis [m/s], or None if there is no feed axis.
        feed_acceleration: bound on the acceleration of the feed axis [m/s²], or None if there is no feed axis.
        feed_force: bound on the force of the feed axis [N], or None for no limit.
        jerk: bounds on the jerks of the revolutes [rad/s³], or None for no limit.
        feed_jerk: bound on the jerk of the feed axis [m/s³], or None for no limit.
        points: limits of points of the arm, such as its tip.
        axes: limits of the axes that carry the base, where they are others than a feed axis.
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
    axes: "DriveLimits | None" = None

    def of_drives(self, coordinates: Coordinates) -> "DriveLimits":
        """Return the limits of every drive of an arm: all revolutes, then the axes that carry the base."""
        count = len(coordinates.base_names)
        axes = self.axes

        def both(of_revolutes: FloatArray | None, of_feed: float | None, of_axes: FloatArray | None) -> FloatArray:
            joints = np.full(coordinates.revolutes, np.inf) if of_revolutes is None else of_revolutes
            carried = np.full(count, np.inf if of_feed is None else of_feed) if of_axes is None else of_axes
            return np.append(joints, carried)

        return DriveLimits(
            velocity=both(self.velocity, self.feed_velocity, None if axes is None else axes.velocity),
            acceleration=both(self.acceleration, self.feed_acceleration, None if axes is None else axes.acceleration),
            jerk=both(self.jerk, self.feed_jerk, None if axes is None else axes.jerk),
            effort=both(self.torque, self.feed_force, None if axes is None else axes.effort),
        )

    def of_coordinates(self, coordinates: Coordinates) -> "DriveLimits":
        """Return the limits of an arm's coordinates, one entry per coordinate: those of the drives that move them."""
        return self.of_drives(coordinates).select(coordinates.drive_numbers)


def planned_share(holding: FloatArray, share: float) -> FloatArray:
    """Return the fraction max(σ, h + ½ σ (1 − h)) of its limit that a planned joint effort may take.

    The module's docstring explains the formula.

    Args:
        holding: effort that holds the arm still at each pose, as a signed fraction of the limit; h is its magnitude,
            clipped to 1.
        share: fraction σ of the limits that plans normally use.

    Returns:
        Fractions in the shape of ``holding``, at most 1, and above h wherever h is below 1.
    """
    held = np.minimum(np.abs(holding), 1.0)
    return np.asarray(np.maximum(share, held + 0.5 * share * (1.0 - held)))


@dataclass(frozen=True)
class DriveLimits:
    """Limits of n drives on absolute values; ∞ where there is no limit.

    Attributes:
        velocity: bounds on the velocities, shape (n,) [rad/s, m/s].
        acceleration: bounds on the accelerations, shape (n,) [rad/s², m/s²].
        jerk: bounds on the jerks, shape (n,) [rad/s³, m/s³].
        effort: bounds on the efforts, shape (n,) [N m, N].
    """

    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    effort: FloatArray

    def rates_within(self, share: float) -> "DriveLimits":
        """Return drive limits with velocities, accelerations and jerks scaled by a factor, and unchanged efforts."""
        return DriveLimits(share * self.velocity, share * self.acceleration, share * self.jerk, self.effort)

    def select(self, drives: IntArray) -> "DriveLimits":
        """Return the limits of the drives with given indices, shape (k,), in that order."""
        return DriveLimits(self.velocity[drives], self.acceleration[drives], self.jerk[drives], self.effort[drives])
