"""How far a long piece of work has come, told to whoever asked to be told.

What is worth telling is known deep inside the search, and who listens is known outside. Between them nobody else has to
know: the listener is set for as long as the work lasts, and whoever has news tells it.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from ccm_opt.errors import Diagnosis
from ccm_opt.ground.length_units import LengthUnit
from ccm_opt.ground.length_words import in_metres, short_length, words_in


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


@dataclass(frozen=True)
class CandidateNews:
    """A candidate of the search is about to be tried; attributes as in ``Progress``."""

    candidate: int
    name: str
    distance: float


_LISTENER: ContextVar[Callable[[CandidateNews], None] | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Callable[[CandidateNews], None] | None) -> Iterator[None]:
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
        listener(CandidateNews(candidate, name, in_metres(distance)))
