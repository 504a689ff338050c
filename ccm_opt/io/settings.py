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
        most_parts: parts that a 3MF or GLB file is put together from, each counted as often as it is used. Taste.
        least_height: triangles lower than this share of the mesh's extent have no area. Derived: some roundings of a
            vertex in double precision.
        largest_coordinate: in the mesh's own unit. Derived: beyond it double precision no longer resolves a millionth.
    """

    most_bytes: int = 256 * 2**20
    most_triangles: int = 2_000_000
    most_unpacked: int = 512 * 2**20
    deepest: int = 20
    most_parts: int = 10_000
    least_height: float = 1e-13
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
    """

    limit_share: float = 0.95


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
    """

    depth: float = 4.0
    least_depth: float = 0.02
    room_wall: float = 0.05
    thin_wall: float = 1e-6
    round_sides: int = 16
    glass: float = 0.35


EXPORT = ExportSettings()
"""Used where no other settings are given."""
