"""Tables of results for the terminal, and printing of results on stdout."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.output import output
from ccm_opt.cli.stage_clock import StageClock
from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import (
    ClearanceRecord,
    NearPlace,
    ParetoPlan,
    ParetoPlans,
    SimulationVerdict,
    Solution,
    Tour,
)
from ccm_opt.robot.frames import drive_torque_limits, drive_torques
from ccm_opt.viz.checks_section import CheckWords, checks_in_words, joint_in_words
from ccm_opt.viz.clearance_section import clearance_sentences
from ccm_opt.viz.document import PageUnits
from ccm_opt.viz.tour_section import tour_sentences

_PIPED_WIDTH = 200
"""Width of tables printed to a file or another program [characters]."""
_WIDEST_TITLE = 28
"""Maximum width of the name of a check before it is wrapped [characters]."""


def value_table(title: str) -> Table:
    """Return an empty table with columns for the name, value, limit and place of a quantity."""
    table = _plain_table(title)
    table.add_column("", no_wrap=True)
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("limit", justify="right", no_wrap=True)
    table.add_column("where")
    return table


def print_solution(solution: Solution, clock: StageClock, folder: str) -> None:
    """Print the solution of a problem on stdout: checks, duration, clearance, simulation, CPU times.

    Args:
        solution: the verified plan.
        clock: clock with the times of the stages.
        folder: path of the output folder.
    """
    problem = solution.problem
    units = result_units(problem)
    in_space = problem.dimension == 3
    words = checks_in_words(solution.checks, units, problem.numbered_goals, in_space=in_space)
    shown_checks = words if output().verbose else [check for check in words if not check.of_itself]
    partly = solution.tour is not None and bool(solution.tour.left_out)
    table = checks_table(f"{problem.name}: {'solved in part' if partly else 'solved'}", shown_checks)
    table.add_row("Duration", f"{solution.trajectory.duration:.4g} s", "", "", "")
    if problem.limits.torque is None:
        torques = drive_torques(problem.arm, solution.joints.torques)
        table.add_row("Peak torque", *peak_torque(problem, torques, solution.joints.names))
    if "leader_deviation_worst_m" in solution.metrics:
        worst = units.length(solution.metrics["leader_deviation_worst_m"])
        mean = units.length(solution.metrics["leader_deviation_mean_m"])
        table.add_row("Leader path deviation", worst, "", "", f"{mean} on average")
    verdict = solution.simulation.verdict
    table.add_row("Simulated arm", *verdict_cells(verdict))
    if verdict.followed:
        error = units.shown(solution.simulation.tracking_error, "rad", 1.0)
        table.add_row("Tracking error", error, "", "", "in the simulation")
    console = report_console()
    console.print(table)
    print_clearance(console, solution.room, units)
    print_not_checked(console, solution.not_checked)
    print_tour(console, solution.tour)
    of_itself = sum(check.of_itself for check in words)
    console.print(f"all {len(words)} checks passed, {of_itself} of them on the plan's consistency")
    console.print(escape(stage_line(clock)), soft_wrap=output().verbose)
    console.print(escape(f"written to {folder}"), soft_wrap=True)


def result_units(problem: Problem) -> PageUnits:
    """Return the units in which a problem's results are printed; lengths are in the unit of the problem file."""
    return PageUnits.of_file(problem.length_unit, problem.arm.length)


def print_clearance(console: Console, room: ClearanceRecord | None, units: PageUnits) -> None:
    """Print the clearance of a motion, one sentence per line; nothing if clearance was not measured."""
    if room is not None:
        for sentence in clearance_sentences(room, units):
            console.print(escape(sentence), soft_wrap=True)


def print_not_checked(console: Console, remarks: Sequence[str]) -> None:
    """Print one line for each property of a plan that was not checked."""
    for remark in remarks:
        console.print(f"[yellow]not checked:[/yellow] {escape(remark)}", soft_wrap=True)


def print_tour(console: Console, tour: Tour | None) -> None:
    """Print the order in which goals in free order are visited and, goal by goal, which are left out and why."""
    if tour is None:
        return
    for goal in tour.left_out:
        console.print(f"[red]left out:[/red] {escape(f'{tour.goal_title(goal.goal)}: {goal.reason}')}", soft_wrap=True)
    for sentence in tour_sentences(tour):
        console.print(escape(sentence), soft_wrap=True)


def checks_table(title: str, checks: Sequence[CheckWords]) -> Table:
    """Return a table of checks with worst value, limit, used fraction of the limit, and place."""
    table = _plain_table(title)
    table.add_column("", max_width=_WIDEST_TITLE)
    table.add_column("worst", justify="right", no_wrap=True)
    table.add_column("limit", justify="right", no_wrap=True)
    table.add_column("used", justify="right", no_wrap=True)
    table.add_column("where")
    for check in checks:
        title = escape(check.title) if check.passed else f"[red]{escape(check.title)}: fails[/red]"
        used = "" if check.used is None else f"{100.0 * check.used:.0f} %"
        # Limits are abbreviated to fit the table.
        limit = check.limit.replace("at least ", "≥ ").replace("at most ", "≤ ").replace("no contact", "≥ 0")
        when = "" if check.time is None else f"{check.time:.2f} s"
        where = ", ".join(part for part in (check.where, when) if part)
        table.add_row(title, escape(check.worst), escape(limit), used, escape(where))
    return table


def columned_table(title: str, columns: Sequence[str], *, unwrapped: int | None = None) -> Table:
    """Return an empty table whose first column is left-aligned and whose other columns are right-aligned.

    Args:
        title: title of the table; may be empty.
        columns: column headings, in plain text.
        unwrapped: number of leading columns that are never wrapped; None for all.
    """
    table = _plain_table(title)
    for k, column in enumerate(columns):
        justify: Literal["left", "right"] = "left" if k == 0 else "right"
        table.add_column(escape(column), justify=justify, no_wrap=unwrapped is None or k < unwrapped)
    return table


def _plain_table(title: str) -> Table:
    return Table(title=escape(title) or None, title_justify="left", title_style="bold", box=None, pad_edge=False)


def report_console() -> Console:
    """Return a console for tables on stdout, with a fixed large width if stdout is not a terminal."""
    console = Console(highlight=False, emoji=False)
    return console if console.is_terminal else Console(highlight=False, emoji=False, width=_PIPED_WIDTH)


def verdict_cells(verdict: SimulationVerdict) -> tuple[str, str, str, str]:
    """Return table cells for the outcome of a simulation: outcome, empty limit, empty fraction, and reason."""
    outcome = f"[red]{verdict.outcome}[/red]" if verdict.is_failure else verdict.outcome
    return outcome, "", "", escape(verdict.reason)


def stage_line(clock: StageClock) -> str:
    """Return one line with wall time and, in brackets, CPU time of every stage and in total."""
    stages = [f"{name} {wall:.2f} ({clock.cpu[name]:.2f})" for name, wall in clock.wall.items()]
    total = f"total {sum(clock.wall.values()):.2f} ({sum(clock.cpu.values()):.2f})"
    return "time in s (CPU): " + ", ".join([*stages, total])


def peak_torque(problem: Problem, torques: FloatArray, names: Sequence[str]) -> tuple[str, str, str, str]:
    """Return table cells for the peak torque of drives that bend an arm: value, limit, used fraction, and drive.

    Args:
        problem: the problem, with arm and torque limits.
        torques: torques of the drives that bend the arm at T samples, shape (T, n) [N m].
        names: names of the revolute joints.
    """
    arm, limits = problem.arm, problem.limits.torque
    magnitudes = np.abs(torques)
    drive = int(np.unravel_index(np.argmax(magnitudes), magnitudes.shape)[1])
    peak = float(magnitudes[:, drive].max())
    limit = None if limits is None else float(drive_torque_limits(arm, limits)[drive])
    bound = "none" if limit is None else f"≤ {limit:.3g} N m"
    used = "" if limit is None else f"{100.0 * peak / limit:.0f} %"
    if arm.drives is not None:
        return f"{peak:.3g} N m", bound, used, arm.drives.drive_names[drive]
    where = joint_in_words(f"joint {drive // 3 + 1} ({names[drive]})", in_space=arm.dimension == 3)
    return f"{peak:.3g} N m", bound, used, escape(where)


COLUMNS = (
    "plan",
    "preferred",
    "duration [s]",
    "least gap",
    "gap at goal",
    "energy [J]",
    "peak torque [N m]",
    "planning CPU [s]",
    "",
)
"""Column headings of the table of Pareto-optimal plans; clearances are those beyond the required clearance."""


def print_pareto(found: ParetoPlans, clock: StageClock, folder: str) -> None:
    """Print a table of Pareto-optimal plans on stdout, and the clearance of the recommended plan.

    Args:
        found: the plans.
        clock: clock with the times of the stages.
        folder: path of the output folder.
    """
    units = result_units(found.problem)
    table = columned_table(f"{found.problem.name}: trade-off of duration and clearance", COLUMNS)
    for number, plan in enumerate(found.plans, start=1):
        table.add_row(f"{number}", *_cells(plan, units), escape(_note(found, plan, number)))
    console = report_console()
    console.print(table)
    console.print(f"plan {found.recommended}, recommended:")
    print_clearance(console, found.best.room, units)
    console.print(f"all {len(found.best.checks)} checks passed")
    console.print(escape(stage_line(clock)), soft_wrap=True)
    console.print(escape(f"written to {folder}, each plan to a folder in {folder}/pareto"), soft_wrap=True)


def _cells(plan: ParetoPlan, units: PageUnits) -> tuple[str, ...]:
    wanted = units.given(plan.wanted_gap, "m")
    if plan.solution is None:
        return (wanted, *[""] * 6)
    return (
        wanted,
        f"{plan.duration:.3f}",
        _gap(plan.solution.room, lambda room: room.nearest, units),
        _gap(plan.solution.room, lambda room: room.at_goal, units),
        f"{plan.energy:.3g}",
        f"{plan.peak_torque:.3g}",
        f"{plan.cpu:.2f}",
    )


def _gap(room: ClearanceRecord | None, at: Callable[[ClearanceRecord], NearPlace], units: PageUnits) -> str:
    """Return a clearance as text, with ">" if nothing is within the search distance; empty if not measured."""
    if room is None:
        return ""
    near = at(room)
    return f"{'' if near.link else '> '}{units.length(near.gap)}"


def _note(found: ParetoPlans, plan: ParetoPlan, number: int) -> str:
    """Return remarks on one of several Pareto-optimal plans: no plan, recommended, dominated, or failed simulation."""
    if plan.solution is None:
        return f"no plan: {plan.reason}"
    notes = ["recommended"] if number == found.recommended else []
    if plan.dominated_by:
        notes.append(f"dominated by {plan.dominated_by}")
    verdict = plan.solution.simulation.verdict
    if not verdict.followed:
        notes.append(f"simulation: {verdict.outcome}")
    return ", ".join(notes)
