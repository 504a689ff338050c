"""The room made wide enough for a pose that lies outside it."""

from dataclasses import replace

import numpy as np
import shapely

from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS
from ccm_opt.diagnosis.keyed_poses import tip_places, whole_poses
from ccm_opt.diagnosis.parameters import WholeChange
from ccm_opt.errors import Finding
from ccm_opt.freespace.workspace import BOUNDARY_NAME
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import in_unit
from ccm_opt.problem import Problem


def wider_room(
    problem: Problem, findings: tuple[Finding, ...], spare: float = DEFAULT_DIAGNOSIS.trials.room_spare
) -> WholeChange | None:
    """The problem in bounds that hold its start and its goals; None where other things than a room's sides matter.

    Args:
        problem: what was asked.
        findings: what is proved.
        spare: room beyond radius and clearance, as a share of the arm's length.
    """
    boundary = problem.workspace.boundary
    of_room = all(finding.kind == "contact" and BOUNDARY_NAME in finding.obstacles for finding in findings)
    if not findings or not of_room or not shapely.equals(boundary, shapely.box(*boundary.bounds)):
        return None
    need = problem.arm.radius + problem.workspace.clearance + spare * problem.arm.length
    points = _points(problem)
    low = np.minimum(points.min(axis=0) - need, boundary.bounds[:2])
    high = np.maximum(points.max(axis=0) + need, boundary.bounds[2:])
    step = 10.0 ** np.floor(np.log10(problem.arm.length) - 3.0)
    bounds = (*(np.floor(low / step) * step).tolist(), *(np.ceil(high / step) * step).tolist())
    # In the unit of the file, into which people copy them.
    unit = problem.length_unit
    numbers = ", ".join(f"{in_unit(value, unit):.6g}" for value in bounds)
    return WholeChange(
        f"workspace.bounds = [{numbers}] {unit}",
        "workspace.bounds",
        numbers,
        lambda p: replace(p, workspace=replace(p.workspace, boundary=shapely.box(*bounds))),
    )


def _points(problem: Problem) -> FloatArray:
    """Joints and tips of all that a problem gives, shape (m, 2) [m]."""
    arm = problem.arm
    poses = [arm.joint_positions(pose.headings, pose.feed) for pose in whole_poses(problem)]
    tips = [place.goal.position[None] for place in tip_places(problem)]
    return np.concatenate([*poses, *tips])
