"""Sizes and numbers of the pictures: resolution, margins, poses on the way, frames of the film. Colours: ``style``."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PictureSettings:
    """Sizes of the still pictures; all of them are taste.

    Attributes:
        dots_per_inch: resolution.
        longest_side: of the drawing of a plan, without its margins [inch].
        least_width: of that drawing [inch], so that the legend finds its place.
        least_height: of that drawing [inch].
        left: margin for axis labels [inch].
        right: margin [inch].
        top: margin for the title [inch].
        bottom: margin for axis labels and legend [inch].
        poses_on_the_way: poses drawn between start and goal.
        most_named_obstacles: with more obstacles than this their names would hide the picture.
        simulated_poses: shares of the duration at which the simulated arm is drawn on its way.
        least_error: smaller tracking errors are drawn at this one, on their logarithmic scale [rad] or [m].
        scale_room: room for a scale of colours at the right [inch].
        curve_places: points by which a curve is drawn.
        least_disc: tolerances of a goal's place are drawn when wider than this share of the picture.
        least_wedge: tolerances of a goal's heading are drawn when wider than this [rad].
        bar_share: half the length of the bar at a side that a pose leans on, as a share of the arm's length.
    """

    dots_per_inch: int = 120
    longest_side: float = 6.0
    least_width: float = 2.6
    least_height: float = 1.2
    left: float = 0.65
    right: float = 0.2
    top: float = 0.45
    bottom: float = 0.95
    poses_on_the_way: int = 7
    most_named_obstacles: int = 12
    simulated_poses: tuple[float, ...] = (0.25, 0.5, 0.75)
    least_error: float = 1e-7
    scale_room: float = 0.9
    curve_places: int = 401
    least_disc: float = 0.012
    least_wedge: float = 0.05
    bar_share: float = 0.02


@dataclass(frozen=True)
class FilmSettings:
    """Sizes of the film; all of them are taste.

    Attributes:
        longest_side: of a frame [pixel].
        frames_a_second: while the motion is shorter than the film may be [1/s].
        most_frames: of longer motions, which are shown faster than they are.
        last_frame: how long the last frame stands [ms].
        oversampling: the arm is drawn this much larger and shrunk, so that its edges are smooth.
        colours: in the palette of the film.
        least_body: width of the arm's body, at least [pixel].
        axis_width: half the width of the arm's axis [pixel].
        body_opacity: of the arm's body, from 0 to 255.
    """

    longest_side: int = 480
    frames_a_second: int = 20
    most_frames: int = 80
    last_frame: int = 900
    oversampling: int = 2
    colours: int = 96
    least_body: float = 1.5
    axis_width: float = 0.7
    body_opacity: int = 215


@dataclass(frozen=True)
class ComparisonPictureSettings:
    """Sizes of the pictures of a comparison; all of them are taste.

    Attributes:
        dots_per_inch: resolution.
        most_columns: panels side by side.
        many_decades: ratio of the ends from which an axis is marked by powers of ten alone.
        least_range: room beyond the points of a linear axis, at least: smaller differences are not worth a picture.
        least_ratio: the same of a logarithmic axis, as a factor.
        room: room beyond the points, as a share of their range.
    """

    dots_per_inch: int = 120
    most_columns: int = 3
    many_decades: float = 1e3
    least_range: float = 1e-3
    least_ratio: float = 1.1
    room: float = 0.06


@dataclass(frozen=True)
class ParetoPictureSettings:
    """Sizes of the picture of several plans; all of them are taste.

    Attributes:
        dots_per_inch: resolution.
        width: of the picture [inch].
        chart_height: of the chart of time against room [inch].
        most_thumbnail: height of the picture of one plan, at most [inch].
        margins: above, between and below the two [inch].
    """

    dots_per_inch: int = 120
    width: float = 9.6
    chart_height: float = 2.6
    most_thumbnail: float = 2.6
    margins: float = 1.55


PICTURES = PictureSettings()
"""Used where no other settings are given."""
FILM = FilmSettings()
"""Likewise."""
PARETO_PICTURE = ParetoPictureSettings()
"""Likewise."""
COMPARISON_PICTURES = ComparisonPictureSettings()
"""Likewise."""
