"""Reads DXF drawings: lines, arcs, circles, ellipses, polylines, splines, solids, hatches, and blocks of them.

Only the model space counts, seen along z, without layers that are off or frozen. Open pieces on one layer whose
ends meet are joined; a closed chain is an outline. Annotations and construction lines are left out; whatever else
cannot be read is refused by name, for a missing obstacle would be worse than a refused file.
"""

import io
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.chains import Piece, joined_pieces
from ccm_opt.files.scene_import.dxf_entities import PIECES, Entity, corner_points, hatch_rings, piece_of
from ccm_opt.files.scene_import.found_shapes import Disc, Line, Region, Shape

if TYPE_CHECKING:
    from ezdxf.document import Drawing

IGNORED = frozenset(
    (
        "ACAD_TABLE",
        "ARC_DIMENSION",
        "ATTDEF",
        "ATTRIB",
        "DIMENSION",
        "IMAGE",
        "LARGE_RADIAL_DIMENSION",
        "LEADER",
        "LIGHT",
        "MLEADER",
        "MTEXT",
        "MULTILEADER",
        "OLE2FRAME",
        "POINT",
        "RAY",
        "TEXT",
        "TOLERANCE",
        "VIEWPORT",
        "WIPEOUT",
        "XLINE",
    )
)
"""Annotations, pictures and construction lines."""
_DEEPEST = 32
"""Blocks nested deeper than this are taken for blocks that hold themselves."""
_GAP = 1e-6
"""Ends nearer than this, relative to the extent of the layer's open pieces, meet."""


@dataclass(frozen=True)
class _Placed:
    """An entity with its layer, and the name that its shape gets."""

    entity: Entity
    layer: str
    name: str


def read_dxf(content: bytes, distance: float) -> list[Shape]:
    """The shapes of a DXF file.

    A shape is named by its layer; on layer 0 by its block, or else by its type and handle.

    Args:
        content: of the file, text or binary DXF.
        distance: allowed between a curve and the polyline that replaces it [drawing units].

    Raises:
        ProblemError: the content is no DXF, or holds entities that cannot be read; those are listed by name.
    """
    drawing = _parsed(content)
    shapes: list[Shape] = []
    open_pieces: dict[str, list[Piece]] = {}
    refusals: list[str] = []
    for item in _entities(drawing, refusals):
        try:
            _add(item, distance, shapes, open_pieces)
        except ProblemError as error:
            refusals.append(f"{_title(item)} cannot be an obstacle: {error}")
    if refusals:
        raise ProblemError("; ".join(refusals[:10]))
    return shapes + [shape for pieces in open_pieces.values() for shape in _chained(pieces, distance)]


def _parsed(content: bytes) -> "Drawing":
    from ezdxf import recover  # noqa: PLC0415 - loaded only when a DXF file is read
    from ezdxf.audit import AuditError  # noqa: PLC0415 - likewise

    # The parser would mend a file that was cut short in silence, and obstacles would be missing.
    if b"EOF" not in content[-64:]:
        raise ProblemError("the DXF file has no end: it was cut short, or it is no DXF; save it again")
    try:
        drawing, auditor = recover.read(io.BytesIO(content))
    except Exception as error:  # whatever the parser stumbles over
        raise ProblemError(f"not readable as DXF: {error}") from error
    # An undefined block counts as mended when its references are deleted; here that is a lost obstacle.
    lost = [fix for fix in auditor.fixes if fix.code == AuditError.UNDEFINED_BLOCK]
    for defect in [*auditor.errors, *lost]:
        raise ProblemError(f"the DXF file is damaged: {defect.message} Save it again from a CAD program.")
    return drawing


def _entities(drawing: "Drawing", refusals: list[str]) -> Iterator[_Placed]:
    """The visible entities of the model space, blocks taken apart, each upright."""
    # Names of layers do not distinguish upper and lower case.
    hidden = {layer.dxf.name.lower() for layer in drawing.layers if layer.is_off() or layer.is_frozen()}
    hidden.add("defpoints")  # CAD programs never print this layer
    for entity in drawing.modelspace():
        name = f"{entity.dxftype().lower()} {entity.dxf.get('handle', '')}".strip()
        for item in _exploded(entity, str(entity.dxf.get("layer", "0")), name, refusals, _DEEPEST):
            if item.layer.lower() not in hidden and not item.entity.dxf.get("invisible", 0):
                yield item


def _exploded(entity: Entity, layer: str, name: str, refusals: list[str], depth: int) -> Iterator[_Placed]:
    """An entity, or the entities of a block reference; those on layer 0 take the reference's layer."""
    if entity.dxftype() != "INSERT":
        yield _Placed(entity, layer, name if layer == "0" else layer)
        return
    if depth == 0:
        raise ProblemError(f"block '{entity.dxf.name}' holds blocks more than {_DEEPEST} deep; explode it")

    def skipped(part: Entity, reason: str) -> None:
        if part.dxftype() not in IGNORED:
            refusals.append(f"{part.dxftype()} in block '{entity.dxf.name}' cannot be placed: {reason}")

    for copy in entity.multi_insert() if entity.mcount > 1 else [entity]:
        for part in copy.virtual_entities(skipped_entity_callback=skipped):
            drawn_on = str(part.dxf.get("layer", "0"))
            part_layer = layer if drawn_on == "0" else drawn_on
            yield from _exploded(part, part_layer, str(entity.dxf.name), refusals, depth - 1)


def _add(item: _Placed, distance: float, shapes: list[Shape], open_pieces: dict[str, list[Piece]]) -> None:
    """Turn one entity into a shape, or keep it as an open piece of its layer."""
    entity = item.entity
    kind = entity.dxftype()
    if kind in IGNORED:
        return
    _turn_upright(entity)

    if kind == "CIRCLE":
        center = entity.dxf.center
        shapes.append(Disc(item.name, np.array((center.x, center.y)), float(entity.dxf.radius)))
    elif kind in {"HATCH", "MPOLYGON"}:
        rings, curved = hatch_rings(entity, distance)
        shapes.append(Region(item.name, rings, "evenodd", curved))
    elif kind in {"SOLID", "TRACE", "3DFACE"}:
        shapes.append(Region(item.name, (corner_points(entity),)))
    elif kind in PIECES:
        piece = replace(piece_of(entity, distance), name=item.name)
        if piece.closed:
            shapes.append(_shape(piece))
        else:
            open_pieces.setdefault(item.layer, []).append(piece)
    else:
        raise ProblemError("entities of this type cannot be read; explode it into polylines, lines and arcs")


def _turn_upright(entity: Entity) -> None:
    """Mirror what was drawn on the back of the plane; refuse what was drawn on another plane."""
    from ezdxf.upright import upright  # noqa: PLC0415 - loaded only when a DXF file is read

    upright(entity)
    normal = entity.dxf.get("extrusion", None)
    if normal is not None and np.hypot(normal.x, normal.y) > 1e-9 * abs(normal.z) and entity.dxftype() != "LINE":
        raise ProblemError("it is not drawn in the x-y plane; turn it into that plane")


def _chained(pieces: list[Piece], distance: float) -> list[Shape]:
    """The shapes of a layer's open pieces after joining."""
    points = np.concatenate([piece.points for piece in pieces])
    gap = min(distance, _GAP * float(np.ptp(points, axis=0).max()))
    return [_shape(chain) for chain in joined_pieces(pieces, gap)]


def _shape(piece: Piece) -> Shape:
    """A closed piece as a region, unless it only runs to and fro; an open one as a line."""
    if piece.closed and shapely.MultiPoint(piece.points).convex_hull.area > 0.0:
        return Region(piece.name, (piece.points,), "nonzero", piece.curved, piece.half_width)
    return Line(piece.name, piece.points, piece.curved, piece.half_width)


def _title(item: _Placed) -> str:
    return f"{item.entity.dxftype()} '{item.name}'"
