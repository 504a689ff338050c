"""Problems made in Python: parts of every kind, held against the same rules as a file, with the same list of defects.

Every part becomes the table of a problem file that says the same, in the unit of the call; the tables are checked as
those of a file are. So whatever is wrong is told at once, under the key that the part would have in a file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import shapely

from ccm_opt.errors import ProblemFileError
from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.part_tables import PartTables, plain
from ccm_opt.files.problem_file.problem_data import (
    arm_table,
    limits_table,
    planner_table,
    simulation_table,
    verification_table,
)
from ccm_opt.files.problem_file.table_reading import check_data
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.expected import expect, expect_that
from ccm_opt.ground.length_units import METRES, LengthUnit
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import (
    CurvePose,
    Goal,
    JointPose,
    Limits,
    PlannerOptions,
    Problem,
    SimulationOptions,
    Start,
    TipGoal,
    VerificationOptions,
)

Given: TypeAlias = Mapping[str, Any]
"""A table as in a problem file."""
Place: TypeAlias = Sequence[float] | FloatArray
"""A place (x, y)."""
GoalLike: TypeAlias = Goal | Place | Given


def make_problem(
    name: str,
    *,
    arm: Arm | Given,
    room: Place | shapely.Polygon | Workspace,
    goal: GoalLike | Sequence[GoalLike],
    limits: Limits | Given,
    obstacles: object = (),
    clearance: float | None = None,
    start: str | Start | Given = "straight",
    unit: LengthUnit = "m",
    description: str = "",
    joint_error_deg: float = 0.0,
    planner: PlannerOptions | Given | None = None,
    simulation: SimulationOptions | Given | None = None,
    verification: VerificationOptions | Given | None = None,
) -> Problem:
    """Make a problem in Python, checked as closely as one from a file.

    Parts are objects, which are in metres and radians, or tables with the keys of a problem file, in ``unit`` and
    degrees::

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

    Args:
        name: also names the output folder.
        arm: as ``Arm.snake`` makes one, or ``[arm]``.
        room: (x low, y low, x high, y high), or its outline, whose holes are obstacles, or a whole workspace.
        goal: a goal as an object, a place (x, y) for the tip, or ``[goal]``; several of them are reached in sequence.
        limits: of the joints, or ``[limits]``.
        obstacles: shapely's geometries, see ``obstacles_of``, or tables of ``[[workspace.obstacles]]``; a list, or
            names with them.
        clearance: least gap between the arm's surface and walls; none when None, or that of the workspace.
        start: "straight", "folded", a pose, or ``[start]``.
        unit: of all lengths that are no objects: "m", "mm" or "in". People are told lengths in it, too.
        description: one line for people.
        joint_error_deg: of every joint at any time, with which the motion has to touch nothing [deg].
        planner: options, or ``[planner]``.
        simulation: options, or ``[simulation]``.
        verification: options, or ``[verification]``.

    Raises:
        ProblemFileError: with every defect, under the key that it has in a problem file.
        ProblemError: the unit or the arm is none at all.
    """
    expect_that(lambda: unit in METRES, unit, f"one of {', '.join(METRES)} for unit=")
    expect(arm, (Arm, Mapping), "a ccm_opt.Arm or a table for arm=", "ccm_opt.Arm.snake(…) makes one")
    issues = Issues()
    parts = PartTables(unit, issues)
    data = {
        "schema": 1,
        "name": name,
        "description": description,
        "units": unit,
        "workspace": parts.workspace(room, obstacles, clearance),
        "arm": parts.table(arm, Arm, arm_table),
        "limits": parts.table(limits, Limits, limits_table),
        "start": parts.start(start, arm),
        "goal": parts.goals(goal, arm),
        "planner": parts.table(planner, PlannerOptions, planner_table),
        "simulation": parts.table(simulation, SimulationOptions, lambda options, _: simulation_table(options)),
        "tolerance": {"joint_error_deg": joint_error_deg},
        "verification": parts.table(verification, VerificationOptions, verification_table),
    }
    problem = check_data(plain(data), issues, "")
    if problem is None:
        raise ProblemFileError(f"problem {name!r}", issues.located({}))
    # What was given as an object stays that object, to the last bit.
    given = {"arm": arm, "limits": limits, "start": start, "goal": goal}
    objects: dict[str, Any] = {key: part for key, part in given.items() if isinstance(part, _OBJECTS)}
    return replace(problem, **objects)


_OBJECTS = (Arm, Limits, TipGoal, JointPose, CurvePose)
