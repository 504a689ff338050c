"""How a drawing is placed (``ImportOptions``, from the problem file), and the tolerances and bounds of its import."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ImportOptions:
    """How a drawing becomes obstacles; what the keys of the problem file say.

    Attributes:
        scale: length in the result of one unit of the drawing.
        offset: place in the result of the drawing's origin, shape (2,).
        curve_tolerance: how far outside a curve its polygon may lie, in the unit of the result; it never lies inside.
        wall_thickness: of open lines, in the unit of the result.
    """

    scale: float = 1.0
    offset: tuple[float, float] = (0.0, 0.0)
    curve_tolerance: float = 2.5e-4
    wall_thickness: float = 0.0


@dataclass(frozen=True)
class ImportSettings:
    """Tolerances and bounds of the import, the same for all formats.

    Attributes:
        most_bytes: larger files are refused. Taste.
        most_vertices: larger scenes are refused. Taste: a planner would take hours with them.
        reported_defects: how many defects of a drawing an error lists. Taste.
        flattening_share: share of the tolerance by which a polyline may leave its curve. Derived: polygons grow by
            half the tolerance, so that a little less than half keeps the true curve inside.
        growth_share: share of the tolerance by which polygons of curves grow. Derived: with the share above the sum
            stays below the tolerance.
        corner_reach: sharp corners of a grown polygon are cut at this many times the growth from the corner. Derived:
            less than 2, so that they stay within the tolerance.
        repair_share: a repair that changes the enclosed area by more than this share is refused, since something else
            was meant. Taste.
    """

    most_bytes: int = 32 * 2**20
    most_vertices: int = 50_000
    reported_defects: int = 10
    flattening_share: float = 0.499
    growth_share: float = 0.5
    corner_reach: float = 1.9
    repair_share: float = 1e-3


IMPORT = ImportSettings()
"""Used where no other settings are given."""
