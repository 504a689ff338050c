"""How long each stage of a run takes, and the line on a terminal that shows the present one."""

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console
from rich.markup import escape

from ccm_opt.cli.display_settings import DISPLAY


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
    """Notes how long each stage takes; call it with a stage's name when the stage starts.

    Attributes:
        current: the present stage; empty before the first and after ``finish``.
        wall: wall time by stage [s].
        cpu: user and system time by stage, of finished child processes too [s].
    """

    def __init__(self, show: Callable[[str], None] | None = None) -> None:
        self.current = ""
        self.wall: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self._show = show
        self._since = _Moment.present()

    def __call__(self, stage: str) -> None:
        """End the present stage and start the next."""
        self.finish()
        self.current = stage
        if self._show is not None:
            self._show(stage)

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
    """A clock whose stages are shown on stderr when that is a terminal, and nowhere else."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield StageClock()
        return
    with console.status(escape(title), refresh_per_second=DISPLAY.status_refreshes) as status:
        yield StageClock(lambda stage: status.update(escape(f"{title}: {stage}")))
