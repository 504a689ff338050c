"""Conversion of planning problems to the tables of a problem file."""

import hashlib
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import PurePosixPath

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.core.length_words import METRES, LengthUnit
from ccm_opt.io.arm_tables import SECTION_KEYS, FeedTable, InertiaTable, SectionTable, TendonTable
from ccm_opt.io.drawn_obstacles import obstacle_table
from ccm_opt.io.goal_tables import GoalTable, SpaceGoalTable
from ccm_opt.io.option_tables import (
    GainsTable,
    LimitsTable,
    PlannerTable,
    PointLimitTable,
    SimulationTable,
    ToleranceTable,
    VerificationTable,
)
from ccm_opt.io.reading import parse_problem
from ccm_opt.io.scene_solids import unique_names
from ccm_opt.io.scene_tables import SpaceObstacleTable, SpaceWorkspaceTable, WorkspaceTable
from ccm_opt.io.schema import BaseAxisTable, BaseTable, PlaneArmTable, SpaceArmTable
from ccm_opt.io.shape_tables import BarTable, PlacementTable
from ccm_opt.io.tool_tables import (
    PlaneBarTable,
    PlaneLinkBodyTable,
    PlaneToolBodyTable,
    PlaneToolTable,
    SpaceLinkBodyTable,
    SpaceToolBodyTable,
    SpaceToolTable,
)
from ccm_opt.problem import Coverage, Goal, Limits, Problem, SimulationOptions, Tolerances
from ccm_opt.problem.solution import Tour
from ccm_opt.robot.arc_sections import ArcSections, Tendons
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import RigidBody, Tool
from ccm_opt.scene.bodies import Body, MeshBody
from ccm_opt.scene.workspace import Workspace

Table = dict[str, object]
"""A table of a problem file, by key."""
_BASE_TOLERANCE = 1e-9
"""Distance up to which the base of a backbone curve counts as the arm's base, as a fraction of the arm's length.
Derived: a thousandth of the contact tolerance of the verifier."""
KEPT_MESHES = "meshes"
"""Name of the subfolder of an output folder that holds copies of the problem's mesh files."""


def recorded_data(problem: Problem) -> Table:
    """Return the tables of a problem for the record of a run, as the user wrote them if possible.

    Args:
        problem: the problem, from a file, from Python, or changed by ``dataclasses.replace``.

    Returns:
        For a planar problem whose ``source`` still describes the problem, the parsed ``source``; else ``problem_data``.

    Raises:
        ProblemError: the problem cannot be expressed in a problem file.
    """
    written = problem_data(problem)
    if problem.dimension == 3 or not problem.source:
        return written
    try:
        read_again = parse_problem(problem.source)
    except ProblemFileError:
        return written
    same = problem_data(read_again) == written
    return tomllib.loads(problem.source) if same else written


def problem_data(problem: Problem, mesh_files: Sequence[str] | None = None) -> Table:
    """Return every value of a problem as nested tables in the layout of a problem file.

    Angles are converted to degrees, so a problem read from these data may differ in the last bit. Lengths are in the
    problem's unit, as numbers that convert back to exactly the same metres wherever such numbers exist.

    Args:
        problem: the problem; its ``source`` is ignored.
        mesh_files: mesh file of each obstacle in space, relative to the folder of the problem file; ignored for
            obstacles that are not meshes. None uses the paths from ``stored_mesh_paths``.

    Returns:
        Plain numbers, texts, lists and tables, from which ``problem_from_mapping`` rebuilds the problem.

    Raises:
        ProblemError: the problem cannot be expressed in a problem file.
    """
    unit = problem.length_unit
    head: Table = {"schema": 1}
    if problem.dimension == 3:
        head["space"] = 3
        files = stored_mesh_paths(problem) if mesh_files is None else mesh_files
        listed = zip(problem.workspace.obstacles, files, strict=True)
        obstacles = [_body(each.name, each.body, file, unit) for each, file in listed]
        workspace: Table = SpaceWorkspaceTable.from_object(problem.workspace).written(unit) | {"obstacles": obstacles}
    else:
        workspace = workspace_table(problem.workspace, unit)
    check_curves(problem)
    written = partial(goal_table, unit=unit, in_space=problem.dimension == 3, fed=problem.arm.feed is not None)
    written = partial(written, arm_axes=problem.arm.coordinates.base_units)
    stops = [written(stop.goal, tolerances=stop.tolerances) | {"pause": float(stop.pause)} for stop in problem.stops]
    goal = written(problem.goal, tolerances=problem.tolerances)
    if problem.coverage is not None:
        goal = coverage_table(problem, problem.coverage)
    goal |= {"pause": float(problem.pause)} if problem.pause else {}
    return {
        **head,
        "name": problem.name,
        "description": problem.description,
        "units": unit,
        "workspace": workspace,
        "arm": arm_table(problem.arm, unit, problem.limits),
        "limits": limits_table(problem.limits, unit),
        "start": written(problem.start),
        "goal": [*stops, goal] if stops else goal,
        "planner": PlannerTable.from_object(problem.planner).written(unit),
        "simulation": simulation_table(problem.simulation, unit),
        "tolerance": ToleranceTable.from_object(problem).written(unit),
        "verification": VerificationTable.from_object(problem.verification).written(unit),
    }


def check_curves(problem: Problem) -> None:
    """Refuse a problem whose start or goal has a backbone curve that does not begin at the arm's base.

    A problem file has one base for the arm and all curves.

    Raises:
        ProblemError: a curve begins elsewhere.
    """
    arm = problem.arm
    for goal in (problem.start, *(stop.goal for stop in problem.goals)):
        curve = goal.for_joints.curve if goal.for_joints else None
        if curve is not None and not np.allclose(curve.base, arm.base, rtol=0.0, atol=_BASE_TOLERANCE * arm.length):
            found, base = (np.asarray(place, dtype=np.float64).tolist() for place in (curve.base, arm.base))
            raise ProblemError(f"a curve begins at {found}; expected the arm's base at {base}")


def workspace_table(workspace: Workspace, unit: LengthUnit) -> Table:
    """Return a planar workspace as the table ``[workspace]`` of a problem file, with lengths in ``unit``.

    Raises:
        ProblemError: the boundary has holes, or an obstacle cannot be expressed in a problem file.
    """
    if workspace.boundary.interiors:
        raise ProblemError(
            "the workspace's boundary has holes, which a problem file cannot represent; make them obstacles"
        )
    boundary = shapely.get_coordinates(workspace.boundary.exterior)[:-1]
    table = WorkspaceTable.from_object(workspace, boundary=boundary).written(unit)
    return table | {"obstacles": [obstacle_table(obstacle, unit) for obstacle in workspace.obstacles]}


def arm_table(arm: Arm, unit: LengthUnit, limits: Limits | None = None) -> Table:
    """Return an arm as the table ``[arm]`` of a problem file, with lengths in ``unit``.

    Args:
        arm: the arm.
        unit: unit of the lengths in the table.
        limits: limits of the axes that carry the arm, which belong to its table; None if there are none.

    Raises:
        ProblemError: axes carry the arm, and their limits are not given.
    """
    entries: dict[str, object] = {
        "inertia": InertiaTable.from_object(None, axial=arm.inertia_axial, transverse=arm.inertia_transverse),
        "feed": None if arm.feed is None else FeedTable.from_object(arm.feed, range=[arm.feed.low, arm.feed.high]),
    }
    entries |= {key: None for key in ("payload", "rotor_inertia", "friction") if not np.any(getattr(arm, key))}
    entries["bodies"] = [_link_body(body, arm) for body in arm.bodies] or None
    if arm.tool is not None:
        entries["tool"] = _tool(arm.tool)
    if arm.proportions is not None:
        entries |= {**dict.fromkeys(SECTION_KEYS), "sections": _sections(arm)}
        if arm.sections is not None:
            return _driven_arm(arm, arm.sections, limits, entries).written(unit)
        base = arm.base_limit * arm.proportions.limits[: arm.bends_a_joint]
        entries["base_limit_deg"] = _pair(base) if np.any(base) else arm.base_limit
    if arm.coupled is not None:
        entries["coupling"] = arm.coupled.ratios.tolist()
    if arm.dimension == 3:
        return SpaceArmTable.from_object(arm, base=_base_table(arm, limits), **entries).written(unit)
    return PlaneArmTable.from_object(arm, **entries).written(unit)


def _tool(tool: Tool) -> PlaneToolTable | SpaceToolTable:
    """Return a tool as the table ``[arm.tool]`` of a problem file, its bodies as capsules."""
    table = PlaneToolTable if len(tool.tip) == 2 else SpaceToolTable
    return table.from_object(tool, **_rigid(tool, len(tool.tip)))


def _link_body(body: RigidBody, arm: Arm) -> PlaneLinkBodyTable | SpaceLinkBodyTable:
    """Return a rigid body on a link as a table ``[[arm.bodies]]`` of a problem file, its bodies as capsules."""
    link = body.link % arm.links
    if arm.sections is not None:
        section, at = arm.sections.place_of(link)
        return SpaceLinkBodyTable.from_object(body, link=None, section=section + 1, at=at, **_rigid(body, 3))
    table = PlaneLinkBodyTable if arm.dimension == 2 else SpaceLinkBodyTable
    return table.from_object(body, link=link + 1, **_rigid(body, arm.dimension))


def _rigid(body: RigidBody, dimension: int) -> dict[str, object]:
    """Return the keys of mass and bodies of the table of a rigid body on a link."""
    bar, row = (PlaneBarTable, PlaneToolBodyTable) if dimension == 2 else (BarTable, SpaceToolBodyTable)
    keys: dict[str, object] = {
        "bodies": [row.from_object(None, capsule=bar.from_object(each)) for each in body.bodies] or None
    }
    if body.mass == 0.0:
        return keys | dict.fromkeys(("mass", "centre", "inertia"))
    centre = np.zeros(dimension) if body.centre is None else body.centre
    return keys | {"centre": centre, "inertia": float(body.moments[1]) if dimension == 2 else body.moments}


def _base_table(arm: Arm, limits: Limits | None) -> BaseTable:
    """Return the base of an arm in space, with the axes that carry it and their limits, as a table."""
    axes = [_axis_table(arm, number, limits) for number in range(len(arm.carrier))] or None
    return BaseTable.from_object(arm, position=arm.base, axes=axes)


def _driven_arm(
    arm: Arm, sections: ArcSections, limits: Limits | None, entries: Mapping[str, object]
) -> PlaneArmTable | SpaceArmTable:
    """Return an arm whose sections bend evenly as the table ``[arm]`` of a problem file."""
    rows = [
        SectionTable.from_object(
            None,
            drive="section",
            links=count,
            link_length=float(sections.lengths[k]) / count,
            radius=sections.radii[k].tolist(),
            joint_limit_deg=float(sections.limits[k]) / count,
            tendons=None if tendons is None else _tendon_table(tendons, plane=arm.dimension == 2),
        )
        for k, (count, tendons) in enumerate(
            zip(sections.counts.tolist(), sections.tendons or (None,) * len(sections.counts), strict=True)
        )
    ]
    entries = {**entries, "base_limit_deg": None, "sections": rows}
    if arm.dimension == 2:
        return PlaneArmTable.from_object(arm, **entries)
    return SpaceArmTable.from_object(arm, base=_base_table(arm, limits), **entries)


def _tendon_table(tendons: Tendons, *, plane: bool) -> TendonTable:
    """Return the tendons of a section as a table, in the plane without their places; a limit of inf is none."""
    limits = {key: getattr(tendons, key) for key in ("travel", "speed")}
    given = {key: limit if np.isfinite(limit) else None for key, limit in limits.items()}
    places = dict.fromkeys(("number", "angle_deg")) if plane else {"angle_deg": tendons.angle}
    return TendonTable.from_object(tendons, **places, **given)


def _pair(limits: FloatArray) -> float | list[float]:
    """Return the limits of a joint's bends, shape (k,), as one number if all are equal."""
    return limits.tolist() if np.ptp(limits) else float(limits[0])


def _axis_table(arm: Arm, number: int, limits: Limits | None) -> BaseAxisTable:
    """Return an axis that carries an arm, given by its index, as a table of a problem file."""
    axis = arm.carrier[number]
    bounds = None if limits is None else limits.axes
    if bounds is None:
        raise ProblemError("the limits of the axes that carry an arm are missing; give Limits.axes")
    ends = [axis.low, axis.high]
    effort = bounds.effort[number] if np.isfinite(bounds.effort[number]) else None
    kind = "revolute" if axis.revolute else "prismatic"
    of_kind = (
        {"range_deg": ends, "position": axis.point, "torque": effort, "range": None, "force": None}
        if axis.revolute
        else {"range": ends, "force": effort, "range_deg": None, "position": None, "torque": None}
    )
    rates = {"velocity": bounds.velocity[number], "acceleration": bounds.acceleration[number]}
    return BaseAxisTable.from_object(axis, kind=kind, axis=axis.direction, **rates, **of_kind)


def _sections(arm: Arm) -> list[SectionTable]:
    """Return runs of successive equal links as the tables ``[[arm.sections]]`` of a problem file."""
    assert arm.proportions is not None  # noqa: S101 - said by who asks
    shares = arm.proportions.limits.reshape(arm.links, -1).copy()
    shares[0] = np.any(shares[0])  # its own limits are the base's
    each = np.column_stack((arm.lengths, arm.radii, arm.joint_limit * shares))
    starts = np.flatnonzero(np.append(True, np.any(each[1:] != each[:-1], axis=1)))
    return [
        SectionTable.from_object(
            None,
            links=len(run),
            link_length=run[0, 0],
            radius=[run[0, 1]],
            joint_limit_deg=_pair(run[0, 2:]) if np.any(run[0, 2:]) else arm.joint_limit,
            locked=None if np.any(run[0, 2:]) else list(range(1, len(run) + 1)),
        )
        for run in np.split(each, starts[1:])
    ]


def limits_table(limits: Limits, unit: LengthUnit) -> Table:
    """Return limits as the table ``[limits]`` of a problem file, with lengths in ``unit``."""
    bounds = [
        (point.at, {key: bound for key in ("velocity", "acceleration") if np.isfinite(bound := getattr(point, key))})
        for point in limits.points
    ]
    tip = {f"tip_{key}": bound for at, given in bounds if at is None for key, bound in given.items()}
    points = [PointLimitTable.from_object(None, at=at, **given) for at, given in bounds if at is not None]
    return LimitsTable.from_object(limits, **tip, points=points or None).written(unit)


def goal_table(
    goal: Goal,
    unit: LengthUnit,
    *,
    in_space: bool,
    fed: bool,
    tolerances: Tolerances | None = None,
    arm_axes: tuple[str, ...] | None = None,
) -> Table:
    """Return a goal as the table ``[goal]`` of a problem file, or a start pose as the table ``[start]``.

    Args:
        goal: the goal, or the start pose of the whole arm.
        unit: unit of the lengths in the table.
        in_space: whether the arm moves in three dimensions.
        fed: whether the base is on a feed axis (a linear axis that advances the arm).
        tolerances: tolerances of the goal; None for a start, which has none.
        arm_axes: units of the axes that carry the base; None if there are none.
    """
    entries: dict[str, object] = {"name": goal.name or None}
    if in_space:
        entries["via"] = list(goal.via) or None
    if goal.path is not None:
        entries |= {"path": list(goal.path), "position": None}
    if (look_at := goal.look_at) is not None:
        entries |= {"position": None, "look_at": look_at.place, "distance": look_at.distance}
        entries |= {"field_of_view_deg": look_at.field_of_view, "normal": look_at.normal}
        entries["angle_deg"] = None if look_at.normal is None else look_at.angle
    elif tolerances:
        angle = "direction" if in_space else "heading"
        turned = tolerances.heading if goal.path is None else None
        entries |= {"position_tolerance": tolerances.position, f"{angle}_tolerance_deg": turned}
        if in_space:
            entries["roll_tolerance_deg"] = None if goal.up is None else tolerances.roll
    if (pose := goal.for_joints) is not None:
        entries["feed"] = pose.feed if fed else None
        if in_space and np.ndim(pose.feed):
            units = arm_axes or ()
            pairs = zip(units, np.atleast_1d(pose.feed), strict=True)
            entries["axes"] = [[math.nan, value] if unit == "rad" else [value, math.nan] for unit, value in pairs]
        if pose.curve is None:
            entries["joints_deg"] = pose.bends
        else:
            entries |= {"heading_deg": pose.curve.base_heading, "segments": pose.curve.segments}
    table = SpaceGoalTable if in_space else GoalTable
    return table.from_object(goal, **entries).written(unit)


def coverage_table(problem: Problem, coverage: Coverage) -> Table:
    """Return the surfaces that have to be seen as the table ``[goal]`` of a problem file.

    Raises:
        ProblemError: the goals are those found for them, which no file has beside them.
    """
    if problem.planner.order != "free":
        raise ProblemError("views found for goal.see are not written as goals; write the problem as posed: tour.posed")
    within = coverage.within
    entries = {
        "see": list(coverage.surfaces),
        "field_of_view_deg": coverage.field_of_view,
        "angle_deg": coverage.angle,
        "within": None if within is None else within.ravel() if problem.dimension == 2 else within,
    }
    table = SpaceGoalTable if problem.dimension == 3 else GoalTable
    return table.from_object(coverage, **entries).written(problem.length_unit)


def views_data(tour: Tour) -> list[Table]:
    """Return the goals that were found for what has to be seen, each as a table ``[goal]`` of a problem file."""
    posed = tour.posed
    written = partial(goal_table, unit=posed.length_unit, in_space=posed.dimension == 3, fed=False)
    return [written(view.goal, tolerances=view.tolerances) | {"pause": float(view.pause)} for view in tour.views]


def simulation_table(options: SimulationOptions, unit: LengthUnit) -> Table:
    """Return simulation options as the table ``[simulation]`` of a problem file, with lengths in ``unit``."""
    gains = GainsTable.from_object(None, proportional=options.proportional_gain, derivative=options.derivative_gain)
    return SimulationTable.from_object(options, gains=gains if gains.model_fields_set else None).written(unit)


def _body(name: str, body: Body, file: str, unit: LengthUnit) -> Table:
    """Return an obstacle in space as a table of a problem file; a box and a mesh also get their pose.

    Args:
        name: name of the obstacle.
        body: the solid.
        file: path of the mesh file; ignored for other solids.
        unit: unit of the lengths in the table.
    """
    entries: dict[str, object] = {body.kind: body}
    if body.kind == "mesh":
        # A mesh made in Python is written in metres, in world coordinates.
        entries = {"mesh": file, "scale": 1.0 / METRES[unit], "solid": None if body.solid else False}
        entries["error"] = body.margin or None
        if body.balls is not None:
            entries = {"points": file, "point_radius": body.balls.point, "error": body.balls.error or None}
        if body.content:
            entries |= {"scale": body.scale / METRES[unit], "sha256": body.digest}
            # A GLB without the key ``up`` causes a warning that its y axis may be up, so "z" is written explicitly.
            entries["up"] = body.up if body.up == "y" or body.file.lower().endswith(".glb") else None
    elif body.kind == "box":
        entries = {"box": [body.low, body.high]}
    if body.kind == "box" or (body.kind == "mesh" and body.content):
        where = body.placement
        pose = PlacementTable.from_object(None, position=where.position, quaternion=where.quaternion)
        entries["pose"] = None if where.is_identity else pose
    return SpaceObstacleTable.from_object(None, name=name, **entries).written(unit)


def stored_mesh_paths(problem: Problem) -> list[str]:
    """Return for each obstacle the path of its mesh file in an output folder; entries of other obstacles are unused."""
    slugs = [slug for _, slug in unique_names(each.name for each in problem.workspace.obstacles)]
    # Meshes made in Python are written as OBJ.
    suffixes = {k: PurePosixPath(body.file).suffix.lower() for k, _, body in problem.workspace.meshes if body.content}
    return [f"{KEPT_MESHES}/{slug}{suffixes.get(k, '.obj')}" for k, slug in enumerate(slugs)]


def _meshes(problem: Problem) -> Iterator[tuple[str, str, MeshBody]]:
    """Yield for each obstacle that is a mesh: the obstacle's name, the path of the stored file, and the mesh."""
    kept = stored_mesh_paths(problem)
    yield from ((obstacle, kept[k], body) for k, obstacle, body in problem.workspace.meshes)


def stored_meshes(problem: Problem) -> dict[str, bytes]:
    """Return the mesh files of a problem, byte for byte, by their path in an output folder.

    With these copies an output folder can be verified on its own. Meshes made in Python are written as OBJ, in world
    coordinates and with every digit, so that a later verification uses exactly the certified mesh.
    """
    return {name: body.content or _mesh_obj(body) for _, name, body in _meshes(problem)}


def _mesh_obj(body: MeshBody) -> bytes:
    """Return a mesh as the bytes of an OBJ file, with enough digits to read the same coordinates again."""
    rows = [f"v {' '.join(map(repr, place))}" for place in body.vertices.tolist()]
    rows += [f"f {' '.join(map(str, face))}" for face in (body.faces + 1).tolist()]
    return "\n".join((*rows, "")).encode()


def mesh_data(problem: Problem) -> list[dict[str, object]]:
    """Return one record per mesh obstacle: original file, stored copy with SHA-256, number of triangles, closedness."""
    kept = stored_meshes(problem)
    return [
        {
            "obstacle": obstacle,
            "file": body.file,
            "kept": name,
            "sha256": hashlib.sha256(kept[name]).hexdigest(),
            "triangles": len(body.faces),
            "closed": body.closed,
        }
        for obstacle, name, body in _meshes(problem)
    ]
