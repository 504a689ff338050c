"""The travelling hairpin in some moments: the old shape, the fold, the strand that follows the track."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.polyline import leg_lengths
from ccm_opt.scene.workspace import Workspace
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import polygon_patch
from concept_pictures.panels import FOLD_EDGE, draw_obstacles, look_at, panels, picture, title

HEIGHT = 5.0
LETTERS = "abcdefgh"


@dataclass(frozen=True)
class HairpinMoment:
    """One moment of the motion.

    Attributes:
        title: above its panel.
        points: joints and tip, shape (links + 1, 2) [m].
        fold_at: arc length from the base at which the fold begins [m]; below 0 when it has passed the base.
        fold_length: length of arm in the fold [m].
        target: where the tip should be, shape (2,) [m].
    """

    title: str
    points: FloatArray
    fold_at: float
    fold_length: float
    target: FloatArray

    @property
    def middles(self) -> FloatArray:
        """Arc length of the links' middles, shape (links,) [m]."""
        lengths = leg_lengths(self.points)
        return np.asarray(np.cumsum(lengths) - 0.5 * lengths, dtype=np.float64)


@dataclass(frozen=True)
class HairpinScene:
    """A travelling hairpin.

    Attributes:
        workspace: the room.
        radius: of the arm [m].
        track: along which the tip is led, shape (k, 2) [m].
        moments: in order; an even number.
        box: part of the plane that is shown, xmin, ymin, xmax, ymax [m].
    """

    workspace: Workspace
    radius: float
    track: FloatArray
    moments: Sequence[HairpinMoment]
    box: tuple[float, float, float, float]


def hairpin_png(scene: HairpinScene) -> bytes:
    """The picture of a scene as the content of a PNG file."""
    return picture(lambda: hairpin_figure(scene))


def hairpin_figure(scene: HairpinScene) -> Figure:
    """A panel for every moment, two in a row, and one legend."""
    figure, axes = panels(len(scene.moments) // 2, 2, HEIGHT)
    for each, moment, letter in zip(axes, scene.moments, LETTERS, strict=False):
        title(each, letter, moment.title)
        look_at(each, scene.box)
        draw_obstacles(each, scene.workspace)
        each.plot(scene.track[:, 0], scene.track[:, 1], **_TRACK)
        _draw_parts(each, moment, scene.radius)
        each.plot(*moment.target, **_TARGET)
        each.plot(*moment.points[0], **_BASE)
    _name_parts(axes[0])
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower left", ncols=6, frameon=False, fontsize=style.FONT_SIZE - 0.5)
    return figure


_TRACK: dict[str, Any] = {
    "color": style.TIP_PATH,
    "linestyle": (0, (3, 2)),
    "linewidth": 0.9,
    "zorder": 1.5,
    "label": "track",
}
_TARGET: dict[str, Any] = {
    "marker": "o", "markersize": 7, "markerfacecolor": "none", "markeredgecolor": style.TIP_PATH,
    "markeredgewidth": 1.3, "linestyle": "none", "zorder": 9, "label": "target of the tip",
}  # fmt: skip
_BASE: dict[str, Any] = {
    "marker": "s", "markersize": 5, "color": style.BOUNDARY, "linestyle": "none", "zorder": 8, "label": "base",
}  # fmt: skip
_PARTS = (
    ("still on the old shape", style.START, style.START_EDGE),
    ("hairpin", style.FOLD, FOLD_EDGE),
    ("on the track", style.GOAL_ARM, style.GOAL_ARM_EDGE),
)


def _draw_parts(axes: Axes, moment: HairpinMoment, radius: float) -> None:
    """The arm in three colours; each part is drawn from joint to joint."""
    before = moment.middles < moment.fold_at
    behind = moment.middles > moment.fold_at + moment.fold_length
    for mask, (_, face, edge) in zip((before, ~before & ~behind, behind), _PARTS, strict=True):
        _draw_links(axes, moment.points, mask, radius, face, edge)
    axes.plot(
        moment.points[:, 0], moment.points[:, 1], color="white", marker="o", markersize=1.1, linewidth=0.0, zorder=5
    )


def _draw_links(axes: Axes, points: FloatArray, mask: BoolArray, radius: float, face: str, edge: str) -> None:
    chosen = np.flatnonzero(mask)
    if len(chosen) == 0:
        return
    line = shapely.LineString(points[chosen[0] : chosen[-1] + 2])
    body = shapely.buffer(line, radius)
    axes.add_patch(polygon_patch(body, facecolor=face, edgecolor=edge, linewidth=0.7, zorder=4))


def _name_parts(axes: Axes) -> None:
    """Entries of the legend for the arm's parts."""
    for name, face, edge in _PARTS:
        axes.fill([], [], facecolor=face, edgecolor=edge, linewidth=0.7, label=name)
