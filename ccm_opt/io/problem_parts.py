"""Construction of planning problems from Python objects.

Every argument is converted to the equivalent table of a problem file, in the unit of the call, and then checked like
a file. All defects are therefore reported together, under the keys that the arguments would have in a file.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, get_args

import numpy as np
import shapely

from ccm_opt.core.arguments import Arguments, expect, expect_that, finite_array
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.core.length_words import METRES, LengthUnit
from ccm_opt.io.drawn_obstacles import obstacle_table
from ccm_opt.io.issues import Issues
from ccm_opt.io.option_tables import PlannerTable, VerificationTable
from ccm_opt.io.problem_data import (
    Table,
    arm_table,
    check_curves,
    goal_table,
    limits_table,
    simulation_table,
    workspace_table,
)
from ccm_opt.io.table_reading import check_data
from ccm_opt.problem import (
    Goal,
    JointPose,
    Limits,
    PlannerOptions,
    Problem,
    SimulationOptions,
    TipGoal,
    VerificationOptions,
)
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import Body
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace, edge_parts, named_shapes

_WRITERS: Mapping[type, Callable[[Any, LengthUnit], Table]] = {
    Arm: arm_table,
    Limits: limits_table,
    SimulationOptions: simulation_table,
    PlannerOptions: lambda options, unit: PlannerTable.from_object(options).written(unit),
    VerificationOptions: lambda options, unit: VerificationTable.from_object(options).written(unit),
}
"""Converters of objects to tables of a problem file, by type. Objects of other types fail the checks for files."""


def _workspace(
    room: object, shapes: object, clearance: object, unit: LengthUnit, issues: Issues, bodies: list[Obstacle] | None
) -> Table:
    """Return the table ``[workspace]`` of a problem file, from bounds, obstacles and required clearance.

    Args:
        room: bounds, the outline of the free area, or a workspace object.
        shapes: obstacles as geometries, objects or tables.
        clearance: required clearance; None keeps the clearance of ``room``.
        unit: unit of the lengths in the table.
        issues: receives the defects of the obstacles.
        bodies: receives the obstacles in space that are given as solid objects, which are not converted to tables; None
            in the plane.
    """
    table: Table = {"bounds": room, "obstacles": []}
    if isinstance(room, Workspace):
        table = workspace_table(room, unit)
    elif isinstance(room, shapely.Polygon):
        holes = [PlaneShape(shapely.Polygon(ring)) for ring in room.interiors]
        listed = [obstacle_table(Obstacle(f"hole {k}", hole)) for k, hole in enumerate(holes, start=1)]
        table = {"boundary": shapely.get_coordinates(room.exterior)[:-1], "obstacles": listed}
    inside: Any = table["obstacles"]
    given = Arguments("the obstacles")
    for name, shape in named_shapes(shapes, given, len(inside) + 1):
        try:
            if isinstance(shape, Mapping):
                inside.append({"name": name, **shape})
            elif bodies is None:
                # Obstacle objects are in metres and get converted; bare geometries are in the unit of the call already.
                whole = [obstacle_table(shape, unit)] if isinstance(shape, Obstacle) else None
                inside += whole or map(obstacle_table, edge_parts(name, shape))
            elif isinstance(shape, _BODIES):
                bodies.append(Obstacle(name, shape))
            else:
                raise ProblemError(f"'{name}' is neither a solid nor a table of [[workspace.obstacles]]")  # noqa: TRY301
        except ProblemError as error:
            issues.add(("workspace", "obstacles"), str(error))
    for line in given.wrong:
        issues.add(("workspace", "obstacles"), line)
    return table | ({} if clearance is None else {"clearance": clearance})


def _goal(goal: object) -> object:
    """Return the table ``[goal]`` for a tip position or the name of a pose; any other value is returned unchanged."""
    if _is_place(goal):
        return {"position": goal}
    return {"shape": goal} if isinstance(goal, str) else goal


def _is_place(value: object) -> bool:
    """Return whether a value is a non-empty one-dimensional sequence of numbers, and may thus be a position."""
    if isinstance(value, (Mapping, str)):
        return False
    found = finite_array(value)
    return found is not None and found.ndim == 1 and len(found) > 0


def _plain(value: Any, writers: Mapping[type, Callable[[Any, LengthUnit], Table]], unit: LengthUnit) -> Any:
    """Return a value converted to plain dictionaries, lists, texts and numbers, as a TOML parser would return them.

    Keys whose value is None are left out.

    Args:
        value: the value, which may contain objects and arrays.
        writers: converters of objects to tables, by type.
        unit: unit of the lengths in the converted tables.
    """
    if type(value) in writers:
        return writers[type(value)](value, unit)
    if isinstance(value, Mapping):
        return {str(key): _plain(entry, writers, unit) for key, entry in value.items() if entry is not None}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [_plain(entry, writers, unit) for entry in value]
    return value


Given: TypeAlias = Mapping[str, Any]
"""A table with the keys of a problem file."""
Place: TypeAlias = Sequence[float] | FloatArray
"""A position, shape (2,) in the plane or (3,) in space."""
GoalLike: TypeAlias = Goal | Place | Given


def make_problem(
    name: str,
    *,
    arm: Arm | Given,
    goal: GoalLike | Sequence[GoalLike],
    limits: Limits | Given,
    room: Place | Sequence[Place] | shapely.Polygon | Workspace | None = None,
    obstacles: object = (),
    clearance: float | None = None,
    start: str | JointPose | Given = "straight",
    unit: LengthUnit = "m",
    description: str = "",
    joint_error_deg: float = 0.0,
    planner: PlannerOptions | Given | None = None,
    simulation: SimulationOptions | Given | None = None,
    verification: VerificationOptions | Given | None = None,
    folder: str | Path | None = None,
) -> Problem:
    """Return a planning problem built from Python objects, with the same checks as a problem file.

    Each part is an object, in metres and radians, or a table with the keys of a problem file, in ``unit`` and degrees::

        problem = ccm_opt.make_problem(
            "behind the post",
            unit="mm",
            arm=ccm_opt.Arm.snake(length=600, links=12, radius=20, unit="mm"),
            room=(-200, -400, 800, 400),
            obstacles={"post": shapely.Point(320, 120).buffer(40)},
            clearance=5,
            limits={"velocity": 1.0, "acceleration": 4.0},
            goal={"position": (430, 230), "heading_deg": 60},
        )

    An arm whose ``base`` is a table moves in three dimensions; obstacles are then solids, in metres, or tables::

        problem = ccm_opt.make_problem(
            "beside the post",
            arm={"links": 12, "link_length": 0.05, "radius": 0.02, "joint_limit_deg": 45,
                 "base": {"position": (0, 0, 0)}},
            obstacles={"post": {"cylinder": {"from": (0.3, -0.1, -1), "to": (0.3, -0.1, 1), "radius": 0.04}}},
            limits={"velocity": 1.0, "acceleration": 4.0},
            goal={"position": (0.45, 0.2, 0.1), "direction": (1, 0, 0)},
        )

    Args:
        name: name of the problem and of its output folder.
        arm: an arm, for example from ``Arm.snake``, or a table ``[arm]``.
        goal: a goal object, a tip position, or a table ``[goal]``; a list of goals is reached in sequence.
        limits: joint limits, or a table ``[limits]``.
        room: the workspace's bounds (x low, y low, x high, y high), its outline, whose holes become obstacles, or a
            workspace object; in space the lower and upper corner, shape (2, 3), or None for no bounds.
        obstacles: shapely geometries, see ``obstacles_of``, in space solids, or tables of
            ``[[workspace.obstacles]]``; as a list, or as a mapping from name to obstacle.
        clearance: required distance between the arm's surface and obstacles; None takes the clearance of ``room`` if
            ``room`` is a workspace object, else 0.
        start: "straight", "folded", a pose, or a table ``[start]``.
        unit: unit of all lengths not given in objects, and of lengths in messages: "m", "mm" or "in".
        description: one line for human readers.
        joint_error_deg: deviation of any joint, at any time, under which the motion must remain collision-free [deg].
        planner: planner options, or a table ``[planner]``.
        simulation: simulation options, or a table ``[simulation]``.
        verification: verification options, or a table ``[verification]``.
        folder: folder to which the paths of mesh files are relative; required if an obstacle refers to a mesh file.

    Raises:
        ProblemFileError: the problem has defects; the message lists each under its key in a problem file.
        ProblemError: ``unit`` is not a unit, ``arm`` is not an arm, or two obstacles have the same name.
    """
    expect_that(lambda: unit in METRES, unit, f"one of {', '.join(METRES)} for unit=")
    expect(arm, (Arm, Mapping), "a ccm_opt.Arm or a table for arm=", "ccm_opt.Arm.snake(…) makes one")
    in_space = arm.dimension == 3 if isinstance(arm, Arm) else isinstance(arm.get("base"), Mapping)
    issues = Issues()
    bodies: list[Obstacle] = []
    several = goal if isinstance(goal, (list, tuple)) and not _is_place(goal) else None
    goals = _goal(goal) if several is None else [_goal(each) for each in several]
    data = {
        "schema": 1,
        "space": 3 if in_space else 2,
        "name": name,
        "description": description,
        "units": unit,
        "workspace": _workspace(room, obstacles, clearance, unit, issues, bodies if in_space else None),
        "arm": arm,
        "limits": limits,
        "start": {"shape": start} if isinstance(start, str) else start,
        "goal": goals,
        "planner": planner,
        "simulation": simulation,
        "tolerance": {"joint_error_deg": joint_error_deg},
        "verification": verification,
    }
    fed = arm.feed is not None if isinstance(arm, Arm) else "feed" in arm
    write_goal = partial(goal_table, in_space=in_space, fed=fed)
    writers: Mapping[type, Callable[[Any, LengthUnit], Table]]
    writers = {**_WRITERS, TipGoal: write_goal, JointPose: write_goal}
    problem = check_data(_plain(data, writers, unit), issues, "", None if folder is None else Path(folder))
    if problem is None:
        raise ProblemFileError(f"problem {name!r}", issues.located({}))
    # Parts given as objects replace what was built from their tables, so that no value changes by rounding.
    given = {"arm": arm, "limits": limits, "start": start, "goal": goal}
    objects: dict[str, Any] = {key: part for key, part in given.items() if type(part) in writers}
    if bodies:
        objects["workspace"] = replace(problem.workspace, obstacles=(*problem.workspace.obstacles, *bodies))
    problem = replace(problem, **objects)
    check_curves(problem)
    return problem


_BODIES = get_args(Body)
