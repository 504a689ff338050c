"""From a problem back to the data of a problem file, the inverse of reading: in its unit, angles in degrees."""

import tomllib
from dataclasses import asdict
from typing import Any

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, LengthUnit, in_unit
from ccm_opt.errors import ProblemError, ProblemFileError
from ccm_opt.io.drawing import obstacle_table
from ccm_opt.io.reading import parse_problem
from ccm_opt.io.settings import READING
from ccm_opt.problem import (
    Disturbances,
    Goal,
    JointPose,
    Limits,
    PlannerOptions,
    Problem,
    SimulationOptions,
    Start,
    TipGoal,
    Tolerances,
    VerificationOptions,
)
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.driven_arm import DrivenArm
from ccm_opt.scene.workspace import Obstacle, Workspace

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
        read_again = parse_problem(problem.source)
    except ProblemFileError:
        return written
    same = isinstance(read_again, Problem) and problem_data(read_again) == written
    return tomllib.loads(problem.source) if same else written


def problem_data(problem: Problem) -> Table:
    """Every value of a problem in the layout of ``problem.toml``.

    Angles pass through degrees, so that the problem read from these data may differ in the last bit. Lengths are in the
    problem's unit, as numbers that are read as the same metres wherever there are such.

    Args:
        problem: the problem; its ``source`` does not matter.

    Returns:
        Plain numbers, texts, lists and tables, from which ``problem_from_mapping`` rebuilds the problem.

    Raises:
        ProblemError: when it cannot be written in a problem file.
    """
    unit = problem.length_unit
    return {
        "schema": 1,
        "name": problem.name,
        "description": problem.description,
        "units": problem.length_unit,
        "workspace": workspace_table(problem.workspace, unit),
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
    return obstacle_table(Obstacle(obstacle.name, core, in_unit(obstacle.rounding, unit)))


def arm_table(arm: Arm, unit: LengthUnit) -> Table:
    """An arm as ``[arm]``."""
    base: Table = {"base": _lengths(arm.base, unit), "base_heading_deg": _degrees(arm.base_heading)}
    chain = chain_table(arm, unit)
    # In the order of the pages on problem files.
    measures = {key: chain.pop(key) for key in ("links", "link_length", "radius")}
    return measures | base | chain


def chain_table(arm: DrivenArm, unit: LengthUnit) -> Table:
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
    table: Table = {"velocity": _list(limits.velocity), "acceleration": _list(limits.acceleration)}
    for key in ("jerk", "torque"):
        if getattr(limits, key) is not None:
            table[key] = _list(getattr(limits, key))
    for key in ("feed_velocity", "feed_acceleration", "feed_jerk"):
        if getattr(limits, key) is not None:
            table[key] = in_unit(getattr(limits, key), unit)
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
    arm = problem.arm
    unit = problem.length_unit
    last = goal_table(problem.goal, arm, unit) | _tolerances(problem.tolerances, unit)
    stops = [
        goal_table(stop.goal, arm, unit) | _tolerances(stop.tolerances, unit) | {"pause": float(stop.pause)}
        for stop in problem.stops
    ]
    return [*stops, last] if stops else last


def goal_table(goal: Goal, arm: Arm, unit: LengthUnit) -> Table:
    """A goal as ``[goal]``, without its tolerances."""
    if not isinstance(goal, TipGoal):
        return pose_table(goal, arm, unit)
    table: Table = {"position": _lengths(goal.position, unit)}
    return table if goal.heading is None else table | {"heading_deg": _degrees(goal.heading)}


def pose_table(pose: Start, arm: Arm, unit: LengthUnit) -> Table:
    """A pose of the whole arm as ``[start]``.

    Raises:
        ProblemError: a curve does not begin at the base.
    """
    feed: Table = {axis: in_unit(pose.feed, unit) for axis in arm.coordinates.base_names}
    if isinstance(pose, JointPose):
        return {"joints_deg": _list(np.rad2deg(pose.bends))} | feed
    return _curve(pose.configuration, arm, unit) | feed


def _curve(curve: Configuration, arm: Arm, unit: LengthUnit) -> Table:
    if not np.allclose(curve.base, arm.base, rtol=0.0, atol=READING.base_tolerance * arm.length):
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


def _tolerances(tolerances: Tolerances, unit: LengthUnit) -> Table:
    return {
        "position_tolerance": in_unit(tolerances.position, unit),
        "heading_tolerance_deg": _degrees(tolerances.heading),
    }


def planner_table(options: PlannerOptions, unit: LengthUnit) -> Table:
    """Planner options as ``[planner]``."""
    table = asdict(options)
    gap = table.pop("wanted_gap")
    return table if gap is None else table | {"wanted_gap": in_unit(gap, unit)}


def simulation_table(options: SimulationOptions) -> Table:
    """Simulation options as ``[simulation]``."""
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


def verification_table(options: VerificationOptions, unit: LengthUnit) -> Table:
    """How strictly plans are judged as ``[verification]``."""
    tolerance = options.contact_tolerance
    return {} if tolerance is None else {"contact_tolerance": in_unit(tolerance, unit)}


def _degrees(angle: float) -> float:
    return float(np.rad2deg(angle))


def _list(values: FloatArray) -> list[float]:
    plain: list[float] = np.asarray(values, dtype=np.float64).tolist()
    return plain


def _lengths(values: FloatArray, unit: LengthUnit) -> list[Any]:
    """Lengths or places in a unit, as nested lists."""
    metres = np.asarray(values, dtype=np.float64)
    given = np.array([in_unit(value, unit) for value in metres.flat])
    nested: list[Any] = given.reshape(metres.shape).tolist()
    return nested
