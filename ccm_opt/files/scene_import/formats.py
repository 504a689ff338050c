"""The formats of drawings: which reader reads which kind of file. A new format is a reader of its own and a line here.

A reader is a function of a file's bytes and of the distance that may lie between a curve and the polyline that stands
for it, both in the drawing's own unit. It returns the shapes that it finds (``found_shapes``), and raises a
``ProblemError`` for what it cannot read. What follows (placement, repair, naming) is the same for all formats.
"""

from collections.abc import Mapping

from ccm_opt.files.scene_import.dxf import read_dxf
from ccm_opt.files.scene_import.found_shapes import Reader
from ccm_opt.files.scene_import.geojson import read_geojson
from ccm_opt.files.scene_import.svg import read_svg
from ccm_opt.files.scene_import.wkt import read_wkt

READERS: Mapping[str, Reader] = {
    ".svg": read_svg,
    ".dxf": read_dxf,
    ".geojson": read_geojson,
    ".json": read_geojson,
    ".wkt": read_wkt,
}
"""Reader by the suffix of the file, in small letters."""
