"""Reads checked tables into problems."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeVar, get_args

import numpy as np
import shapely
import tomlkit
from pydantic import BaseModel

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, LengthUnit, file_length, words_in
from ccm_opt.errors import ProblemError
from ccm_opt.io.build import Tables, build_arm, build_pose, build_problem, build_workspace, feed_of
from ccm_opt.io.drawing import with_scene
from ccm_opt.io.issues import Issues
from ccm_opt.io.keypath import KeyPath, lookup
from ccm_opt.io.rules import (
    check_alternatives,
    check_arm_lists,
    check_limit_lists,
    check_limited_points,
    check_pose,
    goal_paths,
)
from ccm_opt.io.schema import (
    ArmTable,
    GoalTable,
    LimitsTable,
    ObstacleTable,
    PlannerTable,
    RootTable,
    SimulationTable,
    StartTable,
    ToleranceTable,
    VerificationTable,
    WorkspaceTable,
)
from ccm_opt.io.settings import READING
from ccm_opt.problem import ImportedDrawing, Problem
from ccm_opt.robot.arm import MappingName
from ccm_opt.scene.workspace import BOUNDARY_NAME, Obstacle, Workspace

_SLIPS = (1e-3, 1e3, 1.0 / 25.4, 25.4)
"""Factors by which scales are off where millimetres are taken for metres or inches, or the other way round."""
_TINY_SHARE = 0.01
"""What would be smaller than this share of the room is not what was meant."""


def depth_inside(obstacle: Obstacle, point: Sequence[float]) -> float:
    """How far a point is inside an obstacle [m]; negative outside, minus the distance to it."""
    place = shapely.Point(point)
    inside_core = isinstance(obstacle.core, shapely.Polygon) and shapely.contains_properly(obstacle.core, place)
    edge = obstacle.core.boundary if isinstance(obstacle.core, shapely.Polygon) else obstacle.core
    with np.errstate(divide="ignore"):  # of coordinates like 1e-320, whose distances are right all the same
        distance = float(shapely.distance(edge, place))
    return obstacle.rounding + (distance if inside_core else -distance)


def depth_outside(workspace: Workspace, point: Sequence[float]) -> float:
    """How far a point is outside the boundary [m]; negative inside, minus the distance to it."""
    return -depth_inside(Obstacle(BOUNDARY_NAME, workspace.boundary), point)


@dataclass(frozen=True)
class PlacedFile:
    """A drawing or a mesh as it lies in the room.

    Attributes:
        name: of the file.
        box: least and greatest corner, shape (2, d) [m].
        origin: where its own origin lies, shape (d,) [m].
        scale: length of one of its units, in the problem file's.
        scale_key: that says so.
        place_key: that says where its origin lies.
    """

    name: str
    box: FloatArray
    origin: FloatArray
    scale: float
    scale_key: str
    place_key: str

    def told_outside(self, room: FloatArray, unit: str) -> str:
        """Say that it lies wholly outside a room, shape (2, d) [m], and what would bring it in."""
        place = (self.origin + room.mean(axis=0) - self.box.mean(axis=0)) / METRES[unit]
        told = (
            f"{self.name} lies wholly outside the room: it spans {_span(self.box, unit)}, "
            f"the room {_span(room, unit)}; "
            f"{self.place_key} = [{', '.join(f'{value:.6g}' for value in place)}] would put it into the middle"
        )
        for slip in _SLIPS:
            box = self.origin + slip * (self.box - self.origin)
            fits = np.all(box[0] >= room[0]) and np.all(box[1] <= room[1])
            if fits and np.ptp(box, axis=0).max() > _TINY_SHARE * np.ptp(room, axis=0).max():
                return f"{told}, or {self.scale_key} = {self.scale * slip:.6g} would bring it in as it is placed"
        return told


def _span(box: FloatArray, unit: str) -> str:
    corners = [f"({', '.join(f'{value:.4g}' for value in corner / METRES[unit])})" for corner in box]
    return f"{corners[0]} to {corners[1]} {unit}"


def check_base(
    workspace: Workspace, base: Sequence[float], issues: Issues, drawing: ImportedDrawing | None = None
) -> None:
    """The base may touch walls, as the mount does, but not stand inside an obstacle or outside the room."""
    xmin, ymin, xmax, ymax = workspace.boundary.bounds
    rounding = READING.depth_rounding * max(xmax - xmin, ymax - ymin)
    first_drawn = len(workspace.obstacles) - (0 if drawing is None else drawing.obstacles)
    for k, obstacle in enumerate(workspace.obstacles):
        if (depth := depth_inside(obstacle, base)) > rounding:
            advice = "move it out"
            if drawing is not None and k >= first_drawn:
                advice += (
                    f"; where that outline of {drawing.file} is no solid but the room, set workspace.closed = "
                    '"room", where it is a line, "walls"'
                )
            issues.add(("arm", "base"), f"the base is {file_length(depth)} inside '{obstacle.name}'; {advice}")
    if (depth := depth_outside(workspace, base)) > rounding:
        issues.add(("arm", "base"), f"the base is {file_length(depth)} outside the {BOUNDARY_NAME}; move it in")


def toml_with_obstacles(data: Mapping[str, object]) -> str:
    """The text of a problem file.

    Args:
        data: what a TOML parser would make of it, valid, with a list ``workspace.obstacles``.
    """
    workspace = data["workspace"]
    if not isinstance(workspace, Mapping):
        raise TypeError(f"expected a table workspace, got {type(workspace).__name__}")
    rest = {**data, "workspace": {key: value for key, value in workspace.items() if key != "obstacles"}}
    # Elements of arrays of tables may stand anywhere behind their table.
    parts = [tomlkit.dumps(rest)]
    for obstacle in workspace["obstacles"]:
        parts.append("\n[[workspace.obstacles]]\n")
        parts += [f"{_text(key)} = {_value(value)}\n" for key, value in obstacle.items()]
    return "".join(parts)


def _value(value: object) -> str:
    """A value in one line: what of TOML differs from JSON are tables."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_text(key)} = {_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return _text(value)


def _text(value: object) -> str:
    # Of what JSON leaves as it is, TOML wants one character escaped.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


Model = TypeVar("Model", bound=BaseModel)


@dataclass(frozen=True)
class _Draft:
    """The tables that could be validated; None for the others."""

    root: RootTable | None
    workspace: WorkspaceTable | None
    obstacles: tuple[ObstacleTable, ...]
    arm: ArmTable | None
    limits: LimitsTable | None
    start: StartTable | None
    goals: tuple[GoalTable, ...] | None
    planner: PlannerTable | None
    simulation: SimulationTable | None
    tolerance: ToleranceTable | None
    verification: VerificationTable | None


def check_data(
    data: Mapping[str, object],
    issues: Issues,
    source: str,
    folder: Path | None = None,
    *,
    allow_outside: bool = False,
) -> Problem | None:
    """Check parsed data and build the problem.

    Args:
        data: the parsed TOML.
        issues: receives every defect found.
        source: the text of the file, kept in the problem; obstacles from a drawing are written out in it.
        folder: of the problem file, where the path to a drawing begins; None when there is no file.
        allow_outside: whether the drawing may lie outside that folder.

    Returns:
        The problem, or None when there are issues.
    """
    whole, drawing = with_scene(data, folder, issues, allow_outside=allow_outside)
    check_alternatives(whole, issues)
    draft = _validate(whole, issues)
    with words_in(_unit_of(whole)):
        _check_between(draft, issues, drawing)
        _check_drawing(drawing, draft, data, issues)
        tables = _complete(draft)
        if tables is None or issues.found:
            _hint_at_scale(drawing, draft, issues)
            return None
    # With the obstacles of a drawing written out the problem can be read again without that drawing.
    has_drawing = whole is not data
    problem = build_problem(tables, toml_with_obstacles(whole) if has_drawing else source)
    return replace(problem, drawing=drawing)


def _unit_of(data: Mapping[str, object]) -> LengthUnit:
    """The unit of lengths; metres where what the file says is none, which is reported elsewhere."""
    unit = data.get("units", "m")
    return unit if unit in get_args(LengthUnit) else "m"  # type: ignore[return-value]


def _validate(data: Mapping[str, object], issues: Issues) -> _Draft:
    scale = METRES[_unit_of(data)]

    def section(model: type[Model], name: str, *, leave_out: str = "") -> Model | None:
        optional = name in {"planner", "simulation", "tolerance", "verification"}
        table = data.get(name, {} if optional else None)
        if not isinstance(table, Mapping):
            return None
        return issues.validate(model, {k: v for k, v in table.items() if k != leave_out}, (name,), scale)

    return _Draft(
        root=issues.validate(RootTable, data, (), scale),
        # Obstacles are validated one by one, so that a defect of one does not hide those of the others.
        workspace=section(WorkspaceTable, "workspace", leave_out="obstacles"),
        obstacles=_obstacles(data, issues, scale),
        arm=section(ArmTable, "arm"),
        limits=section(LimitsTable, "limits"),
        start=section(StartTable, "start"),
        goals=_goals(data, issues, scale),
        planner=section(PlannerTable, "planner"),
        simulation=section(SimulationTable, "simulation"),
        tolerance=section(ToleranceTable, "tolerance"),
        verification=section(VerificationTable, "verification"),
    )


def _goals(data: Mapping[str, object], issues: Issues, scale: float) -> tuple[GoalTable, ...] | None:
    """The goals in order, or None when one is defective, missing or no table."""
    found = []
    for path in goal_paths(data):
        table = lookup(data, path)
        if isinstance(table, Mapping):
            found.append(issues.validate(GoalTable, table, path, scale))
    if data.get("goal") == []:
        issues.add(("goal",), "expected at least one goal")
    usable = tuple(goal for goal in found if goal is not None)
    return usable if usable and len(usable) == len(goal_paths(data)) else None


def _obstacles(data: Mapping[str, object], issues: Issues, scale: float) -> tuple[ObstacleTable, ...]:
    """The obstacles, each with a name; a defective one is noted and left out."""
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
        named = {"name": f"obstacle {k + 1}", **entry}
        table = issues.validate(ObstacleTable, named, path, scale)
        if table is not None:
            found.append(table)
    return tuple(found)


def _check_drawing(drawing: ImportedDrawing | None, draft: _Draft, data: Mapping[str, object], issues: Issues) -> None:
    """Refuse a drawing that lies wholly outside the room: nobody means to plan without it."""
    if drawing is None or draft.workspace is None or not (draft.workspace.bounds or draft.workspace.boundary):
        return
    room = build_workspace(draft.workspace, ()).boundary
    if shapely.intersects(room, shapely.box(*drawing.box)):
        return
    unit = _unit_of(data)
    origin = METRES[unit] * np.array(lookup(data, ("workspace", "offset")) or [0.0, 0.0])
    scale = lookup(data, ("workspace", "scale")) or 1.0
    placed = PlacedFile(
        drawing.file,
        np.reshape(drawing.box, (2, 2)),
        origin,
        float(scale),  # type: ignore[arg-type]  # it was validated with the drawing
        "workspace.scale",
        "workspace.offset",
    )
    issues.add(("workspace", "file"), placed.told_outside(np.reshape(room.bounds, (2, 2)), unit))


def _check_between(draft: _Draft, issues: Issues, drawing: ImportedDrawing | None = None) -> None:
    """The checks that need two tables, for those tables that are there."""
    if draft.arm is None:
        return
    check_arm_lists(draft.arm, issues)
    if draft.limits is not None:
        check_limit_lists(draft.arm, draft.limits, issues)
        check_limited_points(draft.arm, draft.limits, issues)
    mapping: MappingName = "least-squares" if draft.planner is None else draft.planner.mapping
    for path, pose in _poses(draft):
        check_pose(draft.arm, pose, path, issues)
        _check_shape(draft.arm, pose, mapping, path, issues)
        _check_feed(draft.arm, pose, path, issues)
    _check_places(draft, issues, drawing)


def _poses(draft: _Draft) -> list[tuple[KeyPath, StartTable | GoalTable]]:
    """Start and goals with where they stand."""
    found: list[tuple[KeyPath, StartTable | GoalTable]] = []
    if draft.start is not None:
        found.append((("start",), draft.start))
    goals = draft.goals or ()
    for k, goal in enumerate(goals):
        path: KeyPath = ("goal", k) if len(goals) > 1 else ("goal",)
        found.append((path, goal))
    return found


def _check_feed(arm: ArmTable, pose: StartTable | GoalTable, path: KeyPath, issues: Issues) -> None:
    """A pose lies within the range of the feed axis, and the guide tube holds its joints straight."""
    if arm.feed is None or not _lists_fit(arm):
        return
    built = build_arm(arm)
    low, high = arm.feed.range
    at = feed_of(pose, built)
    if not low <= at <= high:
        issues.add(
            (*path, "feed"), f"outside the range of the feed axis, {file_length(low, 6)} to {file_length(high, 6)}"
        )
    bends = pose.joints_deg or []
    held = built.held(at)
    for k in range(min(len(bends), arm.links)):  # a list of the wrong length is reported elsewhere
        if held[k] and abs(bends[k]) > READING.angle_tolerance:
            issues.add(
                (*path, "joints_deg", k), "this joint is still inside the guide tube of the feed axis; expected 0"
            )


def _check_shape(
    arm: ArmTable, pose: StartTable | GoalTable, mapping: MappingName, path: KeyPath, issues: Issues
) -> None:
    """The arm can be folded, or be laid along the curve."""
    key = "segments" if pose.segments is not None else "shape"
    if (pose.shape == "folded" or pose.segments) and _lists_fit(arm) and not issues.at((*path, key)):
        try:
            build_pose(pose, build_arm(arm), mapping)
        except ProblemError as error:
            issues.add((*path, key), str(error))


def _check_places(draft: _Draft, issues: Issues, drawing: ImportedDrawing | None) -> None:
    """The base stands where it may, as far as there are a room, an arm and a start to tell."""
    if draft.arm is None or draft.workspace is None or draft.start is None:
        return
    has_boundary = draft.workspace.bounds is not None or draft.workspace.boundary is not None
    if has_boundary and _lists_fit(draft.arm):
        # An obstacle without a shape is reported elsewhere, and cannot be built.
        whole = [item for item in draft.obstacles if any((item.polygon, item.box, item.circle, item.wall))]
        workspace = build_workspace(draft.workspace, whole)
        arm = build_arm(draft.arm)
        base = arm.base + feed_of(draft.start, arm) * arm.direction
        check_base(workspace, base.tolist(), issues, drawing)


def _lists_fit(arm: ArmTable) -> bool:
    """Whether the arm's lists have one value a link, so that it can be built."""
    probe = Issues()
    check_arm_lists(arm, probe)
    return not probe.found


def _hint_at_scale(drawing: ImportedDrawing | None, draft: _Draft, issues: Issues) -> None:
    """Beside other defects say that the drawing does not fit the arm, which may be where they come from."""
    if drawing is None or draft.arm is None:
        return
    odd = drawing.odd_size(draft.arm.links * draft.arm.link_length)
    if odd is not None:
        issues.add(("workspace", "scale"), odd)


def _complete(draft: _Draft) -> Tables | None:
    """All tables, or None when one could not be validated."""
    values = {item.name: getattr(draft, item.name) for item in fields(draft)}
    if any(value is None for value in values.values()):
        return None
    return Tables(**values)
