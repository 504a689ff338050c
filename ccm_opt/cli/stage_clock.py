"""Measures the stages of a run, and shows the present one on a terminal."""

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape


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
        self._since = _now()

    def __call__(self, stage: str) -> None:
        """End the present stage and start the next."""
        self.finish()
        self.current = stage
        if self._show is not None:
            self._show(stage)

    def finish(self) -> None:
        """End the present stage."""
        now = _now()
        if self.current:
            self.wall[self.current] = self.wall.get(self.current, 0.0) + now[0] - self._since[0]
            self.cpu[self.current] = self.cpu.get(self.current, 0.0) + now[1] - self._since[1]
        self.current, self._since = "", now

    @property
    def timings(self) -> Mapping[str, float]:
        """CPU time of the stages so far, the present one included [s]."""
        present = {self.current: _now()[1] - self._since[1]} if self.current else {}
        return {**self.cpu, **present}


@contextmanager
def stage_display(title: str) -> Iterator[StageClock]:
    """A clock whose stages are shown on stderr when that is a terminal, and nowhere else."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield StageClock()
        return
    with console.status(escape(title), refresh_per_second=4) as status:
        yield StageClock(lambda stage: status.update(escape(f"{title}: {stage}")))


def _now() -> tuple[float, float]:
    times = os.times()
    return time.perf_counter(), time.process_time() + times.children_user + times.children_system
