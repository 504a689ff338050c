"""The commands ``pose``, the best pose at the goal, and ``reach``, a reachability map of the tip."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.cancelling import last_steps_uninterrupted
from ccm_opt.cli.loading import NO_TERMS, NamedProblems, NamedTerms, loaded_terms
from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.output import output
from ccm_opt.cli.solving import failures_recorded
from ccm_opt.cli.stage_clock import STATUS_REFRESHES, StageClock, ended_when_silent, stage_display
from ccm_opt.cli.tables import columned_table, report_console, result_units, stage_line, value_table
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.executors import DaskWorkers, LocalWorkers, ThisProcess, Workers
from ccm_opt.io.folder import POSE_RECORD, REACH_RECORD, check_target
from ccm_opt.io.records import pose_json
from ccm_opt.io.result_folders import reach_json, write_pose, write_pose_failure, write_reach
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import ReachMap, StaticPose
from ccm_opt.robot.configuration import SpaceConfiguration
from ccm_opt.robot.segment import segment_words

ROWS_SHOWN = 5
"""Maximum number of multipliers shown in the table; the record holds all."""


def pose_files(
    files: Sequence[Path],
    out: Path,
    terms: NamedTerms = NO_TERMS,
    changes: Sequence[str] = (),
    *,
    pictures: bool,
) -> int:
    """Find the best goal pose for every problem file, write an output folder for each, and return the exit code.

    Args:
        files: problem files.
        out: parent folder of the output folders.
        terms: references to the user's constraints and costs.
        changes: overrides of keys of the problem files, each ``key.path=value``.
        pictures: whether to draw a picture of each pose.

    Returns:
        The exit code of the worst outcome; after a failure the other files are still tried.
    """
    problems = NamedProblems(files, changes)

    def pose_one(file: Path) -> int:
        return _find_and_write_pose(problems.read(file), out, terms, pictures=pictures)

    return run_all(files, pose_one)


def _find_and_write_pose(problem: Problem, out: Path, terms: NamedTerms, *, pictures: bool) -> int:
    check_target(out / problem.name, POSE_RECORD)
    with stage_display(problem.name) as clock:
        clock.begin("loading")
        from ccm_opt.driver.finding_pose import find_pose  # noqa: PLC0415 - loads casadi

        arguments = loaded_terms(*terms)
        with failures_recorded(problem, out, clock, pictures=False, write=write_pose_failure) as progress:
            found = find_pose(problem, progress=progress, **arguments)
        clock.begin("writing")
        picture_files = {}
        if pictures:
            from ccm_opt.viz.pose_picture import pose_png  # noqa: PLC0415 - loads matplotlib

            picture_files = {"pose.png": pose_png(found)}
        last_steps_uninterrupted()
        folder = write_pose(found, out, picture_files)
        clock.finish()
    return print_result(lambda: _print_pose(found, clock, folder), SOLVED, lambda: _pose_data(found, folder))


def _pose_data(found: StaticPose, folder: Path) -> dict[str, object]:
    """Return the record of a static pose without the problem, for JSON output."""
    record: dict[str, object] = json.loads(pose_json(found))
    del record["problem"]
    return {"folder": str(folder), **record}


def _print_pose(found: StaticPose, clock: StageClock, folder: Path) -> None:
    """Print a table of a static pose on stdout: clearance, costs, residuals, multipliers, segments, solver."""
    pose = found.pose
    units = result_units(found.problem)
    table = value_table(f"{found.problem.name}: best goal pose")
    table.add_row("least gap", units.length(pose.gap), f"≥ {units.given(pose.wanted_gap, 'm')}", escape(found.nearest))
    if found.problem.dimension == 3:
        _add_base_and_roll(table, found)
    table.add_row("cost", f"{pose.cost:.4g}", "", escape(_main_costs(pose.costs)))
    for name, miss in found.residuals.items():
        table.add_row(escape(f"residual of '{name}'"), f"{miss:.2g}", "", "")
    for name, multiplier in list(pose.multipliers.items())[:ROWS_SHOWN]:
        table.add_row("multiplier", f"{multiplier:.3g}", "", escape(name))
    for number, (length, words) in enumerate(_segment_rows(found), start=1):
        table.add_row(f"segment {number}", units.length(length), "", words)
    variables, rows = pose.size
    steps = f"{pose.iterations} iterations"
    table.add_row("NLP", steps, "", f"{variables} variables, {rows} rows: {pose.status}")
    console = report_console()
    console.print(table)
    for outcome in found.outcomes:
        cost = outcome.reason if outcome.cost is None else f"cost {outcome.cost:.4g}"
        console.print(escape(f"  {outcome.start}: {cost}"), soft_wrap=True)
    console.print(escape(stage_line(clock)), soft_wrap=True)
    console.print(escape(f"written to {folder}"), soft_wrap=True)


def _add_base_and_roll(table: Table, found: StaticPose) -> None:
    """Add table rows for the feed of the base and the roll of the last link."""
    units = result_units(found.problem)
    arm = found.problem.arm
    for name, axis, place in zip(arm.coordinates.base_names, arm.base_axes, np.atleast_1d(found.feed), strict=False):
        bounds = f"{units.given(axis.low, axis.unit)} to {units.given(axis.high, axis.unit)}"
        table.add_row(name, units.shown(float(place), axis.unit), bounds, "")
    rolled = found.goal_errors.roll_error
    if rolled is None:
        table.add_row("roll of the tip", units.shown(found.goal_errors.roll, "rad"), "", "determined by the bends")
    else:
        allowed = units.given(found.problem.tolerances.roll, "rad")
        table.add_row("roll away from goal.up", units.shown(rolled, "rad"), allowed, "")


def _segment_rows(found: StaticPose) -> list[tuple[float, str]]:
    """Return length [m] and description of every segment of a pose's backbone curve; in space, by how much it turns."""
    curve = found.curve
    if isinstance(curve, SpaceConfiguration):
        frames, _ = curve.sample_frames(curve.boundaries)
        words = [_turn_words(start.T @ end[:, 0]) for start, end in pairwise(frames)]
    else:
        words = [segment_words(segment) for segment in curve.segments]
    return [(segment.length, said) for segment, said in zip(curve.segments, words, strict=True)]


def _turn_words(end: FloatArray) -> str:
    """Return a curve segment's angle and azimuth of turn as text, given its end direction in its start frame (3,)."""
    turn = np.rad2deg(np.arctan2(np.hypot(end[1], end[2]), end[0]))
    azimuth = np.rad2deg(np.arctan2(end[2], end[1]))
    return f"turns {turn:.3g}° towards azimuth {azimuth:.0f}°"


def _main_costs(costs: Mapping[str, float]) -> str:
    """Return the significant cost terms as a text, the largest first."""
    parts = sorted(costs.items(), key=lambda item: -abs(item[1]))
    return ", ".join(f"{name} {value:.3g}" for name, value in parts if abs(value) >= 5e-4)


def reach_files(
    files: Sequence[Path],
    out: Path,
    changes: Sequence[str] = (),
    *,
    step: float | None = None,
    headings: int | None = None,
    workers: int = 1,
    dask: str | None = None,
    pictures: bool,
) -> int:
    """Compute a reachability map for every problem file, write an output folder for each, and return the exit code.

    Args:
        files: problem files.
        out: parent folder of the output folders.
        changes: overrides of keys of the problem files, each ``key.path=value``.
        step: width of a grid cell [m]; None for the default.
        headings: number of headings (in space, directions) tried in a cell; None for the default.
        workers: number of processes on this machine.
        dask: address of a Dask scheduler; None for this machine.
        pictures: whether to draw a picture of each map.

    Returns:
        The exit code of the worst outcome; after a failure the other files are still tried.
    """
    problems = NamedProblems(files, changes)
    crew: Workers = DaskWorkers(dask) if dask else ThisProcess() if workers == 1 else LocalWorkers(workers)

    def reach_one(file: Path) -> int:
        problem = problems.read(file)
        check_target(out / problem.name, REACH_RECORD)
        from ccm_opt.driver.reach_mapping import reach_map  # noqa: PLC0415 - loads casadi

        with _cells_display(problem.name) as shown, _watched(problem, crew, shown) as progress:
            found = reach_map(problem, step=step, headings=headings, workers=crew, progress=progress)
        picture_files = {}
        if pictures:
            from ccm_opt.viz.pose_picture import reach_png  # noqa: PLC0415 - loads matplotlib

            picture_files = {"reach.png": reach_png(found)}
        last_steps_uninterrupted()
        folder = write_reach(found, out, picture_files)
        return print_result(lambda: _print_reach(found, folder), SOLVED, lambda: _reach_data(found, folder))

    return run_all(files, reach_one)


def _watched(
    problem: Problem, crew: Workers, progress: Callable[[int, int], None]
) -> AbstractContextManager[Callable[..., None]]:
    """Return a context manager that ends the command if local processes report no progress for too long.

    On a cluster, which has time limits of its own, it does nothing. Its value is the function to call with progress.
    """
    if isinstance(crew, DaskWorkers):
        return nullcontext(progress)
    return ended_when_silent(problem.name, problem.planner, progress)


@contextmanager
def _cells_display(name: str) -> Iterator[Callable[[int, int], None]]:
    """Yield a function that shows the number of grid cells reached so far on stderr, if stderr is a terminal."""
    console = Console(stderr=True, emoji=False)
    if output().quiet or not console.is_terminal:
        yield lambda _reached, _cells: None
        return
    with console.status(escape(name), refresh_per_second=STATUS_REFRESHES) as status:
        yield lambda reached, cells: status.update(escape(f"{name}: {reached} of at most {cells} cells reached"))


def _reach_data(found: ReachMap, folder: Path) -> dict[str, object]:
    """Return the record of a reachability map without the problem, for JSON output."""
    record: dict[str, object] = json.loads(reach_json(found))
    del record["problem"]
    return {"folder": str(folder), "status": "mapped", **record}


def _print_reach(found: ReachMap, folder: Path) -> None:
    """Print the key figures of a reachability map on stdout, in one table row."""
    share = found.taken[found.reachable].mean() if found.taken.size and found.reachable.any() else np.nan
    if found.problem.dimension == 3:
        count = len(found.directions)
        size = ("volume [m³]", f"{found.size:.3g}")
        ways = ("directions", f"{100.0 * share:.0f} % of {count}" if count else "not mapped")
    else:
        size = ("area [m²]", f"{found.size:.3g}")
        ways = ("headings", f"{360.0 * share:.0f}° of 360°")
    cells = (
        ("problem", escape(found.problem.name)),
        ("cells", str(found.reachable.size)),
        ("reached", str(int(found.reachable.sum()))),
        ("proved out of reach", str(int(found.proved.sum()))),
        ("no pose found", str(int((~found.reachable & ~found.proved).sum()))),
        size,
        ways,
        ("CPU [s]", f"{sum(found.timings.values()):.1f}"),
    )
    table = columned_table("", [name for name, _ in cells])
    table.add_row(*(value for _, value in cells))
    console = report_console()
    console.print(table)
    console.print(escape(f"written to {folder}"), soft_wrap=True)
