"""Rules between the keys of a planar problem."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress

from ccm_opt.core.length_words import file_length
from ccm_opt.io.issues import Issues, closest
from ccm_opt.io.keypath import KeyPath, lookup
from ccm_opt.io.schema import (
    ArmTable,
    ChainTable,
    GoalTable,
    InertiaTable,
    LimitsTable,
    ObstacleTable,
    PoseTable,
    SpaceGoalTable,
    SpaceObstacleTable,
    SpaceWorkspaceTable,
    WorkspaceTable,
)
from ccm_opt.io.settings import READING, ReadingSettings
from ccm_opt.problem.planning_problem import MOST_CONTACT_SHARE_OF_LENGTH

OBSTACLE_KINDS = ("polygon", "box", "circle", "wall")
"""Of which every obstacle has exactly one."""
ROOM_KINDS = ("bounds", "boundary")
"""Of which the workspace has exactly one."""
START_KINDS = ("shape", "joints_deg", "segments")
"""Of which the start has exactly one."""
GOAL_KINDS = ("position", "joints_deg", "shape", "segments")
"""Of which every goal has exactly one."""
KNOWN = frozenset(
    key
    for table in (WorkspaceTable, ObstacleTable, GoalTable, SpaceWorkspaceTable, SpaceObstacleTable, SpaceGoalTable)
    for key in table.model_fields
)
"""Keys of the tables that offer alternatives; none of them is a misspelling."""


def check_alternatives(data: Mapping[str, object], issues: Issues) -> None:
    """Every table that offers alternatives must take exactly one, and a heading needs something to apply to."""
    exactly_one(data, ("workspace",), ROOM_KINDS, issues)
    obstacles = lookup(data, ("workspace", "obstacles"))
    if isinstance(obstacles, list):
        for k in range(len(obstacles)):
            exactly_one(data, ("workspace", "obstacles", k), OBSTACLE_KINDS, issues)
        refuse_equal_names(obstacles, issues)
    exactly_one(data, ("start",), START_KINDS, issues)
    _heading_applies(data, ("start",), ("segments",), issues)
    for path in goal_paths(data):
        exactly_one(data, path, GOAL_KINDS, issues)
        _heading_applies(data, path, ("position", "segments"), issues)
    check_masses(data, issues)
    check_feed_keys(data, issues)
    check_tries(data, issues)
    check_contact(data, issues)


def goal_paths(data: Mapping[str, object]) -> list[KeyPath]:
    """Where the goals stand: ``[goal]`` alone, or each ``[[goal]]`` in turn."""
    goals = data.get("goal")
    return [("goal", k) for k in range(len(goals))] if isinstance(goals, list) else [("goal",)]


def _given(data: Mapping[str, object], path: KeyPath, kinds: Sequence[str]) -> list[str]:
    return [kind for kind in kinds if lookup(data, (*path, kind)) is not None]


def exactly_one(data: Mapping[str, object], path: KeyPath, kinds: Sequence[str], issues: Issues) -> None:
    """A table has one of some keys, and no more."""
    if not isinstance(lookup(data, path), Mapping):
        return
    given = _given(data, path, kinds)
    expected = f"expected exactly one of {', '.join(kinds)}"
    if len(given) > 1:
        issues.add((*path, given[1]), f"{expected}; got {' and '.join(given)}")
    elif not given and not _misspelt(data, path, kinds):
        drawn = ', or closed = "room" with a drawing of the room' if kinds is ROOM_KINDS else ""
        issues.add(path, f"{expected}{drawn}; got none of them")


def _misspelt(data: Mapping[str, object], path: KeyPath, kinds: Sequence[str]) -> bool:
    """Whether a key of the table is meant to be one of ``kinds``: that is reported already."""
    table = lookup(data, path)
    if not isinstance(table, Mapping):
        return False
    unknown = [key for key in table if key not in KNOWN]
    return any(closest(key, kinds) is not None for key in unknown)


def refuse_equal_names(obstacles: list[object], issues: Issues) -> None:
    """No two obstacles may have the same name, given or by their place: messages call them by it."""
    first: dict[object, int] = {}
    for k, entry in enumerate(obstacles):
        given = entry.get("name") if isinstance(entry, Mapping) else None
        name = str(given or f"obstacle {k + 1}")
        if first.setdefault(name, k) != k:
            path: KeyPath = ("workspace", "obstacles", k)
            issues.add(
                (*path, "name") if given else path,
                f"the name '{name}' is taken by workspace.obstacles[{first[name]}]; give each obstacle its own",
            )


def _heading_applies(data: Mapping[str, object], path: KeyPath, kinds: Sequence[str], issues: Issues) -> None:
    if lookup(data, (*path, "heading_deg")) is not None and not _given(data, path, kinds):
        issues.add((*path, "heading_deg"), f"only allowed together with {' or '.join(kinds)}")


def check_masses(data: Mapping[str, object], issues: Issues) -> None:
    """Masses are given for all links or for each."""
    if len(_given(data, ("arm",), ("link_mass", "masses"))) == 2:
        issues.add(("arm", "masses"), "expected only one of link_mass, masses; got both")


def check_tries(data: Mapping[str, object], issues: Issues) -> None:
    """Several tries need a planner that draws something."""
    tries = lookup(data, ("planner", "tries"))
    if isinstance(tries, int) and tries > 1 and lookup(data, ("planner", "method")) == "hill-climbing":
        issues.add(("planner", "tries"), '"hill-climbing" draws nothing, so that all tries would be the same; use 1')


def check_contact(data: Mapping[str, object], issues: Issues) -> None:
    """What may be missing of a gap is there for rounding, and not for plans that go through walls."""
    path: KeyPath = ("verification", "contact_tolerance")
    tolerance, links, length = (lookup(data, place) for place in (path, ("arm", "links"), ("arm", "link_length")))
    if not isinstance(tolerance, (int, float)) or not isinstance(links, int) or not isinstance(length, (int, float)):
        return  # that is told already, or nothing is asked for
    with suppress(OverflowError):  # so are numbers that are far too large
        if tolerance > MOST_CONTACT_SHARE_OF_LENGTH * links * length > 0.0:
            issues.add(path, f"at most a thousandth of the arm's length can be left to rounding; got {tolerance:g}")


def check_feed_keys(data: Mapping[str, object], issues: Issues) -> None:
    """A feed axis needs its limits, and nothing may speak of one that is not there."""
    poses = [("start", "feed"), *((*path, "feed") for path in goal_paths(data))]
    limits = [("limits", f"feed_{what}") for what in ("velocity", "acceleration", "jerk", "force")]
    if lookup(data, ("arm", "feed")) is None:
        for path in [*poses, *limits]:
            if lookup(data, path) is not None:
                issues.add(path, "only allowed together with arm.feed; leave it out for a fixed base")
        return
    for path in limits[:2]:
        if lookup(data, path) is None and isinstance(data.get("limits"), Mapping):
            issues.add(path, "missing; an arm with a feed axis needs this limit")
    for path in poses[1:]:
        place = path[:-1]
        if lookup(data, path) is not None and lookup(data, (*place, "position")) is not None:
            issues.add(path, "only allowed with a goal for the whole arm; for a goal of the tip the feed is planned")


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
