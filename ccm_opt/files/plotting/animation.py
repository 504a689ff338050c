"""``motion.gif``: the motion as a short film, the scene drawn once and the arm on top of it in every frame."""

from io import BytesIO

import numpy as np
import shapely
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from ccm_opt.arrays import FloatArray
from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.arm_drawing import draw_tip_path
from ccm_opt.files.plotting.room import draw_workspace
from ccm_opt.solution import Solution

LONGEST_SIDE = 480
"""Longest side of a frame [pixel]."""
FRAMES_A_SECOND, MOST_FRAMES = 20, 80
LAST_FRAME = 900
"""How long the last frame stands [ms]."""
FINENESS = 2
"""The arm is drawn this much larger and shrunk, so that its edges are smooth."""


def motion_gif(solution: Solution) -> bytes:
    """The motion of a plan as an animated GIF, in real time unless it is too long for that.

    Args:
        solution: the plan.

    Returns:
        The content of a GIF file.
    """
    time, points = solution.trajectory.time, solution.joint_positions
    count = int(np.clip(np.ceil(FRAMES_A_SECOND * time[-1]), 2, MOST_FRAMES))
    shown = np.searchsorted(time, np.linspace(0.0, time[-1], count))
    scene, place, scale = _scene(solution, points)
    width = max(2.0 * solution.problem.arm.radius * scale, 1.5)
    frames = [_frame(scene, place(points[k]), width) for k in shown]
    palette = frames[-1].quantize(96)
    flat = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    step = max(1000.0 * float(time[-1]) / count, 1000.0 / FRAMES_A_SECOND)
    durations = [round(step)] * (count - 1) + [LAST_FRAME]
    buffer = BytesIO()
    flat[0].save(buffer, "GIF", save_all=True, append_images=flat[1:], duration=durations, loop=0, optimize=False)
    return buffer.getvalue()


def _scene(solution: Solution, points: FloatArray) -> tuple[Image.Image, "_Place", float]:
    """The picture behind the arm, what takes the plane to its pixels, and pixels to a metre."""
    xmin, ymin, xmax, ymax = solution.problem.workspace.boundary.bounds
    longest = max(xmax - xmin, ymax - ymin)
    size = (max(1.0, 4.8 * (xmax - xmin) / longest), max(1.0, 4.8 * (ymax - ymin) / longest))
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure = Figure(figsize=size, dpi=LONGEST_SIDE / 4.8)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        draw_workspace(axes, solution.problem.workspace)
        draw_tip_path(axes, points[:, -1])
        canvas.draw()  # type: ignore[no-untyped-call]
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]
        ends = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    scale = ends[1] - ends[0]
    return image, _Place(ends[0], scale, image.height), float(scale[0])


class _Place:
    """Takes points of the plane to pixels, y down."""

    def __init__(self, origin: FloatArray, scale: FloatArray, height: int) -> None:
        self._origin, self._scale, self._height = origin, scale, height

    def __call__(self, points: FloatArray) -> FloatArray:
        pixels = self._origin + points * self._scale
        pixels[..., 1] = self._height - pixels[..., 1]
        return np.asarray(pixels)


def _frame(scene: Image.Image, pixels: FloatArray, width: float) -> Image.Image:
    """The scene with the arm: its body and its axis."""
    line = shapely.LineString(FINENESS * pixels)
    frame = scene.copy()
    frame.paste(style.GOAL_ARM, mask=_mask(scene, line.buffer(0.5 * FINENESS * width), 215))
    frame.paste(style.GOAL_ARM_EDGE, mask=_mask(scene, line.buffer(0.7 * FINENESS), 255))
    return frame


def _mask(scene: Image.Image, body: shapely.Geometry, value: int) -> Image.Image:
    """Where a body covers the scene, its edges smooth."""
    large = Image.new("L", (FINENESS * scene.width, FINENESS * scene.height))
    draw = ImageDraw.Draw(large)
    for part in getattr(body, "geoms", [body]):
        draw.polygon(_corners(part.exterior), fill=value)
        for hole in part.interiors:
            draw.polygon(_corners(hole), fill=0)
    return large.resize(scene.size, Image.Resampling.BOX)


def _corners(ring: shapely.LinearRing) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in shapely.get_coordinates(ring)]
