"""Keys of the limits of joints, feed axis and points of the arm."""

from pydantic import Field

from ccm_opt.files.problem_file.schema.table import Table
from ccm_opt.files.problem_file.typed_quantities import (
    NonNegativeLength,
    Positive,
    PositiveAcceleration,
    PositiveEach,
    PositiveJerk,
    PositiveSpeed,
)


class PointLimitTable(Table):
    """Bounds on the speed and the acceleration of a point of the arm."""

    at: NonNegativeLength
    """Arc length of the point from the base, along the links."""
    velocity: PositiveSpeed | None = None
    """Of the point. Default: none."""
    acceleration: PositiveAcceleration | None = None
    """Of the point. Default: none."""


class LimitsTable(Table):
    """Joint limits, each one number, one a ball joint, or one a revolute; limits of the feed axis, and of points."""

    velocity: PositiveEach
    """Of the joints [rad/s]."""
    acceleration: PositiveEach
    """Of the joints [rad/s²]."""
    jerk: PositiveEach | None = None
    """Of the joints [rad/s³]; for smooth motions. Default: accelerations may jump."""
    torque: PositiveEach | None = None
    """Of the joints [N m]. Default: not limited."""
    feed_velocity: PositiveSpeed | None = None
    """Of the feed axis; required where there is one."""
    feed_acceleration: PositiveAcceleration | None = None
    """Of the feed axis; required where there is one."""
    feed_jerk: PositiveJerk | None = None
    """Of the feed axis. Default: its acceleration may jump."""
    feed_force: Positive | None = None
    """Of the feed axis [N]. Default: not limited."""
    tip_velocity: PositiveSpeed | None = None
    """Of the tip in the plane, in any direction. Default: not limited."""
    tip_acceleration: PositiveAcceleration | None = None
    """Of the tip in the plane, in any direction. Default: not limited."""
    points: list[PointLimitTable] = Field(default=[])
    """`[{ at = s, velocity = …, acceleration = … }, …]`: the same of other points of the arm."""
