"""The workspace of the page ``report.html`` as SVG, in metres, y up (the page turns it over)."""

from html import escape

import numpy as np
import shapely

from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray


def view_box(workspace: Workspace, margin_share: float) -> str:
    """The part of the plane that is shown, y down.

    Args:
        workspace: its boundary is shown whole.
        margin_share: room round the boundary, as a share of its longest side.
    """
    xmin, ymin, xmax, ymax = workspace.boundary.bounds
    margin = margin_share * max(xmax - xmin, ymax - ymin)
    return f"{xmin - margin:.6g} {-ymax - margin:.6g} {xmax - xmin + 2 * margin:.6g} {ymax - ymin + 2 * margin:.6g}"


def scene_paths(workspace: Workspace, thin: float) -> str:
    """Boundary and obstacles as paths; an obstacle's name appears under the mouse."""
    parts = [f'<path d="{_path(workspace.boundary)}" fill="white" stroke="#4a4740" stroke-width="{thin:.5g}"/>']
    for obstacle in workspace.obstacles:
        outline = obstacle.outline()
        fill = "var(--wall)" if isinstance(outline, shapely.Polygon) else "none"
        parts.append(
            f'<path d="{_path(outline)}" fill="{fill}" fill-rule="evenodd" stroke="var(--edge)" '
            f'stroke-width="{0.6 * thin:.5g}"><title>{escape(obstacle.name)}</title></path>'
        )
    return "".join(parts)


def goal_marks(goals: list[tuple[FloatArray, float | None]], size: float, thin: float) -> str:
    """A ring at every goal, with a line along its heading if it has one."""
    parts = []
    look = f'fill="none" stroke="var(--good)" stroke-width="{thin:.5g}"'
    for (x, y), heading in goals:
        parts.append(f'<circle cx="{x:.6g}" cy="{y:.6g}" r="{size:.5g}" {look}/>')
        if heading is not None:
            ahead = np.array([x, y]) + 4.0 * size * unit_vector(heading)
            parts.append(f'<line x1="{x:.6g}" y1="{y:.6g}" x2="{ahead[0]:.6g}" y2="{ahead[1]:.6g}" {look}/>')
    return "".join(parts)


def _path(geometry: shapely.Geometry) -> str:
    if isinstance(geometry, shapely.Polygon):
        return "".join(f"{_line(ring)}Z" for ring in (geometry.exterior, *geometry.interiors))
    return "".join(_line(part) for part in getattr(geometry, "geoms", [geometry]))


def _line(geometry: shapely.Geometry) -> str:
    return "M" + "L".join(f"{x:.6g} {y:.6g}" for x, y in shapely.get_coordinates(geometry))
