"""The sides of regions that a goal pose leans on, read from the names of rows with a multiplier."""

import re

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.nlp.arm_pose.pose_solver import ArmPose
from ccm_opt.nlp.arm_pose.pose_task import JointRegions
from ccm_opt.planners.goal_pose import GoalPoseSearch
from ccm_opt.planners.joint_regions import joint_regions
from ccm_opt.solution import BindingSide

_ROW = re.compile(r"link (\d+): side (\d+) of its region, at its (start|end)")
"""What ``region_rows`` calls its rows."""


def binding_sides(search: GoalPoseSearch, pose: ArmPose, start: FloatArray) -> tuple[BindingSide, ...]:
    """The sides that a pose leans on, the largest multiplier first.

    Args:
        search: that found the pose.
        pose: a solution of the NLP.
        start: link headings about which its regions were drawn, shape (links,) [rad].
    """
    arm = search.problem.arm
    points = arm.joint_positions(pose.headings)
    drawn = [joint_regions(arm, search.problem.workspace, start, settings) for settings in search.settings.widening]
    sides = []
    for name, multiplier in pose.answer.multipliers.items():
        row = _ROW.fullmatch(name)
        if row is None:
            continue
        link = int(row[1])
        joint = link if row[3] == "end" else link - 1
        place = points[joint]
        normal = _normal(drawn, joint, int(row[2]) - 1, place, pose.gap, search)
        if normal is not None:
            sides.append(BindingSide(link, _pair(place), _pair(normal), multiplier))
    return tuple(sides)


def _normal(
    drawn: list[JointRegions], joint: int, side: int, place: FloatArray, gap: float, search: GoalPoseSearch
) -> FloatArray | None:
    """The side's outward normal, shape (2,), in the regions by which the place has just the gap to it; None in none."""
    allowed = search.settings.leaning * search.problem.arm.length
    for regions in drawn:
        if side < regions.sides:
            normal: FloatArray = regions.normals[joint, side]
            if abs(float(regions.offsets[joint, side] - normal @ place) - gap) <= allowed:
                return normal
    return None


def _pair(vector: FloatArray) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])
