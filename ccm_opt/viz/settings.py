"""Numbers of pictures and pages."""

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
        beside_action: room left round all that moves, as a share of its longest side.
        beside_room: the same round the whole room.
        least_aspect: shorter side of what is shown, at least, as a share of the longer one.
        most_of_room: share of both sides of the room from which on all of it is shown.
        arrow_share: length of a goal's arrow, as a share of what is shown.
        label_size: of labels in the drawing [points].
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
    beside_action: float = 0.07
    beside_room: float = 0.03
    least_aspect: float = 0.5
    most_of_room: float = 0.85
    arrow_share: float = 0.09
    label_size: float = 7.5
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
        frames_a_second: while the motion is shorter than the film may be [1/s]; a film counts hundredths of a second.
        most_frames: of longer motions, which are shown faster than they are.
        last_frame: how long the last frame stands [ms].
        colours: in the palette of the film.
        told_factor: films that are faster than the motion by more than this factor say so.
        video_side: longest side of a frame of a video [pixel].
        video_frames_a_second: of a video [1/s].
        most_video_frames: of longer motions, which are shown faster than they are.
    """

    longest_side: int = 480
    frames_a_second: int = 25
    most_frames: int = 120
    last_frame: int = 900
    colours: int = 96
    told_factor: float = 1.05
    video_side: int = 960
    video_frames_a_second: int = 50
    most_video_frames: int = 1500


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


@dataclass(frozen=True)
class PaperFigureSettings:
    """Sizes of the figures that are like those of the paper; all of them are taste.

    Attributes:
        curves: of keyframes that are drawn, evenly chosen.
        curves_side: width and height of the drawing of curves and of that of curvatures [inch].
        steps: into which a motion without stops is divided.
        poses_a_step: between the ends of a step.
        all_poses: of the whole motion in its last step.
        step_width: of the picture of a step [inch].
        link_poses: between the ends of the mapped motion.
        links_side: longest side of that drawing [inch].
        space_poses: of the simulated arm in each of three pictures.
        space_side: width of each of them [inch].
    """

    curves: int = 14
    curves_side: float = 3.6
    steps: int = 4
    poses_a_step: int = 4
    all_poses: int = 22
    step_width: float = 2.9
    link_poses: int = 16
    links_side: float = 6.0
    space_poses: int = 5
    space_side: float = 3.6


@dataclass(frozen=True)
class SpacePictureSettings:
    """Sizes of the pictures of a plan in space; all of them are taste.

    Attributes:
        most_triangles: of all bodies together; of more, small ones are left out.
        least_triangles: of one body, however many there are.
        cell: by how much surfaces may be off in a picture, before their corners are joined in cells of this width, as
            a share of the scene's extent.
        round_sides: of balls and bars.
        fewest_sides: of them where there are so many bodies that each may have few triangles only.
        glass: opacity of one body.
        glass_pixels: of the longer side of a view, in which bodies are drawn.
        sharp: angle between two faces from which on their edge is drawn [rad].
        poses: between start and end.
        side: longest side of one view [inch].
        legend_width: of the arm in the legend, at most [point].
        dots_per_inch: of PNG files.
        places: along the arm, at which the section measures.
        section_share: of the arm's length, as far as the section looks for surfaces.
    """

    most_triangles: int = 6000
    least_triangles: int = 200
    cell: float = 0.008
    round_sides: int = 24
    fewest_sides: int = 12
    glass: float = 0.22
    glass_pixels: int = 700
    sharp: float = 0.6
    poses: int = 6
    side: float = 4.6
    legend_width: float = 8.0
    dots_per_inch: int = 110
    places: int = 100
    section_share: float = 0.12


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
        curve_error: distance that a sample may have from its curve, as a share of the chart's range.
        pose_error: the same of the joints' bends, from which the arm is drawn [rad].
        most_samples: of one chart.
        least_samples: of one chart, even where that takes more numbers.
        number_step: of the numbers in the page, as a share of the chart's range.
        place_step: of places in the page, as a share of the room's extent.
        most_vertices: of walls that are drawn with every corner; of more, small corners are left out.
        most_obstacles: with more of them, routes and regions are left out, whose search would take too long.
        pose_margin: round the goal pose in its picture, as a share of its extent.
        thin_line: width of thin lines in that picture, likewise.
        places_per_segment: of the goal pose's curve, at which it is drawn.
        wanted_gaps_shown: gaps up to so many times the wanted one are drawn.
        moving: least share of a joint's velocity limit at which a sample says what limits the speed.
        most_named: obstacles whose names stand in the scene at first.
        most_triangles: of all bodies of a scene in space; of more, small ones are left out.
        cell: width of the cells in which corners are joined first, as a share of the scene's extent.
        round_sides: of balls and bars in space.
        sharp: angle between two faces from which on their edge is drawn [rad].
    """

    most_numbers: int = 70_000
    curve_error: float = 2e-3
    pose_error: float = 1e-4
    most_samples: int = 2000
    least_samples: int = 120
    number_step: float = 1e-4
    place_step: float = 2e-5
    most_vertices: int = 60_000
    most_obstacles: int = 80
    pose_margin: float = 0.18
    thin_line: float = 0.003
    places_per_segment: int = 24
    wanted_gaps_shown: float = 4.0
    moving: float = 0.02
    most_named: int = 16
    most_triangles: int = 60_000
    cell: float = 2e-3
    round_sides: int = 24
    sharp: float = 0.6


REPORT = ReportSettings()
"""Used where no other settings are given."""
