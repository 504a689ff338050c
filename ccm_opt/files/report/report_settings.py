"""How large the page of a plan becomes and how exact its curves are."""

from dataclasses import dataclass


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
