"""The folder of several plans of one problem: that of the recommended plan, with a folder for each plan in it."""

from collections.abc import Mapping

from ccm_opt.io.folder import PARETO_RECORD, solution_files
from ccm_opt.io.solution_json import place_data
from ccm_opt.io.strict_json import strict_text
from ccm_opt.solution import ParetoPlan, ParetoPlans
from ccm_opt.solution.space_solution import AnySolution

SCHEMA = 1
"""Version of the layout of ``pareto.json``."""


def pareto_files(found: ParetoPlans[AnySolution]) -> dict[str, bytes]:
    """Content of every file but the pictures, by file name.

    The recommended plan's are those that ``solve`` would write; those of all plans are in the folder ``pareto``.
    """
    files = solution_files(found.best)
    files[PARETO_RECORD] = pareto_json(found).encode()
    for number, plan in enumerate(found.plans, start=1):
        if plan.solution is not None:
            inner = solution_files(plan.solution)
            files |= {f"{folder_of(number)}/{name}": content for name, content in inner.items()}
    return files


def folder_of(number: int) -> str:
    """Where the plan of a number, from 1, is written within the problem's folder."""
    return f"pareto/{number}"


def pareto_json(found: ParetoPlans[AnySolution]) -> str:
    """The record of the trade-off; lengths [m], times [s]."""
    plans = [_plan_data(plan, number) for number, plan in enumerate(found.plans, start=1)]
    record = {
        "schema": SCHEMA,
        "problem": found.problem.name,
        "recommended": found.recommended,
        "most_time": found.most_time,
        "plans": plans,
    }
    return strict_text(record)


def _plan_data(plan: ParetoPlan[AnySolution], number: int) -> Mapping[str, object]:
    head = {"number": number, "wanted_gap": plan.wanted_gap}
    solution = plan.solution
    if solution is None or solution.room is None:
        return {**head, "status": "no plan", "reason": plan.reason}
    return {
        **head,
        "status": "solved",
        "folder": folder_of(number),
        "duration": plan.duration,
        "price": solution.room.price,
        "nearest": place_data(solution.room.nearest),
        "goal": place_data(solution.room.at_goal),
        "energy": plan.energy,
        "peak_torque": plan.peak_torque,
        "planning_cpu": plan.cpu,
        "simulation": solution.simulation.verdict.outcome,
        "dominated_by": plan.dominated_by or None,
    }
