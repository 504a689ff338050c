"""From a problem back to the data of a problem file, the inverse of reading: in metres, degrees where a key says so."""

import tomllib
from dataclasses import asdict

import numpy as np
import shapely

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.errors import ProblemError, ProblemFileError
from ccm_opt.files.problem_file.reading import parse_problem
from ccm_opt.files.problem_file.reading_settings import READING
from ccm_opt.files.problem_file.scene_file import obstacle_table
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import (
    Disturbances,
    Goal,
    JointPose,
    Limits,
    Problem,
    SimulationOptions,
    Start,
    TipGoal,
    Tolerances,
)

Table = dict[str, object]
"""A table of a problem file."""


def recorded_data(problem: Problem) -> Table:
    """The data to keep for the record: those of the problem's file as long as they still say the same.

    Args:
        problem: the problem, from a file, from Python, or changed by ``dataclasses.replace``.

    Returns:
        The parsed ``source`` when reading it gives this problem, else ``problem_data``.

    Raises:
        ProblemError: when it cannot be written in a problem file.
    """
    written = problem_data(problem)
    if not problem.source:
        return written
    try:
        read_again = problem_data(parse_problem(problem.source))
    except ProblemFileError:
        return written
    return tomllib.loads(problem.source) if read_again == written else written


def problem_data(problem: Problem) -> Table:
    """Every value of a problem in the layout of ``problem.toml``.

    Angles pass through degrees, so that the problem read from these data may differ in the last bit.

    Args:
        problem: the problem; its ``source`` does not matter.

    Returns:
        Plain numbers, texts, lists and tables, from which ``problem_from_mapping`` rebuilds the problem.

    Raises:
        ProblemError: when it cannot be written in a problem file.
    """
    return {
        "schema": 1,
        "name": problem.name,
        "description": problem.description,
        "workspace": _workspace(problem.workspace),
        "arm": _arm(problem.arm),
        "limits": _limits(problem.limits),
        "start": _pose(problem.start, problem.arm),
        "goal": _goals(problem),
        "planner": {key: value for key, value in asdict(problem.planner).items() if value is not None},
        "simulation": _simulation(problem.simulation),
        "tolerance": {"joint_error_deg": _degrees(problem.joint_error)},
        "verification": {key: value for key, value in asdict(problem.verification).items() if value is not None},
    }


def _workspace(workspace: Workspace) -> Table:
    if workspace.boundary.interiors:
        raise ProblemError("the workspace's boundary has holes, which a problem file cannot say; make them obstacles")
    return {
        "boundary": shapely.get_coordinates(workspace.boundary.exterior)[:-1].tolist(),
        "clearance": float(workspace.clearance),
        "obstacles": [_obstacle(obstacle) for obstacle in workspace.obstacles],
    }


def _obstacle(obstacle: Obstacle) -> Table:
    # A rounded polygon has no table of its own, and a point without rounding is no obstacle.
    expected = shapely.Point if obstacle.rounding > 0.0 else shapely.Polygon
    if not isinstance(obstacle.core, (expected, shapely.LineString)):
        raise ProblemError(
            f"obstacle '{obstacle.name}', a {type(obstacle.core).__name__} with rounding {obstacle.rounding:g} m, "
            "is none that a problem file can say; expected a polygon without rounding, a point with, or a line"
        )
    return obstacle_table(obstacle)


def _arm(arm: Arm) -> Table:
    table: Table = {
        "links": int(arm.links),
        "link_length": float(arm.link_length),
        "radius": float(arm.radius),
        "base": _list(arm.base),
        "base_heading_deg": _degrees(arm.base_heading),
        "joint_limit_deg": _degrees(arm.joint_limit),
        "base_limit_deg": _degrees(arm.base_limit),
        "self_collision": bool(arm.self_collision),
        "mount_length": float(arm.mount_length),
        "masses": _list(arm.masses),
        "inertia": {"axial": _list(arm.inertia_axial), "transverse": _list(arm.inertia_transverse)},
        "axes": arm.axes,
    }
    for key in ("payload", "rotor_inertia", "friction"):
        if np.any(value := np.asarray(getattr(arm, key), dtype=np.float64)):
            table[key] = _list(value) if value.ndim else float(value)
    for name, axis in zip(arm.coordinates.base_names, arm.base_axes, strict=True):
        table[name] = {"range": [float(axis.low), float(axis.high)], "hole": float(axis.hole)}
    return table


def _limits(limits: Limits) -> Table:
    table: Table = {"velocity": _list(limits.velocity), "acceleration": _list(limits.acceleration)}
    for key in ("jerk", "torque"):
        if getattr(limits, key) is not None:
            table[key] = _list(getattr(limits, key))
    for key in ("feed_velocity", "feed_acceleration", "feed_jerk", "feed_force"):
        if getattr(limits, key) is not None:
            table[key] = float(getattr(limits, key))
    points = []
    for point in limits.points:
        bounds = {key: float(getattr(point, key)) for key in ("velocity", "acceleration")}
        given = {key: value for key, value in bounds.items() if np.isfinite(value)}
        if point.at is None:
            table |= {f"tip_{key}": value for key, value in given.items()}
        else:
            points.append({"at": float(point.at), **given})
    if points:
        table["points"] = points
    return table


def _goals(problem: Problem) -> Table | list[Table]:
    """The goal, or with stops on the way the list of all goals."""
    last = _goal(problem.goal, problem.arm) | _tolerances(problem.tolerances)
    stops = [
        _goal(stop.goal, problem.arm) | _tolerances(stop.tolerances) | {"pause": float(stop.pause)}
        for stop in problem.stops
    ]
    return [*stops, last] if stops else last


def _goal(goal: Goal, arm: Arm) -> Table:
    if not isinstance(goal, TipGoal):
        return _pose(goal, arm)
    table: Table = {"position": _list(goal.position)}
    return table if goal.heading is None else table | {"heading_deg": _degrees(goal.heading)}


def _pose(pose: Start, arm: Arm) -> Table:
    feed: Table = {axis: float(pose.feed) for axis in arm.coordinates.base_names}
    if isinstance(pose, JointPose):
        return {"joints_deg": _list(np.rad2deg(pose.bends))} | feed
    return _curve(pose.configuration, arm) | feed


def _curve(curve: Configuration, arm: Arm) -> Table:
    if not np.allclose(curve.base, arm.base, rtol=0.0, atol=READING.base_tolerance * arm.length):
        raise ProblemError(f"a curve begins at {_list(curve.base)}, expected the arm's base, {_list(arm.base)}")
    segments = [
        {"length": float(s.length), "curvature": _list(s.curvature), "knots": [float(knot) for knot in s.knots]}
        for s in curve.segments
    ]
    return {"heading_deg": _degrees(curve.base_heading), "segments": segments}


def _tolerances(tolerances: Tolerances) -> Table:
    return {
        "position_tolerance": float(tolerances.position),
        "heading_tolerance_deg": _degrees(tolerances.heading),
    }


def _simulation(options: SimulationOptions) -> Table:
    given = {"proportional": options.proportional_gain, "derivative": options.derivative_gain}
    gains = {name: float(value) for name, value in given.items() if value is not None}
    return {
        "gravity": _list(options.gravity),
        "step": float(options.step),
        "controller": options.controller,
        "bandwidth": float(options.bandwidth),
        **({"gains": gains} if gains else {}),
        "disturbances": _disturbances(options.disturbances),
    }


def _disturbances(disturbances: Disturbances) -> Table:
    table = asdict(disturbances)
    return table | {"angle_noise_deg": _degrees(table.pop("angle_noise"))}


def _degrees(angle: float) -> float:
    return float(np.rad2deg(angle))


def _list(values: FloatArray) -> list[float]:
    plain: list[float] = np.asarray(values, dtype=np.float64).tolist()
    return plain
