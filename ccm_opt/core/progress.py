"""Progress and the stages that it is told of.

What is worth telling is known deep inside the search, and who listens is known outside. Between them nobody else has to
know: the listener is set for as long as the work lasts, and whoever has news tells it.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

from ccm_opt.core.errors import Diagnosis
from ccm_opt.core.length_words import LengthUnit, in_metres, said_unit, short_length, words_in


@dataclass(frozen=True)
class Progress:
    """How far a piece of work has come.

    Attributes:
        stage: what is being done.
        elapsed: CPU time since the beginning [s].
        limit: CPU time after which planning ends [s]; infinite where there is no such limit.
        candidate: number of the candidate that is being tried, from 1; 0 where none is.
        name: what that candidate is, or the change of a problem without a plan that is tried.
        distance: least distance from the goal at which an earlier candidate ended [m]; infinite where there is none.
        unit: in which lengths are said.
        known: why there is no plan, told as soon as it is known, and again when more is; else None.
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
            # Who prints it may be in another thread, where nobody has said what the file counts in.
            with words_in(self.unit):
                words += f", nearest so far {short_length(self.distance)} from the goal"
        return words


Listener: TypeAlias = Callable[[int, str, float], None]
"""Told of every candidate of the search that is about to be tried: number, name and distance as in ``Progress``."""
_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Let a listener be told of candidates until the block ends; nobody when it is None."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def tell_candidate(candidate: int, name: str, distance: float) -> None:
    """Tell that a candidate is about to be tried.

    Args:
        candidate: its number, from 1.
        name: what it is.
        distance: least distance from the goal at which an earlier one ended, in the planner's unit of length.
    """
    listener = _LISTENER.get()
    if listener is not None:
        listener(candidate, name, in_metres(distance))


@dataclass
class Stages:
    """Announces each stage and records its CPU time.

    Attributes:
        progress: called when a stage starts, and when a candidate of the search does, or None.
        limit: CPU time after which planning ends [s].
        timings: CPU time of this process by stage, without the stages inside it [s].
    """

    progress: Callable[[Progress], None] | None = None
    limit: float = math.inf
    timings: dict[str, float] = field(default_factory=dict)
    _running: list[str] = field(default_factory=list)
    _since: float = 0.0
    _beginning: float = field(default_factory=time.process_time)

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Run a block as the stage ``name``; repeated stages add up, also when the block fails."""
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
        """Tell which stage is running, and more by the names of ``Progress``."""
        if self.progress is not None and self._running:
            elapsed = time.process_time() - self._beginning
            self.progress(replace(Progress(self._running[-1], elapsed, self.limit, unit=said_unit()), **news))

    def tell_change(self, words: str, spent: float, most: float) -> None:
        """Tell which change of a problem without a plan is tried.

        Args:
            words: what is changed.
            spent: CPU time that the search for changes has taken so far [s].
            most: that it may take [s].
        """
        self.tell(elapsed=spent, limit=most, name=words)

    def _account(self) -> None:
        """Note the time since the last change for the stage that is running."""
        now = time.process_time()
        if self._running:
            self.timings[self._running[-1]] = self.timings.get(self._running[-1], 0.0) + now - self._since
        self._since = now

    def _hear(self, candidate: int, name: str, distance: float) -> None:
        self.tell(candidate=candidate, name=name, distance=distance)
