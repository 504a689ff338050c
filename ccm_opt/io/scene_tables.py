"""Tables of the workspace and its obstacles in a problem file, in the plane and in space."""

from typing import Annotated, Any, Literal

import shapely
from pydantic import Field, ValidationInfo, field_validator

from ccm_opt.io.quantities import (
    Box,
    Degrees,
    NonNegativeLength,
    Point,
    Polyline,
    Positive,
    PositiveLength,
    Ring,
    Rules,
    Table,
)
from ccm_opt.io.raw_mesh import STEP_SUFFIXES
from ccm_opt.io.shape_tables import BarTable, CircleTable, Corners, PlacementTable, ScanPoints, SphereTable


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


_NAME = Field(
    default=None,
    description="Name, unique among the obstacles. Default: `obstacle 1`, `obstacle 2`, … in the order of the file.",
)
_CLEARANCE = Field(default=0.0, description="Required clearance between the arm's surface and every obstacle.")


class ObstacleTable(Table):
    """Table of a planar obstacle: one of ``polygon`` (with holes), ``box``, ``circle``, ``wall`` and ``points``."""

    rules = Rules(
        exactly_one=("polygon", "box", "circle", "wall", "points"),
        needs={**dict.fromkeys(("point_radius", "error", "scale", "pose"), ("points",)), "points": ("point_radius",)},
    )

    name: Annotated[str, Field(min_length=1)] | None = _NAME
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
    clearance: NonNegativeLength = _CLEARANCE


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

    name: Annotated[str, Field(min_length=1)] | None = _NAME
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
    clearance: NonNegativeLength = _CLEARANCE
