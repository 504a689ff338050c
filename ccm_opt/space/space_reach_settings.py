"""Numbers of the map of where the tip can be in space."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SpaceReachSettings:
    """How it is found out where the tip can be in space.

    Attributes:
        step: width of a cell, as a share of the arm's length, where none is given. Taste: with a base that stands still
            some two thousand cells, in about half a minute.
        directions: that are tried in a cell, where no number is given. Taste: none, for each of them takes as long as
            all of the map without.
        drawn: poses that are drawn, each of which is a beginning in the cell of its tip. Taste: a thousandth of a
            second each; they find what lies beyond narrow places.
        steps: most steps from a pose in the cell beside onto a place. Measured: of those that arrive nearly all take
            less.
        progress: share of the way left that four steps may leave, or the place is given up. Taste.
        attempts: cells beside from which a place is tried in vain before its cell counts as not found. Taste: all.
        seen: room that is looked at, as a share of the arm's length; above it gaps are not told apart. Taste.
        motion_time: CPU time in which a motion to the goal is sought, whose poses are beginnings [s]. Taste.
        most_cells: of a grid; more are refused. Derived: some minutes of work and 10 MB of arrays.
    """

    step: float = 1.0 / 8.0
    directions: int = 0
    drawn: int = 300
    steps: int = 40
    progress: float = 0.9
    attempts: int = 6
    seen: float = 0.05
    motion_time: float = 5.0
    most_cells: int = 200_000


DEFAULT_SPACE_REACH = SpaceReachSettings()
"""Used where no other settings are given."""
