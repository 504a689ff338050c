"""Keys of problem files with ``space = 3`` that differ from those of the plane."""

from typing import Annotated, Literal

from pydantic import Field

from ccm_opt.files.problem_file.schema.arm_keys import ChainTable
from ccm_opt.files.problem_file.schema.table import Table
from ccm_opt.files.problem_file.space_quantities import Bends, Corners, Direction, Quaternion, SpacePoint, Turns
from ccm_opt.files.problem_file.typed_quantities import (
    Length,
    NonNegativeLength,
    Positive,
    PositiveDegrees,
    PositiveLength,
)
from ccm_opt.problem import Tolerances


class SphereTable(Table):
    """A ball."""

    center: SpacePoint
    """Of the ball."""
    radius: PositiveLength
    """Of the ball."""


class BarTable(Table):
    """A round bar."""

    start: Annotated[SpacePoint, Field(alias="from")]
    """One end of its axis."""
    end: Annotated[SpacePoint, Field(alias="to")]
    """The other end."""
    radius: PositiveLength
    """Of the bar."""


class PlacementTable(Table):
    """Where a body stands and how it is turned: it is turned first, then moved."""

    position: SpacePoint = Field(default=[0.0, 0.0, 0.0])
    """Where the origin of the body's own coordinates comes to lie."""
    rotation_deg: Turns | None = None
    """Turns about the fixed axes x, y and z, in this order. Default: none."""
    quaternion: Quaternion | None = None
    """`[w, x, y, z]`, of any length but zero, in place of `rotation_deg`."""


class SpaceObstacleTable(Table):
    """One obstacle: exactly one of mesh, box, sphere, cylinder, capsule."""

    name: Annotated[str, Field(min_length=1)] | None = None
    """Unique among the obstacles. Default: `obstacle 1`, `obstacle 2`, … by its place in the file."""
    mesh: Annotated[str, Field(min_length=1)] | None = None
    """A file with triangles: STL, OBJ, PLY, GLB or 3MF ([below](#meshes)). Its path is relative to the problem file, in
    whose folder it lies unless `--allow-outside` is given (in Python `allow_outside=True`)."""
    scale: Positive | None = None
    """Of a mesh: length of one unit of its file, in the problem file's unit. Default: 1, of 3MF its own unit."""
    up: Literal["y", "z"] | None = None
    """Of a mesh: its axis that points up; `"y"` turns it about x, so that its y becomes z. Default: `"z"`, as it
    stands."""
    solid: bool | None = None
    """Of a mesh: `false` where its surface alone counts, such as that of a room or a tank about the arm, or of sheet
    metal; the arm may then begin and end inside. Default: [what it encloses](space.md#insides) belongs to it."""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    """Of a mesh: the hash of its file, which is refused when it is another. Default: any."""
    box: Corners | None = None
    """`[[xmin, ymin, zmin], [xmax, ymax, zmax]]`."""
    sphere: SphereTable | None = None
    """`{ center = [x, y, z], radius = r }`."""
    cylinder: BarTable | None = None
    """`{ from = [x, y, z], to = [x, y, z], radius = r }`, with flat ends."""
    capsule: BarTable | None = None
    """The same with round ends, whose middles are `from` and `to`."""
    pose: PlacementTable | None = None
    """`{ position = [x, y, z], rotation_deg = [x, y, z] }` or with `quaternion`: where the obstacle stands and how it
    is turned, of whichever kind. Default: as its coordinates say."""


class SpaceWorkspaceTable(Table):
    """The room, without its obstacles: those are validated one by one."""

    bounds: Corners | None = None
    """`[[xmin, ymin, zmin], [xmax, ymax, zmax]]` of the room, whose sides are walls like any obstacle. Default: no
    room, the obstacles alone."""
    clearance: NonNegativeLength = 0.0
    """Gap kept between the arm's surface and every obstacle."""


class BaseTable(Table):
    """Where the arm begins and how it stands."""

    position: SpacePoint
    """Of the first joint; it may touch a wall, not stand inside one."""
    direction: Direction = Field(default=[1.0, 0.0, 0.0])
    """Of the straight arm, of any length but zero."""
    up: Direction = Field(default=[0.0, 0.0, 1.0])
    """About which a joint's first bend turns while the arm is straight; what of it lies along `direction` does not
    count. Required where `direction` is along z."""


class SpaceArmTable(ChainTable):
    """The arm in space."""

    base: BaseTable
    """`{ position = [x, y, z], direction = [x, y, z], up = [x, y, z] }`."""
    axes: Literal["zyx"] = "zyx"
    """Order of a ball's revolutes, the third of which stays at 0."""


class SpacePoseTable(Table):
    """A pose of the whole arm, one of shape, joints_deg."""

    shape: Literal["straight"] | None = None
    """`"straight"`: all links along `arm.base.direction`."""
    joints_deg: Annotated[list[Bends], Field(min_length=1)] | None = None
    """`[[a, b], …]`, the two bends of each joint: about its z-axis, then about its new y-axis."""
    feed: Length | None = None
    """Place of the base on the feed axis, of a whole arm. Default: the least of its range."""


class SpaceStartTable(SpacePoseTable):
    """Where the motion begins."""


class SpaceGoalTable(SpacePoseTable):
    """Where the motion ends: a pose, or a position of the tip."""

    position: SpacePoint | None = None
    """Of the tip."""
    direction: Direction | None = None
    """Where the last link points, with `position`. Default: anywhere."""
    via: Annotated[list[SpacePoint], Field(min_length=1)] | None = None
    """Places that the tip passes on its way, in this order, with `position`: which bore, which gap. Default: none."""
    position_tolerance: PositiveLength = Tolerances.position
    """How far from the goal the tip may end."""
    direction_tolerance_deg: PositiveDegrees = Tolerances.heading
    """How far from the goal's direction the last link may point."""
    pause: Annotated[float, Field(ge=0.0)] = 0.0
    """How long the arm rests at this goal before the next [s]."""
