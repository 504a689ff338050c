"""Validation of parsed problem files: each table alone, then tables against each other, then the problem they give."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, get_args

import numpy as np

from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import METRES, LengthUnit, file_length, words_in
from ccm_opt.io.arm_rules import (
    ANGLE_TOLERANCE,
    check_arm,
    check_bodies,
    check_contact,
    check_limit_lists,
    check_limited_points,
    check_pose,
    check_unequal_links,
)
from ccm_opt.io.arm_tables import ArmTable
from ccm_opt.io.build import (
    build_boundary,
    build_coverage,
    build_options,
    build_pose,
    build_problem,
    build_workspace,
    pose_feed,
)
from ccm_opt.io.build_arm import build_arm
from ccm_opt.io.drawing import with_scene
from ccm_opt.io.goal_tables import PoseTable, SpaceGoalTable, SpacePoseTable
from ccm_opt.io.issues import Issues, KeyPath, lookup
from ccm_opt.io.key_rules import are_paths, check_alternatives, check_up, goal_paths
from ccm_opt.io.mesh_obstacles import cover_mesh_bodies, mesh_bodies, plane_scans
from ccm_opt.io.place_rules import check_base, check_drawing, check_meshes, odd_mesh_size
from ccm_opt.io.quantities import Table
from ccm_opt.io.scene_tables import SpaceWorkspaceTable
from ccm_opt.io.schema import OPTIONAL, TABLES, PlaneArmTable, RootTable, SpaceArmTable
from ccm_opt.io.urdf_arm import with_urdf
from ccm_opt.problem import ImportedDrawing, Problem
from ccm_opt.problem.options import options_without_effect
from ccm_opt.problem.tool_rules import cover_notes
from ccm_opt.robot.arm import MappingName
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.surface_pieces import without_flat_parts
from ccm_opt.scene.workspace import Workspace

IN_SPACE_KEY = 3
"""Value of the key ``space`` in problem files whose arm moves in three dimensions."""
_Pose: TypeAlias = PoseTable | SpacePoseTable


def check_data(
    data: Mapping[str, object],
    issues: Issues,
    source: str,
    folder: Path | None = None,
    *,
    allow_outside: bool = False,
) -> Problem | None:
    """Return the problem that a parsed problem file describes, after collecting all defects of the file.

    Args:
        data: the parsed TOML.
        issues: receives every defect found.
        source: text of the file, kept in the problem unless part of the problem comes from a drawing.
        folder: folder to which the paths of drawings and meshes are relative; None if the data come from no file.
        allow_outside: whether drawings and meshes may lie outside ``folder``.

    Returns:
        The problem; None if any defect was found.
    """
    in_space = data.get("space") == IN_SPACE_KEY
    with_arm, imported_arm = with_urdf(data, folder, issues, in_space=in_space, allow_outside=allow_outside)
    if with_arm is None:
        # What depends on the arm, as limits may come from the URDF, cannot be checked.
        _validate({**data, "arm": {}}, issues, in_space=in_space, skipped=("arm", "limits"))
        return None
    whole, drawing = (with_arm, None) if in_space else with_scene(with_arm, folder, issues, allow_outside=allow_outside)
    check_alternatives(whole, issues, TABLES[in_space])
    # Defective tables are None, or left out of lists, so that the other tables can still be checked.
    found = _validate(whole, issues, in_space=in_space)
    unit = _length_unit(data)
    read: Any = mesh_bodies if in_space else plane_scans
    with words_in(unit):
        found["meshes"] = read(found["obstacles"], folder, METRES[unit], issues, allow_outside=allow_outside)
        if isinstance(found["arm"], SpaceArmTable):
            cover_mesh_bodies(found["arm"], folder, METRES[unit], issues, allow_outside=allow_outside)
        _check_drawing_places(found, drawing, data, issues)
        if found["arm"] is not None:
            _check_between(found, issues, drawing)
        if issues.found or any(table is None for table in found.values()):
            _hint_at_scale(drawing, found, issues)
            return None
        problem = build_problem(found, source)
    # Scans of points in the plane, and bodies of mesh files on links, are kept as what they were read as.
    read_in = bool(problem.arm.rigid_bodies and cover_notes(problem.arm)) if in_space else bool(found["meshes"])
    problem = problem if whole is data and not read_in else replace(problem, source="")
    return replace(problem, drawing=drawing, imported_arm=imported_arm)


def _length_unit(data: Mapping[str, object]) -> LengthUnit:
    """Return the unit of lengths that a problem file states; metres if the unit is missing or invalid."""
    unit = data.get("units", "m")
    return unit if unit in get_args(LengthUnit) else "m"  # type: ignore[return-value]


def _validate(
    data: Mapping[str, object], issues: Issues, *, in_space: bool, skipped: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the validated tables of a problem file, by table name, with None for each table that has defects.

    Args:
        data: the parsed TOML.
        issues: receives the defects.
        in_space: whether the arm moves in three dimensions.
        skipped: names of tables that are left out.
    """
    scale = METRES[_length_unit(data)]
    found: dict[str, Any] = {"root": issues.validate(RootTable, data, (), scale)}
    for name, model in TABLES[in_space].items():
        if name in {"workspace.obstacles", "goal", *skipped}:  # lists of tables are validated below
            continue
        table = data.get(name, {} if name in OPTIONAL else None)
        if isinstance(table, Mapping):
            # Obstacles are validated one by one below, so that a defect of one does not hide those of the others.
            values = {key: value for key, value in table.items() if (name, key) != ("workspace", "obstacles")}
            table = issues.validate(model, values, (name,), scale)
        found[name] = table if isinstance(table, Table) else None
    if found["planner"] is not None:
        options, along = build_options(found["planner"]), are_paths(data)
        for name, why in options_without_effect(options, in_space=in_space, along_paths=along):
            issues.add(("planner", name), why)
    found["obstacles"] = _obstacles(data, issues, scale, TABLES[in_space]["workspace.obstacles"])
    found["goals"] = _goals(data, issues, scale, TABLES[in_space]["goal"])
    return found


def _goals(data: Mapping[str, object], issues: Issues, scale: float, model: type[Table]) -> tuple[Table, ...] | None:
    """Return the validated ``goal`` tables in order, or None if one is defective, missing or not a table.

    Args:
        data: the parsed TOML.
        issues: receives the defects.
        scale: metres per unit of length of the file.
        model: class that validates one goal table.
    """
    paths = goal_paths(data)
    if not paths:
        issues.add(("goal",), "expected at least one goal")
    tables = [(path, table) for path in paths if isinstance(table := lookup(data, path), Mapping)]
    found = [issues.validate(model, table, path, scale) for path, table in tables]
    usable = tuple(goal for goal in found if goal is not None)
    return usable if usable and len(usable) == len(paths) else None


def _obstacles(
    data: Mapping[str, object], issues: Issues, scale: float, model: type[Table]
) -> tuple[tuple[int, Table], ...]:
    """Return the valid obstacle tables with their indices in the file, from 0, and report the defects of the others.

    Args:
        data: the parsed TOML.
        issues: receives the defects.
        scale: metres per unit of length of the file.
        model: class that validates one obstacle table.
    """
    workspace = data.get("workspace")
    entries = workspace.get("obstacles", []) if isinstance(workspace, Mapping) else []
    if not isinstance(entries, list):
        issues.add(("workspace", "obstacles"), "expected a list of tables; write [[workspace.obstacles]] above each")
        return ()
    found = []
    for k, entry in enumerate(entries):
        path = ("workspace", "obstacles", k)
        if not isinstance(entry, Mapping):
            issues.add(path, "expected a table; write [[workspace.obstacles]] above each")
            continue
        table = issues.validate(model, entry, path, scale)
        if table is not None and not _is_flat_bar(table, path, issues):
            found.append((k, table))
    return tuple(found)


def _is_flat_bar(table: Table, path: KeyPath, issues: Issues) -> bool:
    """Return whether an obstacle is a cylinder of zero length, and report this; capsules may have zero length."""
    bar = getattr(table, "cylinder", None)
    if bar is None or not np.allclose(bar.start, bar.end, rtol=1e-12, atol=1e-12):
        return False
    issues.add((*path, "cylinder"), "both ends coincide; expected two different points")
    return True


def _check_drawing_places(
    found: Mapping[str, Any], drawing: ImportedDrawing | None, data: Mapping[str, object], issues: Issues
) -> None:
    """Report a drawing or meshes that lie entirely outside the workspace bounds, if bounds are given."""
    room = found["workspace"]
    if room is None:
        return
    if found["meshes"] and room.bounds is not None:
        check_meshes(found["meshes"], np.reshape(room.bounds, (2, -1)), _length_unit(data), issues)
    if drawing is not None and (room.bounds or room.boundary):
        offset = np.array(lookup(data, ("workspace", "offset")) or [0.0, 0.0])
        scale: Any = lookup(data, ("workspace", "scale")) or 1.0  # validated with the drawing
        check_drawing(drawing, offset, float(scale), build_boundary(room), _length_unit(data), issues)


def _check_between(found: Mapping[str, Any], issues: Issues, drawing: ImportedDrawing | None) -> None:
    """Run the checks that compare the arm's table with other tables of a problem file, as far as those are valid."""
    table: ArmTable | SpaceArmTable = found["arm"]
    arm_is_whole = check_arm(table, issues)
    if arm_is_whole and table.sections:
        check_unequal_links(build_arm(table), table.sections, issues)
    if found["verification"] is not None:
        check_contact(table, found["verification"], issues)
    if arm_is_whole and isinstance(table, PlaneArmTable | SpaceArmTable):
        check_bodies(build_arm(table), table, found, issues)
    if found["limits"] is not None:
        check_limit_lists(table, found["limits"], issues)
        check_limited_points(table, found["limits"], issues)
    mapping: MappingName = "least-squares" if found["planner"] is None else found["planner"].mapping
    goals = found["goals"] or ()
    poses: list[tuple[KeyPath, _Pose]] = [(("start",), found["start"])] if found["start"] is not None else []
    poses += [(("goal", k) if len(goals) > 1 else ("goal",), goal) for k, goal in enumerate(goals)]
    for path, pose in poses:
        check_pose(table, pose, path, issues)
        if isinstance(pose, SpaceGoalTable):
            check_up(pose, path, table.tool if isinstance(table, SpaceArmTable) else None, issues)
        if arm_is_whole:
            _check_built_pose(table, pose, mapping, path, issues)
            _check_travel(table, pose, path, issues)
    room = found["workspace"]
    walled = isinstance(room, SpaceWorkspaceTable) or (room is not None and (room.bounds or room.boundary))
    if arm_is_whole and found["start"] is not None and walled:
        # Obstacles without exactly one shape are reported elsewhere and cannot be built.
        whole = [(k, each) for k, each in found["obstacles"] if k in found["meshes"] or _has_shape(each)]
        arm = build_arm(table)
        at = pose_feed(found["start"], arm)
        base = arm.joint_positions_at(arm.configuration(np.zeros(arm.bends_a_joint * arm.links), at))[0]
        workspace = build_workspace(room, whole, found["meshes"])
        _check_surfaces(workspace, goals, issues)
        check_base(workspace, base, arm.length, issues, drawing)


def _check_surfaces(workspace: Workspace, goals: Sequence[Any], issues: Issues) -> None:
    """Report names of surfaces to be seen that no obstacle with flat surfaces has."""
    coverage = build_coverage(goals[0]) if goals else None
    if coverage is not None and (unknown := without_flat_parts(workspace, coverage.surfaces)):
        named = ", ".join(repr(name) for name in dict.fromkeys(workspace.triangle_soup.names))
        issues.add(
            ("goal", "see"),
            f"no flat surfaces are named {', '.join(map(repr, unknown))}: circles, thick walls, spheres, capsules and "
            f"scans have none; there are {named}",
        )


def _has_shape(table: Table) -> bool:
    """Return whether an obstacle's table gives a shape for which no file is needed."""
    given = [getattr(table, kind) for kind in table.rules.exactly_one if kind != "mesh"]
    return any(value is not None and not isinstance(value, str) for value in given)


def _check_travel(table: ArmTable | SpaceArmTable, pose: _Pose, path: KeyPath, issues: Issues) -> None:
    """Report a pose that takes more than the travel of a tendon."""
    arm = build_arm(table)
    if arm.sections is None or not pose.joints_deg or pose.segments or issues.at((*path, "joints_deg")):
        return
    used = arm.sections.travel_used(np.ravel(build_pose(pose, arm, "least-squares").bends))
    if used > 1.0 + ANGLE_TOLERANCE:
        issues.add((*path, "joints_deg"), f"takes {100.0 * used:.4g} % of the travel of a tendon")


def _check_built_pose(
    table: ArmTable | SpaceArmTable, pose: _Pose, mapping: MappingName, path: KeyPath, issues: Issues
) -> None:
    """Report defects of a start or goal pose that appear only when the pose is built.

    A folded shape or curve segments must fit the arm; the feed must be within its range; joints still inside the guide
    tube of a feed axis must be straight.
    """
    arm = build_arm(table)
    key = "shape" if pose.segments is None else "segments"
    if (pose.shape == "folded" or pose.segments) and not issues.at((*path, key)):
        try:
            build_pose(pose, arm, mapping)
        except ProblemError as error:
            issues.add((*path, key), str(error))
    for axis, value, number in zip(arm.carrier, np.atleast_1d(pose_feed(pose, arm)), itertools.count(1), strict=False):
        if not axis.low <= value <= axis.high:
            issues.add((*path, "axes"), f"outside the range of axis {number} of arm.base")
    if table.feed is None or arm.carrier:
        return
    low, high = table.feed.range
    at = float(pose_feed(pose, arm))
    if not low <= at <= high:
        words = f"outside the range of the feed axis, {file_length(low, 6)} to {file_length(high, 6)}"
        issues.add((*path, "feed"), words)
    # A list of the wrong length is reported elsewhere, hence no strict zip.
    given: Sequence[Any] = pose.joints_deg or []
    inside, what = arm.held(at), "joint"
    if arm.sections is not None and len(given) == len(arm.sections.counts):
        inside, what = inside[[arm.sections.link_ending_at(k, 0) for k in range(len(given))]], "section"
    for k, (held, bends) in enumerate(zip(inside, given, strict=False)):
        if held and np.max(np.abs(bends)) > ANGLE_TOLERANCE:
            straight = "[0, 0]" if np.ndim(bends) else "0"
            words = (
                f"this {what} is still inside the guide tube of the feed axis, where it cannot bend; "
                f"expected {straight}"
            )
            issues.add((*path, "joints_deg", k), words)


def _hint_at_scale(drawing: ImportedDrawing | None, found: Mapping[str, Any], issues: Issues) -> None:
    """Report a drawing or mesh of implausible size, since a wrong unit may have caused the defects found so far."""
    if found["arm"] is None:
        return
    length = found["arm"].links * found["arm"].link_length
    if drawing is not None and (odd := drawing.odd_size(length)) is not None:
        issues.add(("workspace", "scale"), odd)
    for number, body in found["meshes"].items():
        file = body.file if isinstance(body, MeshBody) else body.scan.file
        if (odd := odd_mesh_size(file, body.vertices, length)) is not None:
            issues.add(("workspace", "obstacles", number, "scale"), odd)
