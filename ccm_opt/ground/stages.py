"""Names and times the stages of a solve; the only place that looks at the clock for the record."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class Stages:
    """Announces each stage and records its CPU time.

    Attributes:
        progress: called with the stage's name when it starts, or None.
        timings: CPU time of this process by stage, without the stages inside it [s].
    """

    progress: Callable[[str], None] | None = None
    timings: dict[str, float] = field(default_factory=dict)
    _running: list[str] = field(default_factory=list)
    _since: float = 0.0

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Run a block as the stage ``name``; repeated stages add up, also when the block fails."""
        self._account()
        self._running.append(name)
        self._announce()
        try:
            yield
        finally:
            self._account()
            self._running.pop()
            self._announce()

    def _account(self) -> None:
        """Note the time since the last change for the stage that is running."""
        now = time.process_time()
        if self._running:
            self.timings[self._running[-1]] = self.timings.get(self._running[-1], 0.0) + now - self._since
        self._since = now

    def _announce(self) -> None:
        if self.progress is not None and self._running:
            self.progress(self._running[-1])
