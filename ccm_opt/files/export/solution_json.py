"""The file ``solution.json``: what was asked, what came out, how every limit was met, or why there is no plan.

Strict JSON, without NaN or infinity.
"""

from collections.abc import Mapping
from dataclasses import asdict

from ccm_opt.errors import Diagnosis
from ccm_opt.files.export.goal_pose_json import goal_pose_data
from ccm_opt.files.export.room_json import room_data
from ccm_opt.files.export.space_record import mesh_data, space_recorded_data
from ccm_opt.files.export.strict_json import strict_text
from ccm_opt.files.export.tolerance_json import tolerance_data
from ccm_opt.files.problem_file.problem_data import recorded_data
from ccm_opt.solution import Check
from ccm_opt.space.problem import AnyProblem, SpaceProblem
from ccm_opt.space.space_solution import AnySolution, GoalErrors, SpaceSolution

SCHEMA = 1
"""Version of the file's layout."""


def solution_json(solution: AnySolution) -> str:
    """The record of a solved problem.

    Args:
        solution: the verified plan.

    Returns:
        JSON text; numbers that are not finite stand as null.
    """
    record = _record(solution.problem, "solved", solution.versions)
    record |= {
        "metrics": dict(solution.metrics),
        "timings": dict(solution.timings),
        "timed_by": list(solution.trajectory.timed_by),
        "checks": [_check_data(check) for check in solution.checks],
        "not_checked": list(solution.not_checked),
        "simulation": asdict(solution.simulation.verdict),
    }
    if isinstance(solution, SpaceSolution):
        record["goal"] = goal_data(solution.goal_errors)
        record["meshes"] = mesh_data(solution.problem)
    if solution.room is not None:
        record["room"] = room_data(solution.room)
    if solution.tolerance:
        record["tolerance"] = tolerance_data(solution.tolerance)
    if solution.tries:
        record["tries"] = [asdict(each) for each in solution.tries]
    if solution.path.goal_pose is not None:
        record["goal_pose"] = goal_pose_data(solution.path.goal_pose)
    return strict_text(record)


def goal_data(errors: GoalErrors) -> dict[str, object]:
    """How the last link lies at its goal [m, rad]."""
    return {"position_error": errors.position, "direction_error": errors.direction, "roll": errors.roll}


def _check_data(check: Check) -> dict[str, object]:
    """A check; where its least gap is stands in words, and in figures in the record of the room."""
    return {name: value for name, value in asdict(check).items() if name != "place"}


def failure_json(problem: AnyProblem, status: str, diagnosis: Diagnosis, timings: Mapping[str, float]) -> str:
    """The record of a problem without a plan.

    Args:
        problem: what was asked.
        status: how the search ended.
        diagnosis: why there is no plan.
        timings: of the stages that ran [s].

    Returns:
        JSON text; numbers that are not finite stand as null.
    """
    record = _record(problem, status, {})
    record |= {"metrics": {}, "timings": dict(timings), "checks": [], "diagnosis": asdict(diagnosis)}
    return strict_text(record)


def _record(problem: AnyProblem, status: str, versions: Mapping[str, str]) -> dict[str, object]:
    return {
        "schema": SCHEMA,
        "status": status,
        "method": problem.planner.method,
        "problem": space_recorded_data(problem) if isinstance(problem, SpaceProblem) else recorded_data(problem),
        "versions": dict(versions),
        "seed": problem.planner.seed,
    }
