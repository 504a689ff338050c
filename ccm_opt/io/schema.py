"""Schema of a problem file: the tables of workspace, arm in space, start and goal, and the file as a whole.

Rules between keys and checks of positions are in ``rules``, checks between tables in ``table_reading``.

The description of a key gives its meaning; ``docs/write_references.py`` makes the reference tables from it.
"""

import math
import re
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np
import shapely
from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from ccm_opt.io.schema_tables import (
    ArmTable,
    Box,
    ChainTable,
    Curvature,
    Degrees,
    Length,
    LimitsTable,
    NonNegativeLength,
    PlannerTable,
    Point,
    Polyline,
    Positive,
    PositiveDegrees,
    PositiveLength,
    Ring,
    Rules,
    SimulationTable,
    Table,
    ToleranceTable,
    VerificationTable,
    exactly,
)
from ccm_opt.problem import LengthUnit, Tolerances

CLOSEST_KNOTS = 1e-6
"""Least distance between knots, as a share of the segment's length; a spline through closer knots oscillates."""


class SegmentTable(Table):
    """One curvature segment: a length, five curvature values, three knots."""

    length: PositiveLength = Field(description="Of the segment; all together are as long as the arm (to 1e-6).")
    curvature: Annotated[list[Curvature], exactly(5)] = Field(
        description="`[Ca, Cb, Cc, Cd, Ce]` at its ends and at its knots."
    )
    knots: Annotated[list[float], exactly(3)] = Field(
        default=[0.25, 0.5, 0.75], description="`[Sb, Sc, Sd]`, shares of its length, growing."
    )

    @field_validator("knots")
    @classmethod
    def _increasing(cls, knots: list[float]) -> list[float]:
        if np.min(np.diff([0.0, *knots, 1.0])) < CLOSEST_KNOTS:
            raise ValueError(f"expected three increasing numbers between 0 and 1, {CLOSEST_KNOTS:g} apart")
        return knots


class PoseTable(Table):
    """A whole-arm pose, one of shape, joints_deg, segments."""

    rules = Rules(exactly_one=("shape", "joints_deg", "segments"), needs={"heading_deg": ("segments",)})

    shape: Literal["straight", "folded"] | None = Field(
        default=None, description='`"straight"`, or `"folded"` ([below](#start-and-goal)).'
    )
    joints_deg: Annotated[list[Degrees], Field(min_length=1)] | None = Field(
        default=None, description="One bend a joint, the first relative to the base heading."
    )
    segments: Annotated[list[SegmentTable], Field(min_length=1)] | None = Field(
        default=None, description="`[{ length, curvature, knots }, …]`: a curve, whose mapping is the pose."
    )
    heading_deg: Degrees | None = Field(
        default=None,
        description=(
            "With `segments` the heading at the base (default: the base heading); with `position` the heading "
            "of the last link (default: any)."
        ),
    )
    feed: Length | None = Field(
        default=None,
        description=("Place of the base on the feed axis, of a whole arm. Default: the least of its range."),
    )


class GoalTable(PoseTable):
    """Where the motion ends: a pose, or a position of the tip."""

    rules = Rules(
        exactly_one=("position", "joints_deg", "shape", "segments"), needs={"heading_deg": ("position", "segments")}
    )
    direction: ClassVar[None] = None
    via: ClassVar[None] = None
    direction_tolerance_deg: ClassVar[float] = 0.0

    position: Point | None = Field(default=None, description="Of the tip.")
    position_tolerance: PositiveLength = Field(
        default=Tolerances.position, description="How far from the goal the tip may end."
    )
    heading_tolerance_deg: PositiveDegrees = Field(
        default=Tolerances.heading, description="How far from the goal's heading the last link may end."
    )
    pause: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="How long the arm rests at this goal before the next [s]."
    )


class CircleTable(Table):
    """A disc."""

    center: Point = Field(description="Of the disc.")
    radius: PositiveLength = Field(description="Of the disc.")


class WallTable(Table):
    """A polyline swept by a disc of half its thickness."""

    points: Polyline = Field(description="Of the line, in order.")
    thickness: NonNegativeLength = Field(default=0.0, description="Diameter of the disc that sweeps the line.")


class ObstacleTable(Table):
    """One obstacle: exactly one of polygon, box, circle, wall; a polygon may have holes."""

    rules = Rules(exactly_one=("polygon", "box", "circle", "wall"))

    name: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=("Unique among the obstacles. Default: `obstacle 1`, `obstacle 2`, … by its place in the file."),
    )
    polygon: Ring | None = Field(default=None, description="Corners of a simple polygon, in order, either way round.")
    holes: Annotated[list[Ring], Field(min_length=1)] | None = Field(
        default=None, description="Of the polygon, each given by its corners. Default: none."
    )
    box: Box | None = Field(default=None, description="`[xmin, ymin, xmax, ymax]`.")
    circle: CircleTable | None = Field(default=None, description="`{ center = [x, y], radius = r }`.")
    wall: WallTable | None = Field(
        default=None, description="`{ points = [[x, y], …], thickness = t }`: a line swept by a disc."
    )

    @field_validator("holes")
    @classmethod
    def _inside(cls, holes: list[list[list[float]]] | None, info: ValidationInfo) -> list[list[list[float]]] | None:
        outline = info.data.get("polygon", ())
        if holes is not None and outline is None:
            raise ValueError("only allowed together with polygon")
        if holes is not None and outline and not shapely.Polygon(outline, holes).is_valid:
            raise ValueError("expected holes inside the polygon and apart from each other")
        return holes


class SceneTable(Table):
    """A drawing of obstacles, and how it is placed; lengths stay in the problem file's unit."""

    file: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "A drawing with further obstacles: SVG (`.svg`), DXF (`.dxf`), GeoJSON (`.geojson`, `.json`) or "
            "WKT (`.wkt`). Its path is relative to the problem file, in whose folder it lies unless "
            "`--allow-outside` is given (in Python `allow_outside=True`). Default: none."
        ),
    )
    scale: Positive = Field(default=1.0, description="Length of one unit of the drawing, in the problem file's unit.")
    offset: Point = Field(default=[0.0, 0.0], description="Where the drawing's origin comes to lie.")
    curve_tolerance: PositiveLength | None = Field(
        default=None, description=("How far outside a curve of the drawing its polygon may lie. Default: 0.25 mm.")
    )
    wall_thickness: NonNegativeLength = Field(
        default=0.0, description=('Of open lines of the drawing, and of all outlines with `closed = "walls"`.')
    )
    closed: Literal["solid", "walls", "room"] = Field(
        default="solid",
        description=(
            "What closed outlines of the drawing are: solids, with those drawn as lines within others as "
            "holes; lines of `wall_thickness`; or solids in the largest of them, which is the boundary of the "
            "room."
        ),
    )


class WorkspaceTable(SceneTable):
    """The room, without its obstacles: those are validated one by one."""

    rules = Rules(exactly_one=("bounds", "boundary"), otherwise=', or closed = "room" with a drawing of the room')

    bounds: Box | None = Field(
        default=None,
        description=(
            '`[xmin, ymin, xmax, ymax]` of the room. It, `boundary` or `closed = "room"` is required; each is '
            "a wall like any obstacle."
        ),
    )
    boundary: Ring | None = Field(default=None, description="Corners of the room, one simple polygon.")
    clearance: NonNegativeLength = Field(
        default=0.0, description="Gap kept between the arm's surface and every obstacle."
    )


SHORTEST = 1e-9
"""Least length of directions and quaternions; the direction of shorter ones is lost in rounding."""


def _unit(values: list[float]) -> list[float]:
    length = math.hypot(*values)
    if length < SHORTEST:
        raise ValueError(f"expected numbers that are not all zero; their length is {length:g}")
    return [value / length for value in values]


def _ordered_corners(corners: list[list[float]]) -> list[list[float]]:
    low, high = corners
    if not all(least < greatest for least, greatest in zip(low, high, strict=True)):
        raise ValueError("expected [[xmin, ymin, zmin], [xmax, ymax, zmax]] with every least below its greatest")
    return corners


SpacePoint: TypeAlias = Annotated[list[Length], Field(description="`[x, y, z]`"), exactly(3)]
Corners: TypeAlias = Annotated[
    list[SpacePoint], Field(description="two corners"), exactly(2), AfterValidator(_ordered_corners)
]
Direction: TypeAlias = Annotated[list[float], Field(description="`[x, y, z]`"), exactly(3), AfterValidator(_unit)]
Quaternion: TypeAlias = Annotated[list[float], Field(description="four numbers"), exactly(4), AfterValidator(_unit)]
Turns: TypeAlias = Annotated[list[Degrees], Field(description="three angles"), exactly(3)]
Bends: TypeAlias = Annotated[list[Degrees], Field(description="`[a, b]`"), exactly(2)]


class SphereTable(Table):
    """A ball."""

    center: SpacePoint = Field(description="Of the ball.")
    radius: PositiveLength = Field(description="Of the ball.")


class BarTable(Table):
    """A round bar."""

    start: Annotated[SpacePoint, Field(alias="from")] = Field(description="One end of its axis.")
    end: Annotated[SpacePoint, Field(alias="to")] = Field(description="The other end.")
    radius: PositiveLength = Field(description="Of the bar.")


class PlacementTable(Table):
    """Where a body stands and how it is turned: it is turned first, then moved."""

    rules = Rules(at_most_one=("rotation_deg", "quaternion"))

    position: SpacePoint = Field(
        default=[0.0, 0.0, 0.0], description="Where the origin of the body's own coordinates comes to lie."
    )
    rotation_deg: Turns | None = Field(
        default=None, description="Turns about the fixed axes x, y and z, in this order. Default: none."
    )
    quaternion: Quaternion | None = Field(
        default=None, description="`[w, x, y, z]`, of any length but zero, in place of `rotation_deg`."
    )


class SpaceObstacleTable(Table):
    """One obstacle: exactly one of mesh, box, sphere, cylinder, capsule."""

    rules = Rules(
        exactly_one=("mesh", "box", "sphere", "cylinder", "capsule"),
        needs=dict.fromkeys(("scale", "up", "solid", "sha256"), ("mesh",)),
    )

    name: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=("Unique among the obstacles. Default: `obstacle 1`, `obstacle 2`, … by its place in the file."),
    )
    mesh: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "A file with triangles: STL, OBJ, PLY, GLB or 3MF ([below](#meshes)). Its path is relative to the "
            "problem file, in whose folder it lies unless `--allow-outside` is given (in Python "
            "`allow_outside=True`)."
        ),
    )
    scale: Positive | None = Field(
        default=None,
        description=(
            "Of a mesh: length of one unit of its file, in the problem file's unit. Default: 1, of 3MF its own unit."
        ),
    )
    up: Literal["y", "z"] | None = Field(
        default=None,
        description=(
            'Of a mesh: its axis that points up; `"y"` turns it about x, so that its y becomes z. Default: '
            '`"z"`, as it stands.'
        ),
    )
    solid: bool | None = Field(
        default=None,
        description=(
            "Of a mesh: `false` where its surface alone counts, such as that of a room or a tank about the "
            "arm, or of sheet metal; the arm may then begin and end inside. Default: [what it "
            "encloses](problem-file.md#insides) belongs to it."
        ),
    )
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = Field(
        default=None,
        description=("Of a mesh: the hash of its file, which is refused when it is another. Default: any."),
    )
    box: Corners | None = Field(default=None, description="`[[xmin, ymin, zmin], [xmax, ymax, zmax]]`.")
    sphere: SphereTable | None = Field(default=None, description="`{ center = [x, y, z], radius = r }`.")
    cylinder: BarTable | None = Field(
        default=None, description="`{ from = [x, y, z], to = [x, y, z], radius = r }`, with flat ends."
    )
    capsule: BarTable | None = Field(
        default=None, description="The same with round ends, whose middles are `from` and `to`."
    )
    pose: PlacementTable | None = Field(
        default=None,
        description=(
            "`{ position = [x, y, z], rotation_deg = [x, y, z] }` or with `quaternion`: where the obstacle "
            "stands and how it is turned, of whichever kind. Default: as its coordinates say."
        ),
    )


class SpaceWorkspaceTable(Table):
    """The room, without its obstacles: those are validated one by one."""

    bounds: Corners | None = Field(
        default=None,
        description=(
            "`[[xmin, ymin, zmin], [xmax, ymax, zmax]]` of the room, whose sides are walls like any obstacle. "
            "Default: no room, the obstacles alone."
        ),
    )
    clearance: NonNegativeLength = Field(
        default=0.0, description="Gap kept between the arm's surface and every obstacle."
    )


class BaseTable(Table):
    """Where the arm begins and how it stands."""

    position: SpacePoint = Field(description="Of the first joint; it may touch a wall, not stand inside one.")
    direction: Direction = Field(default=[1.0, 0.0, 0.0], description="Of the straight arm, of any length but zero.")
    up: Direction = Field(
        default=[0.0, 0.0, 1.0],
        description=(
            "About which a joint's first bend turns while the arm is straight; what of it lies along "
            "`direction` does not count. Required where `direction` is along z."
        ),
    )


class SpaceArmTable(ChainTable):
    """The arm in space."""

    base: BaseTable = Field(description="`{ position = [x, y, z], direction = [x, y, z], up = [x, y, z] }`.")
    axes: Literal["zyx"] = Field(
        default="zyx", description="Order of a ball's revolutes, the third of which stays at 0."
    )


class SpacePoseTable(Table):
    """A pose of the whole arm, one of shape, joints_deg."""

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
    feed: Length | None = Field(
        default=None,
        description=("Place of the base on the feed axis, of a whole arm. Default: the least of its range."),
    )


class SpaceGoalTable(SpacePoseTable):
    """Where the motion ends: a pose, or a position of the tip."""

    rules = Rules(
        exactly_one=("position", "joints_deg", "shape"), needs=dict.fromkeys(("direction", "via"), ("position",))
    )
    heading_tolerance_deg: ClassVar[float] = 0.0

    position: SpacePoint | None = Field(default=None, description="Of the tip.")
    direction: Direction | None = Field(
        default=None, description="Where the last link points, with `position`. Default: anywhere."
    )
    via: Annotated[list[SpacePoint], Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Places that the tip passes on its way, in this order, with `position`: which bore, which gap. "
            "Default: none."
        ),
    )
    position_tolerance: PositiveLength = Field(
        default=Tolerances.position, description="How far from the goal the tip may end."
    )
    direction_tolerance_deg: PositiveDegrees = Field(
        default=Tolerances.heading, description="How far from the goal's direction the last link may point."
    )
    pause: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="How long the arm rests at this goal before the next [s]."
    )


OPTIONAL: Mapping[str, type[Table]] = {
    "planner": PlannerTable,
    "simulation": SimulationTable,
    "tolerance": ToleranceTable,
    "verification": VerificationTable,
}
"""Optional tables, by name."""
TABLES: Mapping[bool, Mapping[str, type[Table]]] = {
    False: {
        "workspace": WorkspaceTable,
        "workspace.obstacles": ObstacleTable,
        "arm": ArmTable,
        "limits": LimitsTable,
        "start": PoseTable,
        "goal": GoalTable,
        **OPTIONAL,
    },
    True: {
        "workspace": SpaceWorkspaceTable,
        "workspace.obstacles": SpaceObstacleTable,
        "arm": SpaceArmTable,
        "limits": LimitsTable,
        "start": SpacePoseTable,
        "goal": SpaceGoalTable,
        **OPTIONAL,
    },
}
"""Tables of a file by name, for arms in the plane under False and in space under True."""

_FOLDER_NAME = re.compile(r"\w(?:[\w .+-]*[\w+-])?")
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


def _folder_name(name: str) -> str:
    if not _FOLDER_NAME.fullmatch(name) or _RESERVED.fullmatch(name) or len(name.encode()) > 200:
        raise ValueError(
            "expected a name for a folder: letters, digits, '-', '_', '+', '.' or blanks inside, at most 200 bytes"
        )
    return name


class RootTable(Table):
    """The keys above the first table, and the tables, which are validated separately."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of the format.")
    space: Literal[2, 3] = Field(
        default=2, description="3 for an arm that [leaves the plane](problem-file.md#arms-in-space)."
    )
    name: Annotated[str, AfterValidator(_folder_name)] = Field(
        description=("Also the name of the output folder: letters, digits, `-`, `_`, `+`, and `.` or blanks inside.")
    )
    description: str = Field(default="", description="One line for people.")
    units: LengthUnit = Field(
        default="m", description="Unit of all lengths in this file; curvatures are then per that unit."
    )
    workspace: dict[str, object] = Field(description="[The room](#workspace).")
    arm: dict[str, object] = Field(description="[The arm](#arm).")
    limits: dict[str, object] = Field(description="[Its limits](#limits).")
    start: dict[str, object] = Field(description="[Where the motion begins](#start-and-goal).")
    goal: dict[str, object] | list[dict[str, object]] = Field(
        description="[Where it ends](#start-and-goal); several, written `[[goal]]`, in sequence."
    )
    planner: dict[str, object] = Field(default_factory=dict, description="[How it is planned](#planner).")
    simulation: dict[str, object] = Field(default_factory=dict, description="[How it is simulated](#simulation).")
    tolerance: dict[str, object] = Field(default_factory=dict, description="[What it has to survive](#tolerance).")
    verification: dict[str, object] = Field(
        default_factory=dict, description="[How strictly it is judged](#verification)."
    )
