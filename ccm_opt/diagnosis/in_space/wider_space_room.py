"""The room in space made wide enough for a pose that lies outside it."""

from dataclasses import replace

import numpy as np

from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS
from ccm_opt.diagnosis.in_space.keyed_space_poses import space_tip_places, whole_space_poses
from ccm_opt.diagnosis.parameters import WholeChange
from ccm_opt.errors import Finding
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import in_unit
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.scene import ROOM_NAME


def wider_space_room(
    problem: SpaceProblem, findings: tuple[Finding, ...], spare: float = DEFAULT_DIAGNOSIS.trials.room_spare
) -> WholeChange | None:
    """The problem in bounds that hold its start and its goals; None where other things than a room's sides matter.

    Args:
        problem: what was asked.
        findings: what is proved.
        spare: room beyond radius and clearance, as a share of the arm's length.
    """
    bounds = problem.workspace.bounds
    of_room = all(finding.kind == "contact" and ROOM_NAME in finding.obstacles for finding in findings)
    if not findings or not of_room or bounds is None:
        return None
    need = problem.arm.radius + problem.workspace.clearance + spare * problem.arm.length
    points = _points(problem)
    step = 10.0 ** np.floor(np.log10(problem.arm.length) - 3.0)
    low = np.floor(np.minimum(points.min(axis=0) - need, bounds[0]) / step) * step
    high = np.ceil(np.maximum(points.max(axis=0) + need, bounds[1]) / step) * step
    wider = np.stack((low, high))
    # In the unit of the file, into which people copy them.
    unit = problem.length_unit
    corners = (", ".join(f"{in_unit(value, unit):.6g}" for value in corner.tolist()) for corner in wider)
    numbers = f"[{'], ['.join(corners)}]"
    return WholeChange(
        f"workspace.bounds = [{numbers}] {unit}",
        "workspace.bounds",
        numbers,
        lambda p: replace(p, workspace=replace(p.workspace, bounds=wider)),
    )


def _points(problem: SpaceProblem) -> FloatArray:
    """Joints and tips of all that a problem gives, shape (m, 3) [m]."""
    poses = [joint_positions(problem.arm, pose.q) for pose in whole_space_poses(problem)]
    tips = [place.goal.position[None] for place in space_tip_places(problem)]
    return np.concatenate([*poses, *tips])
