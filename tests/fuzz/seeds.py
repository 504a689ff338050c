"""Small files to begin with, which use much of each format, and words of it: an engine finds no word by chance."""

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import trimesh

from ccm_opt.scene.bodies import BOX_FACES
from tests.space_files import CUBE, binary_stl, cube_3mf

Tag: TypeAlias = tuple[int, object]
"""A code of DXF with its value."""
Entity: TypeAlias = tuple[str, list[Tag]]
"""The kind of an entity of DXF, and its tags."""
DATA = Path(__file__).parents[1] / "data"

SVG = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
width="9cm" viewBox="0 0 9 9">
<style>.a, #b {{ fill-rule: evenodd }} g.c {{ display: none }}</style>
<symbol id="s" viewBox="0 0 2 2"><ellipse cx="1" cy="1" rx="1" ry="50%"/></symbol>
<use xlink:href="#s" width="2" height="2"/><svg x="1" width="3" height="3"><rect rx=".2" width="1" height="1"/></svg>
<path class="a" d="{path}"/><line x2="1" y2="2" style="visibility:visible"/>
<g transform="matrix(1 0 0 1 2 3) scale(2) skewX(9) rotate(30)"><title>t</title><circle r="1in"/></g></svg>"""
PATHS = ("M0 0c1 0 1 1 0 1s-1-1 0-2q1 1 2 0t2 1z", "m1 1a1 2 30 0 1 1 1A1 1 0 10 3 1H0V2h1v-1L0 0l1 1Z")
WKT = (
    "MULTILINESTRING ((0 0, 1 1), (2 2, 3 3, 4 2))",
    "GEOMETRYCOLLECTION (POLYGON EMPTY, LINEARRING (0 0, 1 0, 1 1, 0 0), MULTIPOLYGON (((0 0, 1 0, 1 1, 0 0))))",
    "POINT (1 2)\nMULTIPOINT ((0 0), (1 1))\nCIRCULARSTRING (0 0, 1 1, 2 0)",
    "CURVEPOLYGON (COMPOUNDCURVE ((0 0, 1 0), CIRCULARSTRING (1 0, 2 1, 0 0)))\nTRIANGLE ((0 0, 1 0, 1 1, 0 0))",
)
GEOJSON = (
    '{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}',
    '{"type": "Feature", "id": 1, "geometry": {"type": "MultiLineString", "coordinates": [[[0, 0], [1, 1e3]]]}}',
    '{"type": "GeometryCollection", "geometries": [{"type": "MultiPoint", "coordinates": [[0, 0]]}]}',
)
AT_ORIGIN: list[Tag] = [(10, 0), (20, 0)]
DXF: tuple[Entity, ...] = (
    ("LINE", [*AT_ORIGIN, (11, 1), (21, 2)]),
    ("ARC", [*AT_ORIGIN, (40, 1), (50, 10), (51, 200)]),
    ("CIRCLE", [*AT_ORIGIN, (40, 1), (210, 0), (220, 0), (230, -1)]),
    ("ELLIPSE", [(100, "AcDbEllipse"), *AT_ORIGIN, (11, 2), (21, 0), (40, 0.5), (41, 0), (42, 6.283185307)]),
    ("LWPOLYLINE", [(100, "AcDbPolyline"), (90, 2), (70, 1), (43, 0.1), *AT_ORIGIN, (42, 0.5), (10, 1), (20, 1)]),
    (
        "POLYLINE",
        [(66, 1), (70, 1), (0, "VERTEX"), *AT_ORIGIN, (42, 1), (0, "VERTEX"), (10, 1), (20, 1), (0, "SEQEND")],
    ),
    (
        "SPLINE",
        [
            *((100, "AcDbSpline"), (70, 8), (71, 2), (72, 6), (73, 3)),
            *((40, knot) for knot in (0, 0, 0, 1, 1, 1)),
            *(*AT_ORIGIN, (10, 1), (20, 2), (10, 2), (20, 0)),
        ],
    ),
    ("SOLID", [*AT_ORIGIN, (11, 1), (21, 0), (12, 0), (22, 1), (13, 1), (23, 1)]),
    ("INSERT", [(2, "B"), (10, 1), (20, 1), (41, 2), (42, -1), (50, 30), (70, 2), (71, 2), (44, 3), (45, 3)]),
    ("TEXT", [*AT_ORIGIN, (40, 1), (1, "words")]),
)

WORDS = {
    ".svg": "path rect circle ellipse line polyline polygon use symbol svg style title transform translate scale "
    "rotate skewX skewY matrix viewBox preserveAspectRatio xMidYMid meet slice none display visibility hidden "
    "fill-rule evenodd nonzero href= xlink:href points= px mm cm in % pt <g> </g> <!DOCTYPE <!ENTITY <![CDATA[ &amp; "
    "clipPath",
    ".wkt": "POINT LINESTRING LINEARRING POLYGON MULTIPOINT MULTILINESTRING MULTIPOLYGON GEOMETRYCOLLECTION EMPTY Z M "
    "ZM SRID= CIRCULARSTRING COMPOUNDCURVE CURVEPOLYGON MULTICURVE MULTISURFACE TRIANGLE TIN NaN Inf 1e308",
    ".geojson": '"type" "Feature" "FeatureCollection" "features" "geometry" "geometries" "coordinates" "properties" '
    '"id" "name" "Point" "MultiPoint" "LineString" "MultiLineString" "Polygon" "MultiPolygon" "GeometryCollection" '
    "null true NaN Infinity -1e308 [[ ]] {}",
    ".dxf": "SECTION ENDSEC HEADER TABLES TABLE ENDTAB LAYER BLOCKS BLOCK ENDBLK ENTITIES EOF LINE ARC CIRCLE ELLIPSE "
    "LWPOLYLINE POLYLINE VERTEX SEQEND SPLINE SOLID TRACE 3DFACE HATCH MPOLYGON INSERT TEXT MTEXT POINT RAY "
    "AcDbEntity AcDbSpline AcDbPolyline AcDbEllipse AcDbHatch $ACADVER AC1015 AC1032 $DWGCODEPAGE",
    ".stl": "solid facet normal outer loop vertex endloop endfacet endsolid nan inf 1e308",
    ".obj": "v f vn vt o g s l usemtl mtllib 1/1/1 -1 1//1 nan inf 1e308",
    ".ply": "ply format ascii binary_little_endian binary_big_endian 1.0 comment element vertex face property list "
    "uchar int float double x y z vertex_indices end_header",
    ".glb": '"asset" "version" "scenes" "scene" "nodes" "meshes" "mesh" "primitives" "attributes" "POSITION" "indices" '
    '"mode" "accessors" "bufferView" "bufferViews" "componentType" "count" "type" "VEC3" "SCALAR" "byteOffset" '
    '"byteStride" "byteLength" "buffers" "buffer" "matrix" "children" "rotation" "scale" "translation" "sparse"',
    ".3mf": "model resources object mesh vertices vertex triangles triangle components component objectid= build item "
    "p:path= transform= v1= v2= v3= id= unit= inch requiredextensions= b:beamlattice nan inf 1e308",
}
"""By suffix; what stands between blanks goes into the engine's dictionary."""


def seeds(suffix: str) -> list[bytes]:
    """Small valid files of a format."""
    written = [path.read_bytes() for path in sorted(DATA.glob(f"scene{suffix}"))]
    match suffix:
        case ".svg":
            written += [SVG.format(path=path).encode() for path in PATHS]
        case ".wkt":
            written += [text.encode() for text in WKT]
        case ".geojson":
            written += [text.encode() for text in GEOJSON]
        case ".dxf":
            written += [_dxf([entity]) for entity in DXF] + [_dxf(DXF)]
        case ".stl":
            written += [binary_stl(), _by_trimesh("stl_ascii")]
        case ".3mf":
            packed = cube_3mf(transform='transform="0 1 0 0 0 1 1 0 0 5 6 7"')
            written += [packed, zipfile.ZipFile(io.BytesIO(packed)).read("3D/3dmodel.model")]
        case _:
            written.append(_by_trimesh(suffix[1:]))
    return written


def _by_trimesh(kind: str) -> bytes:
    """The unit cube in a format."""
    content = trimesh.Trimesh(CUBE, BOX_FACES, process=False).export(file_type=kind)
    return content.encode() if isinstance(content, str) else bytes(content)


def _dxf(entities: Sequence[Entity]) -> bytes:
    """A drawing of entities, all on one layer, with a block that they may insert."""
    on_layer = [(kind, [(8, "cut"), (100, "AcDbEntity"), *tags]) for kind, tags in entities]
    block = [("BLOCK", [(8, 0), (2, "B"), (70, 0), (10, 0), (20, 0), (3, "B")]), DXF[0], ("ENDBLK", [(8, 0)])]
    written = [
        *_section("HEADER", [], [(9, "$ACADVER"), (1, "AC1015")]),
        *_section("BLOCKS", block),
        *_section("ENTITIES", on_layer),
        (0, "EOF"),
    ]
    return "".join(f"{code}\n{value}\n" for code, value in written).encode()


def _section(name: str, entities: Sequence[Entity], tags: Sequence[Tag] = ()) -> list[Tag]:
    """The tags of a section."""
    inside = [tag for kind, own in entities for tag in ((0, kind), *own)]
    return [(0, "SECTION"), (2, name), *tags, *inside, (0, "ENDSEC")]
