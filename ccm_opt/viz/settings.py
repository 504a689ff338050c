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
    bottom: float = 0.95
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


@dataclass(frozen=True)
class ComparisonPictureSettings:
    """Sizes of the pictures of a comparison; all of them are taste.

    Attributes:
        dots_per_inch: resolution.
        room: room beyond the points, as a share of their range.
    """

    dots_per_inch: int = 120
    room: float = 0.06


@dataclass(frozen=True)
class ParetoPictureSettings:
    """Sizes of the picture of several plans; all of them are taste.

    Attributes:
        dots_per_inch: resolution.
        width: of the picture [inch].
        margins: above, between and below the two [inch].
    """

    dots_per_inch: int = 120
    width: float = 9.6
    margins: float = 1.55


@dataclass(frozen=True)
class PaperFigureSettings:
    """Sizes of the figures that are like those of the paper; all of them are taste.

    Attributes:
        curves: of keyframes that are drawn, evenly chosen.
        steps: into which a motion without stops is divided.
        space_poses: of the simulated arm in each of three pictures.
    """

    curves: int = 14
    steps: int = 4
    space_poses: int = 5


@dataclass(frozen=True)
class SpacePictureSettings:
    """Sizes of the pictures of a plan in space; all of them are taste.

    Attributes:
        most_triangles: of all bodies together; of more, small ones are left out.
        cell: by how much surfaces may be off in a picture, before their corners are joined in cells of this width, as
            a share of the scene's extent.
        round_sides: of balls and bars.
        glass: opacity of one body.
        sharp: angle between two faces from which on their edge is drawn [rad].
        poses: between start and end.
        side: longest side of one view [inch].
        dots_per_inch: of PNG files.
        places: along the arm, at which the section measures.
    """

    most_triangles: int = 6000
    cell: float = 0.008
    round_sides: int = 24
    glass: float = 0.22
    sharp: float = 0.6
    poses: int = 6
    side: float = 4.6
    dots_per_inch: int = 110
    places: int = 100


PICTURES = PictureSettings()
"""Used where no other settings are given."""
FILM = FilmSettings()
"""Likewise."""
SPACE_FILM = FilmSettings(longest_side=520, frames_a_second=12, most_frames=60, last_frame=1500, colours=128)
"""Likewise in space, where a frame holds more, and a film therefore fewer frames."""
PARETO_PICTURE = ParetoPictureSettings()
"""Likewise."""
COMPARISON_PICTURES = ComparisonPictureSettings()
"""Likewise."""
PAPER_FIGURES = PaperFigureSettings()
"""Likewise."""
SPACE_PICTURES = SpacePictureSettings()
"""Likewise."""


@dataclass(frozen=True)
class ReportSettings:
    """How large the page of a plan becomes and how exact its curves are; all of them are taste.

    Attributes:
        most_numbers: of one chart with all its curves; with more curves each has fewer samples.
        most_samples: of one chart.
        least_samples: of one chart, even where that takes more numbers.
        number_step: of the numbers in the page, as a share of the chart's range.
        most_vertices: of walls that are drawn with every corner; of more, small corners are left out.
        moving: least share of a joint's velocity limit at which a sample says what limits the speed.
        most_triangles: of all bodies of a scene in space; of more, small ones are left out.
        cell: width of the cells in which corners are joined first, as a share of the scene's extent.
        round_sides: of balls and bars in space.
        sharp: angle between two faces from which on their edge is drawn [rad].
    """

    most_numbers: int = 70_000
    most_samples: int = 2000
    least_samples: int = 120
    number_step: float = 1e-4
    most_vertices: int = 60_000
    moving: float = 0.02
    most_triangles: int = 60_000
    cell: float = 2e-3
    round_sides: int = 24
    sharp: float = 0.6


REPORT = ReportSettings()
"""Used where no other settings are given."""
