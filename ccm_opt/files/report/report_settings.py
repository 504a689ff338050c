"""How large the page of a plan becomes: frames of its motion, lines of its charts, room round its drawing."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ReportSettings:
    """How large the page of a plan becomes; all of them are taste.

    Attributes:
        most_numbers: coordinates in the page; more links mean fewer frames.
        most_frames: of the motion.
        least_frames: of the motion, even where that takes more numbers.
        most_lines: joints whose bends are drawn; of more, evenly spread ones.
        line_width: of thin lines, as a share of the room's extent.
        mark_size: radius of the mark of a goal, likewise.
        margin: round the boundary, likewise.
        pose_margin: round the goal pose in its picture, as a share of its extent.
        places_per_segment: of the goal pose's curve, at which it is drawn.
        chart_width: of the chart of gaps over time, in its own units, of which a letter is 13 high.
        chart_height: likewise.
        wanted_gaps_shown: gaps up to so many times the wanted one are drawn.
    """

    most_numbers: int = 60_000
    most_frames: int = 240
    least_frames: int = 40
    most_lines: int = 24
    line_width: float = 0.003
    mark_size: float = 0.018
    margin: float = 0.03
    pose_margin: float = 0.18
    places_per_segment: int = 24
    chart_width: float = 1000.0
    chart_height: float = 280.0
    wanted_gaps_shown: float = 4.0


REPORT = ReportSettings()
"""Used where no other settings are given."""
