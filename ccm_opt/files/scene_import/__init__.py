"""Obstacles from drawings: SVG, DXF, GeoJSON and WKT files in (``formats``), named obstacles out (``drawing``)."""

from ccm_opt.files.scene_import.drawing import ImportedScene, import_scene
from ccm_opt.files.scene_import.import_settings import ImportOptions

__all__ = ["ImportOptions", "ImportedScene", "import_scene"]
