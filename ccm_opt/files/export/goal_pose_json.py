"""What the goal-pose NLP said, as ``solution.json`` has it."""

from collections.abc import Mapping

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.segment import CurvatureSegment
from ccm_opt.continuum.segment_types import classify
from ccm_opt.errors import ProblemError
from ccm_opt.solution import GoalPoseRecord


def goal_pose_data(record: GoalPoseRecord) -> Mapping[str, object]:
    """The whole record; lengths [m], angles [rad]."""
    variables, rows = record.size
    return {
        "reached": record.reached,
        "reason": record.reason,
        "gap_m": record.gap,
        "wanted_gap_m": record.wanted_gap,
        "cost": record.cost,
        "costs": dict(record.costs),
        "multipliers": dict(record.multipliers),
        "status": record.status,
        "iterations": record.iterations,
        "variables": variables,
        "rows": rows,
        "tried": record.tried,
        "headings_rad": record.headings.tolist(),
        "curve": curve_data(record.curve),
    }


def curve_data(curve: Configuration) -> Mapping[str, object]:
    """A curve with the type, the length, the knots and the curvatures of each segment."""
    return {
        "base_m": list(curve.base),
        "base_heading_rad": curve.base_heading,
        "segments": [
            {
                "type": type_of_segment(segment),
                "length_m": segment.length,
                "knots": list(segment.knots),
                "curvatures_per_m": segment.curvature.tolist(),
            }
            for segment in curve.segments
        ],
    }


def type_of_segment(segment: CurvatureSegment) -> str:
    """The type of a segment, or that it has more than one inflection and so none of the paper's types."""
    try:
        return classify(segment).value
    except ProblemError:
        return "several inflections"
