"""The workspace of the page ``report.html`` as SVG, in metres, y up (the page turns it over)."""

from html import escape

import shapely

from ccm_opt.freespace.workspace import Workspace


def scene_paths(workspace: Workspace, thin: float) -> str:
    """Boundary and obstacles as paths; an obstacle's name appears under the mouse."""
    parts = [
        f'<path d="{_path(workspace.boundary)}" fill="var(--paper)" stroke="var(--edge)" stroke-width="{thin:.5g}"/>'
    ]
    for obstacle in workspace.obstacles:
        outline = obstacle.outline()
        fill = "var(--wall)" if isinstance(outline, shapely.Polygon) else "none"
        parts.append(
            f'<path d="{_path(outline)}" fill="{fill}" fill-rule="evenodd" stroke="var(--edge)" '
            f'stroke-width="{0.6 * thin:.5g}"><title>{escape(obstacle.name)}</title></path>'
        )
    return "".join(parts)


def _path(geometry: shapely.Geometry) -> str:
    if isinstance(geometry, shapely.Polygon):
        return "".join(f"{_line(ring)}Z" for ring in (geometry.exterior, *geometry.interiors))
    return "".join(_line(part) for part in getattr(geometry, "geoms", [geometry]))


def _line(geometry: shapely.Geometry) -> str:
    return "M" + "L".join(f"{x:.6g} {y:.6g}" for x, y in shapely.get_coordinates(geometry))
