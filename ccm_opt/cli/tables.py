"""The closing tables of solve and check: every check with its worst value, and the time of every stage."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.display_settings import DISPLAY
from ccm_opt.cli.output import output
from ccm_opt.cli.stage_clock import StageClock
from ccm_opt.files.report.room_words import room_sentences
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import Check, RoomRecord, SimulationVerdict, Solution

SUMMARY = {
    "goal position": "tip error",
    "goal heading": "heading error",
    "goal joints": "largest joint error",
    "goal on the curve": "distance from the curve",
    "goal tip": "tip error",
    "wall clearance": "least clearance",
    "self-collision": "least clearance to itself",
    "survived joint error": "survived joint error",
}
"""Checks that the closing table of a solve shows, and what they are called there."""


def value_table(title: str) -> Table:
    """An empty table of values."""
    return _table(title, "value")


def print_solution(solution: Solution, clock: StageClock, folder: str) -> None:
    """Print what came out of a solved problem, on stdout."""
    table = _table(f"{solution.problem.name}: solved", "value")
    for check in solution.checks:
        if check.name in SUMMARY:
            values = (f"{check.worst:.4g}", f"{check.limit:.4g}", check.unit)
            table.add_row(SUMMARY[check.name], *values, escape(check.where))
    table.add_row("duration", f"{solution.trajectory.duration:.4g}", "", "s", "")
    joints = solution.joints
    torque_limit = solution.problem.limits.torque
    table.add_row(
        "peak torque", *peak_torque_cells(joints.torques, torque_limit, joints.names, solution.trajectory.time)
    )
    table.add_row("tracking error", f"{solution.simulation.tracking_error:.2g}", "", "rad", "in the simulation")
    for name, value in solution.metrics.items():
        if name.startswith("simulated_least"):
            where = "in the simulation"
            table.add_row(name.removesuffix("_m").replace("_", " "), f"{value:.4g}", "", "m", where)
    table.add_row("simulation", *verdict_cells(solution.simulation.verdict))
    console = report_console()
    console.print(table)
    if output().verbose:
        console.print(checks_table("every check", solution.checks))
    print_room(console, solution.room)
    console.print(f"all {len(solution.checks)} checks of the verifier hold")
    console.print(escape(stage_line(clock)), soft_wrap=True)
    console.print(escape(f"written to {folder}"), soft_wrap=True)


def print_room(console: Console, room: RoomRecord | None) -> None:
    """Print how much room a motion keeps, a sentence a line; nothing where nobody measured it."""
    if room is not None:
        for sentence in room_sentences(room):
            console.print(escape(sentence), soft_wrap=True)


def checks_table(title: str, checks: Sequence[Check]) -> Table:
    """A table of checks: worst value, limit, whether it holds, and where."""
    table = _table(title, "worst")
    for check in checks:
        name = escape(check.name) if check.passed else f"[red]{escape(check.name)} fails[/red]"
        table.add_row(name, f"{check.worst:.4g}", f"{check.limit:.4g}", check.unit, escape(check.where))
    return table


def columned_table(title: str, columns: Sequence[str], *, unwrapped: int | None = None) -> Table:
    """An empty table, its first column to the left and the others to the right.

    Args:
        title: above it, or empty.
        columns: their headings, in plain text.
        unwrapped: how many of the columns, from the first, are never broken into lines; all when None.
    """
    table = _plain_table(title)
    for k, column in enumerate(columns):
        justify: Literal["left", "right"] = "left" if k == 0 else "right"
        table.add_column(escape(column), justify=justify, no_wrap=unwrapped is None or k < unwrapped)
    return table


def _plain_table(title: str) -> Table:
    return Table(title=escape(title) or None, title_justify="left", title_style="bold", box=None, pad_edge=False)


def _table(title: str, value: str) -> Table:
    """An empty table of a name, a value, its limit, their unit and a place."""
    table = _plain_table(title)
    table.add_column("", no_wrap=True)
    table.add_column(value, justify="right", no_wrap=True)
    table.add_column("limit", justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("where")
    return table


def report_console() -> Console:
    """Standard output for tables; as wide as they need when it is not a terminal."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=DISPLAY.piped_width)


def verdict_cells(verdict: SimulationVerdict) -> tuple[str, str, str, str]:
    """The verdict on a simulation, no limit and unit, and where and why, as cells of a table."""
    outcome = verdict.outcome if verdict.followed else f"[red]{verdict.outcome}[/red]"
    step = f"with a step of {verdict.step:g} s"
    return outcome, "", "", escape(f"{verdict.reason}; {step}" if verdict.reason else step)


def stage_line(clock: StageClock) -> str:
    """Wall time, and CPU time in brackets, by stage and in all."""
    stages = [f"{name} {wall:.2f} ({clock.cpu[name]:.2f})" for name, wall in clock.wall.items()]
    total = f"total {sum(clock.wall.values()):.2f} ({sum(clock.cpu.values()):.2f})"
    return "time in s (CPU): " + ", ".join([*stages, total])


def peak_torque_cells(
    torques: FloatArray, limit: FloatArray | None, names: Sequence[str], time: FloatArray
) -> tuple[str, str, str, str]:
    """Peak torque, its limit, its unit and where it is met, as cells of a table.

    Args:
        torques: shape (samples, revolutes) [N m].
        limit: shape (revolutes,), or None without limits [N m].
        names: of the revolutes.
        time: of the samples, shape (samples,) [s].
    """
    magnitudes = np.abs(torques)
    sample, joint = np.unravel_index(np.argmax(magnitudes), magnitudes.shape)
    bound = "none" if limit is None else f"{limit[joint]:.4g}"
    where = f"{names[int(joint)]} at t = {time[sample]:.4f} s"
    return f"{magnitudes[sample, joint]:.4g}", bound, "N m", escape(where)
