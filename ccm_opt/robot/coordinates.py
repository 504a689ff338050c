"""Joint coordinates of an arm: names, units, drives, revolutes and their limits.

A configuration q of an arm is one row of numbers: first the coordinates that bend its joints, then those that carry
its base. What plans, times, simulates and verifies handles the rows as they come and asks this layout, or the arm, for
what they mean. An arm whose base is fixed has no coordinates of the second kind; the arrays of them are then of shape
(…, 0), so that sums over them are zero and loops over them do nothing.

Plans use a share σ of the limits on velocities, accelerations, jerks and efforts, so that the controller has something
left. Efforts have a part that no timing changes, what holds the arm still under gravity. With h that part as a share of
its limit, an effort of a plan may take max(σ, h + ½ σ (1 − h)) of the limit: σ as a rule, and where gravity alone takes
so much that hardly any of σ would be left for moving, half of the usual share of what gravity leaves. So an arm that
can be held still can be moved, whatever σ is; and σ = 1 means the limits themselves.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray

FEED = "feed"
"""Name of the coordinate of a feed axis."""


@dataclass(frozen=True)
class Coordinates:
    """The layout of an arm's coordinates.

    Attributes:
        names: of every coordinate, for messages.
        units: of every coordinate, "rad" or "m".
        joints: how many of them, the first, bend joints; those that follow carry the base.
        drives: number of the drive that moves each coordinate. The revolutes are counted first, ball by ball, and the
            axes that carry the base after them.
        revolutes: number of revolutes.
        bends_a_joint: how many coordinates in a row bend the same joint: 1 in the plane, 2 in space.
        sense: 1 where a bend is the angle of its revolute, -1 where it is minus that, as in the plane: its bends are
            counter-clockwise in (x, y), which is world x-z, and the revolutes turn about +y.
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
        """Where the coordinates stand that bend joints."""
        return slice(0, self.joints)

    @property
    def base(self) -> slice:
        """Where the coordinates stand that carry the base."""
        return slice(self.joints, len(self.names))

    @property
    def base_names(self) -> tuple[str, ...]:
        """Names of the coordinates that carry the base; none when it is fixed."""
        return self.names[self.base]

    @property
    def drive_numbers(self) -> IntArray:
        """Number of the drive of every coordinate, shape (c,)."""
        return np.array(self.drives, dtype=np.intp)

    @property
    def drive_count(self) -> int:
        """Number of drives: of all revolutes, and of the axes that carry the base."""
        return self.revolutes + len(self.base_names)

    def advance(self, q: FloatArray) -> FloatArray:
        """Return how far the base is carried along the base heading, shape (...) [m]; 0 when it is fixed.

        The map is linear, so it serves velocities and accelerations too.

        Args:
            q: configurations, shape (..., c).
        """
        return np.asarray(np.sum(q[..., self.base], axis=-1))

    def travel(self, change: FloatArray, link_length: float) -> FloatArray:
        """Bound on how far any point of the arm moves when its coordinates change, shape (...) [m].

        A link that turns moves what is beyond it by at most its length times its turn. In the plane that is the sum of
        the bends up to it; in space bends are about different axes, and what turns back need not be undone.

        Args:
            change: of the coordinates, shape (..., c) [rad, m].
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

    Of the three revolutes of ball i, numbers 3 i to 3 i + 2 in the order of ``joint_names``, the bend of the plane is
    the second, turned the other way, and the bends a and b of space are the first and the second. The others stay at
    zero.

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
        """Return the limits of every drive of an arm, drive by drive."""
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
        """Return the limits of the drives that move an arm's coordinates, one for each coordinate."""
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
        """Return the same with a share of the limits on velocities, accelerations and jerks.

        Efforts are not changed.
        """
        return DriveLimits(share * self.velocity, share * self.acceleration, share * self.jerk, self.effort)

    def of(self, drives: IntArray) -> "DriveLimits":
        """Return the limits of drives of given numbers."""
        return DriveLimits(self.velocity[drives], self.acceleration[drives], self.jerk[drives], self.effort[drives])
