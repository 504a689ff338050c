"""For whom a command prints: tables for people, one JSON document for programs, or nothing; how much; what it reads.

And what options accept, known without loading what they choose between.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, TypeAlias

from ccm_opt import __version__


@dataclass
class Output:
    """How one command prints, and what it has to say to programs.

    Attributes:
        command: its name.
        as_json: whether standard output gets one JSON document in place of tables.
        quiet: whether standard output gets no tables and standard error no progress; errors and warnings are told.
        verbose: whether every stage is told, with the package's own log, and every check in closing tables.
        allow_outside: whether drawings outside the folder of a problem file are read.
        results: one for every item so far, a file or a folder as a rule; the last may be under way.
        told: lines that were printed so far of why the item under way has no plan.
    """

    command: str = ""
    as_json: bool = False
    quiet: bool = False
    verbose: bool = False
    allow_outside: bool = False
    results: list[dict[str, object]] = field(default_factory=list)
    told: list[str] = field(default_factory=list)

    @property
    def tables(self) -> bool:
        """Whether people read standard output."""
        return not (self.as_json or self.quiet)

    def begin(self, item: str) -> None:
        """Note that the work on an item begins."""
        self.results.append({"item": item})
        self.told = []

    @property
    def item(self) -> str:
        """What is under way, in words; the command where there are no items."""
        return str(self.results[-1]["item"]) if self.results else self.command

    def note(self, data: Mapping[str, object]) -> None:
        """Note what came of the item under way, or of the command where there are no items."""
        if not self.results:
            self.begin(self.command)
        self.results[-1].update(data)

    def add_message(self, kind: str, message: str) -> None:
        """Note an error or a warning about the item under way.

        Args:
            kind: ``errors`` or ``warnings``.
            message: what people are told.
        """
        told = self.results[-1].get(kind, []) if self.results else []
        earlier = list(told) if isinstance(told, Sequence) else []
        self.note({kind: [*earlier, message]})

    def document(self, exit_code: int) -> dict[str, object]:
        """Return what programs are given at the end.

        Args:
            exit_code: of the whole command.
        """
        return {
            "ccm_opt": __version__,
            "command": self.command,
            "exit_code": exit_code,
            "results": self.results,
        }


_WITHOUT_COMMAND = Output()
_CURRENT: ContextVar[Output | None] = ContextVar("output of the command", default=None)


def output() -> Output:
    """Return that of the command that is running; tables for people where none is."""
    return _CURRENT.get() or _WITHOUT_COMMAND


@contextmanager
def printing(way: Output) -> Iterator[Output]:
    """Let a command print in a way, until the block ends."""
    token = _CURRENT.set(way)
    try:
        yield way
    finally:
        _CURRENT.reset(token)


MethodChoice: TypeAlias = Literal["nlp", "hill-climbing"]
"""Of ``solve --method``: the names of ``planner.method``."""
ControllerChoice: TypeAlias = Literal["computed-torque", "pd"]
"""Of ``simulate --controller``: the names of ``simulation.controller``."""
ExportFormat: TypeAlias = Literal["urdf", "mjcf", "yaml", "csv", "npz", "glb"]
"""Of ``export --format``."""
FigureKind: TypeAlias = Literal["png", "svg", "pdf"]
"""Of ``--figure-format``."""


class FigureName(StrEnum):
    """Of ``draw --figure``, which may be repeated: Typer reads lists of enumerations, not of literals."""

    PLAN = "plan"
    CURVES = "curves"
    STEPS = "steps"
    LINKS = "links"
    SPACE = "space"
    GIF = "gif"
    MP4 = "mp4"
