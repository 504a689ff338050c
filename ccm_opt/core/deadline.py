"""Time limits."""

import math
import time
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


@dataclass(frozen=True)
class Deadline:
    """A moment on the clock of the process's own work, and one on the wall clock that guards it.

    What is found in so much CPU time does not depend on what else the machine does. But a process that hardly gets any
    must end too, so wall time counts as well, with room for a busy machine. CPU time is that of all threads of this
    process, and of no other process: workers have clocks of their own.

    Attributes:
        cpu: CPU time of this process at which to stop [s].
        wall: monotonic time at which to stop in any case [s].
        settings: how much wall time a second of CPU time may take.
    """

    cpu: float
    wall: float
    settings: DeadlineSettings = DEFAULT_DEADLINE

    @classmethod
    def after(cls, seconds: float, settings: DeadlineSettings = DEFAULT_DEADLINE) -> "Deadline":
        """The moment after so much CPU time from now on."""
        return cls(time.process_time() + seconds, time.monotonic() + settings.wall_guard * seconds, settings)

    @classmethod
    def never(cls) -> "Deadline":
        """No end at all."""
        return cls(math.inf, math.inf)

    @property
    def left(self) -> float:
        """CPU time that is left [s], negative once it has passed; less where wall time runs out before."""
        guarded = (self.wall - time.monotonic()) / self.settings.wall_guard
        return min(self.cpu - time.process_time(), guarded)

    def passed(self) -> bool:
        """Whether it is over."""
        return self.left < 0.0

    def within(self, seconds: float) -> "Deadline":
        """This moment, or that after so much CPU time from now on, whichever is earlier."""
        other = Deadline.after(seconds, self.settings)
        return Deadline(min(self.cpu, other.cpu), min(self.wall, other.wall), self.settings)

    def what_passed(self) -> str:
        """In words, which of the two clocks has ended the work."""
        if time.process_time() > self.cpu:
            return "time limit reached"
        times = f"{self.settings.wall_guard:g} times planner.time_limit of wall time"
        return f"time limit reached ({times} passed first, for the process got little CPU time)"
