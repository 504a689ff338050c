"""Finds places for labels where they cover as little as can be of what is drawn and of other labels."""

from dataclasses import dataclass, field

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from ccm_opt.files.plotting import style
from ccm_opt.ground.arrays import FloatArray

_DIRECTIONS = 24
_DISTANCES = (10.0, 18.0, 28.0, 42.0, 60.0, 84.0)
"""From the place to the label [points]."""
_LETTER = 0.58
"""Width of a letter, as a share of its size, on average."""
_EDGE = 3.0
"""Round what is drawn a label had better keep off, too [points]."""
_OFF_EDGES = 5
"""How much worse it is to stand over an edge of a wall than over poses and paths."""
_OUTSIDE = 6.0
"""How much worse it is to leave the picture than to cover what is drawn."""


@dataclass
class LabelPlaces:
    """Places of labels in one picture.

    Attributes:
        axes: with their limits, size and place in the figure known.
        drawn: what had better not be covered [points].
    """

    axes: Axes
    drawn: list[shapely.Geometry] = field(default_factory=list)

    def keep_off(self, shape: shapely.Geometry) -> None:
        """Note something whose edges would run through letters, in the coordinates of the plane [m]."""
        for _ in range(_OFF_EDGES):
            self.keep_free(shape)

    def keep_free(self, shape: shapely.Geometry) -> None:
        """Note something that is drawn, in the coordinates of the plane [m]."""
        # Thin things count with a margin, or a label would gladly stand over an edge.
        self.drawn.append(shapely.buffer(shapely.transform(shape, self._to_points), _EDGE))

    def keep_names_free(self) -> None:
        """Note all texts that stand in the middle of their place already, such as names of obstacles."""
        for text in self.axes.texts:
            if text.get_horizontalalignment() != "center":
                continue
            x, y = self._to_points(np.array([text.get_position()]))[0]
            along = 0.5 * _LETTER * float(text.get_fontsize()) * len(text.get_text())
            across = 0.65 * float(text.get_fontsize())
            wide, high = (across, along) if text.get_rotation() else (along, across)
            self.drawn.append(shapely.box(x - wide, y - high, x + wide, y + high))

    def write(self, place: FloatArray, text: str, colour: str, size: float) -> None:
        """Write a label beside a place (2,) [m], with a thin line to it."""
        anchor = self._to_points(np.asarray(place)[None])[0]
        width = _LETTER * size * max(len(line) for line in text.splitlines())
        height = 1.3 * size * len(text.splitlines())
        best = min(self._candidates(anchor, width, height), key=lambda box: self._cost(anchor, box))
        self.drawn.append(best)
        middle = np.array([best.centroid.x, best.centroid.y]) - anchor
        self.axes.annotate(
            text, xy=tuple(place), xytext=tuple(middle), textcoords="offset points", ha="center", va="center",
            fontsize=size, color=colour, zorder=12, linespacing=1.1,
            # Round the letters only: a white box would cut a piece out of what it covers.
            path_effects=[withStroke(linewidth=2.4, foreground="white", alpha=0.85)],
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.6, "shrinkA": 0.0, "shrinkB": 4.0},
        )  # fmt: skip

    def _candidates(self, anchor: FloatArray, width: float, height: float) -> list[shapely.Polygon]:
        """Boxes all round the place."""
        found = []
        for distance in _DISTANCES:
            for angle in 2.0 * np.pi * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS:
                across = (distance + 0.5 * width) * np.cos(angle)
                up = (distance + 0.5 * height) * np.sin(angle)
                x = anchor[0] + across
                y = anchor[1] + up
                found.append(shapely.box(x - 0.5 * width, y - 0.5 * height, x + 0.5 * width, y + 0.5 * height))
        return found

    def _cost(self, anchor: FloatArray, box: shapely.Polygon) -> float:
        """What a box covers of what is drawn and how much of it leaves the picture [points²], and how far it is."""
        covered = sum(shapely.intersection(box, shape).area for shape in self.drawn if shapely.intersects(box, shape))
        outside = float(shapely.difference(box, self._window()).area)
        return covered + _OUTSIDE * outside + 0.5 * float(shapely.distance(box, shapely.Point(anchor)))

    def _window(self) -> shapely.Polygon:
        low, high = self._to_points(np.array([[self.axes.get_xlim()[k], self.axes.get_ylim()[k]] for k in (0, 1)]))
        window: shapely.Polygon = shapely.box(low[0], low[1], high[0], high[1])
        return window

    def _to_points(self, places: FloatArray) -> FloatArray:
        left, right = self.axes.get_xlim()
        low, high = self.axes.get_ylim()
        pixels = min(self.axes.bbox.width / (right - left), self.axes.bbox.height / (high - low))
        scale = 72.0 / float(self.axes.figure.dpi) * pixels
        return np.asarray(scale * (np.asarray(places) - np.array([left, low])))


def number_goal(axes: Axes, place: FloatArray, heading: float | None, number: int, size: float) -> None:
    """The number of a goal in a disc, behind the goal's arrow."""
    away = 0.5 * np.pi if heading is None else heading + np.pi
    offset = (11.0 * np.cos(away), 11.0 * np.sin(away))
    axes.annotate(
        str(number), xy=tuple(place), xytext=offset, textcoords="offset points", ha="center", va="center",
        fontsize=size, color="white", weight="bold", zorder=11,
        bbox={"boxstyle": "circle,pad=0.18", "facecolor": style.GOAL_MARK, "edgecolor": "white", "linewidth": 0.6},
    )  # fmt: skip
