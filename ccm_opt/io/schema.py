"""Schema of problem files: tables of workspace, obstacles, arm in space, start and goal, and the file as a whole.

Rules between keys and checks of positions are in ``rules``, checks between tables in ``table_reading``.

The description of a field gives the meaning of its key; ``docs/write_references.py`` generates the reference from
these descriptions.
"""

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
import shapely
from pydantic import (
    AfterValidator,
    Field,
    PlainSerializer,
    SerializationInfo,
    ValidationInfo,
    field_serializer,
    field_validator,
)

from ccm_opt.core.arrays import BoolArray
from ccm_opt.io.raw_mesh import STEP_SUFFIXES
from ccm_opt.io.schema_tables import (
    ArmTable,
    Box,
    ChainTable,
    Curvature,
    Degrees,
    Length,
    LimitsTable,
    NonNegative,
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
    arcs_before_bodies,
    exactly,
    lengths,
    to_metres,
)
from ccm_opt.io.shape_tables import (
    BarTable,
    Bends,
    CircleTable,
    Corners,
    Direction,
    Distances,
    FieldOfView,
    PlacementTable,
    PlaneDirection,
    RightAngle,
    ScanPoints,
    SpacePoint,
    SphereTable,
)
from ccm_opt.io.tool_tables import PlaneLinkBodyTable, PlaneToolTable, SpaceLinkBodyTable, SpaceToolTable
from ccm_opt.problem import LengthUnit, Tolerances
from ccm_opt.robot.base_axes import MOST_AXES

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
    feed: Length | None = Field(
        default=None,
        description=(
            "Feed of the whole-arm pose: position of the base on the feed axis. Default: the lower end of its range."
        ),
    )


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
_LOOK_AT = (
    "Place that the tip looks at, in place of `position` ([how](pose-and-reach.md#looking-at-a-place)); from where, is "
    "left to the planner. Needs `distance` and `field_of_view_deg`."
)
_DISTANCE = "`[least, greatest]` distance of the tip from what it looks at."
_FIELD_OF_VIEW = (
    "Full angle of the field of view about the direction of the last link, or of the tool: what is seen lies within "
    "half of it."
)
_NORMAL = "Outward normal of the surface at the place that is looked at. Default: any."
_ANGLE = (
    "Largest angle between `normal`, or that of the surface to either side with `see`, and the line of sight. "
    "Default: 90."
)
_SEE = (
    'Names of obstacles, or `"room"`, whose surfaces are seen from as few views as possible, in place of `position` '
    "([how](pose-and-reach.md#seeing-a-surface)). Needs `share`, `spacing`, `distance`, `field_of_view_deg` and "
    '`planner.order = "free"`.'
)
_SHARE = "With `see`: least share of the surfaces that is seen, above 0 and at most 1."
_SPACING = "With `see`: longest edge of the pieces into which surfaces are divided; each is seen or not."
_WITHIN = "With `see`: box in which pieces count. Default: everywhere."
SurfaceNames: TypeAlias = Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1)]
"""Names of surfaces."""
Share: TypeAlias = Annotated[float, Field(gt=0.0, le=1.0)]


class GoalTable(PoseTable):
    """Table of the goal of a planar motion: a pose of the whole arm, or a position of the tip."""

    rules = Rules(
        exactly_one=("position", "look_at", "see", "joints_deg", "shape", "segments"),
        needs={
            "heading_deg": ("position", "segments"),
            **dict.fromkeys(TOLERANCE_KEYS, ("position", "joints_deg", "shape", "segments")),
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
    look_at: Point | None = Field(
        default=None,
        description=_LOOK_AT,
    )
    distance: Distances | None = Field(default=None, description=_DISTANCE)
    field_of_view_deg: FieldOfView | None = Field(
        default=None,
        description=_FIELD_OF_VIEW,
    )
    normal: PlaneDirection | None = Field(default=None, description=_NORMAL)
    angle_deg: RightAngle | None = Field(default=None, description=_ANGLE)
    see: SurfaceNames | None = Field(default=None, description=_SEE)
    share: Share | None = Field(default=None, description=_SHARE)
    spacing: PositiveLength | None = Field(default=None, description=_SPACING)
    within: Box | None = Field(default=None, description=_WITHIN)
    position_tolerance: PositiveLength = Field(
        default=Tolerances.position, description="Largest distance of the tip from the goal at the end."
    )
    heading_tolerance_deg: PositiveDegrees = Field(
        default=Tolerances.heading, description="Largest deviation of the last link from the goal's heading."
    )
    pause: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="Time at rest at this goal before the next leg [s]."
    )


class WallTable(Table):
    """Table of a planar wall: the area that a disc of the wall's thickness sweeps along a polyline."""

    points: Polyline = Field(description="Vertices of the line, in order.")
    thickness: NonNegativeLength = Field(
        default=0.0, description="Thickness of the wall: the diameter of the disc swept along the line."
    )


class PlanePlacementTable(Table):
    """Table of the pose of a scan in the plane: a rotation about the origin, followed by a translation."""

    rules = Rules()

    position: Point = Field(default=[0.0, 0.0], description="Position of the origin of the file.")
    rotation_deg: Degrees = Field(default=0.0, description="Rotation about this origin, counter-clockwise.")


class ObstacleTable(Table):
    """Table of a planar obstacle: one of ``polygon`` (with holes), ``box``, ``circle``, ``wall`` and ``points``."""

    rules = Rules(
        exactly_one=("polygon", "box", "circle", "wall", "points"),
        needs={**dict.fromkeys(("point_radius", "error", "scale", "pose"), ("points",)), "points": ("point_radius",)},
    )

    name: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Name, unique among the obstacles. Default: `obstacle 1`, `obstacle 2`, … in the order of the file."
        ),
    )
    polygon: Ring | None = Field(
        default=None, description="Corners of a simple polygon, in order, clockwise or counter-clockwise."
    )
    holes: Annotated[list[Ring], Field(min_length=1)] | None = Field(
        default=None, description="Holes of the polygon, each given by its corners. Default: none."
    )
    box: Box | None = Field(default=None, description="`[xmin, ymin, xmax, ymax]`.")
    circle: CircleTable | None = Field(default=None, description="`{ center = [x, y], radius = r }`.")
    wall: WallTable | None = Field(
        default=None, description="`{ points = [[x, y], …], thickness = t }`: a line swept by a disc."
    )
    points: ScanPoints | None = Field(
        default=None,
        description=(
            "Points of a scan, each a disc: a file as [in space](#scans), with rows of two numbers or of one height, "
            "or the points themselves."
        ),
    )
    point_radius: PositiveLength | None = Field(
        default=None, description="Points only, and required: radius of the disc about each point."
    )
    error: NonNegativeLength | None = Field(
        default=None, description="Points only: greatest error of the scan, further radius. Default: 0."
    )
    scale: Positive | None = Field(
        default=None,
        description="File of points only: length of one unit of the file, in the problem file's unit. Default: 1.",
    )
    pose: PlanePlacementTable | None = Field(
        default=None,
        description=(
            "File of points only: `{ position = [x, y], rotation_deg = angle }`, where the scan comes to lie. "
            "Default: its coordinates as they are."
        ),
    )

    @field_validator("scale", "pose")
    @classmethod
    def _of_file(cls, value: Any, info: ValidationInfo) -> Any:
        if value is not None and isinstance(info.data.get("points"), list):
            raise ValueError("only allowed with the path of a scan; scale or move the points themselves")
        return value

    @field_validator("holes")
    @classmethod
    def _inside(cls, holes: list[list[list[float]]] | None, info: ValidationInfo) -> list[list[list[float]]] | None:
        outline = info.data.get("polygon", ())
        if holes is not None and outline is None:
            raise ValueError("only allowed together with polygon")
        if holes is not None and outline and not shapely.Polygon(outline, holes).is_valid:
            raise ValueError("expected holes that lie inside the polygon and do not overlap")
        return holes


DrawingPlace = Literal["origin", "center", "bottom-left", "bottom-right", "top-left", "top-right"]


class SceneTable(Table):
    """Keys about a drawing of obstacles and its placement, with lengths left in the unit of the problem file."""

    file: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Drawing with further obstacles: SVG (`.svg`), DXF (`.dxf`), GeoJSON (`.geojson`, `.json`) or "
            "WKT (`.wkt`). The path is relative to the problem file and must stay within its folder, unless "
            "`--allow-outside` is given (in Python `allow_outside=True`). Default: none."
        ),
    )
    scale: Positive = Field(default=1.0, description="Length of one unit of the drawing, in the problem file's unit.")
    units: Literal["file"] | None = Field(
        default=None,
        description=(
            "In place of `scale`: the unit is the one that the drawing states, in the header of a DXF file or by "
            "the page size of an SVG file. Default: `scale`."
        ),
    )
    offset: Point = Field(default=[0.0, 0.0], description="Where `place` comes to lie.")
    place: DrawingPlace = Field(
        default="origin",
        description=(
            "The point of the drawing that comes to lie at `offset`: its origin, or the centre or a corner of the "
            "rectangle around the shapes that are read."
        ),
    )
    layers: list[str] | None = Field(
        default=None,
        description=(
            "Names of the layers that are read; in SVG, of the outermost named groups. Hidden ones are never read. "
            "Default: all."
        ),
    )
    without: list[str] = Field(default=[], description="Names of layers and shapes that are not read.")
    curve_tolerance: PositiveLength | None = Field(
        default=None,
        description="Largest distance of the polygon outside the curve that it approximates. Default: 0.25 mm.",
    )
    wall_thickness: NonNegativeLength = Field(
        default=0.0,
        description='Thickness of the drawing\'s open lines and, with `closed = "walls"`, of all its outlines.',
    )
    closed: Literal["solid", "walls", "room"] = Field(
        default="solid",
        description=(
            "What closed outlines of the drawing mean: `solid`: solids, where unfilled outlines within others are "
            "holes; `walls`: lines of `wall_thickness`; `room`: the largest outline is the boundary of the "
            "workspace, the others are solids in it."
        ),
    )


class WorkspaceTable(SceneTable):
    """Table of a planar workspace, without the list of obstacles, each of which is validated separately."""

    rules = Rules(exactly_one=("bounds", "boundary"), otherwise=', or closed = "room" with a drawing of the workspace')

    bounds: Box | None = Field(
        default=None,
        description=(
            "`[xmin, ymin, xmax, ymax]` of a rectangular workspace. Exactly one of `bounds`, `boundary` and "
            '`closed = "room"` is required; each acts as a wall.'
        ),
    )
    boundary: Ring | None = Field(default=None, description="Corners of the workspace, a simple polygon.")
    clearance: NonNegativeLength = Field(
        default=0.0, description="Required clearance between the arm's surface and every obstacle."
    )


class SpaceObstacleTable(Table):
    """Table of an obstacle in space: one of ``mesh``, ``points``, ``box``, ``sphere``, ``cylinder`` and ``capsule``."""

    rules = Rules(
        exactly_one=("mesh", "points", "box", "sphere", "cylinder", "capsule"),
        needs={
            **dict.fromkeys(("scale", "up", "sha256"), ("mesh", "points")),
            "error": ("mesh", "points"),
            "point_radius": ("points",),
            "points": ("point_radius",),
            **dict.fromkeys(("solid", "parts", "curve_tolerance"), ("mesh",)),
        },
    )

    name: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Name, unique among the obstacles. Default: `obstacle 1`, `obstacle 2`, … in the order of the file."
        ),
    )
    mesh: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Triangle mesh, STL, OBJ, PLY, GLB or 3MF, or solids, STEP ([below](#meshes)). The path is relative to the "
            "problem file and must stay within its folder, unless `--allow-outside` is given (in Python "
            "`allow_outside=True`)."
        ),
    )
    points: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Points of a scan: PLY (its vertices), PCD, NPY, or rows of numbers in XYZ, TXT or CSV ([below](#scans)). "
            "The path is as that of `mesh`."
        ),
    )
    point_radius: PositiveLength | None = Field(
        default=None, description="Points only, and required: radius of the ball about each point."
    )
    error: NonNegativeLength | None = Field(
        default=None,
        description="Mesh or points: greatest error of its file, by which its surfaces grow. Default: 0.",
    )
    parts: Annotated[list[str], Field(min_length=1)] | None = Field(
        default=None, description="STEP only: names of the parts that are read. Default: all."
    )
    curve_tolerance: PositiveLength | None = Field(
        default=None,
        description=(
            "STEP only: greatest distance of the triangles from their surfaces, by which they grow. Default: 0.25 mm."
        ),
    )
    scale: Positive | None = Field(
        default=None,
        description=(
            "Mesh or points: length of one unit of its file, in the problem file's unit. Default: 1; for 3MF, the unit "
            "that the file names. STEP names its unit, and is not scaled."
        ),
    )
    up: Literal["y", "z"] | None = Field(
        default=None,
        description=(
            'Mesh or points: the axis of the file that points up; `"y"` rotates its content about x, so that y becomes '
            'z. Default: `"z"`, no rotation.'
        ),
    )
    solid: bool | None = Field(
        default=None,
        description=(
            "Mesh only: `false` if the surface alone is an obstacle, as for a tank around the arm or sheet metal; "
            "the arm may then start and end inside. Default: `true`, [what the mesh "
            "encloses](problem-file.md#insides) is solid."
        ),
    )
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = Field(
        default=None,
        description="Mesh or points: SHA-256 of its file; a file with another hash is refused. Default: not checked.",
    )
    box: Corners | None = Field(default=None, description="`[[xmin, ymin, zmin], [xmax, ymax, zmax]]`.")
    sphere: SphereTable | None = Field(default=None, description="`{ center = [x, y, z], radius = r }`.")
    cylinder: BarTable | None = Field(
        default=None, description="`{ from = [x, y, z], to = [x, y, z], radius = r }`, with flat ends."
    )
    capsule: BarTable | None = Field(
        default=None, description="The same with hemispherical ends, centred at `from` and `to`."
    )
    pose: PlacementTable | None = Field(
        default=None,
        description=(
            "`{ position = [x, y, z], rotation_deg = [x, y, z] }`, or with `quaternion`: position and orientation "
            "of an obstacle of any kind. Default: its coordinates as they are."
        ),
    )

    @field_validator("parts", "curve_tolerance", "scale")
    @classmethod
    def _fits_the_format(cls, value: Any, info: ValidationInfo) -> Any:
        is_step = str(info.data.get("mesh")).lower().endswith(STEP_SUFFIXES)
        if value is not None and info.data.get("mesh") and is_step == (info.field_name == "scale"):
            raise ValueError("not with STEP, whose unit is known" if is_step else "only allowed with a STEP file")
        return value


class SpaceWorkspaceTable(Table):
    """Table of a workspace in space, without the list of obstacles, each of which is validated separately."""

    bounds: Corners | None = Field(
        default=None,
        description=(
            "`[[xmin, ymin, zmin], [xmax, ymax, zmax]]` of the workspace, whose sides act as walls. Default: unbounded."
        ),
    )
    clearance: NonNegativeLength = Field(
        default=0.0, description="Required clearance between the arm's surface and every obstacle."
    )


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


class BaseAxisTable(Table):
    """Table of an axis between the ground and the base of an arm."""

    rules = Rules()

    kind: Literal["prismatic", "revolute"] = Field(description="Kind of the axis.")
    axis: Direction = Field(
        description=(
            "Its direction in the frame of the axis before it. All these frames are parallel to the world's where all "
            "axes are at zero."
        )
    )
    position: SpacePoint | None = Field(
        default=None,
        description=(
            "A point on a revolute axis, where all axes are at zero. Default: the position of the base. Only with "
            '`kind = "revolute"`.'
        ),
    )
    range: Annotated[list[Length], exactly(2)] | None = Field(
        default=None, description="`[lower, upper]` limit of a prismatic axis."
    )
    range_deg: Annotated[list[Degrees], exactly(2)] | None = Field(
        default=None, description="`[lower, upper]` limit of a revolute axis [deg]."
    )
    velocity: Positive = Field(description="Limit on its velocity [length/s, or rad/s].")
    acceleration: Positive = Field(description="Limit on its acceleration [length/s², or rad/s²].")
    force: Positive | None = Field(default=None, description="Force of a prismatic axis [N]. Default: none.")
    torque: Positive | None = Field(default=None, description="Torque of a revolute axis [N m]. Default: none.")
    inertia: NonNegative = Field(
        default=0.0,
        description="What its drive moves beside the arm: mass [kg], or moment of inertia of a revolute axis [kg m²].",
    )

    @field_validator("velocity", "acceleration")
    @classmethod
    def _in_metres(cls, value: float, info: ValidationInfo) -> float:
        return to_metres(value, info) if info.data.get("kind") == "prismatic" else value

    @field_serializer("velocity", "acceleration")
    def _in_unit(self, value: float, info: SerializationInfo) -> Any:
        return lengths(value, info) if self.kind == "prismatic" else value

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper limit of the position [m, rad]; both 0 if not given."""
        low, high = (self.range if self.kind == "prismatic" else self.range_deg) or (0.0, 0.0)
        return low, high


class BaseTable(Table):
    """Table of the position and orientation of the base of an arm in space."""

    position: SpacePoint = Field(
        description="Position of the first joint; it may touch a wall, but not lie inside one."
    )
    direction: Direction = Field(
        default=[1.0, 0.0, 0.0], description="Direction of the straight arm; a vector of any length but zero."
    )
    up: Direction = Field(
        default=[0.0, 0.0, 1.0],
        description=(
            "Axis about which the first bend of a joint turns while the arm is straight; its component along "
            "`direction` is ignored. Required if `direction` is along z."
        ),
    )
    axes: Annotated[list[BaseAxisTable], Field(min_length=1, max_length=MOST_AXES)] | None = Field(
        default=None,
        description=(
            f"`[[arm.base.axes]]`: up to {MOST_AXES} axes between the ground and the arm, from the ground; `position`, "
            "`direction` and `up` are then those where all axes are at zero. Not with `arm.feed`, which is the short "
            "form of one along `direction`. Default: none."
        ),
    )


_BODIES = "`[[arm.bodies]]`: rigid bodies on links ([what they are](problem-file.md#tools-and-bodies-on-links))."


class PlaneArmTable(ArmTable):
    """Table of a planar arm, with its tool and other bodies."""

    bodies: list[PlaneLinkBodyTable] = Field(default=[], description=_BODIES)
    tool: PlaneToolTable | None = Field(
        default=None,
        description=(
            "Rigid tool on the last link ([what it is](problem-file.md#tools-and-bodies-on-links)). Default: none; "
            "goals are for the end of the link."
        ),
    )


class SpaceArmTable(ChainTable):
    """Table of an arm that moves in three dimensions."""

    base: BaseTable = Field(description="`{ position = [x, y, z], direction = [x, y, z], up = [x, y, z] }`.")
    axes: Literal["zyx"] = Field(default="zyx", description="Order of a ball joint's revolutes; the third stays at 0.")
    bodies: list[SpaceLinkBodyTable] = Field(default=[], description=_BODIES)
    tool: SpaceToolTable | None = Field(
        default=None,
        description=(
            "Rigid tool on the last link ([what it is](problem-file.md#tools-and-bodies-on-links)). Default: none; "
            "goals are for the end of the link."
        ),
    )
    coupling: Annotated[list[Annotated[list[float], Field(min_length=1)]], Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Drives that move several joints ([how](arms.md#joints-that-share-a-drive)): a row for each bend, two a "
            "joint in the order of `joints_deg`, and a column for each drive, with the bend's change for a unit of the "
            "drive; no more than one number other than 0 a row. A bend whose row is 0 is locked. Default: each bend "
            "has its own drive."
        ),
    )

    @property
    def straight_joints(self) -> tuple[int, ...]:
        """Indices of the joints of sections that bend evenly at which bodies sit, and which therefore do not bend."""
        places = [(each.section - 1, each.at) for each in self.bodies if each.section is not None]
        before = arcs_before_bodies(places, [each.links for each in self.sections or ()])
        return tuple(arcs + 1 + k for k, arcs in enumerate(before))

    @property
    def moved(self) -> BoolArray | None:
        """Mask of the bends that drives of ``coupling`` move, shape (links, 2); None without a valid one."""
        if self.coupling is None or [len(row) for row in self.coupling] != 2 * self.links * [len(self.coupling[0])]:
            return None
        return np.asarray(np.any(np.array(self.coupling), axis=1).reshape(-1, 2), dtype=np.bool_)


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
    feed: Length | None = Field(
        default=None,
        description=(
            "Feed of the whole-arm pose: position of the base on the feed axis. Default: the lower end of its range."
        ),
    )
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
    look_at: SpacePoint | None = Field(
        default=None,
        description=_LOOK_AT,
    )
    distance: Distances | None = Field(default=None, description=_DISTANCE)
    field_of_view_deg: FieldOfView | None = Field(
        default=None,
        description=_FIELD_OF_VIEW,
    )
    normal: Direction | None = Field(default=None, description=_NORMAL)
    angle_deg: RightAngle | None = Field(default=None, description=_ANGLE)
    see: SurfaceNames | None = Field(default=None, description=_SEE)
    share: Share | None = Field(default=None, description=_SHARE)
    spacing: PositiveLength | None = Field(default=None, description=_SPACING)
    within: Corners | None = Field(default=None, description=_WITHIN)
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
    position_tolerance: PositiveLength = Field(
        default=Tolerances.position, description="Largest distance of the tip from the goal at the end."
    )
    direction_tolerance_deg: PositiveDegrees = Field(
        default=Tolerances.heading, description="Largest deviation of the last link from the goal's direction."
    )
    roll_tolerance_deg: PositiveDegrees = Field(
        default=Tolerances.roll, description="Largest roll about the goal's direction away from `up`."
    )
    pause: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="Time at rest at this goal before the next leg [s]."
    )


OPTIONAL: Mapping[str, type[Table]] = {
    "planner": PlannerTable,
    "simulation": SimulationTable,
    "tolerance": ToleranceTable,
    "verification": VerificationTable,
}
"""Schemas of the optional tables of a problem file, by name."""
TABLES: Mapping[bool, Mapping[str, type[Table]]] = {
    False: {
        "workspace": WorkspaceTable,
        "workspace.obstacles": ObstacleTable,
        "arm": PlaneArmTable,
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
"""Schemas of the tables of a problem file, by name; planar arms under False, arms in space under True."""

_FOLDER_NAME = re.compile(r"\w(?:[\w .+-]*[\w+-])?")
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


def _folder_name(name: str) -> str:
    if not _FOLDER_NAME.fullmatch(name) or _RESERVED.fullmatch(name) or len(name.encode()) > 200:
        raise ValueError(
            "expected a name that can be a folder's: letters, digits, '-', '_', '+', and '.' or spaces inside, "
            "at most 200 bytes"
        )
    return name


class RootTable(Table):
    """Schema of a whole problem file: the keys above the first table, and the tables, each validated separately."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of the format.")
    space: Literal[2, 3] = Field(
        default=2,
        description="Dimension: 2 for an arm in the plane, 3 for an [arm in space](problem-file.md#arms-in-space).",
    )
    name: Annotated[str, AfterValidator(_folder_name)] = Field(
        description=(
            "Name of the problem and of its output folder: letters, digits, `-`, `_`, `+`, and `.` or spaces inside."
        )
    )
    description: str = Field(default="", description="One line about the problem, shown in lists.")
    units: LengthUnit = Field(
        default="m", description="Unit of all lengths in this file; curvatures are in its inverse."
    )
    workspace: dict[str, object] = Field(description="[Bounds and obstacles](#workspace).")
    arm: dict[str, object] = Field(description="[The arm](#arm).")
    limits: dict[str, object] = Field(description="[Limits of joints, feed and points](#limits).")
    start: dict[str, object] = Field(description="[Start pose](#start-and-goal).")
    goal: dict[str, object] | list[dict[str, object]] = Field(
        description="[Goal](#start-and-goal); several, written `[[goal]]`, are reached in sequence."
    )
    planner: dict[str, object] = Field(default_factory=dict, description="[Planner options](#planner).")
    simulation: dict[str, object] = Field(default_factory=dict, description="[Simulation options](#simulation).")
    tolerance: dict[str, object] = Field(
        default_factory=dict, description="[Errors that the motion must tolerate](#tolerance)."
    )
    verification: dict[str, object] = Field(
        default_factory=dict, description="[How strictly the plan is verified](#verification)."
    )
