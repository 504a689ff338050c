"""Names and times the stages of a solve; the only place that looks at the clock for the record."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from ccm_opt.errors import Diagnosis
from ccm_opt.ground.length_words import said_unit
from ccm_opt.ground.progress import CandidateNews, Progress, listening


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
        self._announce()
        try:
            with listening(self._hear if self.progress is not None else None):
                yield
        finally:
            self._account()
            self._running.pop()
            self._announce()

    def tell_known(self, diagnosis: Diagnosis) -> None:
        """Tell why there is no plan, as far as that is known."""
        if self.progress is not None and self._running:
            self.progress(replace(self._present(), known=diagnosis))

    def tell_change(self, words: str, spent: float, most: float) -> None:
        """Tell which change of a problem without a plan is tried.

        Args:
            words: what is changed.
            spent: CPU time that the search for changes has taken so far [s].
            most: that it may take [s].
        """
        if self.progress is not None and self._running:
            self.progress(replace(self._present(), elapsed=spent, limit=most, name=words))

    def _account(self) -> None:
        """Note the time since the last change for the stage that is running."""
        now = time.process_time()
        if self._running:
            self.timings[self._running[-1]] = self.timings.get(self._running[-1], 0.0) + now - self._since
        self._since = now

    def _announce(self) -> None:
        if self.progress is not None and self._running:
            self.progress(self._present())

    def _hear(self, news: CandidateNews) -> None:
        if self.progress is not None and self._running:
            told = replace(self._present(), candidate=news.candidate, name=news.name, distance=news.distance)
            self.progress(told)

    def _present(self) -> Progress:
        elapsed = time.process_time() - self._beginning
        return Progress(self._running[-1], elapsed, self.limit, unit=said_unit())
