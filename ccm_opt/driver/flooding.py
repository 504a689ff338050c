"""Looks at cells of a map on processes, those beside cells that were reached as soon as they are known."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol, TypeVar

from ccm_opt.ground.executors import LocalWorkers, ThisProcess, Workers, completed

TASK = TypeVar("TASK")
FOUND = TypeVar("FOUND")
FOUND_contra = TypeVar("FOUND_contra", contravariant=True)


class Flood(Protocol[TASK, FOUND_contra]):
    """Hands out cells to be looked at, and learns what was found."""

    @property
    def poses(self) -> Mapping[Any, Any]:
        """What is known of the cells that were reached."""

    def __iter__(self) -> Iterator[TASK]:
        """Cells to be looked at; new ones as more is added."""

    def add(self, task: TASK, found: FOUND_contra, /) -> None:
        """Learn what was found in a cell."""


def flooded(
    flood: Flood[TASK, FOUND],
    look: Callable[[TASK], FOUND],
    workers: Workers | int,
    open_cells: int,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Look at all cells that a flood hands out.

    Args:
        flood: learns what is found.
        look: at one cell; pickled.
        workers: where cells are looked at, or on how many processes of this machine.
        open_cells: how many cells there may be.
        progress: called with the numbers of cells reached and of cells that may be; None for nobody.

    Raises:
        BaseException: what looking at a cell raised.
    """
    crew = workers if not isinstance(workers, int) else ThisProcess() if workers == 1 else LocalWorkers(workers)
    for task, found in completed(crew, look, flood):
        if isinstance(found, BaseException):
            raise found
        flood.add(task, found)
        if progress is not None:
            progress(len(flood.poses), open_cells)
