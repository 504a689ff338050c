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
        timings: CPU time of this process by stage [s].
    """

    progress: Callable[[str], None] | None = None
    timings: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Run a block as the stage ``name``; repeated stages add up, also when the block fails."""
        if self.progress is not None:
            self.progress(name)
        start = time.process_time()
        try:
            yield
        finally:
            self.timings[name] = self.timings.get(name, 0.0) + time.process_time() - start
