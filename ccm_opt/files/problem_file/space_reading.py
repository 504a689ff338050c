"""From parsed TOML to a problem in space: each table by itself, its meshes, then the checks between tables."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel

from ccm_opt.files.problem_file.agreement import check_arm_lists, check_limit_lists, check_limited_points
from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.keypath import KeyPath, lookup
from ccm_opt.files.problem_file.mesh_obstacles import MeshObstacles
from ccm_opt.files.problem_file.rules import goal_paths
from ccm_opt.files.problem_file.schema import (
    LimitsTable,
    PlannerTable,
    RootTable,
    SimulationTable,
    SpaceArmTable,
    SpaceGoalTable,
    SpaceObstacleTable,
    SpaceStartTable,
    SpaceWorkspaceTable,
    ToleranceTable,
    VerificationTable,
)
from ccm_opt.files.problem_file.space_agreement import check_space_poses, check_up
from ccm_opt.files.problem_file.space_build import SpaceTables, build_space_problem
from ccm_opt.files.problem_file.space_placement import (
    check_bars,
    check_space_base,
    hint_at_mesh_scale,
    refuse_meshes_outside,
)
from ccm_opt.files.problem_file.space_rules import check_space_alternatives
from ccm_opt.ground.length_units import METRES
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.bodies import MeshBody

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
