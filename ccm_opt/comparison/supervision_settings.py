"""How long a run may take and how much memory, before it is ended from outside."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SupervisionSettings:
    """Bounds on a run that its planner does not keep itself.

    Attributes:
        time_factor: wall time for planning in units of the planner's CPU time. Derived: the wall guard of our own
            deadlines.
        spare_time: wall time beside that, for timing, verification and simulation [s]. Taste.
        most_memory: resident memory of a run [B]. Taste: our planners take less than a tenth.
        look_every: time between two looks at a run's memory [s]. Taste.
        last_words: time for a process that is told to end, before it is killed [s]. Taste.
    """

    time_factor: float = 3.0
    spare_time: float = 120.0
    most_memory: int = 4 << 30
    look_every: float = 0.05
    last_words: float = 5.0


DEFAULT_SUPERVISION = SupervisionSettings()
"""What runs are held to unless other bounds are given."""
