"""Default sizes and frame rates of pictures and films."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PictureSettings:
    """Sizes of still pictures; all values are chosen by hand.

    Attributes:
        dots_per_inch: resolution [1/inch].
        longest_side: longest side of the drawing of a plan, without its margins [inch].
        least_height: minimum height of the drawing of a plan [inch].
        left: left margin, for axis labels [inch].
        right: right margin [inch].
        top: top margin, for the title [inch].
        bottom: bottom margin, for axis labels and legend [inch].
        workspace_margin: margin around the whole workspace, as a fraction of the workspace's longest side.
        most_named_obstacles: maximum number of obstacles whose names are shown; more names would hide the picture.
        least_error: tracking error at the bottom of the logarithmic scale [rad] or [m]; smaller errors are drawn there
            too.
    """

    dots_per_inch: int = 120
    longest_side: float = 6.0
    least_height: float = 1.2
    left: float = 0.65
    right: float = 0.2
    top: float = 0.45
    bottom: float = 1.05
    workspace_margin: float = 0.03
    most_named_obstacles: int = 12
    least_error: float = 1e-7


@dataclass(frozen=True)
class FilmSettings:
    """Sizes and frame rates of films; all values are chosen by hand.

    Attributes:
        longest_side: longest side of a frame of a GIF [pixel].
        frames_a_second: frame rate of a GIF whose motion needs at most ``most_frames`` [1/s]; the resolution of times
            in GIF is a hundredth of a second.
        most_frames: maximum number of frames of a GIF; longer motions are shown faster than real time.
        last_frame: duration of the last frame [ms].
        colours: number of colours in the palette of a GIF.
        video_side: longest side of a frame of a video [pixel].
        video_frames_a_second: frame rate of a video [1/s].
    """

    longest_side: int = 480
    frames_a_second: int = 25
    most_frames: int = 120
    last_frame: int = 900
    colours: int = 96
    video_side: int = 960
    video_frames_a_second: int = 50


PICTURES = PictureSettings()
"""Default sizes of still pictures."""
FILM = FilmSettings()
"""Default sizes of films of planar arms."""
SPACE_FILM = FilmSettings(longest_side=520, frames_a_second=12, most_frames=60, last_frame=1500, colours=128)
"""Default sizes of films of arms in space, whose frames hold more detail, so that there are fewer of them."""
