"""Rules between the keys of a problem file, checked on its data before tables are validated."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ccm_opt.io.arm_rules import ANGLE_TOLERANCE
from ccm_opt.io.arm_tables import SECTION_KEYS
from ccm_opt.io.goal_tables import SpaceGoalTable
from ccm_opt.io.issues import Issues, KeyPath, closest, lookup
from ccm_opt.io.quantities import Table
from ccm_opt.io.schema import TABLES, PlaneArmTable
from ccm_opt.io.shape_tables import PlacementTable
from ccm_opt.io.tool_tables import (
    PlaneLinkBodyTable,
    PlaneToolBodyTable,
    PlaneToolTable,
    SpaceLinkBodyTable,
    SpaceToolBodyTable,
    SpaceToolTable,
)
from ccm_opt.problem.goal_rules import MOST_TURN_WITH_UP
from ccm_opt.robot.tool import PARALLEL

KNOWN = frozenset(
    key
    for tables in TABLES.values()
    for name in ("workspace", "workspace.obstacles", "goal")
    for key in tables[name].model_fields
)
"""Keys of all tables with alternative keys; none of these counts as a misspelling of another."""


def check_alternatives(data: Mapping[str, object], issues: Issues, tables: Mapping[str, type[Table]]) -> None:
    """Report violations of the rules between keys.

    These are rules about alternative keys, keys that require others, obstacles of the same name, and keys about the
    feed.

    Args:
        data: the parsed problem file.
        issues: receives the defects.
        tables: schemas of the tables, by name.
    """
    obstacles = lookup(data, ("workspace", "obstacles"))
    listed = obstacles if isinstance(obstacles, list) else []
    places: list[tuple[KeyPath, type[Table]]] = [(("workspace",), tables["workspace"])]
    for k in range(len(listed)):
        path: KeyPath = ("workspace", "obstacles", k)
        places += [(path, tables["workspace.obstacles"]), ((*path, "pose"), PlacementTable)]
    _refuse_equal_names(listed, issues)
    places += [(("start",), tables["start"]), *((path, tables["goal"]) for path in goal_paths(data))]
    places += _body_tables(data, plane=tables["arm"] is PlaneArmTable)
    for path, table in [*places, (("arm",), tables["arm"])]:
        if table.rules.exactly_one:
            _exactly_one(data, path, table, issues)
        if len(_given(data, path, table.rules.at_most_one)) == 2:
            first, second = table.rules.at_most_one
            issues.add((*path, second), f"expected only one of {first}, {second}; got both")
        for key, others in table.rules.needs.items():
            if lookup(data, (*path, key)) is not None and not _given(data, path, others):
                issues.add((*path, key), f"only allowed together with {' or '.join(others)}")
    last = (*goal_paths(data)[-1], "pause") if data.get("goal") else ()
    if last and lookup(data, last) and lookup(data, ("planner", "order")) != "free":
        issues.add(last, "no goal follows, so that it has no effect; leave it out")
    _check_seen(data, issues)
    _check_feed_keys(data, issues)
    _check_base_axes(data, issues)
    _check_sections(data, issues)
    _check_coupled_joints(data, issues)


def _body_tables(data: Mapping[str, object], *, plane: bool) -> Iterator[tuple[KeyPath, type[Table]]]:
    """Yield the key paths and schemas of the tool, of other rigid bodies on links, and of all their bodies."""
    rigid: list[tuple[KeyPath, type[Table]]] = []
    if isinstance(lookup(data, ("arm", "tool")), dict):
        rigid.append((("arm", "tool"), PlaneToolTable if plane else SpaceToolTable))
    listed = lookup(data, ("arm", "bodies"))
    table = PlaneLinkBodyTable if plane else SpaceLinkBodyTable
    rigid += [(("arm", "bodies", k), table) for k in range(len(listed) if isinstance(listed, list) else 0)]
    for path, each in rigid:
        yield path, each
        if isinstance(bodies := lookup(data, (*path, "bodies")), list):
            for k in range(len(bodies)):
                yield (*path, "bodies", k), PlaneToolBodyTable if plane else SpaceToolBodyTable
                yield (*path, "bodies", k, "pose"), PlacementTable


def goal_paths(data: Mapping[str, object]) -> list[KeyPath]:
    """Return the key paths of all goals in a problem file, written as one ``[goal]`` or as several ``[[goal]]``."""
    goals = data.get("goal")
    return [("goal", k) for k in range(len(goals))] if isinstance(goals, list) else [("goal",)]


def are_paths(data: Mapping[str, object]) -> bool:
    """Return whether every goal of a problem file is a path of the tip."""
    return all(lookup(data, (*path, "path")) is not None for path in goal_paths(data))


def _given(data: Mapping[str, object], path: KeyPath, kinds: Sequence[str]) -> list[str]:
    return [kind for kind in kinds if lookup(data, (*path, kind)) is not None]


def _exactly_one(data: Mapping[str, object], path: KeyPath, table: type[Table], issues: Issues) -> None:
    """Report a table that has none, or more than one, of the keys of which exactly one is required."""
    given_table = lookup(data, path)
    if not isinstance(given_table, Mapping):
        return
    kinds = table.rules.exactly_one
    # A misspelt alternative is already reported as an unknown key.
    misspelt = any(closest(key, kinds) is not None for key in given_table if key not in KNOWN)
    given = _given(data, path, kinds)
    expected = f"expected exactly one of {', '.join(kinds)}"
    if len(given) > 1:
        issues.add((*path, given[1]), f"{expected}; got {' and '.join(given)}")
    elif not given and not misspelt:
        issues.add(path, f"{expected}{table.rules.otherwise}; got none of them")


def _refuse_equal_names(obstacles: list[object], issues: Issues) -> None:
    """Report obstacles of the same name, given or default, since messages identify obstacles by name."""
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


def _check_sections(data: Mapping[str, object], issues: Issues) -> None:
    """Report keys of the whole arm given in addition to sections, and masses given twice or not for all sections."""
    sections = lookup(data, ("arm", "sections"))
    if not isinstance(sections, list):
        return
    for key in SECTION_KEYS:
        if lookup(data, ("arm", key)) is not None:
            issues.add(("arm", key), "not together with arm.sections, which say it for each section; leave it out")
    _check_driven_sections(data, sections, issues)
    masses = [isinstance(each, Mapping) and each.get("mass") is not None for each in sections]
    for k, weighed in enumerate(masses):
        path: KeyPath = ("arm", "sections", k)
        if weighed and _given(data, ("arm",), ("link_mass", "masses", "inertia")):
            issues.add((*path, "mass"), "not together with arm.link_mass, arm.masses or arm.inertia")
        elif any(masses) and not weighed:
            issues.add(path, "mass is missing; give it for all sections or for none")


_NEEDS_PATH = 'for sections with drive = "section" only together with goal.path; leave it out'
_NOT_ALONG_PATH = "not supported along goal.path; leave it out"
_LEAVE_OUT = 'not supported for sections with drive = "section"; leave it out'
_NOT_IN_PLANE = 'not supported in the plane for sections with drive = "section"; give arm.tool, or leave it out'
_UNSUPPORTED = (
    *(("arm", key) for key in ("base_limit_deg", "link_mass")),
    *(("limits", key) for key in ("tip_velocity", "tip_acceleration", "points")),
    ("tolerance", "joint_error_deg"),
)
_ALONG_PATH = (("planner", "follow_within"),)
"""What sections that bend evenly support only where the goals are paths."""


def _check_driven_sections(data: Mapping[str, object], sections: Sequence[object], issues: Issues) -> None:
    """Report what sections that bend evenly do not support.

    Args:
        data: data of the problem file.
        sections: its list ``arm.sections``.
        issues: receives the defects.
    """
    rows = [each if isinstance(each, Mapping) else {} for each in sections]
    driven = [row.get("drive") == "section" for row in rows]
    if not any(driven):
        return
    where: KeyPath = ("arm", "sections")
    one_number = 'expected one number with drive = "section"'
    for k, row in enumerate(rows):
        refused = {
            "drive": not driven[k] and 'expected "section" for all sections or for none',
            "locked": row.get("locked") and 'joints of a section with drive = "section" bend alike; none can be locked',
            "joint_limit_deg": isinstance(row.get("joint_limit_deg"), list) and one_number,
        }
        for key, words in refused.items():
            if words:
                issues.add((*where, k, key), str(words))
    along = are_paths(data)
    given: list[tuple[KeyPath, str]] = [(path, _LEAVE_OUT) for path in _UNSUPPORTED]
    travels: list[KeyPath] = [(*where, k, "tendons", "travel") for k in range(len(rows))]
    given += [(path, _NOT_ALONG_PATH) for path in travels] if along else [(path, _NEEDS_PATH) for path in _ALONG_PATH]
    for path, words in given:
        if lookup(data, path):  # zeros, which other arms have by default, change nothing
            issues.add(path, words)
    if data.get("space") != 3:
        _check_driven_in_plane(data, len(rows), issues)
    _need_masses(data, rows, issues)
    for key, only in (("method", "nlp"), ("retiming", "toppra")):
        if lookup(data, ("planner", key)) not in {None, only}:
            issues.add(("planner", key), f'expected "{only}" for sections with drive = "section"')


def _check_driven_in_plane(data: Mapping[str, object], count: int, issues: Issues) -> None:
    """Report what sections that bend evenly, of a given number, do not support in the plane."""
    if lookup(data, ("arm", "bodies")):
        issues.add(("arm", "bodies"), _NOT_IN_PLANE)
    for k in range(count):
        for key in ("number", "angle_deg"):
            path: KeyPath = ("arm", "sections", k, "tendons", key)
            if lookup(data, path) is not None:
                issues.add(path, "in the plane a section has two tendons, to its left and its right; leave it out")
    for pose in (("start",), *goal_paths(data)):
        if lookup(data, (*pose, "segments")) is not None:
            issues.add((*pose, "segments"), _LEAVE_OUT)
        if lookup(data, (*pose, "shape")) == "folded":
            issues.add((*pose, "shape"), 'expected "straight" for sections with drive = "section"')


def _need_masses(data: Mapping[str, object], rows: Sequence[Mapping[str, object]], issues: Issues) -> None:
    """Report masses of sections that bend evenly which are missing where torques are limited."""
    weighed = lookup(data, ("arm", "masses")) or any(row.get("mass") is not None for row in rows)
    if lookup(data, ("limits", "torque")) is not None and not weighed:
        issues.add(("arm", "sections", 0, "mass"), "missing; limits.torque needs the mass of each section")


_NOT_COUPLED = (
    ("tolerance", "joint_error_deg"),
    *(("limits", key) for key in ("tip_velocity", "tip_acceleration", "points")),
)


def _check_coupled_joints(data: Mapping[str, object], issues: Issues) -> None:
    """Report what joints that share a drive do not support."""
    if lookup(data, ("arm", "coupling")) is None:
        return
    for path in _NOT_COUPLED:
        if lookup(data, path):
            issues.add(path, "not supported together with arm.coupling; leave it out")
    for key, only in (("method", "nlp"), ("retiming", "toppra")):
        if lookup(data, ("planner", key)) not in {None, only}:
            issues.add(("planner", key), f'expected "{only}" together with arm.coupling')


def _check_seen(data: Mapping[str, object], issues: Issues) -> None:
    """Report what is missing from, or goes beside, a goal of seeing surfaces."""
    paths = goal_paths(data)
    for path in paths:
        if lookup(data, (*path, "see")) is None:
            continue
        for key in ("share", "spacing"):
            if lookup(data, (*path, key)) is None:
                issues.add((*path, key), "missing; goal.see needs it")
        if len(paths) > 1:
            issues.add((*path, "see"), "expected as the only goal; views are found for it, and no other goals")
        if lookup(data, ("planner", "order")) != "free":
            issues.add((*path, "see"), 'needs planner.order = "free", since the order of the views is free')
        if lookup(data, ("planner", "end")) == "last":
            issues.add(("planner", "end"), 'expected "free" or "start" with goal.see, which has no last goal')


def _check_feed_keys(data: Mapping[str, object], issues: Issues) -> None:
    """Report missing limits of a feed axis, or keys about the feed if the arm has no feed axis."""
    poses = [("start", "feed"), *((*path, "feed") for path in goal_paths(data))]
    limits = [("limits", f"feed_{what}") for what in ("velocity", "acceleration", "jerk", "force")]
    if lookup(data, ("arm", "feed")) is None:
        for path in [*poses, *limits]:
            if lookup(data, path) is not None:
                issues.add(path, "only allowed together with arm.feed; leave it out for a fixed base")
        _check_paths(data, issues)
        return
    _check_followed_paths(data, issues)
    for path in limits[:2]:
        if lookup(data, path) is None and isinstance(data.get("limits"), Mapping):
            issues.add(path, "missing; an arm with a feed axis needs this limit")
    for path in poses[1:]:
        if lookup(data, path) is not None and _given(data, path[:-1], ("position", "path", "look_at", "see")):
            issues.add(path, "only allowed with a whole-arm goal; with a tip goal the feed is planned")


def _check_followed_paths(data: Mapping[str, object], issues: Issues) -> None:
    """Report paths of the tip of an arm on a feed axis whose drives move several joints."""
    sections = lookup(data, ("arm", "sections"))
    rows = [each for each in sections if isinstance(each, Mapping)] if isinstance(sections, list) else []
    if lookup(data, ("arm", "coupling")) is None and not any(row.get("drive") == "section" for row in rows):
        return
    for path in ((*each, "path") for each in goal_paths(data)):
        if lookup(data, path) is not None:
            issues.add(path, "followed by joints that bend one by one; make arm.feed the last of arm.base.axes")


def _check_paths(data: Mapping[str, object], issues: Issues) -> None:
    """Report paths of the tip, and bounds on following it, of an arm without a feed axis that cannot follow."""
    moves, within = lookup(data, ("arm", "base", "axes")), ("planner", "follow_within")
    for path in [] if moves else [(*each, "path") for each in goal_paths(data)]:
        if lookup(data, path) is not None:
            issues.add(path, "only allowed together with arm.feed or arm.base.axes; a fixed base follows no path")
    if lookup(data, within) is not None and not (moves and are_paths(data)):
        issues.add(within, "only allowed together with arm.feed, or with arm.base.axes and goal.path; leave it out")


def _check_base_axes(data: Mapping[str, object], issues: Issues) -> None:
    """Report defects of base axes, of their positions in poses, and keys that are not supported together with them."""
    axes = lookup(data, ("arm", "base", "axes"))
    listed = [each if isinstance(each, Mapping) else {} for each in axes] if isinstance(axes, list) else []
    _check_positions_of_axes(data, len(listed), issues)
    if listed and lookup(data, ("arm", "feed")) is not None:
        issues.add(("arm", "feed"), "not together with arm.base.axes; make it the last of them")
    if listed and lookup(data, ("tolerance", "joint_error_deg")):
        issues.add(("tolerance", "joint_error_deg"), "not supported for an arm on arm.base.axes; leave it out")
    if listed and lookup(data, ("arm", "mount_length")):
        issues.add(("arm", "mount_length"), "expected 0 on arm.base.axes, which move the mount; leave it out")
    for path, value in (("planner", "method"), "hill-climbing"), (("planner", "retiming"), "paul"):
        if listed and lookup(data, path) == value:
            issues.add(path, f'"{value}" is not supported for an arm on arm.base.axes; leave it out')
    for key in ("tip_velocity", "tip_acceleration", "points"):
        if listed and lookup(data, ("limits", key)) is not None:
            issues.add(("limits", key), "not supported for an arm on arm.base.axes; leave it out")
    for k, table in enumerate(listed):
        if table.get("kind") in {"prismatic", "revolute"}:  # others are reported elsewhere
            _check_base_axis(table, ("arm", "base", "axes", k), issues)


def _check_positions_of_axes(data: Mapping[str, object], count: int, issues: Issues) -> None:
    """Report positions of base axes, in poses, that do not fit the number of axes, or are given with a tip goal."""
    for path in [("start", "axes"), *((*path, "axes") for path in goal_paths(data))]:
        given = lookup(data, path)
        if given is None:
            continue
        if count == 0:
            issues.add(path, "only allowed together with arm.base.axes")
        elif isinstance(given, list) and len(given) != count:
            issues.add(path, f"expected one number for each of the {count} axes of arm.base, got {len(given)}")
        if _given(data, path[:-1], ("position", "path", "look_at", "see")):
            issues.add(path, "only allowed with a whole-arm goal; with a tip goal the axes are planned")


def _check_base_axis(table: Mapping[str, Any], where: KeyPath, issues: Issues) -> None:
    """Report keys of a base axis that do not fit its kind, and a range that is missing, reversed or too short."""
    kind = table["kind"]
    key, effort, others = (
        ("range", "force", ("range_deg", "torque", "position"))
        if kind == "prismatic"
        else ("range_deg", "torque", ("range", "force"))
    )
    for other in others:
        if other in table:
            issues.add((*where, other), f"not for a {kind} axis, which has {key} and {effort}")
    ends = table.get(key)
    numbers = [each for each in ends if isinstance(each, (int, float))] if isinstance(ends, list) else []
    if ends is None:
        issues.add((*where, key), f"missing; a {kind} axis needs it")
    elif len(numbers) != 2 or not numbers[0] < numbers[1]:
        issues.add((*where, key), "expected [lower, upper] with lower < upper")
    else:
        _check_braking(table, numbers[1] - numbers[0], where, issues)


def _check_braking(table: Mapping[str, Any], width: float, where: KeyPath, issues: Issues) -> None:
    """Report an axis that needs more than its whole range to brake from its greatest velocity, v² / 2 a."""
    speed, gain = table.get("velocity"), table.get("acceleration")
    if not (isinstance(speed, (int, float)) and isinstance(gain, (int, float)) and gain > 0.0):
        return  # reported elsewhere
    if table.get("kind") == "revolute":
        width = math.radians(width)
    needed = speed**2 / (2.0 * gain)
    if needed > width:
        issues.add(
            (*where, "acceleration"),
            f"the axis cannot brake: from its velocity of {speed:g} it needs {needed:.4g} to stop, more than its range "
            f"of {width:.4g}; expected at least {speed**2 / (2.0 * width):.4g}, or a lower velocity",
        )


def check_up(goal: SpaceGoalTable, path: KeyPath, tool: SpaceToolTable | None, issues: Issues) -> None:
    """Report an up direction of a goal that does not determine the roll about the goal's direction.

    Args:
        goal: the table of the goal.
        path: its key path.
        tool: the table of the arm's tool, or None.
        issues: receives the defects.
    """
    if goal.up is None or goal.direction is None:
        return
    if np.linalg.norm(np.cross(goal.up, goal.direction)) < PARALLEL:
        issues.add((*path, "up"), "parallel to goal.direction; expected a vector with a component across it")
    if goal.direction_tolerance_deg > MOST_TURN_WITH_UP + ANGLE_TOLERANCE:
        issues.add((*path, "direction_tolerance_deg"), "expected at most 45 together with goal.up")
    if tool is None:
        return
    up = [0.0, 0.0, 1.0] if tool.up is None else tool.up
    if np.linalg.norm(np.cross(up, tool.direction)) < PARALLEL:
        given = "missing" if tool.up is None else "parallel to arm.tool.direction"
        what = "z, the default, is along arm.tool.direction" if tool.up is None else "expected a component across it"
        issues.add(("arm", "tool", "up"), f"{given}; goal.up needs it, and {what}")
