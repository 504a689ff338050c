"""Checks between tables of a problem file in space: poses within limits, and an arm whose up is no direction."""

import math
from collections.abc import Sequence

import numpy as np

from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.keypath import KeyPath
from ccm_opt.files.problem_file.reading_settings import READING, ReadingSettings
from ccm_opt.files.problem_file.schema import SpaceArmTable, SpaceGoalTable, SpacePoseTable, SpaceStartTable
from ccm_opt.files.problem_file.space_build import build_space_arm, build_space_pose

LEAST_ACROSS = 1e-6
"""Part of ``up`` that must lie across the direction; less is rounding of one along it."""


def check_up(arm: SpaceArmTable, issues: Issues) -> None:
    """The base's up must not lie along its direction."""
    if float(np.linalg.norm(np.cross(arm.base.up, arm.base.direction))) < LEAST_ACROSS:
        issues.add(("arm", "base", "up"), "it lies along arm.base.direction; expected a vector across it")


def check_space_poses(
    arm: SpaceArmTable,
    poses: Sequence[tuple[KeyPath, SpaceStartTable | SpaceGoalTable]],
    issues: Issues,
    *,
    arm_is_whole: bool,
    settings: ReadingSettings = READING,
) -> None:
    """Poses of the whole arm suit its joints, the range of its feed axis and its guide tube.

    Args:
        arm: the arm's table.
        poses: start and goals with where they stand.
        issues: receives what is wrong.
        arm_is_whole: whether the arm can be built.
        settings: tolerances.
    """
    for path, pose in poses:
        if isinstance(pose, SpaceGoalTable) and pose.position is not None:
            continue
        _check_bends(arm, pose, (*path, "joints_deg"), issues, settings.angle_tolerance)
        if arm.feed is not None and arm_is_whole:
            _check_fed(arm, pose, path, issues, settings.angle_tolerance)


def _check_bends(arm: SpaceArmTable, pose: SpacePoseTable, path: KeyPath, issues: Issues, tolerance: float) -> None:
    bends = pose.joints_deg or []
    if bends and len(bends) != arm.links:
        issues.add(path, f"expected one [a, b] a joint, that is {arm.links}; got {len(bends)}")
    for k, pair in enumerate(bends):
        key = "base_limit_deg" if k == 0 else "joint_limit_deg"
        limit = arm.base_limit_deg if k == 0 else arm.joint_limit_deg
        for which, bend in enumerate(pair):
            if abs(bend) > limit + tolerance:
                passed = f"{math.degrees(bend):g} deg passes {key} = {math.degrees(limit):g}"
                issues.add((*path, k, which), passed)


def _check_fed(arm: SpaceArmTable, pose: SpacePoseTable, path: KeyPath, issues: Issues, tolerance: float) -> None:
    """A pose lies within the range of the feed axis, and the guide tube holds its joints straight."""
    built = build_space_arm(arm)
    low, high = built.base_range
    at = build_space_pose(pose, built).feed
    if not low <= at <= high:
        issues.add((*path, "feed"), f"outside the range of the feed axis, {low:g} to {high:g} m")
    held = built.held(at)
    bends = pose.joints_deg or []
    for k in range(min(len(bends), arm.links)):  # a list of the wrong length is reported already
        if held[k] and max(map(abs, bends[k])) > tolerance:
            words = "this joint is still inside the guide tube of the feed axis; expected [0, 0]"
            issues.add((*path, "joints_deg", k), words)
