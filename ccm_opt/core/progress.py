"""Progress reports of planning, and CPU times of its stages.

Progress arises deep inside the search, while the listener is known only to the caller. A context variable connects the
two, so that no function in between has to pass the listener on.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

from ccm_opt.core.errors import Diagnosis
from ccm_opt.core.length_words import LengthUnit, in_metres, message_unit, short_length, words_in


@dataclass(frozen=True)
class Progress:
    """A progress report of planning.

    Attributes:
        stage: name of the running stage.
        elapsed: CPU time since the start [s].
        limit: CPU time after which planning ends [s]; infinite without a limit.
        candidate: number of the search attempt (candidate) in progress, from 1; 0 for none.
        name: name of that candidate, or the change being tried on a problem without a plan.
        distance: least distance from the goal at which an earlier candidate ended [m]; infinite without one.
        unit: unit in which lengths are shown.
        known: diagnosis of why there is no plan, reported as soon as it is known and again when it grows; else None.
    """

    stage: str
    elapsed: float = 0.0
    limit: float = math.inf
    candidate: int = 0
    name: str = ""
    distance: float = math.inf
    unit: LengthUnit = "m"
    known: Diagnosis | None = None

    def __str__(self) -> str:
        words = self.stage
        if self.elapsed > 0.0:
            limit = f" of {self.limit:g}" if math.isfinite(self.limit) else ""
            words += f", {self.elapsed:.1f}{limit} s"
        if self.candidate:
            words += f", candidate {self.candidate} ({self.name})"
        elif self.name:
            words += f": {self.name}"
        if math.isfinite(self.distance):
            # The report may be printed in another thread, which does not inherit the unit of the file.
            with words_in(self.unit):
                words += f", closest so far {short_length(self.distance)} from the goal"
        return words


Listener: TypeAlias = Callable[[int, str, float], None]
"""Function called before every search attempt with number, name and distance as in ``Progress``."""
_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Send reports of search attempts to a listener until the end of a block; None silences the reports."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def report_candidate(candidate: int, name: str, distance: float) -> None:
    """Report to the current listener, if any, that a search attempt (candidate) is about to start.

    Args:
        candidate: number of the candidate, from 1.
        name: name of the candidate.
        distance: least distance from the goal at which an earlier candidate ended, in the planner's unit of length.
    """
    listener = _LISTENER.get()
    if listener is not None:
        listener(candidate, name, in_metres(distance))


@dataclass
class Stages:
    """Reporter of the running stage of planning, which also records the CPU time of each stage.

    Attributes:
        progress: called when a stage or a search attempt starts, or None.
        limit: CPU time after which planning ends [s].
        timings: CPU time of this process by stage, excluding nested stages [s].
    """

    progress: Callable[[Progress], None] | None = None
    limit: float = math.inf
    timings: dict[str, float] = field(default_factory=dict)
    _running: list[str] = field(default_factory=list)
    _since: float = 0.0
    _beginning: float = field(default_factory=time.process_time)

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Run a block as the stage ``name``; times of a repeated stage add up, even if the block fails."""
        self._account()
        self._running.append(name)
        self.tell()
        try:
            with listening(self._hear if self.progress is not None else None):
                yield
        finally:
            self._account()
            self._running.pop()
            self.tell()

    def tell(self, **news: Any) -> None:
        """Report the running stage to the listener; ``news`` sets further fields of ``Progress``."""
        if self.progress is not None and self._running:
            elapsed = time.process_time() - self._beginning
            self.progress(replace(Progress(self._running[-1], elapsed, self.limit, unit=message_unit()), **news))

    def report_change(self, words: str, spent: float, most: float) -> None:
        """Report the change that is being tried on a problem without a plan.

        Args:
            words: text for the change.
            spent: CPU time spent on the search for changes so far [s].
            most: CPU time allowed for the search for changes [s].
        """
        self.tell(elapsed=spent, limit=most, name=words)

    def _account(self) -> None:
        """Add the CPU time since the last change of stage to the time of the running stage."""
        now = time.process_time()
        if self._running:
            self.timings[self._running[-1]] = self.timings.get(self._running[-1], 0.0) + now - self._since
        self._since = now

    def _hear(self, candidate: int, name: str, distance: float) -> None:
        self.tell(candidate=candidate, name=name, distance=distance)
