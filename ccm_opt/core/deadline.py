"""Deadlines in CPU time, with a limit on wall time as a safeguard."""

import math
import time
from dataclasses import dataclass

WALL_GUARD = 3.0
"""Wall time allowed per second of CPU time before a search is stopped regardless.

Heuristic: on a machine with three times as many busy processes as cores, every search still gets its full CPU time.
"""


@dataclass(frozen=True)
class Deadline:
    """A deadline in CPU time of this process, with a later one in wall time as a safeguard.

    CPU time makes results independent of other load on the machine; wall time also stops a process that hardly gets any
    CPU. CPU time counts all threads of this process and no other process: workers have deadlines of their own.

    Attributes:
        cpu: CPU time of this process at which to stop [s].
        wall: monotonic time at which to stop in any case [s].
    """

    cpu: float
    wall: float

    @classmethod
    def after(cls, seconds: float) -> "Deadline":
        """Return a deadline ``seconds`` of CPU time from now."""
        return cls(time.process_time() + seconds, time.monotonic() + WALL_GUARD * seconds)

    @classmethod
    def never(cls) -> "Deadline":
        """Return a deadline that never passes."""
        return cls(math.inf, math.inf)

    @property
    def left(self) -> float:
        """CPU time left [s], negative once the deadline has passed; less if wall time runs out first."""
        guarded = (self.wall - time.monotonic()) / WALL_GUARD
        return min(self.cpu - time.process_time(), guarded)

    def passed(self) -> bool:
        """Return whether the deadline has passed, by either clock."""
        return self.left < 0.0

    def within(self, seconds: float) -> "Deadline":
        """Return the earlier of this deadline and a deadline ``seconds`` of CPU time from now."""
        other = Deadline.after(seconds)
        return Deadline(min(self.cpu, other.cpu), min(self.wall, other.wall))

    def what_passed(self) -> str:
        """Return text that says which of the two clocks, CPU or wall time, stopped the work."""
        if time.process_time() > self.cpu:
            return "time limit reached"
        times = f"{WALL_GUARD:g} times planner.time_limit"
        return f"time limit reached (by wall time, {times}: the process got too little CPU time)"
