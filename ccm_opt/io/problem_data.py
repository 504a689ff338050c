"""Problems as data of a problem file."""

import hashlib
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.core.length_words import METRES, LengthUnit, in_unit
from ccm_opt.io.drawing import obstacle_table
from ccm_opt.io.reading import parse_problem
from ccm_opt.io.robot_models import triangles_stl
from ccm_opt.io.scene_solids import told_apart
from ccm_opt.problem import (
    Goal,
    JointPose,
    Limits,
    PlannerOptions,
    Problem,
    SimulationOptions,
    Tolerances,
    VerificationOptions,
)
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.bodies import Body, MeshBody, RigidPlacement
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

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
    """Every value of a problem in the layout of ``problem.toml``.

    Angles pass through degrees, so that the problem read from these data may differ in the last bit. Lengths are in the
    problem's unit, as numbers that are read as the same metres wherever there are such.

    Args:
        problem: the problem; its ``source`` does not matter.
        mesh_files: path of the mesh of each obstacle in space, relative to where the data will be read; of no matter
            where it is no mesh. Those of ``kept_names`` when None.

    Returns:
        Plain numbers, texts, lists and tables, from which ``problem_from_mapping`` rebuilds the problem.

    Raises:
        ProblemError: when it cannot be written in a problem file.
    """
    unit = problem.length_unit
    head: Table = {"schema": 1}
    workspace: Table
    if problem.dimension == 3:
        head["space"] = 3
        files = kept_names(problem) if mesh_files is None else mesh_files
        workspace = {"clearance": in_unit(problem.workspace.clearance, unit)}
        if problem.workspace.bounds is not None:
            workspace["bounds"] = _lengths(problem.workspace.bounds, unit)
        listed = zip(problem.workspace.obstacles, files, strict=True)
        workspace["obstacles"] = [{"name": each.name} | _body(each.body, file, unit) for each, file in listed]
    else:
        workspace = workspace_table(problem.workspace, unit)
    return {
        **head,
        "name": problem.name,
        "description": problem.description,
        "units": unit,
        "workspace": workspace,
        "arm": arm_table(problem.arm, unit),
        "limits": limits_table(problem.limits, unit),
        "start": pose_table(problem.start, problem.arm, unit),
        "goal": _goals(problem),
        "planner": planner_table(problem.planner, unit),
        "simulation": simulation_table(problem.simulation),
        "tolerance": {"joint_error_deg": _degrees(problem.joint_error)},
        "verification": verification_table(problem.verification, unit),
    }


def workspace_table(workspace: Workspace, unit: LengthUnit) -> Table:
    """A room as ``[workspace]``.

    Raises:
        ProblemError: its boundary has holes, or an obstacle is none that a problem file can say.
    """
    if workspace.boundary.interiors:
        raise ProblemError("the workspace's boundary has holes, which a problem file cannot say; make them obstacles")
    return {
        "boundary": _lengths(shapely.get_coordinates(workspace.boundary.exterior)[:-1], unit),
        "clearance": in_unit(workspace.clearance, unit),
        "obstacles": [obstacle_in_unit(obstacle, unit) for obstacle in workspace.obstacles],
    }


def obstacle_in_unit(obstacle: Obstacle, unit: LengthUnit) -> Table:
    """An obstacle as an entry of ``[[workspace.obstacles]]``.

    Raises:
        ProblemError: it is none that a problem file can say.
    """
    # A rounded polygon has no table of its own, and a point without rounding is no obstacle.
    expected = shapely.Point if obstacle.rounding > 0.0 else shapely.Polygon
    if not isinstance(obstacle.core, (expected, shapely.LineString)):
        raise ProblemError(
            f"obstacle '{obstacle.name}', a {type(obstacle.core).__name__} with rounding {obstacle.rounding:g} m, "
            "is none that a problem file can say; expected a polygon without rounding, a point with, or a line"
        )
    core = shapely.transform(obstacle.core, lambda points: np.array(_lengths(points, unit)))
    return obstacle_table(Obstacle(obstacle.name, PlaneShape(core, in_unit(obstacle.rounding, unit))))


def arm_table(arm: Arm, unit: LengthUnit) -> Table:
    """An arm as ``[arm]``."""
    chain = _chain_table(arm, unit)
    if arm.dimension == 3:
        position, along, up = _lengths(arm.base, unit), arm.direction.tolist(), arm.up.tolist()
        return chain | {"base": {"position": position, "direction": along, "up": up}}
    base: Table = {"base": _lengths(arm.base, unit), "base_heading_deg": _degrees(arm.base_heading)}
    # In the order of the pages on problem files.
    measures = {key: chain.pop(key) for key in ("links", "link_length", "radius")}
    return measures | base | chain


def _chain_table(arm: Arm, unit: LengthUnit) -> Table:
    """What ``[arm]`` says of an arm in the plane or in space, but for its base."""
    table: Table = {
        "links": int(arm.links),
        "link_length": in_unit(arm.link_length, unit),
        "radius": in_unit(arm.radius, unit),
        "joint_limit_deg": _degrees(arm.joint_limit),
        "base_limit_deg": _degrees(arm.base_limit),
        "self_collision": bool(arm.self_collision),
        "mount_length": in_unit(arm.mount_length, unit),
        "masses": _list(arm.masses),
        "inertia": {"axial": _list(arm.inertia_axial), "transverse": _list(arm.inertia_transverse)},
        "axes": arm.axes,
    }
    for key in ("payload", "rotor_inertia", "friction"):
        if np.any(value := np.asarray(getattr(arm, key), dtype=np.float64)):
            table[key] = _list(value) if value.ndim else float(value)
    for name, axis in zip(arm.coordinates.base_names, arm.base_axes, strict=True):
        ends = [in_unit(axis.low, unit), in_unit(axis.high, unit)]
        table[name] = {"range": ends, "hole": in_unit(axis.hole, unit)}
    return table


def limits_table(limits: Limits, unit: LengthUnit) -> Table:
    """Limits as ``[limits]``."""
    keys = ("velocity", "acceleration", "jerk", "torque", "feed_velocity", "feed_acceleration", "feed_jerk")
    values = {key: getattr(limits, key) for key in keys if getattr(limits, key) is not None}
    table: Table = {
        key: in_unit(value, unit) if key.startswith("feed") else _list(value) for key, value in values.items()
    }
    if limits.feed_force is not None:
        table["feed_force"] = float(limits.feed_force)
    points = []
    for point in limits.points:
        bounds = {key: in_unit(getattr(point, key), unit) for key in ("velocity", "acceleration")}
        given = {key: value for key, value in bounds.items() if np.isfinite(value)}
        if point.at is None:
            table |= {f"tip_{key}": value for key, value in given.items()}
        else:
            points.append({"at": in_unit(point.at, unit), **given})
    if points:
        table["points"] = points
    return table


def _goals(problem: Problem) -> Table | list[Table]:
    """The goal, or with stops on the way the list of all goals."""
    unit = problem.length_unit

    def table(goal: Goal, tolerances: Tolerances) -> Table:
        angle = "direction" if problem.dimension == 3 else "heading"
        own = goal_table(goal, problem.arm, unit)
        own["position_tolerance"] = in_unit(tolerances.position, unit)
        return own | {f"{angle}_tolerance_deg": _degrees(tolerances.heading)}

    last = table(problem.goal, problem.tolerances)
    stops = [table(stop.goal, stop.tolerances) | {"pause": float(stop.pause)} for stop in problem.stops]
    return [*stops, last] if stops else last


def goal_table(goal: Goal, arm: Arm, unit: LengthUnit) -> Table:
    """A goal as ``[goal]``, without its tolerances."""
    if goal.for_joints:
        return pose_table(goal.for_joints, arm, unit)
    table: Table = {"position": _lengths(goal.tip(arm), unit)}
    if goal.heading is not None:
        table["heading_deg"] = _degrees(goal.heading)
    elif goal.direction is not None:
        table["direction"] = goal.direction.tolist()
    return table | {"via": [_lengths(place, unit) for place in goal.via]} if goal.via else table


def pose_table(pose: JointPose, arm: Arm, unit: LengthUnit) -> Table:
    """A pose of the whole arm as ``[start]``.

    Raises:
        ProblemError: a curve does not begin at the base.
    """
    feed: Table = {axis: in_unit(pose.feed, unit) for axis in arm.coordinates.base_names}
    if pose.curve is None:
        return {"joints_deg": np.rad2deg(pose.bends).tolist()} | feed
    return _curve(pose.curve, arm, unit) | feed


def _curve(curve: Configuration, arm: Arm, unit: LengthUnit) -> Table:
    if not np.allclose(curve.base, arm.base, rtol=0.0, atol=_BASE_TOLERANCE * arm.length):
        raise ProblemError(f"a curve begins at {_list(curve.base)}, expected the arm's base, {_list(arm.base)}")
    segments = [
        {
            "length": in_unit(segment.length, unit),
            "curvature": _list(METRES[unit] * segment.curvature),
            "knots": [float(knot) for knot in segment.knots],
        }
        for segment in curve.segments
    ]
    return {"heading_deg": _degrees(curve.base_heading), "segments": segments}


def planner_table(options: PlannerOptions, unit: LengthUnit) -> Table:
    """Planner options as ``[planner]``."""
    table = asdict(options)
    gap = table.pop("wanted_gap")
    return table if gap is None else table | {"wanted_gap": in_unit(gap, unit)}


def simulation_table(options: SimulationOptions) -> Table:
    """Simulation options as ``[simulation]``."""
    disturbances = asdict(options.disturbances)
    given = {"proportional": options.proportional_gain, "derivative": options.derivative_gain}
    gains = {name: float(value) for name, value in given.items() if value is not None}
    return {
        "gravity": _list(options.gravity),
        "step": float(options.step),
        "controller": options.controller,
        "bandwidth": float(options.bandwidth),
        **({"gains": gains} if gains else {}),
        "disturbances": disturbances | {"angle_noise_deg": _degrees(disturbances.pop("angle_noise"))},
    }


def verification_table(options: VerificationOptions, unit: LengthUnit) -> Table:
    """How strictly plans are judged as ``[verification]``."""
    return {key: in_unit(value, unit) for key, value in asdict(options).items() if value is not None}


def _degrees(angle: float) -> float:
    return float(np.rad2deg(angle))


def _list(values: FloatArray) -> list[float]:
    plain: list[float] = np.asarray(values, dtype=np.float64).tolist()
    return plain


def _lengths(values: npt.ArrayLike, unit: LengthUnit) -> list[Any]:
    """Lengths or places in a unit, as nested lists."""
    metres = np.asarray(values, dtype=np.float64)
    given = np.array([in_unit(value, unit) for value in metres.flat])
    nested: list[Any] = given.reshape(metres.shape).tolist()
    return nested


def _body(body: Body, file: str, unit: LengthUnit) -> Table:
    """An obstacle without its name; bodies that are round stand where they are without being placed."""
    if body.kind == "mesh":
        surface: Table = {} if body.solid else {"solid": False}
        if not body.content:
            # Made in Python: written in metres, where it stands.
            return {"mesh": file, "scale": 1.0 / METRES[unit]} | surface
        table: Table = {"mesh": file, "scale": body.scale / METRES[unit], "sha256": body.digest} | surface
        # Of GLB it is said that y is up where the key is not there.
        if body.up == "y" or body.file.lower().endswith(".glb"):
            table["up"] = body.up
        return table | _placement(body.placement, unit)
    if body.kind == "box":
        return {"box": [_lengths(body.low, unit), _lengths(body.high, unit)]} | _placement(body.placement, unit)
    radius = in_unit(body.radius, unit)
    if body.kind == "sphere":
        return {"sphere": {"center": _lengths(body.center, unit), "radius": radius}}
    bar = {
        "from": _lengths(body.start, unit),
        "to": _lengths(body.end, unit),
        "radius": radius,
    }
    return {body.kind: bar}


def _placement(placement: RigidPlacement, unit: LengthUnit) -> Table:
    if placement.is_identity:
        return {}
    return {
        "pose": {
            "position": _lengths(placement.position, unit),
            "quaternion": placement.quaternion.tolist(),
        }
    }


def kept_names(problem: Problem) -> list[str]:
    """Where the mesh of each obstacle is kept, relative to the folder; of no matter where it is no mesh."""
    slugs = [slug for _, slug in told_apart(each.name for each in problem.workspace.obstacles)]
    # Meshes that have no file are written as STL.
    suffixes = {k: PurePosixPath(body.file).suffix.lower() for k, _, body in problem.workspace.meshes if body.content}
    return [f"{KEPT_MESHES}/{slug}{suffixes.get(k, '.stl')}" for k, slug in enumerate(slugs)]


def _meshes(problem: Problem) -> Iterator[tuple[str, str, MeshBody]]:
    """The meshes among the obstacles: name of the obstacle, where the file is kept, and the mesh."""
    kept = kept_names(problem)
    yield from ((obstacle, kept[k], body) for k, obstacle, body in problem.workspace.meshes)


def kept_meshes(problem: Problem) -> dict[str, bytes]:
    """The mesh files that a problem was read with, byte for byte, so that a folder can be verified by itself.

    Meshes that were made in Python are written as they stand.
    """
    return {name: body.content or triangles_stl(body.triangles) for _, name, body in _meshes(problem)}


def mesh_data(problem: Problem) -> list[dict[str, object]]:
    """Of every mesh where it is from, what it was, and where it is kept."""
    kept = kept_meshes(problem)
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
