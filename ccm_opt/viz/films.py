"""Films of the motion of a plan, as animated GIF or MP4."""

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from PIL import Image

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.scene.tool_links import drawn_radii
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import PLANE, PlanDrawing, Side, draw_tip_path, radius_runs
from ccm_opt.viz.plan import MOST_STOPS, draw_goals, draw_sights, tip_path_tube
from ccm_opt.viz.raster import Shades
from ccm_opt.viz.scene_views import Pose, SceneViews, pose_tube, show_picture, view_window, viewing_side
from ccm_opt.viz.settings import FILM, SPACE_FILM, FilmSettings
from ccm_opt.viz.shading import ShadedView, picture_size
from ccm_opt.viz.views import action_window, draw_base
from ccm_opt.viz.work_box import work_box

_TOLD_FACTOR = 1.05
"""Ratio of playback speed to real time above which a film states this ratio."""
_MOST_VIDEO_FRAMES = 1500
"""Maximum number of frames of a video; longer motions are shown faster than real time."""

_HUNDREDTH = 10
"""Resolution of frame times in GIF [ms]."""
_DOTS_PER_INCH = 100.0
"""Resolution of a film of the default size [1/inch]; larger films are scaled up."""
_SWATCH = 12
"""Height of the strip of a mark's colour from which the palette is made [pixel]. Heuristic."""
_STRIP = 32
"""Height of the strip below the drawing for the time and the progress bar [pixel of a film of the default size]."""


@dataclass(frozen=True)
class Film:
    """A film of a motion: a fixed background and the poses of the arm, from which frames are drawn.

    Attributes:
        figure: background behind the arm, above a strip for the time.
        axes: axes in which the arm is drawn.
        arm: artists that are drawn in every frame, in their order.
        show: function that shows the arm at the sample of a given index, by changing these artists or the pixels of
            the frame, shape (height, width, 4).
        time: times of the samples, shape (T,) [s].
        settings: sizes and frame rates.
        shown: indices of the samples shown, one per frame.
        seconds: total duration of all frames but the last [s].
    """

    figure: Figure
    axes: Axes
    arm: Sequence[Artist]
    show: Callable[[int, Any], None]
    time: FloatArray
    settings: FilmSettings
    shown: IntArray
    seconds: float

    def frames(self) -> Iterator[Image.Image]:
        """Yield the frames of the film as RGB images of equal size."""
        figure = self.figure
        for artist in self.arm:
            artist.set_animated(True)
        end = float(self.time[-1])
        faster = end / self.seconds if self.seconds > 0.0 else 1.0
        note = f"  {faster:.2g}\N{MULTIPLICATION SIGN} speed" if faster > _TOLD_FACTOR else ""
        strip = 1.0 - self.axes.get_position().height
        clock = figure.text(0.015, 0.55 * strip, "", size=10.0, family=style.FONT_FAMILY, va="center", animated=True)
        clock.set_color(style.BOUNDARY)
        bar = Rectangle((0.0, 0.0), 0.0, 0.12 * strip, color=style.GOAL_ARM, animated=True)
        figure.add_artist(bar)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()  # type: ignore[no-untyped-call]
        still = canvas.copy_from_bbox(figure.bbox)  # type: ignore[no-untyped-call]
        pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        for k in self.shown:
            canvas.restore_region(still)  # type: ignore[no-untyped-call]
            self.show(int(k), pixels)
            clock.set_text(f"{self.time[k]:.2f} s{note}")
            bar.set_width(float(self.time[k]) / max(end, 1e-12))
            for artist in (*self.arm, clock, bar):
                figure.draw_artist(artist)
            yield Image.fromarray(pixels).convert("RGB")

    def gif(self) -> bytes:
        """Return the film as the bytes of an animated GIF file."""
        frames = list(self.frames())
        # One palette for all frames: palettes of their own would make the colours flicker.
        palette = _with_swatches(frames[-1]).quantize(self.settings.colours)
        flat = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
        # The end of every frame is rounded to a hundredth of a second, so that rounding errors do not add up.
        ends = np.round(np.linspace(0.0, 1e3 * self.seconds, len(flat))[1:] / _HUNDREDTH) * _HUNDREDTH
        durations = [*np.maximum(np.diff(ends, prepend=0.0), _HUNDREDTH).astype(int).tolist(), self.settings.last_frame]
        buffer = BytesIO()
        flat[0].save(buffer, "GIF", save_all=True, append_images=flat[1:], duration=durations, loop=0, optimize=False)
        return buffer.getvalue()


def make_film(plan: PlanDrawing, settings: FilmSettings | None = None, scene: SceneViews | None = None) -> Film:
    """Return the film of a plan's motion, in real time unless real time would need too many frames.

    Args:
        plan: the plan.
        settings: size and number of the frames; None for the defaults.
        scene: obstacles in space prepared for drawing; None to prepare them here.
    """
    problem, points, time = plan.problem, plan.points, plan.trajectory.time
    settings = settings or _usual_settings(plan)
    in_space = problem.dimension == 3
    if in_space:
        work = np.concatenate((points[:, -1], points[-1]))
        window, side = work_box(problem, points, work), viewing_side(work)
    else:
        window, side = action_window(problem, points), PLANE
    width, height = picture_size(view_window(side, window), settings.longest_side)
    times = settings.longest_side / FILM.longest_side
    # Video encoders need even side lengths.
    whole = 2.0 * np.ceil(0.5 * np.array([width, height + times * _STRIP]))
    dots = times * _DOTS_PER_INCH
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure = Figure(figsize=tuple(whole / dots), dpi=dots)
        axes = figure.add_axes((0.0, 1.0 - height / whole[1], width / whole[0], height / whole[1]))
        axes.set_axis_off()
        scene = scene or SceneViews(problem)
        if in_space:
            view = _shaded_scene(axes, scene, side, window, plan, settings.longest_side)
        else:
            scene.begin_view(axes, side, window)
            arm, show = _flat_arm(axes, points, drawn_radii(problem.arm))
            draw_tip_path(axes, points[:, -1])
            draw_base(axes, points[0, 0], 5.0)
        draw_goals(axes, plan, side, poses=False, numbers=len(problem.goals) < MOST_STOPS)
        draw_sights(axes, plan, side)
        if in_space:
            arm, show = [], _shaded_arm(view, plan, _marks(figure))
    # In real time unless that takes more frames than the settings allow.
    rate = settings.frames_a_second
    wanted = int(np.ceil(rate * time[-1])) + 1
    count = int(np.clip(wanted, 2, settings.most_frames))
    shown = np.searchsorted(time, np.linspace(0.0, time[-1], count))
    seconds = float(time[-1]) if count == wanted else (count - 1) / rate
    return Film(figure, axes, arm, show, time, settings, shown, seconds)


def _shaded_scene(
    axes: Axes, scene: SceneViews, side: Side, window: FloatArray, plan: PlanDrawing, pixels: int
) -> ShadedView:
    """Draw the background of a film in space, and return the view into which the arm is drawn.

    Args:
        axes: axes at the top of the figure, without margins.
        scene: the obstacles.
        side: projection to the picture plane.
        window: lower and upper corner of the visible box, shape (2, 3) [m].
        plan: the plan.
        pixels: number of pixels of the longer side of the axes.
    """
    radii = drawn_radii(plan.problem.arm)
    still = [tip_path_tube(plan, window), pose_tube(Pose(plan.points[0], radii, "start"))]
    view = scene.shaded(side, window, pixels, [*still, pose_tube(Pose(plan.points[-1], radii, "end"))], still)
    show_picture(axes, view, view.picture(()))
    return view


def _marks(figure: Figure) -> Shades:
    """Return what is drawn on top of the picture in a figure: colours and opacities, shape (h, w, 4), 0 to 1."""
    canvas = FigureCanvasAgg(figure)
    hidden = [figure.patch, *(image for axes in figure.axes for image in axes.images)]
    for artist in hidden:
        artist.set_visible(False)
    canvas.draw()  # type: ignore[no-untyped-call]
    for artist in hidden:
        artist.set_visible(True)
    return np.asarray(canvas.buffer_rgba(), dtype=np.float32) / 255.0  # type: ignore[no-untyped-call]


def _shaded_arm(view: ShadedView, plan: PlanDrawing, marks: Shades) -> Callable[[int, Any], None]:
    """Return the function that draws the arm into a frame, below the marks.

    Args:
        view: the scene.
        plan: the plan.
        marks: what lies on top of the scene and the arm, shape (h, w, 4).
    """
    radii = drawn_radii(plan.problem.arm)
    high = view.shape[0] // view.oversampling

    def show(sample: int, frame: IntArray) -> None:
        rows, columns, picture = view.part([pose_tube(Pose(plan.points[sample], radii, "end"))])
        place = (slice(high - rows.stop, high - rows.start), columns)
        colour, opacity = marks[place][..., :3], marks[place][..., 3:]
        shown = np.clip(picture[::-1], 0.0, 1.0)
        frame[place][..., :3] = np.round(255.0 * (shown + opacity * (colour - shown)))

    return show


def _flat_arm(axes: Axes, points: FloatArray, radii: FloatArray) -> tuple[list[Artist], Callable[[int, Any], None]]:
    """Return the lines of a planar arm in front of its start pose, and the function that changes its pose.

    Args:
        axes: axes to draw in, with their limits set.
        points: positions of joints and tip of n links at T samples, shape (T, n + 1, 2) [m].
        radii: radius of each link, shape (n,) [m].
    """
    _capsules(axes, points[0], radii, (style.START, style.START_EDGE), 0.43)
    lines = _capsules(axes, points[0], radii, (style.GOAL_ARM, style.GOAL_ARM_EDGE), 0.84)

    def show(sample: int, _: Any) -> None:
        for line, part in lines:
            line.set_data(*points[sample, part].T)

    return [line for line, _ in lines], show


def _with_swatches(frame: Image.Image) -> Image.Image:
    """Return a frame with a strip of the colours of marks, which are too small for a palette to heed."""
    marks = (style.GOAL_MARK, style.TIP_PATH, style.GOAL_ARM, style.START)
    shown = Image.new("RGB", (frame.width, frame.height + len(marks) * _SWATCH))
    shown.paste(frame)
    for number, colour in enumerate(marks):
        shown.paste(colour, (0, frame.height + number * _SWATCH, frame.width, frame.height + (number + 1) * _SWATCH))
    return shown


def _capsules(
    axes: Axes, points: FloatArray, radii: FloatArray, colours: tuple[str, str], opacity: float
) -> list[tuple[Line2D, slice]]:
    """Draw an arm's body, a union of capsules, and its axis, and return each line with the joints on it.

    The joints are a slice of joints and tip.

    Args:
        axes: axes to draw in.
        points: positions of joints and tip in the picture, shape (n links + 1, 2) [m].
        radii: radius of each link, shape (n links,) [m].
        colours: colours of body and axis.
        opacity: opacity of the body, from 0 to 1.
    """
    left, right = axes.transData.transform([(0.0, 0.0), (1.0, 0.0)])[:, 0]
    scale = 72.0 / axes.figure.dpi * float(right - left)
    each = radius_runs(radii, len(radii))
    runs = [(part, max(2.0 * radius * scale, 1.0), colours[0], opacity) for part, radius in each]
    look: dict[str, Any] = {"zorder": 9.0, "solid_capstyle": "round", "solid_joinstyle": "round"}
    return [
        (axes.plot(*points[part].T, color=colour, linewidth=width, alpha=alpha, **look)[0], part)
        for part, width, colour, alpha in [*runs, (slice(None), 1.0, colours[1], 1.0)]
    ]


def _usual_settings(plan: PlanDrawing) -> FilmSettings:
    """Return the default film settings for a plan of a planar arm or of an arm in space."""
    return SPACE_FILM if plan.problem.dimension == 3 else FILM


_QUALITY = ("-c:v", "libx264", "-crf", "20", "-preset", "veryfast", "-pix_fmt", "yuv420p", "-movflags", "+faststart")


def encoder() -> str | None:
    """Return the path of the program ffmpeg; None if ffmpeg is not installed."""
    return shutil.which("ffmpeg")


def motion_gif(plan: PlanDrawing, scene: SceneViews | None = None) -> bytes:
    """Return a film of a plan's motion as the bytes of an animated GIF, in real time unless the motion is too long.

    Args:
        plan: the plan.
        scene: obstacles in space prepared for drawing; None to prepare them here.
    """
    return make_film(plan, scene=scene).gif()


def motion_mp4(plan: PlanDrawing, settings: FilmSettings | None = None) -> bytes:
    """Return a film of a plan's motion as the bytes of an MP4 file, in real time unless the motion is too long.

    Args:
        plan: the plan.
        settings: size and number of the frames; None for the defaults.

    Raises:
        ProblemError: ffmpeg is missing, or cannot encode the video.
    """
    program = encoder()
    if program is None:
        raise ProblemError("a video needs the program ffmpeg, which is not found; install it, or leave out 'mp4'")
    usual = settings or _usual_settings(plan)
    rate = usual.video_frames_a_second
    of_video = {"longest_side": usual.video_side, "frames_a_second": rate, "most_frames": _MOST_VIDEO_FRAMES}
    frames = list(make_film(plan, replace(usual, **of_video)).frames())
    still = frames[-1:] * round(rate * usual.last_frame / 1e3)
    width, height = frames[0].size
    raw = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(rate), "-i", "-")
    with tempfile.TemporaryDirectory() as folder:
        # The index of an MP4 comes first (faststart), so the file cannot be written to a pipe.
        out = Path(folder) / "motion.mp4"
        content = b"".join(frame.tobytes() for frame in (*frames, *still))
        command = [program, "-loglevel", "error", "-y", *raw, *_QUALITY, str(out)]
        done = subprocess.run(command, input=content, capture_output=True, check=False)  # noqa: S603 - no shell
        if done.returncode != 0:
            raise ProblemError(f"ffmpeg cannot encode the video: {done.stderr.decode(errors='replace').strip()}")
        return out.read_bytes()
