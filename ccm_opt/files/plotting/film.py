"""A film of a moving arm: what is behind it is drawn once, and the arm on top of that in every frame.

Who draws what is behind: `animation.py` for an arm in the plane, `space_film.py` for one in space.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TypeAlias

import matplotlib as mpl
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.picture_settings import FILM, FilmSettings
from ccm_opt.ground.arrays import FloatArray, IntArray

_HUNDREDTH = 10
"""Shortest time that a film in GIF can tell [ms]."""
_Box: TypeAlias = tuple[int, int, int, int]
"""Left, upper, right and lower side of a part of a picture [pixel]; the last two are out of it."""


@dataclass(frozen=True)
class PixelMap:
    """Takes points of a drawing to pixels, y down.

    Attributes:
        origin: pixel of the drawing's origin, y up, shape (2,).
        scale: pixels to a metre, shape (2,).
        height: of the picture [pixel].
    """

    origin: FloatArray
    scale: FloatArray
    height: int

    @property
    def pixels_a_metre(self) -> float:
        """The same in both directions."""
        return float(self.scale[0])

    def __call__(self, points: FloatArray) -> FloatArray:
        """The pixels of points, shape (…, 2) [m], which may be in between."""
        pixels = self.origin + points * self.scale
        pixels[..., 1] = self.height - pixels[..., 1]
        return np.asarray(pixels)


@dataclass(frozen=True)
class Backdrop:
    """What is behind the arm in every frame.

    Attributes:
        image: RGB.
        pixels: takes points of the drawing to pixels of the image.
    """

    image: Image.Image
    pixels: PixelMap

    @classmethod
    def above_clock(cls, drawn: Image.Image, pixels: PixelMap, settings: FilmSettings) -> "Backdrop":
        """A drawing with a strip below it for the time, which covers nothing there."""
        high = drawn.height + _strip_height(settings)
        # A video cannot have sides of odd length.
        image = Image.new("RGB", (drawn.width - drawn.width % 2, high - high % 2), "white")
        image.paste(drawn, (0, 0))
        return cls(image, pixels)


@dataclass(frozen=True)
class Film:
    """The frames of a motion.

    Attributes:
        backdrop: behind the arm.
        points: joints and tip in the drawing at the samples of the motion, shape (T, links + 1, 2) [m].
        time: of the samples, shape (T,) [s].
        radius: of the arm [m].
        settings: sizes.
        shown: samples that are shown, one a frame.
        seconds: for which all frames but the last are shown [s].
    """

    backdrop: Backdrop
    points: FloatArray
    time: FloatArray
    radius: float
    settings: FilmSettings
    shown: IntArray
    seconds: float

    @classmethod
    def of_motion(
        cls, backdrop: Backdrop, points: FloatArray, time: FloatArray, radius: float, settings: FilmSettings
    ) -> "Film":
        """The film of a motion, in real time unless that takes more frames than the settings allow."""
        rate = settings.frames_a_second
        wanted = int(np.ceil(rate * time[-1])) + 1
        count = int(np.clip(wanted, 2, settings.most_frames))
        shown = np.searchsorted(time, np.linspace(0.0, time[-1], count))
        seconds = float(time[-1]) if count == wanted else (count - 1) / rate
        return cls(backdrop, points, time, radius, settings, shown, seconds)

    def frames(self) -> Iterator[Image.Image]:
        """The frames, RGB, all of one size."""
        return (frame for frame, _ in self._painted(self._still()))

    def gif(self) -> bytes:
        """The film as the content of an animated GIF file."""
        still = self._still()
        painted = list(self._painted(still))
        # One palette for all frames: a palette each would make the colours flicker.
        palette = painted[-1][0].quantize(self.settings.colours)
        flat_still = still.quantize(palette=palette, dither=Image.Dither.NONE)
        flat = []
        for frame, boxes in painted:
            flat.append(flat_still.copy())
            for box in boxes:
                flat[-1].paste(frame.crop(box).quantize(palette=palette, dither=Image.Dither.NONE), box)
        # Every frame ends at a whole hundredth of a second, so that what is lost in one is won back in the next.
        ends = np.round(np.linspace(0.0, 1e3 * self.seconds, len(flat))[1:] / _HUNDREDTH) * _HUNDREDTH
        durations = [*np.maximum(np.diff(ends, prepend=0.0), _HUNDREDTH).astype(int).tolist(), self.settings.last_frame]
        buffer = BytesIO()
        flat[0].save(buffer, "GIF", save_all=True, append_images=flat[1:], duration=durations, loop=0, optimize=False)
        return buffer.getvalue()

    def _still(self) -> Image.Image:
        """What is behind the arm, with its body at the start."""
        still = self.backdrop.image.copy()
        start = self.backdrop.pixels(self.points[0])
        self._brush.paint(still, start, style.START, style.START_EDGE, self.settings.start_opacity)
        return still

    def _painted(self, still: Image.Image) -> Iterator[tuple[Image.Image, list[_Box]]]:
        """The frames, each with the boxes out of which it is as what is behind the arm."""
        brush = self._brush
        end = float(self.time[-1])
        faster = end / self.seconds if self.seconds > 0.0 else 1.0
        clock = _Clock(faster, self.settings)
        for k in self.shown:
            frame = still.copy()
            pose = self.backdrop.pixels(self.points[k])
            box = brush.paint(frame, pose, style.GOAL_ARM, style.GOAL_ARM_EDGE, self.settings.body_opacity)
            strip = clock.show(frame, float(self.time[k]), float(self.time[k] / max(end, 1e-12)))
            yield frame, [strip] if box is None else [box, strip]

    @property
    def _brush(self) -> "ArmBrush":
        width = max(2.0 * self.radius * self.backdrop.pixels.pixels_a_metre, self.settings.least_body)
        return ArmBrush(width, self.settings)


def _letter_height(settings: FilmSettings) -> int:
    """Of the time, in a film of any size [pixel]."""
    return round(settings.clock_size * settings.longest_side / FILM.longest_side)


def _strip_height(settings: FilmSettings) -> int:
    """Of the strip below the drawing, for the time and the bar [pixel]."""
    return 2 * _letter_height(settings) + settings.bar_height


@dataclass(frozen=True)
class ArmBrush:
    """Paints the arm into a frame: its body and its axis, with smooth edges.

    Attributes:
        width: of the body [pixel].
        settings: sizes.
    """

    width: float
    settings: FilmSettings

    def paint(self, frame: Image.Image, pixels: FloatArray, body: str, axis: str, opacity: int) -> _Box | None:
        """Paint one pose (links + 1, 2) [pixel]; the box around it, which alone is touched, None for none."""
        reach = 0.5 * self.width + 2.0
        low = np.maximum(np.floor(pixels.min(axis=0) - reach), 0.0).astype(int)
        high = np.minimum(np.ceil(pixels.max(axis=0) + reach), frame.size).astype(int)
        if np.any(high <= low):
            return None
        size = (int(high[0] - low[0]), int(high[1] - low[1]))
        box = (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
        for width, colour, value in ((self.width, body, opacity), (2.0 * self.settings.axis_width, axis, 255)):
            mask = self._mask(pixels - low, size, width, value)
            frame.paste(colour, box, mask)
        return box

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

    def show(self, frame: Image.Image, time: float, share: float) -> _Box:
        """Write the time, and draw the bar for the share of the motion that is over; the box of both."""
        draw = ImageDraw.Draw(frame)
        place = (self._margin, frame.height - 3 * self._margin - self._bar)
        draw.text(place, f"{time:.2f} s{self._note}", fill=style.BOUNDARY, font=self._font)
        draw.rectangle((0, frame.height - self._bar, round(share * frame.width), frame.height), fill=style.GOAL_ARM)
        return (0, place[1], frame.width, frame.height)
