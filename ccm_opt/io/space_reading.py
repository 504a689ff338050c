"""Reads problems in space and holds their rules."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

import numpy as np
from pydantic import BaseModel

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, LengthUnit, words_in
from ccm_opt.io.issues import Issues
from ccm_opt.io.keypath import KeyPath, lookup
from ccm_opt.io.mesh_obstacles import MeshObstacles
from ccm_opt.io.rules import (
    check_arm_lists,
    check_contact,
    check_feed_keys,
    check_limit_lists,
    check_limited_points,
    check_masses,
    exactly_one,
    goal_paths,
    refuse_equal_names,
)
from ccm_opt.io.schema import (
    LimitsTable,
    PlannerTable,
    RootTable,
    SimulationTable,
    SpaceArmTable,
    SpaceGoalTable,
    SpaceObstacleTable,
    SpacePoseTable,
    SpaceStartTable,
    SpaceWorkspaceTable,
    ToleranceTable,
    VerificationTable,
)
from ccm_opt.io.settings import READING, ReadingSettings
from ccm_opt.io.space_build import (
    SpaceTables,
    build_space_arm,
    build_space_pose,
    build_space_problem,
    build_space_workspace,
)
from ccm_opt.io.table_reading import PlacedFile
from ccm_opt.problem.field_types import ODD_RATIO
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.distances.enclosures import ways_out
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.scene import ROOM_NAME, SpaceWorkspace
from ccm_opt.scene.surfaces import box_about

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


BODY_KEYS = ("mesh", "box", "sphere", "cylinder", "capsule")


def check_bars(table: SpaceObstacleTable, path: KeyPath, issues: Issues) -> bool:
    """Whether the ends of a bar, if it is one, are two places; else that is noted. A capsule may be a ball."""
    if table.cylinder is not None and np.allclose(table.cylinder.start, table.cylinder.end, rtol=1e-12, atol=1e-12):
        issues.add((*path, "cylinder"), "both ends are the same place; expected two different ones")
        return False
    return True


def check_space_base(
    workspace: SpaceWorkspaceTable,
    obstacles: Sequence[tuple[int, SpaceObstacleTable]],
    meshes: Mapping[int, MeshBody],
    arm: SpaceArmTable,
    start: SpaceStartTable,
    units: LengthUnit,
    issues: Issues,
) -> None:
    """The base may touch walls, as the mount does, but not stand inside an obstacle or outside the room."""
    usable = [
        (number, item)
        for number, item in obstacles
        if number in meshes or sum(getattr(item, key) is not None for key in BODY_KEYS if key != "mesh") == 1
    ]
    room = build_space_workspace(workspace, usable, meshes)
    built = build_space_arm(arm)
    base = built.base + build_space_pose(start, built).feed * built.direction
    rounding = READING.depth_rounding * max(float(np.ptp(room.extent, axis=0).max()), built.length)
    for obstacle in room.obstacles:
        if (depth := depth_inside(obstacle.body, base)) > rounding:
            where = f"the base at {_place(base, units)} is {_length(depth, units)} inside '{obstacle.name}'"
            with words_in(units):
                ways = " or ".join(ways_out(room, obstacle.name, "it"))
            issues.add(("arm", "base"), f"{where}; {ways}")
    if (depth := depth_outside_room(room, base)) > rounding:
        place = _place(base, units)
        issues.add(
            ("arm", "base"), f"the base at {place} is {_length(depth, units)} outside the {ROOM_NAME}; move it in"
        )


def refuse_meshes_outside(
    workspace: SpaceWorkspaceTable, meshes: Mapping[int, MeshBody], units: str, issues: Issues
) -> None:
    """Refuse meshes that lie wholly outside the room: nobody means to plan without them."""
    if workspace.bounds is None:
        return
    room = np.array(workspace.bounds)
    for number, body in meshes.items():
        box = box_about(body.vertices)
        if np.any(box[0] > room[1]) or np.any(box[1] < room[0]):
            scale = body.scale / METRES[units]
            placed = PlacedFile(body.file, box, body.placement.position, scale, "scale", "pose.position")
            issues.add(("workspace", "obstacles", number, "mesh"), placed.told_outside(room, units))


def depth_outside_room(workspace: SpaceWorkspace, point: FloatArray) -> float:
    """How far a place is outside the room [m]; not above 0 inside of it, or where there is none."""
    if workspace.bounds is None:
        return 0.0
    beyond = np.maximum(workspace.bounds[0] - point, point - workspace.bounds[1])
    return float(np.linalg.norm(np.maximum(beyond, 0.0)))


def hint_at_mesh_scale(meshes: Mapping[int, MeshBody], arm: SpaceArmTable, issues: Issues) -> None:
    """Beside other defects say that a mesh does not fit the arm, which may be where they come from."""
    for number, body in meshes.items():
        odd = odd_mesh_size(body, arm.links * arm.link_length)
        if odd is not None:
            issues.add(("workspace", "obstacles", number, "scale"), odd)


def odd_mesh_size(body: MeshBody, arm_length: float) -> str | None:
    """A warning where a mesh is so much larger or smaller than the arm that its scale must be wrong.

    Args:
        body: the mesh.
        arm_length: length of the arm [m].
    """
    extent = float(np.ptp(body.vertices, axis=0).max())
    ratio = extent / arm_length
    if ODD_RATIO**-1 < ratio < ODD_RATIO:
        return None
    larger = ratio > 1.0
    times = f"{ratio if larger else 1.0 / max(ratio, 1e-300):.3g} times {'larger' if larger else 'smaller'}"
    return (
        f"{body.file} is {times} than the arm is long: {extent:.4g} m against {arm_length:.4g} m; is scale the length "
        "of one unit of the mesh? (0.001 where the mesh is in millimetres and the file in metres)"
    )


def _place(point: FloatArray, units: str) -> str:
    x, y, z = point / METRES[units]
    return f"({x:.4g}, {y:.4g}, {z:.4g}) {units}"


def _length(metres: float, units: str) -> str:
    return f"{metres / METRES[units]:.4g} {units}"


Model = TypeVar("Model", bound=BaseModel)


@dataclass(frozen=True)
class _SpaceDraft:
    """The tables that could be validated; None for the others."""

    root: RootTable | None
    workspace: SpaceWorkspaceTable | None
    obstacles: tuple[tuple[int, SpaceObstacleTable], ...]
    meshes: Mapping[int, MeshBody]
    arm: SpaceArmTable | None
    limits: LimitsTable | None
    start: SpaceStartTable | None
    goals: tuple[SpaceGoalTable, ...] | None
    planner: PlannerTable | None
    simulation: SimulationTable | None
    tolerance: ToleranceTable | None
    verification: VerificationTable | None


def check_space_data(
    data: Mapping[str, object], issues: Issues, source: str, folder: Path | None = None, *, allow_outside: bool = False
) -> SpaceProblem | None:
    """Check parsed data of a problem in space and build it.

    Args:
        data: the parsed TOML.
        issues: receives every defect found.
        source: the text of the file, kept in the problem.
        folder: of the problem file, where the paths of meshes begin; None when there is no file.
        allow_outside: whether meshes may lie outside that folder.

    Returns:
        The problem, or None when there are issues.
    """
    check_space_alternatives(data, issues)
    draft = _validated(data, issues, folder, allow_outside=allow_outside)
    _check_between(draft, issues)
    tables = _complete(draft)
    if tables is None or issues.found:
        if draft.arm is not None:
            hint_at_mesh_scale(draft.meshes, draft.arm, issues)
        return None
    return build_space_problem(tables, source)


def _validated(data: Mapping[str, object], issues: Issues, folder: Path | None, *, allow_outside: bool) -> _SpaceDraft:
    scale = METRES.get(str(data.get("units", "m")), 1.0)

    def section(model: type[Model], name: str, *, leave_out: str = "") -> Model | None:
        optional = name in {"planner", "simulation", "tolerance", "verification"}
        table = data.get(name, {} if optional else None)
        if not isinstance(table, Mapping):
            return None
        return issues.validate(model, {k: v for k, v in table.items() if k != leave_out}, (name,), scale)

    root = issues.validate(RootTable, data, (), scale)
    obstacles = _obstacles(data, issues, scale)
    meshes = MeshObstacles(folder, scale, issues, allow_outside).bodies(obstacles)
    return _SpaceDraft(
        root=root,
        workspace=section(SpaceWorkspaceTable, "workspace", leave_out="obstacles"),
        obstacles=obstacles,
        meshes=meshes,
        arm=section(SpaceArmTable, "arm"),
        limits=section(LimitsTable, "limits"),
        start=section(SpaceStartTable, "start"),
        goals=_goals(data, issues, scale),
        planner=section(PlannerTable, "planner"),
        simulation=section(SimulationTable, "simulation"),
        tolerance=section(ToleranceTable, "tolerance"),
        verification=section(VerificationTable, "verification"),
    )


def _goals(data: Mapping[str, object], issues: Issues, scale: float) -> tuple[SpaceGoalTable, ...] | None:
    """The goals in order, or None when one is defective, missing or no table."""
    found = []
    for path in goal_paths(data):
        table = lookup(data, path)
        if isinstance(table, Mapping):
            found.append(issues.validate(SpaceGoalTable, table, path, scale))
    if data.get("goal") == []:
        issues.add(("goal",), "expected at least one goal")
    usable = tuple(goal for goal in found if goal is not None)
    return usable if usable and len(usable) == len(goal_paths(data)) else None


def _obstacles(data: Mapping[str, object], issues: Issues, scale: float) -> tuple[tuple[int, SpaceObstacleTable], ...]:
    """The obstacles with their places in the file; a defective one is noted and left out."""
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
        table = issues.validate(SpaceObstacleTable, entry, path, scale)
        if table is not None and check_bars(table, path, issues):
            found.append((k, table))
    return tuple(found)


def _check_between(draft: _SpaceDraft, issues: Issues) -> None:
    """The checks that need two tables, for those tables that are there."""
    units = draft.root.units if draft.root is not None else "m"
    if draft.workspace is not None:
        refuse_meshes_outside(draft.workspace, draft.meshes, units, issues)
    if draft.arm is None:
        return
    before = len(issues.found)
    check_arm_lists(draft.arm, issues)
    check_up(draft.arm, issues)
    arm_is_whole = len(issues.found) == before
    if draft.limits is not None:
        check_limit_lists(draft.arm, draft.limits, issues)
        check_limited_points(draft.arm, draft.limits, issues)
    poses: list[tuple[KeyPath, SpaceStartTable | SpaceGoalTable]] = []
    if draft.start is not None:
        poses.append((("start",), draft.start))
    goals = draft.goals or ()
    poses += [(("goal", k) if len(goals) > 1 else ("goal",), goal) for k, goal in enumerate(goals)]
    check_space_poses(draft.arm, poses, issues, arm_is_whole=arm_is_whole)
    if arm_is_whole and draft.start is not None and draft.workspace is not None:
        check_space_base(draft.workspace, draft.obstacles, draft.meshes, draft.arm, draft.start, units, issues)


def _complete(draft: _SpaceDraft) -> SpaceTables | None:
    """All tables, or None when one could not be validated."""
    values = {item.name: getattr(draft, item.name) for item in fields(draft)}
    if any(value is None for value in values.values()):
        return None
    return SpaceTables(**values)
