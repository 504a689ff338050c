"""The file ``pose.json``: the best pose at the goal, its curve, and what the goal-pose NLP says about it."""

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from ccm_opt.errors import Diagnosis
from ccm_opt.io.problem_data import recorded_data
from ccm_opt.io.strict_json import strict_text
from ccm_opt.problem import Problem
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment_types import segment_words
from ccm_opt.solution import StaticPose
from ccm_opt.solution.space_solution import AnyStaticPose

__all__ = ["SCHEMA", "curve_record", "pose_failure_json", "pose_json", "segment_words"]

SCHEMA = 1
"""Version of the file's layout."""


def pose_json(found: StaticPose) -> str:
    """The record of a pose.

    Args:
        found: the pose.

    Returns:
        JSON text; numbers that are not finite stand as null.
    """
    record = _record(found.problem, "solved") | answer_record(found)
    record |= {
        "curve": curve_record(found.pose.curve),
        "binding": [asdict(side) for side in found.binding],
    }
    return strict_text(record)


def answer_record(found: AnyStaticPose) -> dict[str, object]:
    """What the records of poses have in common, in the plane and in space."""
    pose = found.pose
    variables, rows = pose.size
    return {
        "joints_deg": np.rad2deg(found.bends).tolist(),
        "joint_positions": found.joint_positions.tolist(),
        "gap": pose.gap,
        "wanted_gap": pose.wanted_gap,
        "nearest": found.nearest,
        "cost": pose.cost,
        "costs": dict(pose.costs),
        "multipliers": dict(pose.multipliers),
        "residuals": dict(found.residuals),
        "nlp": {"variables": variables, "rows": rows, "iterations": pose.iterations, "status": pose.status},
        "tries": [asdict(outcome) for outcome in found.outcomes],
        "timings": dict(found.timings),
    }


def pose_failure_json(problem: Problem, status: str, diagnosis: Diagnosis, timings: Mapping[str, float]) -> str:
    """The record of a problem at whose goal no pose was found.

    Args:
        problem: what was asked.
        status: how the search ended.
        diagnosis: why there is no pose.
        timings: of the stages that ran [s].
    """
    return strict_text(_record(problem, status) | {"timings": dict(timings), "diagnosis": asdict(diagnosis)})


def curve_record(curve: Configuration) -> dict[str, object]:
    """A curve with the type, length, knots and curvature of every segment."""
    return {
        "base": curve.base.tolist(),
        "base_heading": curve.base_heading,
        "segments": [
            {
                "type": segment_words(segment),
                "length": segment.length,
                "knots": list(segment.knots),
                "curvature": segment.curvature.tolist(),
            }
            for segment in curve.segments
        ],
    }


def _record(problem: Problem, status: str) -> dict[str, object]:
    return {"schema": SCHEMA, "status": status, "problem": recorded_data(problem)}
