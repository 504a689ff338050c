"""The film ``motion.gif``: the scene is drawn once, and the arm on top of it in every frame."""

from dataclasses import dataclass
from io import BytesIO

import numpy as np
import shapely
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.arm_drawing import draw_tip_path
from ccm_opt.files.plotting.picture_settings import FILM, FilmSettings
from ccm_opt.files.plotting.workspace_drawing import draw_workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import Solution

_FIGURE_SIDE = 4.8
"""Longest side of the figure behind a frame [inch]; only the size of its text depends on it."""


def motion_gif(solution: Solution, settings: FilmSettings = FILM) -> bytes:
    """The motion of a plan as an animated GIF, in real time unless it is too long for that.

    Args:
        solution: the plan.
        settings: size and number of the frames.

    Returns:
        The content of a GIF file.
    """
    time = solution.trajectory.time
    points = solution.joint_positions
    count = int(np.clip(np.ceil(settings.frames_a_second * time[-1]), 2, settings.most_frames))
    shown = np.searchsorted(time, np.linspace(0.0, time[-1], count))
    scene, to_pixels = _scene(solution, points, settings)
    width = max(2.0 * solution.problem.arm.radius * to_pixels.pixels_a_metre, settings.least_body)
    frames = [_frame(scene, to_pixels(points[k]), width, settings) for k in shown]

    # One palette for all frames: a palette each would make the colours flicker.
    palette = frames[-1].quantize(settings.colours)
    flat = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    step = max(1000.0 * float(time[-1]) / count, 1000.0 / settings.frames_a_second)
    durations = [round(step)] * (count - 1) + [settings.last_frame]
    buffer = BytesIO()
    flat[0].save(buffer, "GIF", save_all=True, append_images=flat[1:], duration=durations, loop=0, optimize=False)
    return buffer.getvalue()


def _scene(solution: Solution, points: FloatArray, settings: FilmSettings) -> tuple[Image.Image, "_PixelMap"]:
    """The picture behind the arm, and what takes the plane to its pixels."""
    xmin, ymin, xmax, ymax = solution.problem.workspace.boundary.bounds
    longest = max(xmax - xmin, ymax - ymin)
    width = max(1.0, _FIGURE_SIDE * (xmax - xmin) / longest)
    height = max(1.0, _FIGURE_SIDE * (ymax - ymin) / longest)
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure = Figure(figsize=(width, height), dpi=settings.longest_side / _FIGURE_SIDE)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        draw_workspace(axes, solution.problem.workspace)
        draw_tip_path(axes, points[:, -1])
        canvas.draw()  # type: ignore[no-untyped-call]
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]
        ends = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    return image, _PixelMap(ends[0], ends[1] - ends[0], image.height)


@dataclass(frozen=True)
class _PixelMap:
    """Takes points of the plane to pixels, y down.

    Attributes:
        origin: pixel of the plane's origin, y up, shape (2,).
        scale: pixels to a metre, shape (2,).
        height: of the picture [pixel].
    """

    origin: FloatArray
    scale: FloatArray
    height: int

    @property
    def pixels_a_metre(self) -> float:
        return float(self.scale[0])

    def __call__(self, points: FloatArray) -> FloatArray:
        pixels = self.origin + points * self.scale
        pixels[..., 1] = self.height - pixels[..., 1]
        return np.asarray(pixels)


def _frame(scene: Image.Image, pixels: FloatArray, width: float, settings: FilmSettings) -> Image.Image:
    """The scene with the arm: its body and its axis."""
    times = settings.oversampling
    line = shapely.LineString(times * pixels)
    body = line.buffer(0.5 * times * width)
    axis = line.buffer(settings.axis_width * times)
    frame = scene.copy()
    frame.paste(style.GOAL_ARM, mask=_mask(scene, body, settings.body_opacity, times))
    frame.paste(style.GOAL_ARM_EDGE, mask=_mask(scene, axis, 255, times))
    return frame


def _mask(scene: Image.Image, body: shapely.Geometry, value: int, times: int) -> Image.Image:
    """Where a body, drawn so many times larger, covers the scene; shrinking makes its edges smooth."""
    large = Image.new("L", (times * scene.width, times * scene.height))
    draw = ImageDraw.Draw(large)
    for part in getattr(body, "geoms", [body]):
        draw.polygon(_corners(part.exterior), fill=value)
        for hole in part.interiors:
            draw.polygon(_corners(hole), fill=0)
    return large.resize(scene.size, Image.Resampling.BOX)


def _corners(ring: shapely.LinearRing) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in shapely.get_coordinates(ring)]
