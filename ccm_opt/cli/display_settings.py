"""Widths and bounds of what the command line prints, and when it warns."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DisplaySettings:
    """Widths and bounds of what the command line prints; all of them are taste.

    Attributes:
        piped_width: columns of output that goes to a file or another program.
        most_problems: problems of a comparison up to which the table of all runs is printed; of more it is in the
            file only.
        status_refreshes: times a second that the line of the present stage is drawn [1/s].
    """

    piped_width: int = 200
    most_problems: int = 40
    status_refreshes: float = 4.0


DISPLAY = DisplaySettings()
"""What every command uses."""
