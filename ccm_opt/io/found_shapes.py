"""Shapes that a drawing holds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.problem import LeftOut


@dataclass(frozen=True)
class ImportBounds:
    """Bounds of the import, the same for all formats.

    Attributes:
        most_bytes: larger files are refused. Taste.
        most_vertices: larger scenes are refused. Taste: a planner would take hours with them.
        most_points: shapes of more points in all, counted before repairs join some, are refused while they are read.
            Derived: what more than ``most_vertices`` would remain of, but for outlines that are drawn several times.
        most_elements: drawings of more elements, those counted as often as they are used or inserted, are refused
            while they are expanded. Derived: an element gives one vertex at least.
        most_nodes: files of more elements of any kind, or places in lists, are refused while they are read. Taste.
        deepest: elements nested deeper are refused, so that nothing depends on how deep a file nests. Taste: people
            nest a dozen deep, and programs that convert drawings some dozens.
        reported_defects: how many defects of a drawing an error lists. Taste.
        largest_coordinate: larger ones are refused, in the unit of the result. Derived: beyond it double precision no
            longer resolves a millionth.
        most_nested: pairs of rings of one shape whose boxes meet. Measured: 0.5 s for
            as many, each ring in the next.
    """

    most_bytes: int = 32 * 2**20
    most_vertices: int = 50_000
    most_points: int = 100_000
    most_elements: int = 50_000
    most_nodes: int = 300_000
    deepest: int = 200
    reported_defects: int = 10
    largest_coordinate: float = 1e9
    most_nested: int = 500_000

    def listed(self, defects: Sequence[str]) -> str:
        """The first defects of a drawing in one sentence, with the number of the rest."""
        shown = list(defects[: self.reported_defects])
        if len(defects) > len(shown):
            shown.append(f"and {len(defects) - len(shown)} more")
        return "; ".join(shown)


IMPORT = ImportBounds()
"""What every drawing is held to."""


FillRule = Literal["polygon", "evenodd", "nonzero"]
"""How rings within rings count, see ``Region``."""

Drawn = Literal["outline", "painted", "area"]
"""How an outline is drawn: as a line alone, so that outlines within it are holes; filled; or as an area, by a hatch for
example, which is solid whatever outlines stand for."""


@dataclass(frozen=True)
class Disc:
    """A true circle.

    Attributes:
        name: what the drawing calls it.
        center: shape (2,).
        radius: positive.
        layer: on which it is drawn; empty where the drawing has none.
        drawn: see ``Drawn``.
    """

    name: str
    center: FloatArray
    radius: float
    layer: str = ""
    drawn: Drawn = "outline"

    @property
    def size(self) -> int:
        """Number of points."""
        return 1


@dataclass(frozen=True)
class Region:
    """What closed rings enclose.

    Attributes:
        name: what the drawing calls it.
        rings: each of shape (k, 2), the first point not repeated.
        rule: ``polygon``: the first ring is the outline, the others are holes; ``evenodd`` and ``nonzero``: rings
            within rings are holes by the fill rules of SVG.
        curved: whether some ring is a flattened curve.
        half_width: by which the drawn line is wider than the ring on each side.
        layer: as for a disc.
        drawn: as for a disc.
    """

    name: str
    rings: tuple[FloatArray, ...]
    rule: FillRule = "polygon"
    curved: bool = False
    half_width: float = 0.0
    layer: str = ""
    drawn: Drawn = "painted"

    @property
    def size(self) -> int:
        """Number of points."""
        return sum(len(ring) for ring in self.rings)


@dataclass(frozen=True)
class Line:
    """An open line.

    Attributes:
        name: what the drawing calls it.
        points: shape (k, 2).
        curved: whether it is a flattened curve.
        half_width: half the width with which it is drawn, where the width belongs to the drawing's geometry.
        layer: as for a disc.
    """

    name: str
    points: FloatArray
    curved: bool = False
    half_width: float = 0.0
    layer: str = ""

    @property
    def size(self) -> int:
        """Number of points."""
        return len(self.points)


Shape: TypeAlias = Disc | Region | Line


@dataclass(frozen=True)
class DrawingContent:
    """What a reader found.

    Attributes:
        shapes: in the order of the drawing.
        left_out: what became no shape, with the reasons.
        unit: of length that the file names, for example ``mm``; empty where it names none.
    """

    shapes: tuple[Shape, ...]
    left_out: tuple[LeftOut, ...] = ()
    unit: str = ""


Reader: TypeAlias = Callable[[bytes, float], DrawingContent]
"""Finds the shapes in a file's bytes; curves are flattened to the given distance, in the drawing's own unit."""


def shapes_of(geometry: shapely.Geometry, name: str, left_out: list[LeftOut]) -> list[Shape]:
    """The shapes of a geometry, collections taken apart; a line string is a line even when it is closed.

    Args:
        geometry: of any kind and nesting.
        name: of every shape.
        left_out: receives what has no extent, and heights.

    Raises:
        ProblemError: a coordinate is not a finite number.
    """
    if not np.isfinite(shapely.get_coordinates(geometry)).all():
        raise ProblemError(f"'{name}' has a coordinate that is not a finite number")
    if shapely.has_z(geometry):
        left_out.append(LeftOut(f"heights of '{name}'", "a drawing is seen from above"))
    shapes: list[Shape] = []
    parts = [geometry]
    for part in parts:  # grows while it is read
        kind = type(part).__name__
        if shapely.is_empty(part):
            left_out.append(LeftOut(f"{kind} '{name}'", "it is empty"))
        elif hasattr(part, "geoms"):
            parts.extend(part.geoms)
        elif isinstance(part, shapely.Polygon):
            shapes.append(Region(name, tuple(shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(part))))
        elif isinstance(part, shapely.Point):
            left_out.append(LeftOut(f"{kind} '{name}'", "points have no extent"))
        else:
            shapes.append(Line(name, shapely.get_coordinates(part)))
    return shapes
