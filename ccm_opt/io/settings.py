"""Numbers of reading and writing."""

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


@dataclass(frozen=True)
class MeshSettings:
    """Bounds on mesh files and what counts as a defect of a mesh, the same for all formats.

    Attributes:
        most_bytes: of a file; larger ones are refused unread. Taste: two million triangles as text.
        most_triangles: of a mesh, or of all meshes of a problem together; more are refused. Taste: distances would take
            gigabytes of memory.
        most_unpacked: bytes of the model inside a 3MF file, which is packed. Taste: as many triangles as text.
        deepest: components of components in a 3MF file. Taste: programs nest two or three deep.
        deepest_nodes: nodes below nodes in a GLB file. Taste: robots nest a few dozen deep.
        most_parts: parts that a 3MF or GLB file is put together from, each counted as often as it is used. Taste.
        least_height: triangles lower than this share of the mesh's extent have no area. Derived: some roundings of a
            vertex in double precision.
        most_flat: share of triangles without area from which on a mesh is refused, since its file must be broken.
            Taste: programs write one in a hundred where they cut curved faces.
        largest_coordinate: in the mesh's own unit. Derived: beyond it double precision no longer resolves a millionth.
    """

    most_bytes: int = 256 * 2**20
    most_triangles: int = 2_000_000
    most_unpacked: int = 512 * 2**20
    deepest: int = 20
    deepest_nodes: int = 200
    most_parts: int = 10_000
    least_height: float = 1e-13
    most_flat: float = 0.5
    largest_coordinate: float = 1e9


MESHES = MeshSettings()
"""Used where no other settings are given."""


@dataclass(frozen=True)
class ReadingSettings:
    """Tolerances with which the values of a problem file are held against each other.

    Attributes:
        length_tolerance: relative difference allowed between the total length of a pose's segments and the arm's
            length. Taste: lengths are written with six digits or more.
        angle_tolerance: by which bends may pass a limit [rad]. Derived: degrees are rounded when they become radians.
        depth_rounding: depths below this share of the room are rounding. Derived: a thousandth of the contact
            tolerance of the verifier.
        base_tolerance: by which a curve's base may be off the arm's, as a share of its length. Derived: likewise; a
            problem file has one base for both.
    """

    length_tolerance: float = 1e-6
    angle_tolerance: float = 1e-9
    depth_rounding: float = 1e-9
    base_tolerance: float = 1e-9


READING = ReadingSettings()
"""Used where no other settings are given."""


@dataclass(frozen=True)
class FoldSettings:
    """How tightly ``shape = "folded"`` folds an arm; all of them are taste.

    Attributes:
        limit_share: share of the joint limit that a folded arm uses, so that it can still move either way.
        gap_in_diameters: the axes of distant links keep at least this many link diameters (two radii) apart.
        least_gap_in_links: and at least this many link lengths, for arms of zero radius.
    """

    limit_share: float = 0.95
    gap_in_diameters: float = 1.1
    least_gap_in_links: float = 0.1


FOLD = FoldSettings()
"""Used where no other settings are given."""


@dataclass(frozen=True)
class ExportSettings:
    """Sizes of exported scenes and films; all of them are taste but where it says otherwise.

    Attributes:
        depth: of extruded obstacles behind and before the plane, in radii of the arm: as the viewer shows them.
        least_depth: the same at least, as a share of the arm's length; arms without a radius need it.
        room_wall: thickness of the walls around the room, as a share of the arm's length.
        thin_wall: thickness of walls that have none, as a share of the arm's length. Derived: what a contact may be
            off by unless the problem says otherwise, since engines know no walls without thickness.
        round_sides: sides of cylinders and half spheres in films.
        glass: opacity of bodies in films in space, which would hide the arm otherwise.
        film_rate: keyframes of films a second [1/s]; between them players interpolate.
        compression: of arrays, from 1, fast, to 9, small. Measured on the plan of the swan's neck, 1.37 MB without:
            615 kB in 14 ms at 1, 612 kB in 24 ms at 6.
    """

    depth: float = 4.0
    least_depth: float = 0.02
    room_wall: float = 0.05
    thin_wall: float = 1e-6
    round_sides: int = 16
    glass: float = 0.35
    film_rate: float = 30.0
    compression: int = 1


EXPORT = ExportSettings()
"""Used where no other settings are given."""
