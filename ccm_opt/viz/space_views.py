"""Views of a scene in space: its bodies seen through from one side, the arm as a band, in matplotlib's axes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from PIL import Image, ImageDraw

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.scene.surfaces import all_within, seen_triangles, sharp_edges
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.settings import SPACE_PICTURES, SpacePictureSettings

_LEAST_TRIANGLES = 200
"""Of one body, however many there are."""
_FEWEST_SIDES = 12
"""Of them where there are so many bodies that each may have few triangles only."""
_GLASS_PIXELS = 700
"""Of the longer side of a view, in which bodies are drawn."""


@dataclass(frozen=True)
class Side:
    """A direction in which a scene is looked at.

    Attributes:
        name: of the view.
        across: number of the coordinate that grows to the right, or weights of the three, shape (3,).
        up: likewise of the one that grows upwards.
        labels: of both axes.
    """

    name: str
    across: FloatArray
    up: FloatArray
    labels: tuple[str, str]

    def __call__(self, points: FloatArray) -> FloatArray:
        """Places in the picture, shape (..., 3) to (..., 2) [m]."""
        return np.stack((points @ self.across, points @ self.up), axis=-1)


_X, _Y, _Z = np.eye(3)
SIDES = (
    Side("from above", _X, _Y, ("x", "y")),
    Side("from the front", _X, _Z, ("x", "z")),
    Side("from the left", _Y, _Z, ("y", "z")),
)
"""The three sides of a plan's picture."""
SLANTED = Side(
    "slanted",
    np.array([np.cos(0.6), -np.sin(0.6), 0.0]),
    np.array([0.42 * np.sin(0.6), 0.42 * np.cos(0.6), np.sqrt(1.0 - 0.42**2)]),
    ("", ""),
)
"""From before and above, as a film shows it."""


@dataclass(frozen=True)
class SeenScene:
    """The bodies of a problem as triangles that are few enough to be drawn.

    Attributes:
        problem: what is shown.
        settings: how many.
    """

    problem: SpaceProblem
    settings: SpacePictureSettings = SPACE_PICTURES

    @cached_property
    def bodies(self) -> list[tuple[FloatArray, IntArray]]:
        """Corners, shape (v, 3) [m], and faces, shape (m, 3), of every body; the sides of the room are none."""
        obstacles = self.problem.workspace.obstacles
        extent = float(np.max(np.ptp(self.problem.workspace.extent, axis=0), initial=self.problem.arm.length))
        settings = self.settings
        # A ball of n sides has about n² triangles.
        fine = settings.most_triangles >= len(obstacles) * settings.round_sides**2
        sides = settings.round_sides if fine else _FEWEST_SIDES
        surfaces = [seen_triangles(obstacle.body, sides) for obstacle in obstacles]
        return all_within(surfaces, settings.most_triangles, _LEAST_TRIANGLES, settings.cell * extent)

    @cached_property
    def edges(self) -> list[FloatArray]:
        """Ends of the sharp edges of every body, shape (k, 2, 3) [m]."""
        sharp = self.settings.sharp
        return [vertices[sharp_edges(vertices, faces, sharp)] for vertices, faces in self.bodies]

    def begin_view(self, axes: Axes, side: Side, window: FloatArray) -> None:
        """Draw room and bodies from a side, within a box, whose corners have the shape (2, 3) [m]."""
        low, high = side(window)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        self.draw_room(axes, side)
        self.draw(axes, side)
        axes.set_aspect("equal", adjustable="box", anchor="NW")

    def draw(self, axes: Axes, side: Side) -> None:
        """Draw every body as one sheet of glass with its edges; the limits of the axes must be set."""
        low = np.array([axes.get_xlim()[0], axes.get_ylim()[0]])
        high = np.array([axes.get_xlim()[1], axes.get_ylim()[1]])
        scale = _GLASS_PIXELS / float(np.max(high - low))
        size = np.maximum(np.round(scale * (high - low)), 1.0).astype(np.intp)
        sheets = np.zeros(size[::-1], dtype=np.intp)
        for vertices, faces in self.bodies:
            _lay_sheet(sheets, scale * (side(vertices) - low), faces)
        picture = np.empty((*sheets.shape, 4), dtype=np.float32)
        picture[..., :3] = to_rgb(style.WALL_EDGE)
        picture[..., 3] = (1.0 - (1.0 - self.settings.glass) ** np.arange(len(self.bodies) + 1))[sheets]
        extent = (low[0], high[0], low[1], high[1])
        axes.imshow(picture, extent=extent, origin="lower", interpolation="bilinear", zorder=1, aspect="auto")
        self._draw_edges(axes, side)

    def draw_cut(self, axes: Axes, side: Side, across: int, at: float) -> None:
        """Draw the outlines along which a plane cuts the bodies.

        Args:
            axes: drawn on.
            side: from which the plane is seen.
            across: the coordinate axis that the plane is normal to.
            at: coordinate of the plane [m].
        """
        for vertices, faces in self.bodies:
            corners = vertices[faces]
            above = corners[..., across] > at
            cut = corners[above.any(axis=1) & ~above.all(axis=1)]
            # Two of the three sides of such a triangle pass through the plane.
            following = np.roll(cut, -1, axis=1)
            height, next_height = cut[..., across] - at, following[..., across] - at
            through = (height > 0.0) != (next_height > 0.0)
            share = (height[through] / (height - next_height)[through])[:, None]
            ends = (cut[through] + share * (following - cut)[through]).reshape(-1, 2, 3)
            axes.add_collection(LineCollection(list(side(ends)), colors=style.WALL_EDGE, linewidths=0.9, zorder=1.5))

    def _draw_edges(self, axes: Axes, side: Side) -> None:
        """All sharp edges, each by itself: where several lie upon each other they are darker."""
        ends = side(np.concatenate([np.zeros((0, 2, 3)), *self.edges]))
        edges = LineCollection(list(ends), colors=style.WALL_EDGE, linewidths=0.4, alpha=0.7, zorder=1.5)
        axes.add_collection(edges)

    def draw_room(self, axes: Axes, side: Side) -> None:
        """Draw the outline of the room where there is one."""
        bounds = self.problem.workspace.bounds
        if bounds is None:
            return
        corners = side(_corners(bounds))
        edges = [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]
        lines = [corners[list(edge)] for edge in edges]
        axes.add_collection(LineCollection(lines, colors=style.BOUNDARY, linewidths=0.6, alpha=0.5, zorder=0.5))


def _lay_sheet(sheets: IntArray, flat: FloatArray, faces: IntArray) -> None:
    """Count one sheet more at all pixels that a body covers.

    Args:
        sheets: of glass at every pixel, shape (height, width), y up.
        flat: corners of the body, shape (v, 2) [pixel].
        faces: shape (m, 3).
    """
    whole = np.floor(flat[faces]).astype(np.intp)
    # Only the part of the picture that the body may cover is looked at.
    first = np.maximum(whole.min(axis=(0, 1)), 0)
    last = np.minimum(whole.max(axis=(0, 1)) + 1, sheets.shape[::-1])
    if np.any(last <= first):
        return
    mask = Image.new("L", tuple((last - first).tolist()))
    brush = ImageDraw.Draw(mask)
    for corners in (whole - first).reshape(-1, 6).tolist():
        brush.polygon(corners, fill=1)
    sheets[first[1] : last[1], first[0] : last[0]] += np.asarray(mask)


def seen_window(side: Side, window: FloatArray) -> FloatArray:
    """Lower left and upper right corner of what is seen of a box, shape (2, 3) [m], in the picture, shape (2, 2)."""
    seen = side(_corners(window))
    return np.stack((seen.min(axis=0), seen.max(axis=0)))


def _corners(box: FloatArray) -> FloatArray:
    """All corners of a box between two of them, shape (2, 3) [m], in the order of binary numbers, shape (8, 3)."""
    counted = np.arange(8)[:, None] >> np.arange(3) & 1
    return np.asarray(np.where(counted == 1, box[1], box[0]))


def window_of(problem: SpaceProblem, points: FloatArray) -> FloatArray:
    """Corners of the box in which the arm moves, and of what is near it, shape (2, 3) [m]."""
    margin = 3.0 * max(problem.arm.radius, 0.5 * problem.arm.link_length)
    low = points.min(axis=(0, 1)) - margin
    high = points.max(axis=(0, 1)) + margin
    # Of a duct that the arm goes through so much is shown that one can tell where it leads.
    extent = problem.workspace.extent
    near = 0.15 * problem.arm.length
    if len(problem.workspace.soup):
        low = np.maximum(np.minimum(low, extent[0]), low - near)
        high = np.minimum(np.maximum(high, extent[1]), high + near)
    return np.stack((low, high))
