"""Rules between the keys of a problem in space."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ccm_opt.io.issues import Issues
from ccm_opt.io.keypath import KeyPath, lookup
from ccm_opt.io.rules import check_contact, check_feed_keys, check_masses, exactly_one, goal_paths, refuse_equal_names
from ccm_opt.io.schema import SpaceArmTable, SpaceGoalTable, SpacePoseTable, SpaceStartTable
from ccm_opt.io.settings import READING, ReadingSettings
from ccm_opt.io.space_build import build_space_arm, build_space_pose

BODY_KINDS = ("mesh", "box", "sphere", "cylinder", "capsule")
"""Of which every obstacle has exactly one."""
SPACE_START_KINDS = ("shape", "joints_deg")
"""Of which the start has exactly one."""
SPACE_GOAL_KINDS = ("position", "joints_deg", "shape")
"""Of which every goal has exactly one."""


def check_space_alternatives(data: Mapping[str, object], issues: Issues) -> None:
    """Every table that offers alternatives takes exactly one, and keys that need others have them."""
    obstacles = lookup(data, ("workspace", "obstacles"))
    if isinstance(obstacles, list):
        for k in range(len(obstacles)):
            path: KeyPath = ("workspace", "obstacles", k)
            exactly_one(data, path, BODY_KINDS, issues)
            for key in ("scale", "up", "solid", "sha256"):
                _needs(data, path, key, ("mesh",), issues)
            _one_turn(data, path, issues)
        refuse_equal_names(obstacles, issues)
    exactly_one(data, ("start",), SPACE_START_KINDS, issues)
    for path in goal_paths(data):
        exactly_one(data, path, SPACE_GOAL_KINDS, issues)
        for key in ("direction", "via"):
            _needs(data, path, key, ("position",), issues)
    check_masses(data, issues)
    check_contact(data, issues)
    check_feed_keys(data, issues)
    _refuse_planar_planning(data, issues)


def _needs(data: Mapping[str, object], path: KeyPath, key: str, others: Sequence[str], issues: Issues) -> None:
    """A key is only allowed together with one of some others."""
    if lookup(data, (*path, key)) is not None and all(lookup(data, (*path, other)) is None for other in others):
        issues.add((*path, key), f"only allowed together with {' or '.join(others)}")


def _one_turn(data: Mapping[str, object], path: KeyPath, issues: Issues) -> None:
    """A body is turned in one way alone."""
    ways = ("rotation_deg", "quaternion")
    if all(lookup(data, (*path, "pose", way)) is not None for way in ways):
        issues.add((*path, "pose", ways[1]), f"expected only one of {', '.join(ways)}; got both")


def _refuse_planar_planning(data: Mapping[str, object], issues: Issues) -> None:
    """The paper's planner and its mapping know the plane alone."""
    for key, word in (("method", "hill-climbing"), ("mapping", "even-joints")):
        if lookup(data, ("planner", key)) == word:
            issues.add(("planner", key), f'"{word}" is the paper\'s and knows the plane alone; leave it out in space')


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
