"""The closing table of ``ccm-opt solve --pareto``."""

from collections.abc import Callable

from rich.markup import escape

from ccm_opt.cli.stage_clock import StageClock
from ccm_opt.cli.tables import columned_table, print_room, report_console, stage_line, units_of
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.solution import NearPlace, ParetoPlan, ParetoPlans, RoomRecord
from ccm_opt.space.space_solution import AnySolution

COLUMNS = (
    "plan",
    "wanted gap",
    "duration [s]",
    "least gap",
    "gap at goal",
    "energy [J]",
    "peak torque [N m]",
    "planning CPU [s]",
    "",
)
"""Gaps are those beyond the clearance, with their unit."""


def print_pareto(found: ParetoPlans[AnySolution], clock: StageClock, folder: str) -> None:
    """Print what came out of the trade-off between time and room, on stdout."""
    units = units_of(found.problem)
    table = columned_table(f"{found.problem.name}: from the fastest plan to the roomiest", COLUMNS)
    for number, plan in enumerate(found.plans, start=1):
        table.add_row(f"{number}", *_cells(plan, units), escape(_note(found, plan, number)))
    console = report_console()
    console.print(table)
    console.print(f"plan {found.recommended}, recommended:")
    print_room(console, found.best.room, units)
    console.print(f"all {len(found.best.checks)} checks of the verifier hold")
    console.print(escape(stage_line(clock)), soft_wrap=True)
    console.print(escape(f"written to {folder}, every plan to its folder in {folder}/pareto"), soft_wrap=True)


def _cells(plan: ParetoPlan[AnySolution], units: PageUnits) -> tuple[str, ...]:
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


def _gap(room: RoomRecord | None, at: Callable[[RoomRecord], NearPlace], units: PageUnits) -> str:
    """A gap; that nothing is within reach where it is so."""
    if room is None:
        return ""
    near = at(room)
    return f"{'' if near.link else '> '}{units.length(near.gap)}"


def _note(found: ParetoPlans[AnySolution], plan: ParetoPlan[AnySolution], number: int) -> str:
    """What there is to say of a plan beside its figures."""
    if plan.solution is None:
        return f"no plan: {plan.reason}"
    notes = ["recommended"] if number == found.recommended else []
    if plan.dominated_by:
        notes.append(f"dominated by {plan.dominated_by}")
    verdict = plan.solution.simulation.verdict
    if not verdict.followed:
        notes.append(f"simulation: {verdict.outcome}")
    return ", ".join(notes)
