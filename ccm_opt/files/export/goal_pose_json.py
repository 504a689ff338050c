"""What the goal-pose NLP said about the end of a motion, as ``solution.json`` has it."""

from collections.abc import Mapping

from ccm_opt.files.export.pose_json import curve_record
from ccm_opt.solution import GoalPoseRecord


def goal_pose_data(record: GoalPoseRecord) -> Mapping[str, object]:
    """The whole record; lengths [m], angles [rad]."""
    variables, rows = record.size
    return {
        "reached": record.reached,
        "reason": record.reason,
        "headings": record.headings.tolist(),
        "curve": curve_record(record.curve),
        "gap": record.gap,
        "wanted_gap": record.wanted_gap,
        "cost": record.cost,
        "costs": dict(record.costs),
        "multipliers": dict(record.multipliers),
        "nlp": {"variables": variables, "rows": rows, "iterations": record.iterations, "status": record.status},
        "tried": record.tried,
    }
