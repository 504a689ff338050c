"""``ccm-opt pose``: the best pose at the goal of a problem, drawn and written, or a record of why there is none."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.cancelling import last_steps_uninterrupted
from ccm_opt.cli.failure_record import tell_where
from ccm_opt.cli.loading import NO_TERMS, NamedProblems, TermReferences
from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.stage_clock import StageClock, stage_display
from ccm_opt.cli.tables import report_console, stage_line, units_of, value_table
from ccm_opt.cli.watchdog import ended_when_silent
from ccm_opt.errors import Diagnosis, NoPlanFound
from ccm_opt.io.failure_folder import write_pose_failure
from ccm_opt.io.folder import POSE_RECORD, check_target
from ccm_opt.io.pose_folder import write_pose
from ccm_opt.io.solution_json import pose_json, segment_words
from ccm_opt.io.space_pose_files import space_pose_json, write_space_pose
from ccm_opt.problem.space_problem import AnyProblem
from ccm_opt.robot.space_configuration import SpaceSegment
from ccm_opt.solution.space_solution import AnyStaticPose, SpaceStaticPose

ROWS_SHOWN = 5
"""Multipliers that the table shows; all are in the record."""


def pose_files(
    files: Sequence[Path],
    out: Path,
    terms: TermReferences = NO_TERMS,
    changes: Sequence[str] = (),
    *,
    pictures: bool,
) -> int:
    """Find the best pose for every file; all are tried.

    Args:
        files: problem files.
        out: directory of the output folders.
        terms: user constraints and costs.
        changes: keys of the problem files that are set to other values, each ``key.path=value``.
        pictures: whether to draw.

    Returns:
        The exit code.
    """
    problems = NamedProblems(files, changes)

    def pose_one(file: Path) -> int:
        return _pose(problems.read(file), out, terms, pictures=pictures)

    return run_all(files, pose_one)


def _pose(problem: AnyProblem, out: Path, terms: TermReferences, *, pictures: bool) -> int:
    check_target(out / problem.name, POSE_RECORD)
    with stage_display(problem.name) as clock:
        found = _found_or_recorded(problem, out, clock, terms)
        clock.begin("writing")
        drawn = _pictures(found) if pictures else {}
        last_steps_uninterrupted()
        folder = _written(found, out, drawn)
        clock.finish()
    return print_result(lambda: _print(found, clock, folder), SOLVED, lambda: _data(found, folder))


def _found_or_recorded(problem: AnyProblem, out: Path, clock: StageClock, terms: TermReferences) -> AnyStaticPose:
    """Ask the static question; where there is no answer, the record of why is left in the output folder.

    Raises:
        NoPlanFound: its diagnosis is written to ``pose.json``.
        KeyboardInterrupt: a record with the status ``cancelled`` is written.
    """
    clock.begin("loading")
    from ccm_opt.driver.finding_pose import find_pose  # noqa: PLC0415 - loads casadi

    arguments = terms.loaded()

    def record(status: str, diagnosis: Diagnosis) -> None:
        folder = write_pose_failure(problem, status, diagnosis, out, clock.timings)
        tell_where(folder, out / problem.name, "why there is no new one is recorded")

    try:
        with ended_when_silent(problem.name, problem.planner, clock, record) as progress:
            return find_pose(problem, progress=progress, **arguments)
    except NoPlanFound as error:
        record(error.status, error.diagnosis)
        raise
    except KeyboardInterrupt:
        record("cancelled", Diagnosis("cancelled by the user", clock.current or "configuration"))
        raise


def _written(found: AnyStaticPose, out: Path, drawn: Mapping[str, bytes]) -> Path:
    if isinstance(found, SpaceStaticPose):
        return write_space_pose(found, out, drawn)
    return write_pose(found, out, drawn)


def _data(found: AnyStaticPose, folder: Path) -> dict[str, object]:
    """The record of the pose without the problem, for programs."""
    text = space_pose_json(found) if isinstance(found, SpaceStaticPose) else pose_json(found)
    record: dict[str, object] = json.loads(text)
    del record["problem"]
    return {"folder": str(folder), **record}


def _pictures(found: AnyStaticPose) -> Mapping[str, bytes]:
    from ccm_opt.viz.pose_picture import pose_png  # noqa: PLC0415 - loads matplotlib
    from ccm_opt.viz.space_pose_picture import space_pose_png  # noqa: PLC0415 - likewise

    return {"pose.png": space_pose_png(found) if isinstance(found, SpaceStaticPose) else pose_png(found)}


def _print(found: AnyStaticPose, clock: StageClock, folder: Path) -> None:
    """Print the pose, on stdout."""
    pose = found.pose
    units = units_of(found.problem)
    table = value_table(f"{found.problem.name}: best pose at the goal")
    table.add_row("gap", units.length(pose.gap), f"≥ {units.given(pose.wanted_gap, 'm')}", escape(found.nearest))
    if isinstance(found, SpaceStaticPose):
        _add_ends(table, found)
    table.add_row("cost", f"{pose.cost:.4g}", "", escape(_parts(pose.costs)))
    for name, miss in found.residuals.items():
        table.add_row(escape(f"residual of '{name}'"), f"{miss:.2g}", "", "")
    for name, multiplier in list(pose.multipliers.items())[:ROWS_SHOWN]:
        table.add_row("multiplier", f"{multiplier:.3g}", "", escape(name))
    for number, (length, words) in enumerate(_segments(found), start=1):
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


def _add_ends(table: Table, found: SpaceStaticPose) -> None:
    """Where the base is on its axis, and how the last link is rolled."""
    units = units_of(found.problem)
    for axis in found.problem.arm.base_axes:
        bounds = f"{units.given(axis.low, 'm')} to {units.given(axis.high, 'm')}"
        table.add_row("feed", units.length(found.feed), bounds, "")
    table.add_row("roll of the tip", units.shown(found.goal_errors.roll, "rad"), "", "follows from the bends")


def _segments(found: AnyStaticPose) -> list[tuple[float, str]]:
    """Length [m] of every segment of the curve, and its type, or in space where it turns, in words."""
    if isinstance(found, SpaceStaticPose):
        return [(segment.length, _space_segment_words(segment)) for segment in found.curve.segments]
    return [(segment.length, segment_words(segment)) for segment in found.pose.curve.segments]


def _space_segment_words(segment: SpaceSegment) -> str:
    """By how much a segment turns from its beginning to its end, and towards where."""
    end = segment.frame.T @ segment.end[0][:, 0]
    turn = np.rad2deg(np.arctan2(np.hypot(end[1], end[2]), end[0]))
    azimuth = np.rad2deg(np.arctan2(end[2], end[1]))
    return f"turns {turn:.3g}° towards azimuth {azimuth:.0f}°"


def _parts(costs: Mapping[str, float]) -> str:
    """The parts of the objective that count, the largest first."""
    parts = sorted(costs.items(), key=lambda item: -abs(item[1]))
    return ", ".join(f"{name} {value:.3g}" for name, value in parts if abs(value) >= 5e-4)
