"""Reader of DXF drawings: lines, arcs, circles, ellipses, polylines, splines, solids, hatches, and blocks.

Only the model space is read, projected along z, without layers that are off or frozen. Open polylines of a layer are
joined where their ends meet; a closed chain is an outline. Annotations and construction lines are left out and
reported, even damaged ones; any other unreadable entity is refused by name, since a missing obstacle is worse than a
refused file.
"""

import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.errors import ProblemError
from ccm_opt.io.dxf_pieces import PIECES, Entity, Piece, corner_points, hatch_rings, joined_pieces
from ccm_opt.io.issues import collected_warnings
from ccm_opt.io.shapes import IMPORT, DrawingContent, Drawn, LayerSelection, Shape
from ccm_opt.problem import LeftOut

if TYPE_CHECKING:
    from ezdxf.document import Drawing

_MOST_DXF_BYTES = 8 * 2**20
"""Maximum size of a DXF file [bytes]. Measured: the parser reads 1.5 MB per second."""

IGNORED = frozenset(
    (
        "ACAD_TABLE",
        "ARC_DIMENSION",
        "ATTDEF",
        "ATTRIB",
        "DGNUNDERLAY",
        "DIMENSION",
        "DWFUNDERLAY",
        "IMAGE",
        "LARGE_RADIAL_DIMENSION",
        "LEADER",
        "LIGHT",
        "MLEADER",
        "MTEXT",
        "MULTILEADER",
        "OLE2FRAME",
        "PDFUNDERLAY",
        "POINT",
        "RAY",
        "SHAPE",
        "TEXT",
        "TOLERANCE",
        "VIEWPORT",
        "WIPEOUT",
        "XLINE",
    )
)
"""DXF types of annotations, pictures and construction lines, which are not imported."""
_IGNORED_BECAUSE = {
    "MTEXT": "text is not an obstacle",
    "POINT": "points have zero size",
    "RAY": "construction lines are not obstacles",
    "TEXT": "text is not an obstacle",
    "XLINE": "construction lines are not obstacles",
}
_IN_SPACE = {
    "3DFACE": "a 3-D face",
    "3DSOLID": "a 3-D solid",
    "BODY": "a 3-D body",
    "EXTRUDEDSURFACE": "a 3-D surface",
    "LOFTEDSURFACE": "a 3-D surface",
    "MESH": "a 3-D mesh",
    "PLANESURFACE": "a 3-D surface",
    "POLYFACE": "a 3-D mesh",
    "POLYMESH": "a 3-D mesh",
    "REGION": "an area stored as a 3-D body",
    "REVOLVEDSURFACE": "a 3-D surface",
    "SURFACE": "a 3-D surface",
    "SWEPTSURFACE": "a 3-D surface",
}
"""Descriptions of three-dimensional entities, which are refused, by DXF type (POLYLINE meshes: POLYFACE, POLYMESH)."""
_PARTS = frozenset(("BLOCK", "ENDBLK", "ENDSEC", "EOF", "SECTION", "SEQEND", "VERTEX"))
"""DXF types of structural records, which are not entities."""
_KIND = re.compile(rb"(?m)^[ \t]*0[ \t]*\r?\n[ \t]*(\d*[A-Z][A-Z0-9_]*)[ \t]*\r?$")
"""Group code 0 in the text of a DXF file, followed by the type of an entity."""
_ANNOTATIONS = re.compile(
    rb"(?m)^[ \t]*0[ \t]*\r?\n[ \t]*(?:M|MULTI|ARC_|LARGE_RADIAL_)?(?:TEXT|LEADER|DIMENSION|TOLERANCE)[ \t]*\r?\n"
    rb"(?:(?![ \t]*0[ \t]*\r?\n).*\n.*\n)*"
)
"""An annotation in the text of a DXF file, up to the next group code 0."""
_BINARY = b"AutoCAD Binary DXF"
_DEEPEST = 32
"""Maximum nesting depth of blocks; deeper nesting suggests a block that contains itself."""
_GAP = 1e-6
"""Maximum distance between ends that are joined, relative to the extent of the layer's open polylines."""


@dataclass(frozen=True)
class _Placed:
    """An entity of the drawing with its layer, the name for its shape, and the number of blocks around it."""

    entity: Entity
    layer: str
    name: str
    depth: int = 0


@dataclass
class _Findings:
    """Results collected while a DXF drawing is read: shapes, open polylines by layer, entities left out or refused."""

    selection: LayerSelection
    shapes: list[Shape] = field(default_factory=list)
    open_pieces: dict[str, list[Piece]] = field(default_factory=dict)
    left_out: list[LeftOut] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)
    in_space: Counter[str] = field(default_factory=Counter)
    points: int = 0

    def leave_out(self, item: _Placed, reason: str) -> None:
        """Record an entity that is not imported as an obstacle, and the reason."""
        self.left_out.append(LeftOut(_title(item), reason))


def read_dxf(content: bytes, distance: float, selection: LayerSelection) -> DrawingContent:
    """Return the shapes in the bytes of a DXF file.

    A shape is named after its layer, on layer 0 after its block, and outside blocks after its type and handle.

    Args:
        content: content of the file, text or binary DXF.
        distance: maximum distance between a curve and its polyline [drawing units].
        selection: selection of shapes.

    Raises:
        ProblemError: the content is not DXF, has unreadable entities, which are listed by name, or exceeds a limit of
            ``ImportBounds``.
    """
    found = _Findings(selection)
    drawing = _parsed(content, found)
    try:
        return _read(drawing, distance, found)
    except ProblemError:
        raise
    except Exception as error:  # the parser lets entities pass that it cannot make sense of later
        raise ProblemError(f"the DXF file is damaged: {error} Save it anew from a CAD program.") from error


def _read(drawing: "Drawing", distance: float, found: _Findings) -> DrawingContent:
    for item in _entities(drawing, found):
        try:
            _add(item, distance, found)
        except ProblemError as error:
            found.refusals.append(f"{_title(item)} cannot be an obstacle: {error}")
        if found.points > IMPORT.most_points:
            raise ProblemError(f"its shapes have more than {IMPORT.most_points} points; simplify the drawing")
    found.refusals += [
        f"{kind}: {_IN_SPACE[kind]} ({number} of them); draw its outline in the x-y plane, or export a mesh "
        "(STL) and plan in space, with space = 3"
        for kind, number in found.in_space.items()
    ]
    if found.refusals:
        raise ProblemError(IMPORT.listed(found.refusals))
    # Of the layouts of sheets nothing is read.
    for sheet in drawing.layouts:
        count = sum(entity.dxftype() != "VIEWPORT" for entity in sheet) if sheet.is_any_paperspace else 0
        if count:
            left = f"a paper-space layout with {count} entities; only the model space is read"
            found.left_out.append(LeftOut(f"layout '{sheet.name}'", left))
    for layer, pieces in found.open_pieces.items():
        found.shapes += _chained(pieces, layer, distance)
    return DrawingContent(tuple(found.shapes), tuple(found.left_out), *_unit(drawing))


def _unit(drawing: "Drawing") -> tuple[str, float | None]:
    """Return the unit of length in the header of a DXF drawing, for example ``mm``, and its length [m]; "" if none."""
    from ezdxf.enums import InsertUnits  # noqa: PLC0415 - loaded only when a DXF file is read
    from ezdxf.units import conversion_factor, decode  # noqa: PLC0415

    if not drawing.units:
        return "", None
    return decode(drawing.units) or "", float(conversion_factor(InsertUnits(drawing.units), InsertUnits.Meters))


def _parsed(content: bytes, found: _Findings) -> "Drawing":
    from ezdxf import recover  # noqa: PLC0415 - loaded only when a DXF file is read
    from ezdxf.audit import AuditError  # noqa: PLC0415 - likewise
    from ezdxf.document import Drawing  # noqa: PLC0415 - likewise
    from ezdxf.lldxf.tagger import binary_tags_loader  # noqa: PLC0415 - likewise

    # The parser silently repairs a truncated file, and obstacles would be missing.
    if b"EOF" not in content[-64:]:
        raise ProblemError("the DXF file has no end: it is truncated, or not DXF; save it anew")
    if len(content) > _MOST_DXF_BYTES:
        raise ProblemError(
            f"the DXF file has {len(content)} bytes; at most {_MOST_DXF_BYTES} can be read; simplify the drawing"
        )
    with collected_warnings("ezdxf") as messages:
        try:
            if content.startswith(_BINARY):
                drawing = Drawing.load(binary_tags_loader(content))
                auditor = drawing.audit()
            else:
                try:
                    drawing, auditor = recover.read(io.BytesIO(content))
                except Exception:  # noqa: BLE001 - maybe over an annotation, without which it can be read
                    content, number = _ANNOTATIONS.subn(b"", content)
                    drawing, auditor = recover.read(io.BytesIO(content))
                    found.left_out.append(LeftOut(f"{number} annotations", "at least one of them is damaged"))
        except Exception as error:  # whatever the parser stumbles over
            raise ProblemError(f"not readable as DXF: {error}") from error
    # The parser only logs that it skips parts of a damaged file, and obstacles may be among them.
    for message in messages:
        if "ignor" in message.lower():
            raise ProblemError(f"the DXF file is damaged: {message} Save it again from a CAD program.")
    # The parser repairs an undefined block by deleting its references; here that is a lost obstacle.
    lost = [fix for fix in auditor.fixes if fix.code == AuditError.UNDEFINED_BLOCK]
    # Other programs allow names of layers that AutoCAD does not; shapes are read all the same.
    errors = [error for error in auditor.errors if error.code != AuditError.INVALID_LAYER_NAME]
    for defect in [*errors, *lost]:
        named = re.search(r"\b([A-Z][A-Z0-9_]+)\(#", defect.message)
        kind = defect.entity.dxftype() if defect.entity is not None else named[1] if named else ""
        if kind not in IGNORED:
            raise ProblemError(f"the DXF file is damaged: {defect.message} Save it again from a CAD program.")
        found.left_out.append(LeftOut(kind, f"annotations are not obstacles, and it is damaged: {defect.message}"))
    empty = [fix.message for fix in auditor.fixes if fix.code == AuditError.INVALID_VERTEX_COUNT]
    found.left_out += [LeftOut("polyline", f"it is empty: {message}") for message in empty]
    _refuse_lost(drawing, content, empty)
    return drawing


def _refuse_lost(drawing: "Drawing", content: bytes, empty: Sequence[str]) -> None:
    """Raise an error if the DXF parser returned fewer entities than the text of the file contains.

    Args:
        drawing: the parsed drawing.
        content: bytes of the file.
        empty: the parser's messages about empty polylines, which may be missing.

    Raises:
        ProblemError: entities were lost.
    """
    sections = re.split(rb"(?m)^[ \t]*0[ \t]*\r?\n[ \t]*SECTION[ \t]*\r?$", content)
    drawn = b"".join(part for part in sections if part.split(maxsplit=2)[1:2] in ([b"ENTITIES"], [b"BLOCKS"]))
    held = Counter(kind.decode() for kind in _KIND.findall(drawn))
    held.subtract(entity.dxftype() for block in drawing.blocks for entity in block)
    for kind, number in held.items():
        if kind not in IGNORED | _PARTS and number > sum(f"{kind}(#" in message for message in empty):
            raise ProblemError(
                f"{number} of the entities of type {kind} cannot be read; explode them, or save the file anew"
            )


def _entities(drawing: "Drawing", found: _Findings) -> Iterator[_Placed]:
    """Yield the visible entities of the model space, with block references and multilines replaced by their parts.

    Args:
        drawing: the parsed drawing.
        found: receives invisible entities as left out, and refused block references.

    Raises:
        ProblemError: there are too many entities, or blocks are nested too deep.
    """
    # Names of layers do not distinguish upper and lower case.
    reasons = {layer.dxf.name.lower(): "off" for layer in drawing.layers if layer.is_off()}
    reasons |= {layer.dxf.name.lower(): "frozen" for layer in drawing.layers if layer.is_frozen()}
    pending = [
        _Placed(entity, str(entity.dxf.get("layer", "0")), _kind_and_handle(entity))
        for entity in reversed(list(drawing.modelspace()))
    ]
    count = 0
    while pending:
        item = pending.pop()
        if item.entity.dxftype() == "INSERT":
            pending.extend(reversed(_parts(item, found)))
            count += max(item.entity.mcount, 1)
        elif item.entity.dxftype() == "MLINE":
            lines = list(item.entity.virtual_entities())
            pending.extend(replace(item, entity=line, depth=item.depth + 1) for line in reversed(lines))
        count += 1
        if count > IMPORT.most_elements:
            raise ProblemError(
                f"it draws more than {IMPORT.most_elements} entities, counting those of a block at each "
                "insertion; simplify the drawing"
            )
        layer = item.layer.lower()
        if item.entity.dxftype() in {"INSERT", "MLINE"}:
            continue
        if found.selection.skips(item.layer, item.name):
            continue
        if layer == "defpoints":
            found.leave_out(item, "CAD programs never print the layer defpoints")
        elif layer in reasons:
            found.leave_out(item, f"its layer '{item.layer}' is {reasons[layer]}")
        elif item.entity.dxf.get("invisible", 0):
            found.leave_out(item, "it is invisible")
        else:
            yield item


def _parts(inserted: _Placed, found: _Findings) -> list[_Placed]:
    """Return the entities of a block reference, placed in the drawing; those on layer 0 take the reference's layer."""
    entity = inserted.entity
    block = str(entity.dxf.name)
    if inserted.depth == _DEEPEST:
        raise ProblemError(f"block '{block}' nests blocks more than {_DEEPEST} deep; explode it")
    if entity.dxf.zscale == 0.0:  # seen along z that does not matter, and without height nothing can be turned
        entity.dxf.zscale = 1.0
    definition = entity.block()
    if definition is not None and definition.block.is_xref:
        if found.selection.skips(inserted.layer, block):
            return []
        found.refusals.append(f"INSERT '{block}' refers to another file; bind that file to the drawing")
        return []
    # Copies are counted before they are made: two numbers in a file may ask for a billion.
    held = 0 if definition is None else len(definition)
    if entity.mcount * max(held, 1) > IMPORT.most_elements:
        raise ProblemError(
            f"block '{block}' is inserted {entity.mcount} times with {held} entities; at most "
            f"{IMPORT.most_elements} entities can be drawn; simplify the drawing"
        )

    def skipped(part: Entity, reason: str) -> None:
        layer = _layer_in(inserted, part)
        if part.dxftype() not in IGNORED and not found.selection.skips(layer, block if layer == "0" else layer):
            found.refusals.append(f"{part.dxftype()} in block '{block}' cannot be placed: {reason}")

    parts = []
    for copy in entity.multi_insert() if entity.mcount > 1 else [entity]:
        for part in copy.virtual_entities(skipped_entity_callback=skipped):
            layer = _layer_in(inserted, part)
            name = block if layer == "0" else layer
            parts.append(_Placed(part, layer, name, inserted.depth + 1))
    return parts


def _layer_in(inserted: _Placed, part: Entity) -> str:
    """Return the layer of an entity in a block reference, whose own layer stands in for layer 0."""
    own = str(part.dxf.get("layer", "0"))
    return inserted.layer if own == "0" else own


def _kind_and_handle(entity: Entity) -> str:
    """Return the name for the shape of an entity outside blocks: its layer, or on layer 0 its type and handle."""
    layer = str(entity.dxf.get("layer", "0"))
    return f"{entity.dxftype().lower()} {entity.dxf.get('handle', '')}".strip() if layer == "0" else layer


def _add(item: _Placed, distance: float, found: _Findings) -> None:
    """Add one entity to the results of reading a drawing, as a shape or as an open polyline of its layer.

    Args:
        item: the entity.
        distance: maximum distance between a curve and its polyline [drawing units].
        found: receives the shape or polyline, or the entity as left out.

    Raises:
        ProblemError: the entity cannot be read.
    """
    entity = item.entity
    kind = entity.dxftype()
    if kind in IGNORED:
        found.leave_out(item, _IGNORED_BECAUSE.get(kind, "annotations and images are not obstacles"))
        return
    if kind == "POLYLINE" and (entity.is_poly_face_mesh or entity.is_polygon_mesh):
        kind = "POLYFACE" if entity.is_poly_face_mesh else "POLYMESH"
    if kind in _IN_SPACE:
        found.in_space[kind] += 1
        return
    _turn_upright(entity)

    layer = item.layer
    if kind == "CIRCLE":
        center = entity.dxf.center
        ring = np.array([(center.x, center.y)], dtype=np.float64)
        shape = Shape(item.name, (ring,), "outline", half_width=float(entity.dxf.radius), layer=layer)
    elif kind in {"HATCH", "MPOLYGON"}:
        rings, curved = hatch_rings(entity, distance)
        shape = Shape(item.name, rings, "area", "evenodd", curved, layer=layer)
    elif kind in {"SOLID", "TRACE"}:
        shape = Shape(item.name, (corner_points(entity),), "area", layer=layer)
    elif kind in PIECES:
        piece = replace(PIECES[kind](entity, distance), name=item.name)
        found.points += len(piece.points)
        if np.all(piece.points == piece.points[0]):
            found.leave_out(item, "it has zero length")
            return
        if not piece.closed:
            found.open_pieces.setdefault(layer, []).append(piece)
            return
        shape = _shape(piece, layer)
    else:
        raise ProblemError("entities of this type cannot be read; explode it into polylines, lines and arcs")
    found.shapes.append(shape)
    found.points += 0 if kind in PIECES else shape.size


def _turn_upright(entity: Entity) -> None:
    """Mirror an entity whose normal points along -z, in place, so that its coordinates are those seen along z.

    Raises:
        ProblemError: the entity is not drawn in the x-y plane.
    """
    from ezdxf.upright import upright  # noqa: PLC0415 - loaded only when a DXF file is read

    upright(entity)
    normal = entity.dxf.get("extrusion", None)
    if normal is not None and np.hypot(normal.x, normal.y) > 1e-9 * abs(normal.z) and entity.dxftype() != "LINE":
        raise ProblemError("it does not lie in the x-y plane; rotate it into that plane")


def _chained(pieces: list[Piece], layer: str, distance: float) -> list[Shape]:
    """Return the open polylines of a layer as shapes, after joining them where exactly two ends meet."""
    points = np.concatenate([piece.points for piece in pieces])
    worst = float(np.abs(points).max())
    if not worst <= IMPORT.largest_coordinate:  # also where it is no number
        raise ProblemError(
            f"layer '{layer}' has a coordinate of {worst:.6g}; expected at most {IMPORT.largest_coordinate:g}"
        )
    gap = min(distance, _GAP * float(np.ptp(points, axis=0).max()))
    return [_shape(chain, layer) for chain in joined_pieces(pieces, gap)]


def _shape(piece: Piece, layer: str) -> Shape:
    drawn: Drawn = "outline" if piece.closed else "line"
    return Shape(piece.name, (piece.points,), drawn, "nonzero", piece.curved, piece.half_width, layer)


def _title(item: _Placed) -> str:
    return f"{item.entity.dxftype()} '{item.name}'"
