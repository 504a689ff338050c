"""Obstacles from drawings: SVG, DXF, GeoJSON and WKT files in, named obstacles out."""

from ccm_opt.files.scene_import.drawing import ImportOptions, import_scene

__all__ = ["ImportOptions", "import_scene"]
