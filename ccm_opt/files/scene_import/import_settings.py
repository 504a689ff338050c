"""How a drawing is placed (``ImportOptions``, from the problem file), and the tolerances and bounds of its import."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class ImportOptions:
    """How a drawing becomes obstacles; what the keys of the problem file say.

    Attributes:
        scale: length in the result of one unit of the drawing.
        offset: place in the result of the drawing's origin, shape (2,).
        curve_tolerance: how far outside a curve its polygon may lie, in the unit of the result; it never lies inside.
        wall_thickness: of open lines, in the unit of the result.
        closed: what closed outlines are: solids with holes, lines, or, the largest of them, the room.
    """

    scale: float = 1.0
    offset: tuple[float, float] = (0.0, 0.0)
    curve_tolerance: float = 2.5e-4
    wall_thickness: float = 0.0
    closed: Literal["solid", "walls", "room"] = "solid"


@dataclass(frozen=True)
class ImportSettings:
    """Tolerances and bounds of the import, the same for all formats.

    Attributes:
        most_bytes: larger files are refused. Taste.
        most_dxf_bytes: larger DXF files are refused. Measured: the parser reads 1.5 MB a second.
        most_vertices: larger scenes are refused. Taste: a planner would take hours with them.
        most_points: shapes of more points in all, counted before repairs join some, are refused while they are read.
            Derived: what more than ``most_vertices`` would remain of, but for outlines that are drawn several times.
        most_elements: drawings of more elements, those counted as often as they are used or inserted, are refused
            while they are expanded. Derived: an element gives one vertex at least.
        most_nodes: files of more elements of any kind, or places in lists, are refused while they are read. Taste.
        deepest: elements nested deeper are refused, so that nothing depends on how deep a file nests. Taste: people
            nest a dozen deep, and programs that convert drawings some dozens.
        longest_path: characters of path data of one element; longer ones are refused unread. Derived: most_vertices
            points as programs write them, with all sixteen digits.
        longest_attribute: characters of a style, class or transform. Taste: a hundred times what programs write.
        longest_text: characters of a style sheet or a title that are kept. Taste.
        most_style_rules: rules of style sheets that decide whether and how shapes are filled. Taste: each is compared
            with every element.
        reported_defects: how many defects of a drawing an error lists. Taste.
        largest_coordinate: larger ones are refused, in the unit of the result. Derived: beyond it double precision no
            longer resolves a millionth.
        most_meeting: neighbours that an open end has within the joining distance, on average. Taste: two as a rule.
        most_nested: pairs of rings of one shape whose boxes meet. Measured: 0.5 s for
            as many, each ring in the next.
        most_crossings: pairs of edges of one outline that meet besides neighbours, and are repaired. Measured: 0.5 s
            for as many, and ten seconds for four times as many.
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
    most_dxf_bytes: int = 8 * 2**20
    most_vertices: int = 50_000
    most_points: int = 100_000
    most_elements: int = 50_000
    most_nodes: int = 300_000
    deepest: int = 200
    longest_path: int = 2_000_000
    longest_attribute: int = 20_000
    longest_text: int = 1_000_000
    most_style_rules: int = 300
    reported_defects: int = 10
    largest_coordinate: float = 1e9
    most_meeting: int = 100
    most_nested: int = 500_000
    most_crossings: int = 1000
    flattening_share: float = 0.499
    growth_share: float = 0.5
    corner_reach: float = 1.9
    repair_share: float = 1e-3

    def listed(self, defects: Sequence[str]) -> str:
        """The first defects of a drawing in one sentence, with the number of the rest."""
        shown = list(defects[: self.reported_defects])
        if len(defects) > len(shown):
            shown.append(f"and {len(defects) - len(shown)} more")
        return "; ".join(shown)


IMPORT = ImportSettings()
"""Used where no other settings are given."""
