"""Output options of commands: tables for people, one JSON document for programs, or nothing.

The module also lists the values of command-line options that select code, so that help texts need not import that code.
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
    """Output options of a command, and the results collected for its JSON document.

    Attributes:
        command: name of the command.
        as_json: whether one JSON document is printed instead of tables.
        quiet: whether tables and progress are suppressed; errors and warnings are still printed.
        verbose: whether every stage, the package's log, and every check are printed.
        allow_outside: whether drawings outside the folder of a problem file may be read.
        results: one result per item (file or folder) so far; the last one may be in progress.
        reported: lines already printed about why no plan was found for the current item.
    """

    command: str = ""
    as_json: bool = False
    quiet: bool = False
    verbose: bool = False
    allow_outside: bool = False
    results: list[dict[str, object]] = field(default_factory=list)
    reported: list[str] = field(default_factory=list)

    @property
    def tables(self) -> bool:
        """Whether tables are printed on stdout."""
        return not (self.as_json or self.quiet)

    def begin(self, item: str) -> None:
        """Begin the result of an item, a file or folder."""
        self.results.append({"item": item})
        self.reported = []

    @property
    def item(self) -> str:
        """Name of the current item (file or folder); name of the command if it has no items."""
        return str(self.results[-1]["item"]) if self.results else self.command

    def note(self, data: Mapping[str, object]) -> None:
        """Add data to the result of the current item, or of the command itself if it has no items."""
        if not self.results:
            self.begin(self.command)
        self.results[-1].update(data)

    def add_message(self, kind: str, message: str) -> None:
        """Add an error or a warning to the result of the current item.

        Args:
            kind: ``errors`` or ``warnings``.
            message: text of the message.
        """
        reported = self.results[-1].get(kind, []) if self.results else []
        earlier = list(reported) if isinstance(reported, Sequence) else []
        self.note({kind: [*earlier, message]})

    def document(self, exit_code: int) -> dict[str, object]:
        """Return the content of the JSON document of the command.

        Args:
            exit_code: exit code of the whole command.
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
    """Return the output options of the running command; outside commands, those for tables."""
    return _CURRENT.get() or _WITHOUT_COMMAND


@contextmanager
def printing(way: Output) -> Iterator[Output]:
    """Set the output options of the running command for the duration of a ``with`` block."""
    token = _CURRENT.set(way)
    try:
        yield way
    finally:
        _CURRENT.reset(token)


MethodChoice: TypeAlias = Literal["nlp", "hill-climbing"]
"""Choices of ``solve --method``: the values of ``planner.method``."""
ControllerChoice: TypeAlias = Literal["computed-torque", "pd"]
"""Choices of ``simulate --controller``: the values of ``simulation.controller``."""
SizeChoice: TypeAlias = Literal["length", "links", "radius"]
"""Choices of ``size --find``."""
ExportFormat: TypeAlias = Literal["urdf", "mjcf", "yaml", "csv", "npz", "glb"]
"""Choices of ``export --format``."""
FigureKind: TypeAlias = Literal["png", "svg", "pdf"]
"""Choices of ``--figure-format``."""


class FigureName(StrEnum):
    """Values of ``draw --figure``; an enumeration, since Typer reads repeated options from enumerations only."""

    PLAN = "plan"
    CURVES = "curves"
    STEPS = "steps"
    LINKS = "links"
    SPACE = "space"
    GIF = "gif"
    MP4 = "mp4"
    REPORT = "report"
