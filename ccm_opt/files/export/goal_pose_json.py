"""What the goal-pose NLP said about the end of a motion, as ``solution.json`` has it."""

from collections.abc import Mapping

from ccm_opt.files.export.pose_json import curve_record
from ccm_opt.solution import GoalPoseRecord, SpaceGoalPoseRecord


def goal_pose_data(record: GoalPoseRecord | SpaceGoalPoseRecord) -> Mapping[str, object]:
    """The whole record; lengths [m], angles [rad]."""
    variables, rows = record.size
    return {
        "reached": record.reached,
        "reason": record.reason,
        **_pose_data(record),
        "gap": record.gap,
        "wanted_gap": record.wanted_gap,
        "cost": record.cost,
        "costs": dict(record.costs),
        "multipliers": dict(record.multipliers),
        "nlp": {"variables": variables, "rows": rows, "iterations": record.iterations, "status": record.status},
        "tried": record.tried,
    }


def _pose_data(record: GoalPoseRecord | SpaceGoalPoseRecord) -> Mapping[str, object]:
    """The pose itself; in the plane with the curve behind it."""
    if isinstance(record, SpaceGoalPoseRecord):
        return {"configuration": record.configuration.tolist()}
    return {"headings": record.headings.tolist(), "curve": curve_record(record.curve)}
