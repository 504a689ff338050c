"""Problems in space made in Python, held against the same rules as a file, with the same list of defects."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, get_args

from ccm_opt.errors import ProblemError, ProblemFileError
from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.part_tables import plain
from ccm_opt.files.problem_file.space_reading import check_space_data
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.expected import expect, expect_that
from ccm_opt.ground.length_units import METRES, LengthUnit
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.bodies import Body
from ccm_opt.space.scene.scene import SpaceObstacle

SpaceTable: TypeAlias = Mapping[str, Any]
"""A table as in a problem file with ``space = 3``."""
_BODIES = get_args(Body)


def make_space_problem(
    name: str,
    *,
    arm: SpaceTable,
    goal: SpaceTable | Sequence[float] | FloatArray | Sequence[SpaceTable],
    limits: SpaceTable,
    obstacles: Mapping[str, SpaceTable | Body] | None = None,
    room: Sequence[Sequence[float]] | FloatArray | None = None,
    clearance: float = 0.0,
    start: str | SpaceTable = "straight",
    unit: LengthUnit = "m",
    folder: str | Path | None = None,
    **tables: object,
) -> SpaceProblem:
    """Make a problem of an arm in space in Python, checked as closely as one from a file.

    Parts are tables with the keys of a problem file, in ``unit`` and degrees. Obstacles may be bodies too, in metres::

        problem = ccm_opt.make_space_problem(
            "beside the post",
            arm={"links": 12, "link_length": 0.05, "radius": 0.02, "joint_limit_deg": 45,
                 "base": {"position": (0, 0, 0)}},
            obstacles={"post": {"cylinder": {"from": (0.3, 0, -1), "to": (0.3, 0, 1), "radius": 0.04}}},
            limits={"velocity": 1.0, "acceleration": 4.0},
            goal={"position": (0.45, 0.2, 0.1), "direction": (1, 0, 0)},
        )

    Args:
        name: also names the output folder.
        arm: ``[arm]``.
        goal: ``[goal]``, or the place (x, y, z) of the tip, or several tables that are reached in sequence.
        limits: ``[limits]``.
        obstacles: by name, bodies or tables of ``[[workspace.obstacles]]``.
        room: its lower and upper corner, shape (2, 3); None where there is no room.
        clearance: least gap between the arm's surface and walls.
        start: "straight", or ``[start]``.
        unit: of all lengths that are no bodies: "m", "mm" or "in". People are told lengths in it, too.
        folder: where the paths of meshes begin; needed where an obstacle names a mesh.
        tables: the other tables of a problem file: ``planner``, ``simulation``, ``tolerance``, ``verification``; and
            ``description``.

    Raises:
        ProblemFileError: with every defect, under the key that it has in a problem file.
        ProblemError: the unit or the obstacles are none at all, or a mesh that is a body shares its name.
    """
    expect_that(lambda: unit in METRES, unit, f"one of {', '.join(METRES)} for unit=")
    given = {} if obstacles is None else obstacles
    expect(given, Mapping, "names with bodies or tables for obstacles=")
    bodies = tuple(SpaceObstacle(str(key), body) for key, body in given.items() if isinstance(body, _BODIES))
    entries = [{"name": str(key), **plain(table)} for key, table in given.items() if isinstance(table, Mapping)]
    wrong = [key for key, each in given.items() if not isinstance(each, (Mapping, *_BODIES))]
    if wrong:
        raise ProblemError(f"obstacles: '{wrong[0]}' is neither a body nor a table of [[workspace.obstacles]]")
    workspace: dict[str, object] = {"clearance": clearance, "obstacles": entries} | (
        {} if room is None else {"bounds": room}
    )
    data = {
        "schema": 1,
        "space": 3,
        "name": name,
        "units": unit,
        "workspace": workspace,
        "arm": arm,
        "limits": limits,
        "start": {"shape": start} if isinstance(start, str) else start,
        "goal": _goal(goal),
        **tables,
    }
    issues = Issues()
    problem = check_space_data(plain(data), issues, "", None if folder is None else Path(folder))
    if problem is None:
        raise ProblemFileError(f"problem {name!r}", issues.located({}))
    whole = replace(problem.workspace, obstacles=(*problem.workspace.obstacles, *bodies))
    return replace(problem, workspace=whole)


def _goal(goal: object) -> object:
    """``[goal]``, or each ``[[goal]]``, from tables and places."""
    if isinstance(goal, Mapping):
        return goal
    found = plain(goal)
    tables = isinstance(found, list) and bool(found) and all(isinstance(each, Mapping) for each in found)
    return found if tables else {"position": found}
