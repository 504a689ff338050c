"""Time limits."""

import math
import time
from dataclasses import dataclass

WALL_GUARD = 3.0
"""Wall time that a second of CPU time may take before a search ends all the same. Taste: a machine with three times as
many busy processes as cores still gives every search its whole time."""


@dataclass(frozen=True)
class Deadline:
    """A moment on the clock of the process's own work, and one on the wall clock that guards it.

    What is found in so much CPU time does not depend on what else the machine does. But a process that hardly gets any
    must end too, so wall time counts as well, with room for a busy machine. CPU time is that of all threads of this
    process, and of no other process: workers have clocks of their own.

    Attributes:
        cpu: CPU time of this process at which to stop [s].
        wall: monotonic time at which to stop in any case [s].
    """

    cpu: float
    wall: float

    @classmethod
    def after(cls, seconds: float) -> "Deadline":
        """Return the moment after so much CPU time from now on."""
        return cls(time.process_time() + seconds, time.monotonic() + WALL_GUARD * seconds)

    @classmethod
    def never(cls) -> "Deadline":
        """Return no end at all."""
        return cls(math.inf, math.inf)

    @property
    def left(self) -> float:
        """CPU time that is left [s], negative once it has passed; less where wall time runs out before."""
        guarded = (self.wall - time.monotonic()) / WALL_GUARD
        return min(self.cpu - time.process_time(), guarded)

    def passed(self) -> bool:
        """Return whether it is over."""
        return self.left < 0.0

    def within(self, seconds: float) -> "Deadline":
        """Return the this moment, or that after so much CPU time from now on, whichever is earlier."""
        other = Deadline.after(seconds)
        return Deadline(min(self.cpu, other.cpu), min(self.wall, other.wall))

    def what_passed(self) -> str:
        """In words, which of the two clocks has ended the work."""
        if time.process_time() > self.cpu:
            return "time limit reached"
        times = f"{WALL_GUARD:g} times planner.time_limit of wall time"
        return f"time limit reached ({times} passed first, for the process got little CPU time)"
