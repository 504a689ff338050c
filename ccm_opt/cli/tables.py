"""The tables that end a run: every check with its worst value, and the time of every stage."""

from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.stage_clock import StageClock
from ccm_opt.solution import Check, Solution

PIPED_WIDTH = 200
"""Columns of output that goes to a file or another program."""


def print_solution(solution: Solution, clock: StageClock, folder: str) -> None:
    """Print what came out of a solved problem, on stdout."""
    table = checks_table(f"{solution.problem.name}: solved", solution.checks)
    table.add_row("duration", f"{solution.trajectory.duration:.4g}", "", "s", "", "")
    *torque, where = _peak_torque(solution)
    table.add_row("peak torque", *torque, "", where)
    console = report_console()
    console.print(table)
    console.print(escape(stage_line(clock)), soft_wrap=True)
    console.print(escape(f"written to {folder}"), soft_wrap=True)


def checks_table(title: str, checks: Sequence[Check]) -> Table:
    """A table of checks: worst value, limit, whether it holds, and where."""
    table = Table(title=escape(title), title_justify="left", title_style="bold", box=None, pad_edge=False)
    table.add_column("", no_wrap=True)
    table.add_column("worst", justify="right", no_wrap=True)
    table.add_column("limit", justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("where")
    for check in checks:
        verdict = "[green]ok[/green]" if check.passed else "[red]fails[/red]"
        values = (f"{check.worst:.4g}", f"{check.limit:.4g}", check.unit)
        table.add_row(escape(check.name), *values, verdict, escape(check.where))
    return table


def report_console() -> Console:
    """Standard output for tables; as wide as they need when it is not a terminal."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=PIPED_WIDTH)


def stage_line(clock: StageClock) -> str:
    """Wall time, and CPU time in brackets, by stage and in all."""
    stages = [f"{name} {wall:.2f} ({clock.cpu[name]:.2f})" for name, wall in clock.wall.items()]
    total = f"total {sum(clock.wall.values()):.2f} ({sum(clock.cpu.values()):.2f})"
    return "time in s (CPU): " + ", ".join([*stages, total])


def _peak_torque(solution: Solution) -> tuple[str, str, str, str]:
    """Peak torque, its limit, its unit, and where it is met."""
    joints, limit = solution.joints, solution.problem.limits.torque
    sample, joint = np.unravel_index(np.argmax(np.abs(joints.torques)), joints.torques.shape)
    where = f"{joints.names[joint]} at t = {solution.trajectory.time[sample]:.4f} s"
    return f"{abs(joints.torques[sample, joint]):.4g}", "none" if limit is None else f"{limit[joint]:.4g}", "N m", where
