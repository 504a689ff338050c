"""How long each stage of a run takes, and the line on a terminal that shows the present one."""

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from ccm_opt.cli.outcome import tell_reason
from ccm_opt.cli.output import output
from ccm_opt.core.progress import Progress

if TYPE_CHECKING:
    from ccm_opt.errors import Diagnosis


STATUS_REFRESHES = 4.0
"""Times a second that the line of the present stage is drawn [1/s]. Taste."""
FIRST_LINE_AFTER = 3.0
"""Wall time after which it is told how far the work has come where there is no terminal [s]. Taste."""
LINE_EVERY = 3.0
"""Wall time between two such lines [s]. Taste."""


@dataclass(frozen=True)
class _Moment:
    """Both clocks at one moment [s]; CPU time counts finished child processes too."""

    wall: float
    cpu: float

    @classmethod
    def present(cls) -> "_Moment":
        times = os.times()
        children = times.children_user + times.children_system
        return cls(time.perf_counter(), time.process_time() + children)


class StageClock:
    """Notes how long each stage takes; ``begin`` tells it of one, and it can be the ``progress`` of a solve.

    Attributes:
        current: the present stage; empty before the first and after ``finish``.
        wall: wall time by stage [s].
        cpu: user and system time by stage, of finished child processes too [s].
        known: why there is no plan, as far as the solve has told; None while it seeks one.
    """

    def __init__(self, show: Callable[[Progress], None] | None = None) -> None:
        self.current = ""
        self.wall: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self.known: Diagnosis | None = None
        self._show = show
        self._since = _Moment.present()

    def begin(self, stage: str) -> None:
        """End the present stage and start the next."""
        self(Progress(stage))

    def __call__(self, progress: Progress) -> None:
        """Hear how far a solve has come; plans of several are counted as one."""
        stage = progress.stage.rpartition(": ")[2]
        if stage != self.current:
            self.finish()
            self.current = stage
        if progress.known is not None:
            self.known = progress.known
            tell_reason(progress.known)
        elif self._show is not None:
            self._show(progress)

    def finish(self) -> None:
        """End the present stage."""
        now = _Moment.present()
        if self.current:
            self.wall[self.current] = self.wall.get(self.current, 0.0) + now.wall - self._since.wall
            self.cpu[self.current] = self.cpu.get(self.current, 0.0) + now.cpu - self._since.cpu
        self.current = ""
        self._since = now

    @property
    def timings(self) -> Mapping[str, float]:
        """CPU time of the stages so far, the present one included [s]."""
        if not self.current:
            return dict(self.cpu)
        return {**self.cpu, self.current: _Moment.present().cpu - self._since.cpu}


@contextmanager
def stage_display(title: str) -> Iterator[StageClock]:
    """A clock that tells on stderr how far the work has come.

    On a terminal one line says so, and changes. Elsewhere plain lines are printed, from the moment on when people would
    ask; with ``--verbose`` there is a line for every stage. With ``--quiet`` there is nothing.

    Args:
        title: stands in front of every line.
    """
    console = Console(stderr=True, emoji=False)
    if output().quiet:
        yield StageClock()
    elif output().verbose or not console.is_terminal:
        yield StageClock(_PlainLines(title, everything=output().verbose))
    else:
        with console.status(escape(title), refresh_per_second=STATUS_REFRESHES) as status:
            yield StageClock(lambda progress: status.update(escape(f"{title}: {progress}")))


class _PlainLines:
    """Prints how far the work has come, line by line, not more often than people read it."""

    def __init__(self, title: str, *, everything: bool) -> None:
        self._title = title
        self._everything = everything
        self._next = time.monotonic() + FIRST_LINE_AFTER
        self._stage = ""

    def __call__(self, progress: Progress) -> None:
        new_stage = progress.stage != self._stage
        self._stage = progress.stage
        if (self._everything and new_stage) or time.monotonic() >= self._next:
            self._next = time.monotonic() + LINE_EVERY
            with suppress(OSError):  # nobody reads it, which is no reason to stop
                sys.stderr.write(f"{self._title}: {progress}\n")
                sys.stderr.flush()
