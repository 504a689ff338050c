"""Checks of the rules between keys of a problem file, and of the positions of the base, the drawing and the meshes."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, LengthUnit, file_length, in_unit, message_unit
from ccm_opt.io.issues import Issues, KeyPath, closest, lookup
from ccm_opt.io.schema import TABLES, PlaneArmTable, PoseTable, SpaceArmTable, SpaceGoalTable, SpacePoseTable
from ccm_opt.io.schema_tables import (
    SECTION_KEYS,
    ArmTable,
    ChainTable,
    LimitsTable,
    SectionTable,
    Table,
    VerificationTable,
    arc_ending_at,
)
from ccm_opt.io.shape_tables import PlacementTable
from ccm_opt.io.tool_tables import (
    PlaneLinkBodyTable,
    PlaneToolBodyTable,
    PlaneToolTable,
    SpaceLinkBodyTable,
    SpaceToolBodyTable,
    SpaceToolTable,
)
from ccm_opt.problem import ImportedDrawing
from ccm_opt.problem.definition import MOST_TURN_WITH_UP
from ccm_opt.problem.field_types import odd_times
from ccm_opt.problem.options import MOST_CONTACT_SHARE_OF_LENGTH
from ccm_opt.problem.tool_rules import Key, tool_defects
from ccm_opt.robot.arc_sections import MOST_ARC_TURN
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import PARALLEL
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.distances.enclosures import enclosure_advice
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.surfaces import box_about
from ccm_opt.scene.workspace import BOUNDARY_NAME, ROOM_NAME, Obstacle, PlaneScan, PlaneShape, Workspace

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
_UNSUPPORTED = (
    *(("arm", key) for key in ("base_limit_deg", "feed", "link_mass")),
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
    if data.get("space") != 3:
        issues.add((*where, driven.index(True), "drive"), '"section" is supported in space only, with space = 3')
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
    _need_masses(data, rows, issues)
    for key, only in (("method", "nlp"), ("retiming", "toppra")):
        if lookup(data, ("planner", key)) not in {None, only}:
            issues.add(("planner", key), f'expected "{only}" for sections with drive = "section"')


def _need_masses(data: Mapping[str, object], rows: Sequence[Mapping[str, object]], issues: Issues) -> None:
    """Report masses of sections that bend evenly which are missing where torques are limited."""
    weighed = lookup(data, ("arm", "masses")) or any(row.get("mass") is not None for row in rows)
    if lookup(data, ("limits", "torque")) is not None and not weighed:
        issues.add(("arm", "sections", 0, "mass"), "missing; limits.torque needs the mass of each section")


_NOT_COUPLED = (("arm", "feed"), ("tolerance", "joint_error_deg"))
_NOT_COUPLED_LIMITS = tuple(("limits", key) for key in ("tip_velocity", "tip_acceleration", "points"))


def _check_coupled_joints(data: Mapping[str, object], issues: Issues) -> None:
    """Report what joints that share a drive do not support."""
    if lookup(data, ("arm", "coupling")) is None:
        return
    for path in (*_NOT_COUPLED, *_NOT_COUPLED_LIMITS):
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
    for path in limits[:2]:
        if lookup(data, path) is None and isinstance(data.get("limits"), Mapping):
            issues.add(path, "missing; an arm with a feed axis needs this limit")
    for path in poses[1:]:
        if lookup(data, path) is not None and _given(data, path[:-1], ("position", "path", "look_at", "see")):
            issues.add(path, "only allowed with a whole-arm goal; with a tip goal the feed is planned")


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


_LENGTH_TOLERANCE = 1e-6
"""Allowed relative difference between the total length of a pose's curve segments and the arm's length. Heuristic:
lengths are written with six digits or more."""
ANGLE_TOLERANCE = 1e-9
"""Amount by which joint angles may exceed their limit [rad]. Derived: converting degrees to radians rounds."""
LEAST_ACROSS = 1e-6
"""Minimum component of ``up`` perpendicular to the base direction; with less, the two count as parallel."""


def check_arm(arm: ArmTable | SpaceArmTable, issues: Issues) -> bool:
    """Report lists of the arm's table with a wrong number of entries, and an ``up`` parallel to the base direction.

    Returns:
        Whether the arm can be built from the table.
    """
    before = len(issues.found)
    _one_each(arm.masses, ("arm", "masses"), (arm.links,), "link", issues)
    counts, what = _drive_lists(arm) if arm.bends_evenly else ((arm.links, 3 * arm.links), "ball joint or revolute")
    for key in ("rotor_inertia", "friction"):
        _one_each(getattr(arm, key), ("arm", key), counts, what, issues)
    if arm.inertia is not None:
        _one_each(arm.inertia.axial, ("arm", "inertia", "axial"), (arm.links,), "link", issues)
        _one_each(arm.inertia.transverse, ("arm", "inertia", "transverse"), (arm.links,), "link", issues)
    if isinstance(arm, SpaceArmTable) and np.linalg.norm(np.cross(arm.base.up, arm.base.direction)) < LEAST_ACROSS:
        issues.add(
            ("arm", "base", "up"), "parallel to arm.base.direction; expected a vector with a component across it"
        )
    if isinstance(arm, ArmTable):
        pairs = [
            (("arm", "sections", k, "joint_limit_deg"), each.joint_limit_deg)
            for k, each in enumerate(arm.sections or ())
        ]
        for path, limit in [(("arm", "base_limit_deg"), arm.base_limit_deg), *pairs]:
            if isinstance(limit, list):
                issues.add(path, "expected one number in the plane, where a joint has one bend")
    if isinstance(arm, SpaceArmTable) and arm.coupling is not None:
        _check_coupling(arm, arm.coupling, issues)
    if arm.sections and not any(np.any(each.limits) for each in arm.sections):
        issues.add(("arm", "sections"), "all joints are locked; expected at least one that bends")
    # Sections in the plane that bend evenly are refused elsewhere.
    return len(issues.found) == before and not (isinstance(arm, ArmTable) and arm.bends_evenly)


def _check_coupling(arm: SpaceArmTable, rows: Sequence[Sequence[float]], issues: Issues) -> None:
    """Report a coupling of drives that has another size than the arm, or more than one drive a bend or none to move."""
    path: KeyPath = ("arm", "coupling")
    if arm.bends_evenly:
        issues.add(path, 'not together with sections with drive = "section", which have drives of their own')
    if len(rows) != 2 * arm.links:
        issues.add(path, f"expected one row for each of the {2 * arm.links} bends of the joints; got {len(rows)}")
        return
    drives = len(rows[0])
    limits = np.array([arm.bend_limit(k // 2, k % 2)[1] for k in range(len(rows))])
    for k, row in enumerate(rows):
        moved = sum(value != 0.0 for value in row)
        if len(row) != drives:
            issues.add((*path, k), f"expected one number for each of the {drives} drives; got {len(row)}")
        elif moved > 1:
            issues.add((*path, k), f"{moved} drives move one bend; expected one at most")
        elif moved and limits[k] == 0.0:
            issues.add((*path, k), f"joint {k // 2 + 1} {'ab'[k % 2]} is locked; expected zeros")
    if any(len(row) != drives for row in rows):
        return
    for drive in np.flatnonzero(~np.any(np.array(rows), axis=0)):
        issues.add(path, f"drive {drive + 1} moves nothing, so that the matrix has no full rank; leave its column out")


def check_unequal_links(arm: Arm, sections: Sequence[SectionTable], issues: Issues) -> None:
    """Report links of even sections that turn too far, and tendons outside of the body.

    Args:
        arm: the arm.
        sections: its sections.
        issues: receives the defects.
    """
    where: KeyPath = ("arm", "sections")
    arcs = () if arm.sections is None else zip(arm.sections.limits, arm.sections.counts, strict=True)
    for k, (limit, count) in enumerate(arcs):
        turn = np.sqrt(2.0) * limit / count
        if turn > MOST_ARC_TURN:
            least = int(np.ceil(turn * count / MOST_ARC_TURN))
            issues.add((*where, k, "links"), f"links turn by up to {np.rad2deg(turn):.3g}°; expected {least} or more")
    thinnest = math.inf
    for k, each in enumerate(sections):
        thinnest = min(thinnest, *each.radius)
        if each.tendons is not None and each.tendons.radius > thinnest:
            words = f"expected at most {file_length(thinnest, 6)}, the least radius of the body up to the section's end"
            issues.add((*where, k, "tendons", "radius"), words)


def check_contact(arm: ChainTable, table: VerificationTable, issues: Issues) -> None:
    """Report a contact tolerance so large that plans could pass through walls; it is meant for rounding errors only."""
    tolerance = table.contact_tolerance
    if tolerance is not None and tolerance > MOST_CONTACT_SHARE_OF_LENGTH * arm.links * arm.link_length > 0.0:
        given = f"{in_unit(tolerance, message_unit()):g}"
        path: KeyPath = ("verification", "contact_tolerance")
        issues.add(path, f"expected at most a thousandth of the arm's length; got {given}")


def _check_places(table: SpaceArmTable, issues: Issues) -> None:
    """Report bodies on links of sections that bend evenly, on sections of others, or at places where no arc ends."""
    rows = table.sections or ()
    for k, body in enumerate(table.bodies):
        where: KeyPath = ("arm", "bodies", k)
        if body.section is None:
            if table.bends_evenly:
                issues.add((*where, "link"), 'expected section and at for sections with drive = "section"')
        elif not table.bends_evenly:
            issues.add((*where, "section"), 'only for sections with drive = "section"; give the link')
        elif body.section > len(rows):
            issues.add((*where, "section"), f"expected a section from 1 to {len(rows)}, got {body.section}")
        elif arc_ending_at(body.at, arcs := rows[body.section - 1].links) is None:
            ends = [end for end in (math.floor(body.at * arcs), math.ceil(body.at * arcs)) if end]
            near = " or ".join(f"{end / arcs:.6g}" for end in ends)
            words = f"no arc of the section, of {arcs}, ends there; expected {near}, or another number of links"
            issues.add((*where, "at"), words)


def check_bodies(arm: Arm, table: PlaneArmTable | SpaceArmTable, tables: Mapping[str, Any], issues: Issues) -> None:
    """Report bodies that collide with their own arm at rest, and keys that are not allowed together with bodies.

    Args:
        arm: the arm.
        table: its table.
        tables: validated tables by name, None for each that has defects.
        issues: receives the defects.
    """
    keys: dict[Key, Any] = {("arm", "payload"): arm.payload}
    for name in ("limits", "planner", "tolerance"):
        values = (
            {} if tables[name] is None else {key: getattr(tables[name], key) for key in type(tables[name]).model_fields}
        )
        keys |= {(name, key): value for key, value in values.items()}
    before = len(issues.found)
    if isinstance(table, SpaceArmTable):
        _check_places(table, issues)
    if len(issues.found) > before:
        return
    for key, defect in tool_defects(arm, keys):
        last = key[-1]
        if key[-2:-1] != ("bodies",) or not isinstance(last, int) or len(key) == 3:
            issues.add(key, defect)
            continue
        # A body of the file is covered by one or more capsules.
        rigid = table.tool if key[1] == "tool" else table.bodies[int(key[2])]
        rows: Sequence[PlaneToolBodyTable | SpaceToolBodyTable] = rigid.bodies if rigid is not None else ()
        covers = [k for k, body in enumerate(rows) for _ in body.capsules()]
        issues.add((*key[:-1], covers[last]), defect)


def check_limit_lists(arm: ChainTable, limits: LimitsTable, issues: Issues) -> None:
    """Report lists of joint limits that have neither one value per ball joint nor one per revolute joint."""
    counts, what = _drive_lists(arm)
    for key in ("velocity", "acceleration", "jerk", "torque"):
        _one_each(getattr(limits, key), ("limits", key), counts, what, issues)


def _drive_lists(arm: ChainTable) -> tuple[tuple[int, int], str]:
    """Return the lengths that lists of values of drives may have, and what they have one value for, in words."""
    if arm.bends_evenly:
        return (len(arm.sections or ()), 3 * arm.links), "section or revolute"
    if isinstance(arm, SpaceArmTable) and arm.coupling is not None:
        return (len(arm.coupling[0]), 3 * arm.links), "drive or revolute"
    return (arm.links, 3 * arm.links), "ball joint or revolute"


def check_limited_points(arm: ChainTable, limits: LimitsTable, issues: Issues) -> None:
    """Report entries of ``limits.points`` that lie beyond the tip, give no limit, or repeat a point."""
    length = arm.links * arm.link_length
    for k, point in enumerate(limits.points):
        path: KeyPath = ("limits", "points", k)
        if point.at > length * (1.0 + _LENGTH_TOLERANCE):
            expected = f"at most the arm's length, links * link_length = {file_length(length, 6)}"
            issues.add((*path, "at"), f"{file_length(point.at, 6)} is beyond the tip; expected {expected}")
        if point.velocity is None and point.acceleration is None:
            issues.add(path, "limits nothing; expected velocity, acceleration or both")
        if point.at in [other.at for other in limits.points[:k]]:
            issues.add(
                (*path, "at"),
                f"the point at {file_length(point.at, 6)} is limited already; expected one entry per point",
            )


def check_pose(
    arm: ArmTable | SpaceArmTable,
    pose: PoseTable | SpacePoseTable,
    path: KeyPath,
    issues: Issues,
) -> None:
    """Report a pose whose joint angles have a wrong number or exceed their limits, or whose curve has a wrong length.

    The lengths of a curve's segments must add up to the arm's length.

    Args:
        arm: the table ``[arm]``.
        pose: the table ``[start]`` or ``[goal]``.
        path: key path of that table.
        issues: receives the defects.
    """
    bends: Sequence[Any] = pose.joints_deg or []
    if arm.bends_evenly and len(bends) == len(arm.sections or ()):
        _check_section_bends(arm.sections or (), bends, path, issues)
        return
    if bends and len(bends) != arm.links:
        each = "[a, b] per joint" if isinstance(bends[0], list) else "value per joint"
        issues.add((*path, "joints_deg"), f"expected one {each}, {arm.links} in all; got {len(bends)}")
    for k, bend in enumerate(bends):
        if k >= arm.links:
            break
        for *which, value in [(*pair,) for pair in enumerate(bend)] if isinstance(bend, list) else [(bend,)]:
            key, limit = arm.bend_limit(k, *which)
            if abs(value) > limit + ANGLE_TOLERANCE:
                passed = f"{math.degrees(value):g}° exceeds {key} = {math.degrees(limit):g}"
                issues.add((*path, "joints_deg", k, *which), passed)
    if pose.segments is not None:
        total = sum(segment.length for segment in pose.segments)
        length = arm.links * arm.link_length
        if abs(total - length) > _LENGTH_TOLERANCE * length:
            issues.add(
                (*path, "segments"),
                f"the lengths of the segments add up to {file_length(total, 9)}; expected the arm's length, "
                f"links * link_length = {file_length(length, 9)}",
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


def _check_section_bends(sections: Sequence[SectionTable], bends: Sequence[Any], path: KeyPath, issues: Issues) -> None:
    """Report bends of sections that bend evenly which exceed their limits, one pair of bends a section."""
    for k, (pair, section) in enumerate(zip(bends, sections, strict=True)):
        limit = section.links * float(np.max(section.joint_limit_deg))
        most = float(np.max(np.abs(pair)))
        if most > limit + ANGLE_TOLERANCE:
            passed = f"{math.degrees(most):g}° exceeds {math.degrees(limit):g}°, the limit of the section's bends"
            issues.add((*path, "joints_deg", k), passed)


def _one_each(
    value: float | Sequence[float] | None, path: KeyPath, counts: tuple[int, ...], what: str, issues: Issues
) -> None:
    if isinstance(value, Sequence) and len(value) not in counts:
        wanted = " or ".join(map(str, counts))
        issues.add(path, f"expected one value per {what}, {wanted} in all; got {len(value)}")


_DEPTH_ROUNDING = 1e-9
"""Depth inside an obstacle that is attributed to rounding, as a fraction of the workspace's size. Derived: a
thousandth of the contact tolerance of the verifier."""
_SLIPS = (1e-3, 1e3, 1.0 / 25.4, 25.4)
"""Ratios of typical errors of scale: millimetres confused with metres or with inches."""
_TINY_SHARE = 0.01
"""Minimum size of a rescaled drawing, as a fraction of the workspace's size, for the new scale to be plausible."""


def outside_message(
    file: str, box: FloatArray, origin: FloatArray, room: FloatArray, unit: LengthUnit, *, scale: float, keys: str
) -> str:
    """Return the message that a drawing or mesh lies entirely outside the workspace, with a correction.

    Args:
        file: name of the file.
        box: lower and upper corner of the drawing's or mesh's bounding box, d = 2 or 3, shape (2, d) [m].
        origin: position of the drawing's or mesh's own origin, shape (d,) [m].
        room: lower and upper corner of the workspace, shape (2, d) [m].
        unit: unit of length of the problem file.
        scale: length of one unit of the drawing or mesh, in ``unit``.
        keys: key of the scale and key of the position, separated by a blank.
    """
    scale_key, place_key = keys.split()
    place = (origin + room.mean(axis=0) - box.mean(axis=0)) / METRES[unit]
    message = (
        f"{file} lies entirely outside the workspace: it spans {_span(box, unit)}, the workspace "
        f"{_span(room, unit)}; {place_key} = [{', '.join(f'{value:.6g}' for value in place)}] would centre "
        "it"
    )
    for slip in _SLIPS:
        slipped = origin + slip * (box - origin)
        fits = np.all(slipped[0] >= room[0]) and np.all(slipped[1] <= room[1])
        if fits and np.ptp(slipped, axis=0).max() > _TINY_SHARE * np.ptp(room, axis=0).max():
            return f"{message}, {scale_key} = {scale * slip:.6g} would bring it inside"
    return message


def _span(box: FloatArray, unit: str) -> str:
    return f"{' to '.join(_place(corner, unit) for corner in box)} {unit}"


def _place(point: FloatArray, unit: str) -> str:
    return f"({', '.join(f'{value:.4g}' for value in point / METRES[unit])})"


def check_drawing(
    drawing: ImportedDrawing, offset: FloatArray, scale: float, room: shapely.Polygon, unit: LengthUnit, issues: Issues
) -> None:
    """Report a drawing that lies entirely outside the workspace, where its obstacles would silently have no effect.

    Args:
        drawing: report on the imported drawing.
        offset: position of the drawing's origin, shape (2,), in ``unit``.
        scale: length of one unit of the drawing, in ``unit``.
        room: boundary of the workspace [m].
        unit: unit of length of the problem file.
        issues: receives the defect.
    """
    if not shapely.intersects(room, shapely.box(*drawing.box)):
        boxes = np.reshape(drawing.box, (2, 2)), METRES[unit] * offset, np.reshape(room.bounds, (2, 2))
        keys = "workspace.scale workspace.offset"
        issues.add(("workspace", "file"), outside_message(drawing.file, *boxes, unit, scale=scale, keys=keys))


def check_meshes(
    meshes: Mapping[int, MeshBody | PlaneShape], room: FloatArray, unit: LengthUnit, issues: Issues
) -> None:
    """Report meshes and scans that lie entirely outside the workspace, where they would silently have no effect.

    Args:
        meshes: meshes, or scans in the plane, by the index of the obstacle in the file.
        room: lower and upper corner of the workspace, shape (2, d) [m].
        unit: unit of length of the problem file.
        issues: receives the defects.
    """
    for number, body in meshes.items():
        box = box_about(body.vertices)
        if np.any(box[0] > room[1]) or np.any(box[1] < room[0]):
            if isinstance(body, MeshBody):
                file, scale, origin = body.file, body.scale, body.placement.position
                key = "mesh" if body.balls is None else "points"
            else:
                scan = cast("PlaneScan", body.scan)
                file, scale, origin, key = scan.file, scan.scale, np.array(scan.origin), "points"
            keys = "scale pose.position"
            message = outside_message(file, box, origin, room, unit, scale=scale / METRES[unit], keys=keys)
            issues.add(("workspace", "obstacles", number, key), message)


def check_base(
    workspace: Workspace,
    base: FloatArray,
    arm_length: float,
    issues: Issues,
    drawing: ImportedDrawing | None = None,
) -> None:
    """Report an arm base that lies inside an obstacle or outside the workspace; a base that touches a wall is allowed.

    Args:
        workspace: the workspace.
        base: position of the base at the start of the motion, shape (2,) or (3,) [m].
        arm_length: length of the arm [m].
        issues: receives the defects.
        drawing: report on the drawing whose shapes are the last obstacles of the workspace; None without a drawing.
    """
    unit = message_unit()
    if workspace.dimension == 3:
        size = max(float(np.ptp(workspace.extent, axis=0).max()), arm_length)
        depths = [depth_inside(obstacle.body, base) for obstacle in workspace.obstacles]
        bounds = workspace.bounds
        away = np.zeros(3) if bounds is None else np.maximum(np.maximum(bounds[0] - base, base - bounds[1]), 0.0)
        outside, room = float(np.linalg.norm(away)), ROOM_NAME
        where = f"the base at {_place(base, unit)} {unit}"
    else:
        xmin, ymin, xmax, ymax = workspace.boundary.bounds
        size = max(xmax - xmin, ymax - ymin)
        depths = [_depth_inside(obstacle, base) for obstacle in workspace.obstacles]
        outside, room = -_depth_inside(Obstacle(BOUNDARY_NAME, PlaneShape(workspace.boundary)), base), BOUNDARY_NAME
        where = "the base"
    rounding = _DEPTH_ROUNDING * size
    for k, depth in enumerate(depths):
        if depth > rounding:
            message = f"{where} is {file_length(depth)} inside '{workspace.obstacles[k].name}'"
            issues.add(("arm", "base"), f"{message}; {_way_out(workspace, k, drawing)}")
    if outside > rounding:
        advice = "move the base inside"
        if drawing is not None:
            low, high = np.reshape(drawing.box, (2, 2))
            advice += (
                f", or {drawing.file} by workspace.offset: it lies from {_place(low, unit)} to {_place(high, unit)}"
            )
            advice += f" {unit}"
        issues.add(("arm", "base"), f"{where} is {file_length(outside)} outside the {room}; {advice}")


def _way_out(workspace: Workspace, number: int, drawing: ImportedDrawing | None) -> str:
    """Return a phrase that advises the user how to get the arm's base out of an obstacle.

    Args:
        workspace: the workspace.
        number: index of the obstacle.
        drawing: report on the drawing whose shapes are the last obstacles of the workspace; None without a drawing.
    """
    if workspace.dimension == 3:
        return " or ".join(enclosure_advice(workspace, workspace.obstacles[number].name, "it"))
    if drawing is None or number < len(workspace.obstacles) - drawing.obstacles:
        return "move the base out"
    return (
        f"move the base out; if that outline of {drawing.file} bounds the workspace, set workspace.closed = "
        '"room"; if it is a line, "walls"'
    )


def _depth_inside(obstacle: Obstacle, point: FloatArray) -> float:
    """Return how deep a point lies inside a planar obstacle [m]; for a point outside, minus its distance."""
    place = shapely.Point(point)
    inside_core = isinstance(obstacle.core, shapely.Polygon) and shapely.contains_properly(obstacle.core, place)
    edge = obstacle.core.boundary if isinstance(obstacle.core, shapely.Polygon) else obstacle.core
    with np.errstate(divide="ignore"):  # warns of coordinates like 1e-320, but is right
        distance = float(shapely.distance(edge, place))
    return obstacle.rounding + (distance if inside_core else -distance)


def odd_mesh_size(file: str, vertices: FloatArray, arm_length: float) -> str | None:
    """Return a warning if the size of a mesh, compared with the arm's length, suggests a wrong scale; else None.

    Args:
        file: file of the mesh.
        vertices: its vertices, or the points of a scan, shape (n, d) [m].
        arm_length: length of the arm [m].
    """
    extent = float(np.ptp(vertices, axis=0).max())
    if (times := odd_times(extent / arm_length)) is None:
        return None
    return (
        f"the mesh {file} spans {extent:.4g} m, {times} than the arm's {arm_length:.4g} m; check "
        "scale, the length of one unit of the mesh (0.001 for a mesh in millimetres and a problem file in "
        "metres)"
    )
