"""The film ``motion.gif`` of a plan in space: the scene from before and above, drawn once, and the arm on top of it."""

from dataclasses import replace
from io import BytesIO

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.animation import ArmBrush
from ccm_opt.files.plotting.picture_settings import FILM, SPACE_PICTURES, SpacePictureSettings
from ccm_opt.files.plotting.space_plan import draw_goals_in_space
from ccm_opt.files.plotting.space_views import SLANTED, SeenScene, window_of
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.space_solution import SpacePlan


def space_motion_gif(plan: SpacePlan, settings: SpacePictureSettings = SPACE_PICTURES) -> bytes:
    """The motion of a plan in space as an animated GIF, faster than it is where it is long."""
    points = plan.joint_positions
    time = plan.trajectory.time
    count = int(np.clip(np.ceil(settings.film_rate * time[-1]), 2, settings.film_frames))
    shown = np.searchsorted(time, np.linspace(0.0, time[-1], count))
    scene, pixels, scale = _scene(plan, points, settings)
    brush = ArmBrush(max(2.0 * plan.problem.arm.radius * scale, FILM.least_body), replace(FILM, oversampling=2))
    frames = []
    for sample in shown:
        frame = scene.copy()
        brush.paint(frame, pixels(points[sample]), style.GOAL_ARM, style.GOAL_ARM_EDGE, FILM.body_opacity)
        ImageDraw.Draw(frame).text((6, frame.height - 16), f"{time[sample]:.1f} s", fill=style.BOUNDARY)
        frames.append(frame)
    palette = frames[-1].quantize(settings.colours)
    flat = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [round(1000 / settings.film_rate)] * (len(flat) - 1) + [1500]
    buffer = BytesIO()
    flat[0].save(buffer, "GIF", save_all=True, append_images=flat[1:], duration=durations, loop=0, optimize=False)
    return buffer.getvalue()


def _scene(plan: SpacePlan, points: FloatArray, settings: SpacePictureSettings) -> tuple[Image.Image, "_Pixels", float]:
    """The picture behind the arm, what takes places to its pixels, and pixels a metre."""
    window = window_of(plan.problem, points)
    counted = np.arange(8)[:, None] >> np.arange(3) & 1
    flat = SLANTED(np.where(counted == 1, window[1], window[0]))
    low = flat.min(axis=0)
    high = flat.max(axis=0)
    size = settings.film_side * (high - low) / float(np.max(high - low))
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure = Figure(figsize=tuple(size / 100.0), dpi=100)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        seen = SeenScene(plan.problem, settings)
        seen.draw_room(axes, SLANTED)
        seen.draw(axes, SLANTED)
        axes.plot(*SLANTED(points[:, -1]).T, color=style.TIP_PATH, linewidth=1.0, linestyle=(0, (4, 2)), zorder=7)
        draw_goals_in_space(axes, plan, SLANTED, points)
        canvas.draw()  # type: ignore[no-untyped-call]
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]
    scale = image.width / float(high[0] - low[0])
    return image, _Pixels(low, scale, image.height), scale


class _Pixels:
    """Takes places to pixels, y down.

    Args:
        low: place of the lower left corner in the picture, shape (2,) [m].
        scale: pixels a metre.
        height: of the picture [pixel].
    """

    def __init__(self, low: FloatArray, scale: float, height: int) -> None:
        self._low = low
        self._scale = scale
        self._height = height

    def __call__(self, points: FloatArray) -> FloatArray:
        flat = (SLANTED(points) - self._low) * self._scale
        flat[..., 1] = self._height - flat[..., 1]
        return np.asarray(flat)
