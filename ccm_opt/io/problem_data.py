"""Problems as data of a problem file."""

import hashlib
import tomllib
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import PurePosixPath

import numpy as np
import shapely

from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.core.length_words import METRES, LengthUnit
from ccm_opt.io.drawing import obstacle_table
from ccm_opt.io.reading import parse_problem
from ccm_opt.io.robot_models import triangles_stl
from ccm_opt.io.scene_solids import unique_names
from ccm_opt.io.schema import (
    BaseTable,
    GoalTable,
    PlacementTable,
    SpaceArmTable,
    SpaceGoalTable,
    SpaceObstacleTable,
    SpaceWorkspaceTable,
    WorkspaceTable,
)
from ccm_opt.io.schema_tables import (
    ArmTable,
    FeedTable,
    GainsTable,
    InertiaTable,
    LimitsTable,
    PlannerTable,
    PointLimitTable,
    SimulationTable,
    ToleranceTable,
    VerificationTable,
)
from ccm_opt.problem import Goal, Limits, Problem, SimulationOptions, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import Body, MeshBody
from ccm_opt.scene.workspace import Workspace

Table = dict[str, object]
"""A table of a problem file."""
_BASE_TOLERANCE = 1e-9
"""By which a curve's base may be off the arm's, as a share of its length: a problem file has one base for both.
Derived: a thousandth of the contact tolerance of the verifier."""
KEPT_MESHES = "meshes"
"""Folder in an output folder with the mesh files that the problem was read with."""


def recorded_data(problem: Problem) -> Table:
    """The data to keep for the record: in the plane those of the problem's file as long as they still say the same.

    Args:
        problem: the problem, from a file, from Python, or changed by ``dataclasses.replace``.

    Returns:
        The parsed ``source`` when reading it gives this problem, else ``problem_data``.

    Raises:
        ProblemError: when it cannot be written in a problem file.
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
    """Return every value of a problem in the layout of ``problem.toml``.

    Angles pass through degrees, so that the problem read from these data may differ in the last bit. Lengths are in the
    problem's unit, as numbers that are read as the same metres wherever there are such.

    Args:
        problem: the problem; its ``source`` does not matter.
        mesh_files: path of the mesh of each obstacle in space, relative to where the data will be read; of no matter
            where it is no mesh. Those of ``stored_mesh_paths`` when None.

    Returns:
        Plain numbers, texts, lists and tables, from which ``problem_from_mapping`` rebuilds the problem.

    Raises:
        ProblemError: when it cannot be written in a problem file.
    """
    unit = problem.length_unit
    head: Table = {"schema": 1}
    if problem.dimension == 3:
        head["space"] = 3
        files = stored_mesh_paths(problem) if mesh_files is None else mesh_files
        listed = zip(problem.workspace.obstacles, files, strict=True)
        obstacles = [_body(each.name, each.body, file, unit) for each, file in listed]
        workspace: Table = SpaceWorkspaceTable.of(problem.workspace).written(unit) | {"obstacles": obstacles}
    else:
        workspace = workspace_table(problem.workspace, unit)
    check_curves(problem)
    written = partial(goal_table, unit=unit, in_space=problem.dimension == 3, fed=bool(problem.arm.base_axes))
    stops = [written(stop.goal, tolerances=stop.tolerances) | {"pause": float(stop.pause)} for stop in problem.stops]
    goal = written(problem.goal, tolerances=problem.tolerances)
    return {
        **head,
        "name": problem.name,
        "description": problem.description,
        "units": unit,
        "workspace": workspace,
        "arm": arm_table(problem.arm, unit),
        "limits": limits_table(problem.limits, unit),
        "start": written(problem.start),
        "goal": [*stops, goal] if stops else goal,
        "planner": PlannerTable.of(problem.planner).written(unit),
        "simulation": simulation_table(problem.simulation, unit),
        "tolerance": ToleranceTable.of(problem).written(unit),
        "verification": VerificationTable.of(problem.verification).written(unit),
    }


def check_curves(problem: Problem) -> None:
    """Refuse curves that do not begin at the base, which a problem file has but one of.

    Raises:
        ProblemError: there is such a curve.
    """
    arm = problem.arm
    for goal in (problem.start, *(stop.goal for stop in problem.goals)):
        curve = goal.for_joints.curve if goal.for_joints else None
        if curve is not None and not np.allclose(curve.base, arm.base, rtol=0.0, atol=_BASE_TOLERANCE * arm.length):
            found, base = (np.asarray(place, dtype=np.float64).tolist() for place in (curve.base, arm.base))
            raise ProblemError(f"a curve begins at {found}, expected the arm's base, {base}")


def workspace_table(workspace: Workspace, unit: LengthUnit) -> Table:
    """Return a room in the plane as ``[workspace]``.

    Raises:
        ProblemError: its boundary has holes, or an obstacle is none that a problem file can say.
    """
    if workspace.boundary.interiors:
        raise ProblemError("the workspace's boundary has holes, which a problem file cannot say; make them obstacles")
    boundary = shapely.get_coordinates(workspace.boundary.exterior)[:-1]
    table = WorkspaceTable.of(workspace, boundary=boundary).written(unit)
    return table | {"obstacles": [obstacle_table(obstacle, unit) for obstacle in workspace.obstacles]}


def arm_table(arm: Arm, unit: LengthUnit) -> Table:
    """Return an arm as ``[arm]``."""
    own: dict[str, object] = {
        "inertia": InertiaTable.of(None, axial=arm.inertia_axial, transverse=arm.inertia_transverse),
        "feed": next((FeedTable.of(axis, range=[axis.low, axis.high]) for axis in arm.base_axes), None),
    }
    own |= {key: None for key in ("payload", "rotor_inertia", "friction") if not np.any(getattr(arm, key))}
    if arm.dimension == 3:
        return SpaceArmTable.of(arm, base=BaseTable.of(arm, position=arm.base), **own).written(unit)
    return ArmTable.of(arm, **own).written(unit)


def limits_table(limits: Limits, unit: LengthUnit) -> Table:
    """Return the limits as ``[limits]``."""
    bounds = [
        (point.at, {key: bound for key in ("velocity", "acceleration") if np.isfinite(bound := getattr(point, key))})
        for point in limits.points
    ]
    tip = {f"tip_{key}": bound for at, given in bounds if at is None for key, bound in given.items()}
    points = [PointLimitTable.of(None, at=at, **given) for at, given in bounds if at is not None]
    return LimitsTable.of(limits, **tip, points=points or None).written(unit)


def goal_table(
    goal: Goal, unit: LengthUnit, *, in_space: bool, fed: bool, tolerances: Tolerances | None = None
) -> Table:
    """Return a goal as ``[goal]``, or a pose of the whole arm as ``[start]``, which has no tolerances.

    Args:
        goal: as an object.
        unit: of the lengths in the table.
        in_space: whether the arm leaves the plane.
        fed: whether a feed axis carries its base.
        tolerances: how near it counts.
    """
    own: dict[str, object] = {"via": list(goal.via) or None} if in_space else {}
    if tolerances:
        angle = "direction" if in_space else "heading"
        own |= {"position_tolerance": tolerances.position, f"{angle}_tolerance_deg": tolerances.heading}
    if (pose := goal.for_joints) is not None:
        own["feed"] = pose.feed if fed else None
        if pose.curve is None:
            own["joints_deg"] = pose.bends
        else:
            own |= {"heading_deg": pose.curve.base_heading, "segments": pose.curve.segments}
    table = SpaceGoalTable if in_space else GoalTable
    return table.of(goal, **own).written(unit)


def simulation_table(options: SimulationOptions, unit: LengthUnit) -> Table:
    """Return the simulation options as ``[simulation]``."""
    gains = GainsTable.of(None, proportional=options.proportional_gain, derivative=options.derivative_gain)
    return SimulationTable.of(options, gains=gains if gains.model_fields_set else None).written(unit)


def _body(name: str, body: Body, file: str, unit: LengthUnit) -> Table:
    """Return an obstacle in space; bodies that are round stand where they are without being placed."""
    own: dict[str, object] = {body.kind: body}
    if body.kind == "mesh":
        # Made in Python: written in metres, where it stands.
        own = {"mesh": file, "scale": 1.0 / METRES[unit], "solid": None if body.solid else False}
        if body.content:
            own |= {"scale": body.scale / METRES[unit], "sha256": body.digest}
            # Of GLB it is said that y is up where the key is not there.
            own["up"] = body.up if body.up == "y" or body.file.lower().endswith(".glb") else None
    elif body.kind == "box":
        own = {"box": [body.low, body.high]}
    if body.kind == "box" or (body.kind == "mesh" and body.content):
        where = body.placement
        pose = PlacementTable.of(None, position=where.position, quaternion=where.quaternion)
        own["pose"] = None if where.is_identity else pose
    return SpaceObstacleTable.of(None, name=name, **own).written(unit)


def stored_mesh_paths(problem: Problem) -> list[str]:
    """Return where the mesh of each obstacle is kept, relative to the folder; of no matter where it is no mesh."""
    slugs = [slug for _, slug in unique_names(each.name for each in problem.workspace.obstacles)]
    # Meshes that have no file are written as STL.
    suffixes = {k: PurePosixPath(body.file).suffix.lower() for k, _, body in problem.workspace.meshes if body.content}
    return [f"{KEPT_MESHES}/{slug}{suffixes.get(k, '.stl')}" for k, slug in enumerate(slugs)]


def _meshes(problem: Problem) -> Iterator[tuple[str, str, MeshBody]]:
    """Yield the meshes among the obstacles: name of the obstacle, where the file is kept, and the mesh."""
    kept = stored_mesh_paths(problem)
    yield from ((obstacle, kept[k], body) for k, obstacle, body in problem.workspace.meshes)


def stored_meshes(problem: Problem) -> dict[str, bytes]:
    """Return the mesh files that a problem was read with, byte for byte, so that a folder can be verified by itself.

    Meshes that were made in Python are written as they stand.
    """
    return {name: body.content or triangles_stl(body.triangles) for _, name, body in _meshes(problem)}


def mesh_data(problem: Problem) -> list[dict[str, object]]:
    """Of every mesh where it is from, what it was, and where it is kept."""
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
