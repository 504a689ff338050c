"""``ccm-opt reach``: where the tip can be in the room of a problem, as a table line, arrays and a picture."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape

from ccm_opt.cli.cancelling import last_steps_uninterrupted
from ccm_opt.cli.display_settings import DISPLAY
from ccm_opt.cli.loading import NamedProblems
from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.output import output
from ccm_opt.cli.tables import columned_table, report_console
from ccm_opt.cli.watchdog import ended_when_silent
from ccm_opt.core.executors import DaskWorkers, LocalWorkers, ThisProcess, Workers
from ccm_opt.io.folder import REACH_RECORD, check_target
from ccm_opt.io.pose_folder import reach_json, write_reach
from ccm_opt.io.space_pose_files import space_reach_json, write_space_reach
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.solution import ReachMap
from ccm_opt.solution.space_solution import SpaceReachMap


@dataclass(frozen=True)
class ReachOptions:
    """What the command line asks for.

    Attributes:
        out: directory of the output folders.
        step: width of a cell [m], or None.
        headings: that are tried in a cell, or None.
        workers: processes of this machine.
        dask: address of a Dask scheduler, or None.
        pictures: whether to draw.
    """

    out: Path
    step: float | None
    headings: int | None
    workers: int
    dask: str | None
    pictures: bool

    @property
    def crew(self) -> Workers:
        """Where cells are looked at."""
        if self.dask is not None:
            return DaskWorkers(self.dask)
        return ThisProcess() if self.workers == 1 else LocalWorkers(self.workers)


def reach_files(files: Sequence[Path], options: ReachOptions, changes: Sequence[str] = ()) -> int:
    """Map the reach in every file's room; all are tried.

    Args:
        files: problem files.
        options: the options.
        changes: keys of the problem files that are set to other values, each ``key.path=value``.

    Returns:
        The exit code.
    """
    problems = NamedProblems(files, changes)

    def reach_one(file: Path) -> int:
        problem = problems.read(file)
        check_target(options.out / problem.name, REACH_RECORD)
        if isinstance(problem, SpaceProblem):
            return _reach_in_space(problem, options)
        from ccm_opt.driver.reach_mapping import reach_map  # noqa: PLC0415 - loads casadi

        with _display(problem.name) as shown, _guarded(problem, options, shown) as progress:
            found = reach_map(
                problem, step=options.step, headings=options.headings, workers=options.crew, progress=progress
            )
        drawn = _pictures(found) if options.pictures else {}
        last_steps_uninterrupted()
        folder = write_reach(found, options.out, drawn)
        return print_result(lambda: _print(found, folder), SOLVED, lambda: _data(found, folder))

    return run_all(files, reach_one)


def _reach_in_space(problem: SpaceProblem, options: ReachOptions) -> int:
    """The same of a problem in space."""
    from ccm_opt.driver.reach_mapping_in_space import reach_map_in_space  # noqa: PLC0415 - loads casadi

    with _display(problem.name) as shown, _guarded(problem, options, shown) as progress:
        found = reach_map_in_space(
            problem, step=options.step, directions=options.headings, workers=options.crew, progress=progress
        )
    drawn = _space_pictures(found) if options.pictures else {}
    last_steps_uninterrupted()
    folder = write_space_reach(found, options.out, drawn)
    return print_result(lambda: _print_space(found, folder), SOLVED, lambda: _space_data(found, folder))


def _guarded(
    problem: AnyProblem, options: ReachOptions, progress: Callable[[int, int], None]
) -> AbstractContextManager[Callable[..., None]]:
    """Ended when a process of this machine looks at a cell without end; a cluster has bounds of its own."""
    if isinstance(options.crew, DaskWorkers):
        return nullcontext(progress)
    return ended_when_silent(problem.name, problem.planner, progress)


@contextmanager
def _display(name: str) -> Iterator[Callable[[int, int], None]]:
    """How many cells are reached, on stderr when that is a terminal."""
    console = Console(stderr=True, emoji=False)
    if output().quiet or not console.is_terminal:
        yield lambda _reached, _cells: None
        return
    with console.status(escape(name), refresh_per_second=DISPLAY.status_refreshes) as status:
        yield lambda reached, cells: status.update(escape(f"{name}: {reached} of at most {cells} cells reached"))


def _data(found: ReachMap, folder: Path) -> dict[str, object]:
    """The record of the map without the problem, for programs."""
    record: dict[str, object] = json.loads(reach_json(found))
    del record["problem"]
    return {"folder": str(folder), "status": "mapped", **record}


def _pictures(found: ReachMap) -> Mapping[str, bytes]:
    from ccm_opt.viz.pose_picture import reach_png  # noqa: PLC0415 - loads matplotlib

    return {"reach.png": reach_png(found)}


def _space_data(found: SpaceReachMap, folder: Path) -> dict[str, object]:
    """The record of a map in space without the problem, for programs."""
    record: dict[str, object] = json.loads(space_reach_json(found))
    del record["problem"]
    return {"folder": str(folder), "status": "mapped", **record}


def _space_pictures(found: SpaceReachMap) -> Mapping[str, bytes]:
    from ccm_opt.viz.space_pose_picture import space_reach_png  # noqa: PLC0415 - loads matplotlib

    return {"reach.png": space_reach_png(found)}


def _print_space(found: SpaceReachMap, folder: Path) -> None:
    """Print one line of figures of a map in space, on stdout."""
    columns = (
        "problem",
        "cells",
        "reached",
        "proved out of reach",
        "no pose found",
        "volume [m³]",
        "directions",
        "CPU [s]",
    )
    table = columned_table("", columns)
    count = len(found.directions)
    share = found.taken[found.reachable].mean() if count and found.reachable.any() else np.nan
    table.add_row(
        escape(found.problem.name),
        str(found.reachable.size),
        str(int(found.reachable.sum())),
        str(int(found.proved.sum())),
        str(int((~found.reachable & ~found.proved).sum())),
        f"{found.volume:.3g}",
        f"{100.0 * share:.0f} % of {count}" if count else "not asked",
        f"{sum(found.timings.values()):.1f}",
    )
    console = report_console()
    console.print(table)
    console.print(escape(f"written to {folder}"), soft_wrap=True)


def _print(found: ReachMap, folder: Path) -> None:
    """Print one line of figures, on stdout."""
    columns = (
        "problem",
        "cells",
        "reached",
        "proved out of reach",
        "no pose found",
        "area [m²]",
        "headings",
        "CPU [s]",
    )
    table = columned_table("", columns)
    unknown = int((~found.reachable & ~found.proved).sum())
    share = found.taken[found.reachable].mean() if found.reachable.any() else np.nan
    table.add_row(
        escape(found.problem.name),
        str(found.reachable.size),
        str(int(found.reachable.sum())),
        str(int(found.proved.sum())),
        str(unknown),
        f"{found.area:.3g}",
        f"{360.0 * share:.0f}° of 360°",
        f"{sum(found.timings.values()):.1f}",
    )
    console = report_console()
    console.print(table)
    console.print(escape(f"written to {folder}"), soft_wrap=True)
