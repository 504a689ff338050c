"""Keys of the room, its obstacles and its drawing."""

from typing import Annotated, Literal

import shapely
from pydantic import Field, ValidationInfo, field_validator

from ccm_opt.files.problem_file.schema.table import Table
from ccm_opt.files.problem_file.typed_quantities import (
    Box,
    NonNegativeLength,
    Point,
    Polyline,
    Positive,
    PositiveLength,
    Ring,
)


class CircleTable(Table):
    """A disc."""

    center: Point
    """Of the disc."""
    radius: PositiveLength
    """Of the disc."""


class WallTable(Table):
    """A polyline swept by a disc of half its thickness."""

    points: Polyline
    """Of the line, in order."""
    thickness: NonNegativeLength = 0.0
    """Diameter of the disc that sweeps the line."""


class ObstacleTable(Table):
    """One obstacle: exactly one of polygon, box, circle, wall; a polygon may have holes."""

    name: Annotated[str, Field(min_length=1)] | None = None
    """Unique among the obstacles. Default: `obstacle 1`, `obstacle 2`, … by its place in the file."""
    polygon: Ring | None = None
    """Corners of a simple polygon, in order, either way round."""
    holes: Annotated[list[Ring], Field(min_length=1)] | None = None
    """Of the polygon, each given by its corners. Default: none."""
    box: Box | None = None
    """`[xmin, ymin, xmax, ymax]`."""
    circle: CircleTable | None = None
    """`{ center = [x, y], radius = r }`."""
    wall: WallTable | None = None
    """`{ points = [[x, y], …], thickness = t }`: a line swept by a disc."""

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

    file: Annotated[str, Field(min_length=1)] | None = None
    """A drawing with further obstacles: SVG (`.svg`), DXF (`.dxf`), GeoJSON (`.geojson`, `.json`) or WKT (`.wkt`). Its
    path is relative to the problem file, in whose folder it lies unless `--allow-outside` is given (in Python
    `allow_outside=True`). Default: none."""
    scale: Positive = 1.0
    """Length of one unit of the drawing, in the problem file's unit."""
    offset: Point = Field(default=[0.0, 0.0])
    """Where the drawing's origin comes to lie."""
    curve_tolerance: PositiveLength | None = None
    """How far outside a curve of the drawing its polygon may lie. Default: 0.25 mm."""
    wall_thickness: NonNegativeLength = 0.0
    """Of open lines of the drawing, and of all outlines with `closed = "walls"`."""
    closed: Literal["solid", "walls", "room"] = "solid"
    """What closed outlines of the drawing are: solids, with those drawn as lines within others as holes; lines of
    `wall_thickness`; or solids in the largest of them, which is the boundary of the room."""


class WorkspaceTable(SceneTable):
    """The room, without its obstacles: those are validated one by one."""

    bounds: Box | None = None
    """`[xmin, ymin, xmax, ymax]` of the room. It, `boundary` or `closed = "room"` is required; each is a wall like any
    obstacle."""
    boundary: Ring | None = None
    """Corners of the room, one simple polygon."""
    clearance: NonNegativeLength = 0.0
    """Gap kept between the arm's surface and every obstacle."""
