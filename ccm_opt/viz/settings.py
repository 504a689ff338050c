"""Numbers of pictures and pages."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PictureSettings:
    """Sizes of the still pictures; all of them are taste.

    Attributes:
        dots_per_inch: resolution.
        longest_side: of the drawing of a plan, without its margins [inch].
        least_height: of that drawing [inch].
        left: margin for axis labels [inch].
        right: margin [inch].
        top: margin for the title [inch].
        bottom: margin for axis labels and legend [inch].
        beside_room: the same round the whole room.
        most_named_obstacles: with more obstacles than this their names would hide the picture.
        least_error: smaller tracking errors are drawn at this one, on their logarithmic scale [rad] or [m].
    """

    dots_per_inch: int = 120
    longest_side: float = 6.0
    least_height: float = 1.2
    left: float = 0.65
    right: float = 0.2
    top: float = 0.45
    bottom: float = 1.05
    beside_room: float = 0.03
    most_named_obstacles: int = 12
    least_error: float = 1e-7


@dataclass(frozen=True)
class FilmSettings:
    """Sizes of the film; all of them are taste.

    Attributes:
        longest_side: of a frame [pixel].
        frames_a_second: while the motion is shorter than the film may be [1/s]; a film counts hundredths of a second.
        most_frames: of longer motions, which are shown faster than they are.
        last_frame: how long the last frame stands [ms].
        colours: in the palette of the film.
        video_side: longest side of a frame of a video [pixel].
        video_frames_a_second: of a video [1/s].
    """

    longest_side: int = 480
    frames_a_second: int = 25
    most_frames: int = 120
    last_frame: int = 900
    colours: int = 96
    video_side: int = 960
    video_frames_a_second: int = 50


PICTURES = PictureSettings()
"""Used where no other settings are given."""
FILM = FilmSettings()
"""Likewise."""
SPACE_FILM = FilmSettings(longest_side=520, frames_a_second=12, most_frames=60, last_frame=1500, colours=128)
"""Likewise in space, where a frame holds more, and a film therefore fewer frames."""
