"""Checks between tables of a problem file: a value for every link, poses within limits, curves as long as the arm."""

import math
from collections.abc import Sequence

from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.keypath import KeyPath
from ccm_opt.files.problem_file.reading_settings import READING, ReadingSettings
from ccm_opt.files.problem_file.schema import ArmTable, ChainTable, InertiaTable, LimitsTable, PoseTable
from ccm_opt.ground.length_words import file_length


def check_arm_lists(arm: ChainTable, issues: Issues) -> None:
    """Masses and moments of inertia given as lists need one value a link."""
    _one_each(arm.masses, ("arm", "masses"), (arm.links,), "link", issues)
    for key in ("rotor_inertia", "friction"):
        _one_each(getattr(arm, key), ("arm", key), (arm.links, 3 * arm.links), "ball joint or revolute", issues)
    inertia = arm.inertia
    if isinstance(inertia, InertiaTable):
        _one_each(inertia.axial, ("arm", "inertia", "axial"), (arm.links,), "link", issues)
        _one_each(inertia.transverse, ("arm", "inertia", "transverse"), (arm.links,), "link", issues)


def check_limit_lists(arm: ChainTable, limits: LimitsTable, issues: Issues) -> None:
    """Limits given as lists need one value a ball joint or one a revolute."""
    for key in ("velocity", "acceleration", "jerk", "torque"):
        _one_each(getattr(limits, key), ("limits", key), (arm.links, 3 * arm.links), "ball joint or revolute", issues)


def check_limited_points(
    arm: ChainTable, limits: LimitsTable, issues: Issues, settings: ReadingSettings = READING
) -> None:
    """Points whose motion is limited stand on the arm, and something of them is limited."""
    length = arm.links * arm.link_length
    for k, point in enumerate(limits.points):
        path: KeyPath = ("limits", "points", k)
        if point.at > length * (1.0 + settings.length_tolerance):
            expected = f"at most the arm's length, links * link_length = {file_length(length, 6)}"
            issues.add((*path, "at"), f"{file_length(point.at, 6)} is beyond the tip; expected {expected}")
        if point.velocity is None and point.acceleration is None:
            issues.add(path, "nothing is limited; expected velocity, acceleration or both")
        if point.at in [other.at for other in limits.points[:k]]:
            issues.add(
                (*path, "at"), f"the point at {file_length(point.at, 6)} is limited already; expected one entry a point"
            )


def check_pose(
    arm: ArmTable, pose: PoseTable, path: KeyPath, issues: Issues, settings: ReadingSettings = READING
) -> None:
    """A pose given by joints must suit the joints, one given by segments the arm's length."""
    if pose.joints_deg is not None:
        _one_each(pose.joints_deg, (*path, "joints_deg"), (arm.links,), "link", issues)
        _within_limits(arm, pose.joints_deg, (*path, "joints_deg"), issues, settings.angle_tolerance)
    if pose.segments is not None:
        total = sum(segment.length for segment in pose.segments)
        length = arm.links * arm.link_length
        if abs(total - length) > settings.length_tolerance * length:
            issues.add(
                (*path, "segments"),
                f"the segments are {file_length(total, 9)} long together; expected the arm's length, "
                f"links * link_length = {file_length(length, 9)}",
            )


def _one_each(
    value: float | Sequence[float] | None, path: KeyPath, counts: tuple[int, ...], what: str, issues: Issues
) -> None:
    if isinstance(value, Sequence) and len(value) not in counts:
        wanted = " or ".join(map(str, counts))
        issues.add(path, f"expected one value a {what}, that is {wanted}; got {len(value)}")


def _within_limits(arm: ArmTable, bends: Sequence[float], path: KeyPath, issues: Issues, tolerance: float) -> None:
    for k, bend in enumerate(bends):
        key = "base_limit_deg" if k == 0 else "joint_limit_deg"
        limit = arm.base_limit_deg if k == 0 else arm.joint_limit_deg
        if abs(bend) > limit + tolerance:
            issues.add((*path, k), f"{math.degrees(bend):g} deg passes {key} = {math.degrees(limit):g}")
