"""Draws the arm into a picture: its body as the union of capsules, its links as a line, the path of its tip."""

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.workspace_drawing import polygon_patch
from ccm_opt.ground.arrays import FloatArray


def draw_body(
    axes: Axes, points: FloatArray, radius: float, face: str, edge: str, *, label: str, zorder: float
) -> None:
    """Draw the arm in one pose.

    Args:
        axes: where to draw.
        points: joint and tip positions, shape (links + 1, 2) [m].
        radius: of the capsules [m]; a line stands for zero.
        face: colour of the body.
        edge: colour of its outline, links and joints.
        label: in the legend.
        zorder: higher is nearer the eye.
    """
    body = shapely.buffer(shapely.LineString(points), radius) if radius > 0.0 else shapely.Polygon()
    for part in getattr(body, "geoms", [body]):
        axes.add_patch(
            polygon_patch(part, facecolor=face, edgecolor=edge, linewidth=0.8, alpha=0.85, zorder=zorder, label=label)
        )
    width = 0.7 if radius > 0.0 else 1.5
    axes.plot(
        points[:, 0],
        points[:, 1],
        color=edge,
        linewidth=width,
        marker="o",
        markersize=min(1.8, 40.0 / len(points)),
        zorder=zorder + 0.1,
    )


def draw_poses(axes: Axes, poses: FloatArray) -> None:
    """Draw poses on the way as thin lines coloured from early to late; ``poses`` has shape (k, links + 1, 2) [m]."""
    shades = colormaps[style.POSE_COLOURS](np.linspace(0.15, 0.85, len(poses)))
    axes.add_collection(LineCollection(list(poses), colors=shades, linewidths=1.1, alpha=0.9, zorder=5))
    middle = shades[len(shades) // 2]
    axes.plot([], [], color=middle, linewidth=1.1, label="on the way, early to late")


def draw_tip_path(axes: Axes, tips: FloatArray) -> None:
    """Draw where the tip goes; ``tips`` has shape (T, 2) [m]."""
    axes.plot(
        tips[:, 0],
        tips[:, 1],
        color=style.TIP_PATH,
        linewidth=1.3,
        linestyle=(0, (4, 2)),
        zorder=7,
        label="path of the tip",
    )
