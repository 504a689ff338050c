"""How much longer than its CPU time a search may take on a busy machine."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DeadlineSettings:
    """How much longer than its CPU time a search may take on a busy machine.

    Attributes:
        wall_guard: wall time that a second of CPU time may take before the search ends all the same. Taste: a machine
            with three times as many busy processes as cores still gives every search its whole time.
    """

    wall_guard: float = 3.0


DEFAULT_DEADLINE = DeadlineSettings()
"""Used where no other settings are given."""
