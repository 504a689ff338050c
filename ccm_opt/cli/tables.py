"""The tables that end a run: every check with its worst value, and the time of every stage."""

from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.stage_clock import StageClock
from ccm_opt.solution import Check, Solution


def print_solution(solution: Solution, clock: StageClock, folder: str) -> None:
    """Print what came out of a solved problem, on stdout."""
    table = checks_table(f"{solution.problem.name}: {solution.status}", solution.checks)
    table.add_section()
    table.add_row("duration", f"{solution.trajectory.duration:.4g}", "", "s", "", "")
    table.add_row("peak torque", *_peak_torque(solution), "")
    console = Console(soft_wrap=True, highlight=False)
    console.print(table)
    console.print(escape(stage_line(clock)))
    console.print(escape(f"written to {folder}"))


def checks_table(title: str, checks: Sequence[Check]) -> Table:
    """A table of checks: worst value, limit, where, and whether it holds."""
    table = Table(title=escape(title), title_justify="left", title_style="bold", box=None, pad_edge=False)
    for heading, justify in (
        ("", "left"),
        ("worst", "right"),
        ("limit", "right"),
        ("", "left"),
        ("where", "left"),
        ("", "left"),
    ):
        table.add_column(heading, justify="right" if justify == "right" else "left", no_wrap=True)
    for check in checks:
        verdict = "[green]ok[/green]" if check.passed else "[red]fails[/red]"
        table.add_row(
            escape(check.name), f"{check.worst:.4g}", f"{check.limit:.4g}", check.unit, escape(check.where), verdict
        )
    return table


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
