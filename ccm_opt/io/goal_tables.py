"""Tables of start and goal in a problem file: poses, tolerances, places to look at and paths."""

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field, PlainSerializer, SerializationInfo, ValidationInfo, field_validator

from ccm_opt.io.quantities import (
    Box,
    Curvature,
    Degrees,
    Length,
    Point,
    PositiveDegrees,
    PositiveLength,
    Rules,
    Table,
    exactly,
    lengths,
    to_metres,
)
from ccm_opt.io.shape_tables import (
    Bends,
    Corners,
    Direction,
    Distances,
    FieldOfView,
    PlaneDirection,
    RightAngle,
    SpacePoint,
)
from ccm_opt.problem import Tolerances

CLOSEST_KNOTS = 1e-6
"""Minimum distance between knots, as a fraction of the segment's length; splines through closer knots oscillate."""


class SegmentTable(Table):
    """Table of a curvature segment: length, five curvature values, and three knots."""

    length: PositiveLength = Field(
        description="Length of the segment; the lengths add up to that of the arm (to 1e-6)."
    )
    curvature: Annotated[list[Curvature], exactly(5)] = Field(
        description="Curvatures `[Ca, Cb, Cc, Cd, Ce]` at the start, the three knots and the end."
    )
    knots: Annotated[list[float], exactly(3)] = Field(
        default=[0.25, 0.5, 0.75], description="Knots `[Sb, Sc, Sd]`, increasing, as fractions of the segment's length."
    )

    @field_validator("knots")
    @classmethod
    def _increasing(cls, knots: list[float]) -> list[float]:
        if np.min(np.diff([0.0, *knots, 1.0])) < CLOSEST_KNOTS:
            raise ValueError(f"expected three increasing numbers between 0 and 1, at least {CLOSEST_KNOTS:g} apart")
        return knots


_FEED = Field(
    default=None,
    description=(
        "Feed of the whole-arm pose: position of the base on the feed axis. Default: the lower end of its range."
    ),
)


class PoseTable(Table):
    """Table of a pose of a whole planar arm, given by exactly one of ``shape``, ``joints_deg`` and ``segments``."""

    rules = Rules(exactly_one=("shape", "joints_deg", "segments"), needs={"heading_deg": ("segments",)})

    shape: Literal["straight", "folded"] | None = Field(
        default=None, description='Named pose: `"straight"` or `"folded"` ([below](#start-and-goal)).'
    )
    joints_deg: Annotated[list[Degrees], Field(min_length=1)] | None = Field(
        default=None, description="One bend per joint, the first relative to the base heading."
    )
    segments: Annotated[list[SegmentTable], Field(min_length=1)] | None = Field(
        default=None, description="`[{ length, curvature, knots }, …]`: a curve that the mapping turns into the pose."
    )
    heading_deg: Degrees | None = Field(
        default=None,
        description=(
            "With `segments`: heading of the curve at the base (default: the base heading). With `position`: "
            "heading of the last link (default: free)."
        ),
    )
    feed: Length | None = _FEED


TOLERANCE_KEYS = ("position_tolerance", "heading_tolerance_deg", "direction_tolerance_deg")
"""Keys of goals without effect where the tip looks at a place."""
VIEW_NEEDS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("look_at", "see"), ("distance",)),
    "distance": ("field_of_view_deg",),
    "field_of_view_deg": ("look_at", "see"),
    "normal": ("look_at",),
    "angle_deg": ("normal", "see"),
    **dict.fromkeys(("share", "spacing", "within"), ("see",)),
}
"""For each key about what is looked at, the keys of which it requires one; the first four require each other."""
NAMED = ("position", "look_at", "joints_deg", "shape", "segments", "path")
"""Keys of goals of which one is given beside a name; views that are found for surfaces have none."""
_NAME = Field(
    default=None, description="Name of the goal in messages, on the page and in the viewer, beside its number."
)
_LOOK_AT = Field(
    default=None,
    description=(
        "Place that the tip looks at, in place of `position` ([how](pose-and-reach.md#looking-at-a-place)); from "
        "where, is left to the planner. Needs `distance` and `field_of_view_deg`."
    ),
)
_DISTANCE = Field(default=None, description="`[least, greatest]` distance of the tip from what it looks at.")
_FIELD_OF_VIEW = Field(
    default=None,
    description=(
        "Full angle of the field of view about the direction of the last link, or of the tool: what is seen lies "
        "within half of it."
    ),
)
_NORMAL = Field(default=None, description="Outward normal of the surface at the place that is looked at. Default: any.")
_ANGLE = Field(
    default=None,
    description=(
        "Largest angle between `normal`, or that of the surface to either side with `see`, and the line of sight. "
        "Default: 90."
    ),
)
_SEE = Field(
    default=None,
    description=(
        'Names of obstacles, or `"room"`, whose surfaces are seen from as few views as possible, in place of '
        "`position` ([how](pose-and-reach.md#seeing-a-surface)). Needs `share`, `spacing`, `distance`, "
        '`field_of_view_deg` and `planner.order = "free"`.'
    ),
)
_SHARE = Field(default=None, description="With `see`: least share of the surfaces that is seen, above 0 and at most 1.")
_SPACING = Field(
    default=None,
    description="With `see`: longest edge of the pieces into which surfaces are divided; each is seen or not.",
)
_WITHIN = Field(default=None, description="With `see`: box in which pieces count. Default: everywhere.")
SurfaceNames: TypeAlias = Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1)]
"""Names of surfaces."""
Share: TypeAlias = Annotated[float, Field(gt=0.0, le=1.0)]


_POSITION_TOLERANCE = Field(
    default=Tolerances.position, description="Largest distance of the tip from the goal at the end."
)
_PAUSE = Field(default=0.0, description="Time at rest at this goal before the next leg [s].")


class GoalTable(PoseTable):
    """Table of the goal of a planar motion: a pose of the whole arm, or a position of the tip."""

    rules = Rules(
        exactly_one=("position", "look_at", "see", "joints_deg", "shape", "segments"),
        needs={
            "heading_deg": ("position", "segments"),
            **dict.fromkeys(TOLERANCE_KEYS, ("position", "joints_deg", "shape", "segments")),
            "name": NAMED,
            **VIEW_NEEDS,
        },
    )
    direction: ClassVar[None] = None
    via: ClassVar[None] = None
    path: ClassVar[None] = None
    up: ClassVar[None] = None
    direction_tolerance_deg: ClassVar[float] = 0.0
    roll_tolerance_deg: ClassVar[float] = Tolerances.roll

    position: Point | None = Field(default=None, description="Position of the tip.")
    look_at: Point | None = _LOOK_AT
    distance: Distances | None = _DISTANCE
    field_of_view_deg: FieldOfView | None = _FIELD_OF_VIEW
    normal: PlaneDirection | None = _NORMAL
    angle_deg: RightAngle | None = _ANGLE
    see: SurfaceNames | None = _SEE
    share: Share | None = _SHARE
    spacing: PositiveLength | None = _SPACING
    within: Box | None = _WITHIN
    position_tolerance: PositiveLength = _POSITION_TOLERANCE
    heading_tolerance_deg: PositiveDegrees = Field(
        default=Tolerances.heading, description="Largest deviation of the last link from the goal's heading."
    )
    name: Annotated[str, Field(min_length=1)] | None = _NAME
    pause: Annotated[float, Field(ge=0.0)] = _PAUSE


def _positions_of_axes(values: list[float], info: ValidationInfo) -> list[list[float]]:
    """Return each position both in metres and in radians, as the kind of its axis is known to another table."""
    return [[to_metres(value, info), math.radians(value)] for value in values]


def _written_positions(values: list[list[float]], info: SerializationInfo) -> list[float]:
    """Return positions in the unit of the serialisation context or in degrees; of each, the other is not a number."""
    return [math.degrees(angle) if math.isnan(metres) else lengths(metres, info) for metres, angle in values]


AxisPositions: TypeAlias = Annotated[
    list[float],
    Field(description="one number an axis: length, or degrees of a revolute axis"),
    AfterValidator(_positions_of_axes),
    PlainSerializer(_written_positions),
]


class SpacePoseTable(Table):
    """Table of a pose of a whole arm in space, given by exactly one of ``shape`` and ``joints_deg``."""

    rules = Rules(exactly_one=("shape", "joints_deg"))
    segments: ClassVar[None] = None
    heading_deg: ClassVar[None] = None

    shape: Literal["straight"] | None = Field(
        default=None, description='`"straight"`: all links along `arm.base.direction`.'
    )
    joints_deg: Annotated[list[Bends], Field(min_length=1)] | None = Field(
        default=None,
        description=("`[[a, b], …]`, the two bends of each joint: about its z-axis, then about its new y-axis."),
    )
    feed: Length | None = _FEED
    axes: AxisPositions | None = Field(
        default=None,
        description="Positions of `arm.base.axes` in the whole-arm pose. Default: 0 each, or the limit next to it.",
    )


class SpaceGoalTable(SpacePoseTable):
    """Table of the goal of a motion in space: a pose of the whole arm, or a position of the tip."""

    rules = Rules(
        exactly_one=("position", "look_at", "see", "path", "joints_deg", "shape"),
        needs={
            **dict.fromkeys(("direction", "via"), ("position",)),
            **dict.fromkeys(TOLERANCE_KEYS, ("position", "joints_deg", "shape")),
            "position_tolerance": ("position", "path", "joints_deg", "shape"),
            "up": ("direction",),
            "roll_tolerance_deg": ("up",),
            "name": NAMED,
            **VIEW_NEEDS,
        },
    )
    heading_tolerance_deg: ClassVar[float] = 0.0

    position: SpacePoint | None = Field(default=None, description="Position of the tip.")
    direction: Direction | None = Field(
        default=None, description="Direction of the last link, with `position`. Default: free."
    )
    up: Direction | None = Field(
        default=None,
        description=(
            "Where up is at the goal, with `direction`: as seen along it, the up axis of the tool, or z of the last "
            "link, points there ([how](arms.md#roll-at-the-goal)). Default: any roll."
        ),
    )
    look_at: SpacePoint | None = _LOOK_AT
    distance: Distances | None = _DISTANCE
    field_of_view_deg: FieldOfView | None = _FIELD_OF_VIEW
    normal: Direction | None = _NORMAL
    angle_deg: RightAngle | None = _ANGLE
    see: SurfaceNames | None = _SEE
    share: Share | None = _SHARE
    spacing: PositiveLength | None = _SPACING
    within: Corners | None = _WITHIN
    path: Annotated[list[SpacePoint], Field(min_length=2)] | None = Field(
        default=None,
        description=(
            "Path that the tip follows, in place of `position`: points on a smooth curve that begins where the tip "
            "starts and ends at the goal ([how](arms.md#along-a-given-path))."
        ),
    )
    via: Annotated[list[SpacePoint], Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Points that the tip passes on its way, in this order, with `position`: through which bore, through "
            "which opening. Default: none."
        ),
    )
    position_tolerance: PositiveLength = _POSITION_TOLERANCE
    direction_tolerance_deg: PositiveDegrees = Field(
        default=Tolerances.heading, description="Largest deviation of the last link from the goal's direction."
    )
    roll_tolerance_deg: PositiveDegrees = Field(
        default=Tolerances.roll, description="Largest roll about the goal's direction away from `up`."
    )
    name: Annotated[str, Field(min_length=1)] | None = _NAME
    pause: Annotated[float, Field(ge=0.0)] = _PAUSE
