"""Films of a motion: the scene is drawn once, and the arm on top of it in every frame, where it is alone."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.action_window import action_window
from ccm_opt.files.plotting.arm_drawing import draw_tip_path
from ccm_opt.files.plotting.drawn_plan import DrawnPlan
from ccm_opt.files.plotting.picture_settings import FILM, FilmSettings
from ccm_opt.files.plotting.plan import draw_goals
from ccm_opt.files.plotting.workspace_drawing import draw_workspace
from ccm_opt.ground.arrays import FloatArray, IntArray

_FIGURE_SIDE = 4.8
"""Longest side of the figure behind a frame [inch]; only the size of its text depends on it."""
_HUNDREDTH = 10
"""Shortest time that a film in GIF can tell [ms]."""


def motion_gif(plan: DrawnPlan, settings: FilmSettings = FILM) -> bytes:
    """The motion of a plan as an animated GIF, in real time unless it is too long for that.

    Args:
        plan: the plan.
        settings: size and number of the frames.

    Returns:
        The content of a GIF file.
    """
    film = Film.of_plan(plan, settings, settings.frames_a_second, settings.most_frames)
    frames = list(film.frames())
    # One palette for all frames: a palette each would make the colours flicker.
    palette = frames[-1].quantize(settings.colours)
    flat = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    # Every frame ends at a whole hundredth of a second, so that what is lost in one is won back in the next.
    ends = np.round(np.linspace(0.0, 1e3 * film.seconds, len(flat))[1:] / _HUNDREDTH) * _HUNDREDTH
    durations = [*np.maximum(np.diff(ends, prepend=0.0), _HUNDREDTH).astype(int).tolist(), settings.last_frame]
    buffer = BytesIO()
    flat[0].save(buffer, "GIF", save_all=True, append_images=flat[1:], duration=durations, loop=0, optimize=False)
    return buffer.getvalue()


@dataclass(frozen=True)
class Film:
    """The frames of a motion.

    Attributes:
        plan: the plan.
        settings: sizes.
        samples: that are shown, one a frame.
        seconds: for which all frames but the last are shown [s].
    """

    plan: DrawnPlan
    settings: FilmSettings
    samples: IntArray
    seconds: float

    @classmethod
    def of_plan(cls, plan: DrawnPlan, settings: FilmSettings, rate: int, most: int) -> "Film":
        """The film of a plan with so many frames a second, and at most so many in all."""
        time = plan.trajectory.time
        wanted = int(np.ceil(rate * time[-1])) + 1
        count = int(np.clip(wanted, 2, most))
        shown = np.searchsorted(time, np.linspace(0.0, time[-1], count))
        return cls(plan, settings, shown, float(time[-1]) if count == wanted else (count - 1) / rate)

    def frames(self) -> Iterator[Image.Image]:
        """The frames, RGB, all of one size."""
        plan = self.plan
        scene, to_pixels = _scene(plan, self.settings)
        width = max(2.0 * plan.problem.arm.radius * to_pixels.pixels_a_metre, self.settings.least_body)
        brush = ArmBrush(width, self.settings)
        brush.paint(scene, to_pixels(plan.points[0].copy()), style.START, style.START_EDGE, self.settings.start_opacity)
        time = plan.trajectory.time
        faster = time[-1] / self.seconds if self.seconds > 0.0 else 1.0
        clock = _Clock(faster, self.settings)
        for k in self.samples:
            frame = scene.copy()
            colours = (style.GOAL_ARM, style.GOAL_ARM_EDGE)
            brush.paint(frame, to_pixels(plan.points[k].copy()), *colours, self.settings.body_opacity)
            clock.show(frame, float(time[k]), float(time[k] / max(time[-1], 1e-12)))
            yield frame


def _scene(plan: DrawnPlan, settings: FilmSettings) -> tuple[Image.Image, "_PixelMap"]:
    """The picture behind the arm, and what takes the plane to its pixels."""
    xmin, ymin, xmax, ymax = window = action_window(plan.problem, plan.points)
    longest = max(xmax - xmin, ymax - ymin)
    width = _FIGURE_SIDE * (xmax - xmin) / longest
    height = _FIGURE_SIDE * (ymax - ymin) / longest
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure = Figure(figsize=(width, height), dpi=settings.longest_side / _FIGURE_SIDE)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        draw_workspace(axes, plan.problem.workspace, window=window)
        draw_tip_path(axes, plan.points[:, -1])
        draw_goals(axes, plan, poses=False)
        axes.plot(*plan.points[0, 0], marker="s", markersize=5, color=style.BOUNDARY, zorder=8)
        canvas.draw()  # type: ignore[no-untyped-call]
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]
        ends = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    # The time stands below the drawing, where it covers nothing; a video cannot have sides of odd length.
    high = image.height + _strip_height(settings)
    scene = Image.new("RGB", (image.width - image.width % 2, high - high % 2), "white")
    scene.paste(image, (0, 0))
    return scene, _PixelMap(ends[0], ends[1] - ends[0], image.height)


def _letter_height(settings: FilmSettings) -> int:
    """Of the time, in a film of any size [pixel]."""
    return round(settings.clock_size * settings.longest_side / FILM.longest_side)


def _strip_height(settings: FilmSettings) -> int:
    """Of the strip below the drawing, for the time and the bar [pixel]."""
    return 2 * _letter_height(settings) + settings.bar_height


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


@dataclass(frozen=True)
class ArmBrush:
    """Paints the arm into a frame: its body and its axis, with smooth edges.

    Attributes:
        width: of the body [pixel].
        settings: sizes.
    """

    width: float
    settings: FilmSettings

    def paint(self, frame: Image.Image, pixels: FloatArray, body: str, axis: str, opacity: int) -> None:
        """Paint one pose (links + 1, 2) [pixel]; only the box around it is touched."""
        reach = 0.5 * self.width + 2.0
        low = np.maximum(np.floor(pixels.min(axis=0) - reach), 0.0).astype(int)
        high = np.minimum(np.ceil(pixels.max(axis=0) + reach), frame.size).astype(int)
        if np.any(high <= low):
            return
        size = (int(high[0] - low[0]), int(high[1] - low[1]))
        place = (int(low[0]), int(low[1]))
        for width, colour, value in ((self.width, body, opacity), (2.0 * self.settings.axis_width, axis, 255)):
            mask = self._mask(pixels - low, size, width, value)
            frame.paste(colour, (*place, place[0] + size[0], place[1] + size[1]), mask)

    def _mask(self, pixels: FloatArray, size: tuple[int, int], width: float, value: int) -> Image.Image:
        """Where a line of a width covers a box; drawn much larger, so that shrinking makes its edges smooth."""
        times = self.settings.oversampling
        large = Image.new("L", (times * size[0], times * size[1]))
        draw = ImageDraw.Draw(large)
        points = (times * pixels).tolist()
        draw.line([tuple(point) for point in points], fill=value, width=max(round(times * width), 1))
        # Round joints and ends, which make the body the union of capsules that it is.
        half = max(0.5 * times * width - 0.5, 0.5)
        for x, y in points:
            draw.ellipse((x - half, y - half, x + half, y + half), fill=value)
        return large.reduce(times)


class _Clock:
    """The time below the drawing, and a bar along the lower edge that grows with it.

    Args:
        faster: by which factor the film is faster than the motion.
        settings: sizes.
    """

    def __init__(self, faster: float, settings: FilmSettings) -> None:
        fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
        size = _letter_height(settings)
        self._font = ImageFont.truetype(str(fonts / "DejaVuSans.ttf"), size)
        self._note = f"  {faster:.2g} times as fast" if faster > settings.told_factor else ""
        self._margin = size // 2
        self._bar = settings.bar_height

    def show(self, frame: Image.Image, time: float, share: float) -> None:
        """Write the time, and draw the bar for the share of the motion that is over."""
        draw = ImageDraw.Draw(frame)
        place = (self._margin, frame.height - 3 * self._margin - self._bar)
        draw.text(place, f"{time:.2f} s{self._note}", fill=style.BOUNDARY, font=self._font)
        draw.rectangle((0, frame.height - self._bar, round(share * frame.width), frame.height), fill=style.GOAL_ARM)


def video_settings(settings: FilmSettings = FILM) -> FilmSettings:
    """The settings of a film with the size of a video."""
    return replace(settings, longest_side=settings.video_side, oversampling=2)
