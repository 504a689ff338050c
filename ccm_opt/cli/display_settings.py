"""Widths and bounds of what the command line prints, and when it warns."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DisplaySettings:
    """Widths and bounds of what the command line prints; all of them are taste.

    Attributes:
        status_refreshes: times a second that the line of the present stage is drawn [1/s].
        first_line_after: wall time after which it is told how far the work has come where there is no terminal [s].
        line_every: wall time between two such lines [s].
    """

    status_refreshes: float = 4.0
    first_line_after: float = 3.0
    line_every: float = 3.0


DISPLAY = DisplaySettings()
"""What every command uses."""


@dataclass(frozen=True)
class WatchdogSettings:
    """How long planning may tell nothing before it is ended from outside.

    Attributes:
        limits: times the time limit. Derived: planning ends after three times as much wall time by itself.
        grace: further time [s]. Taste: far longer than any stage that no time limit ends has taken.
        patience: time within which a process that was told to end ends, before it is killed [s]. Taste.
    """

    limits: float = 3.0
    grace: float = 60.0
    patience: float = 2.0


WATCHDOG = WatchdogSettings()
"""What every command that plans goes by."""
