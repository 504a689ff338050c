"""Problems made in Python, part by part.

Every part becomes the table of a problem file that says the same, in the unit of the call; the tables are checked as
those of a file are. So whatever is wrong is told at once, under the key that the part would have in a file.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, get_args

import numpy as np
import shapely

from ccm_opt.core.arguments import Arguments, expect, expect_that, finite_array
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.core.length_words import METRES, LengthUnit
from ccm_opt.io.build import build_arm
from ccm_opt.io.drawing import obstacle_table
from ccm_opt.io.issues import Issues
from ccm_opt.io.problem_data import (
    Table,
    arm_table,
    goal_table,
    limits_table,
    obstacle_in_unit,
    planner_table,
    simulation_table,
    verification_table,
    workspace_table,
)
from ccm_opt.io.schema import SpaceArmTable
from ccm_opt.io.schema_tables import ArmTable
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
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace, named_shapes, parts_of

Part = TypeVar("Part")


@dataclass(frozen=True)
class PartTables:
    """Makes tables of parts; a value that is no such part stays as it is, for the rules of files to refuse.

    Attributes:
        unit: in which lengths are given and written.
        issues: receives what is wrong with a part that has no table.
        in_space: whether obstacles are bodies.
        bodies: receives obstacles in space that were given as bodies, and stay themselves.
    """

    unit: LengthUnit
    issues: Issues
    in_space: bool = False
    bodies: list[Obstacle] = field(default_factory=list)

    def table(self, given: object, kind: type[Part], made: Callable[[Part, LengthUnit], Table]) -> object:
        """The table of an object of a kind."""
        return made(given, self.unit) if isinstance(given, kind) else given

    def workspace(self, room: object, obstacles: object, clearance: object) -> Table:
        """``[workspace]`` from the room, what is in it, and the gap to keep."""
        table: Table = {}
        inside: list[object] = []
        if isinstance(room, Workspace):
            # Its obstacles are tables already; so are the holes of its outline, below.
            table = dict(workspace_table(room, self.unit))
            inside = list(table["obstacles"])  # type: ignore[call-overload]
        elif isinstance(room, shapely.Polygon):
            table["boundary"] = shapely.get_coordinates(room.exterior)[:-1]
            holes = [
                Obstacle(f"hole {k}", PlaneShape(shapely.Polygon(ring)))
                for k, ring in enumerate(room.interiors, start=1)
            ]
            inside = [obstacle_table(hole) for hole in holes]
        else:
            table["bounds"] = room
        if clearance is not None:
            table["clearance"] = clearance
        return table | {"obstacles": inside + self._obstacles(obstacles, len(inside) + 1)}

    def _obstacles(self, shapes: object, first: int) -> list[object]:
        """``[[workspace.obstacles]]`` from geometries, obstacles and tables."""
        given = Arguments("the obstacles")
        entries: list[object] = []
        for name, shape in named_shapes(shapes, given, first):
            try:
                entries += self._entries(name, shape)
            except ProblemError as error:
                self.issues.add(("workspace", "obstacles"), str(error))
        for line in given.wrong:
            self.issues.add(("workspace", "obstacles"), line)
        return entries

    def _entries(self, name: str, shape: object) -> list[object]:
        if self.in_space and not isinstance(shape, Mapping):
            if not isinstance(shape, _BODIES):
                raise ProblemError(f"'{name}' is neither a body nor a table of [[workspace.obstacles]]")
            self.bodies.append(Obstacle(name, shape))
            return []
        if isinstance(shape, Obstacle):
            return [obstacle_in_unit(shape, self.unit)]
        if isinstance(shape, Mapping):
            return [{"name": name, **shape}]
        return [obstacle_table(part) for part in parts_of(name, shape)]

    def start(self, start: object, arm: object) -> object:
        """``[start]`` from the name of a pose, or a pose."""
        if isinstance(start, str):
            return {"shape": start}
        return self._pose(start, arm)

    def goals(self, goal: object, arm: object) -> object:
        """``[goal]``, or each ``[[goal]]``, from goals and places."""
        several = isinstance(goal, (list, tuple)) and not _is_place(goal)
        return [self._goal(each, arm) for each in goal] if several else self._goal(goal, arm)  # type: ignore[attr-defined]

    def _goal(self, goal: object, arm: object) -> object:
        if _is_place(goal):
            return {"position": goal}
        if isinstance(goal, str):
            return {"shape": goal}
        return self._pose(goal, arm)

    def _pose(self, pose: object, arm: object) -> object:
        if not isinstance(pose, (TipGoal, JointPose)):
            return pose
        built = arm if isinstance(arm, Arm) else self._built(arm)
        # An arm that cannot be built has defects of its own, which are told; the pose is told of when it has none.
        return {"shape": "straight"} if built is None else goal_table(pose, built, self.unit)

    def _built(self, arm: object) -> Arm | None:
        """The arm of a table, or None where it has defects."""
        probe = Issues()
        model: type[ArmTable | SpaceArmTable] = SpaceArmTable if self.in_space else ArmTable
        table = probe.validate(model, plain(arm), ("arm",), METRES[self.unit])
        return build_arm(table) if table is not None and not probe.found else None


def _is_place(value: object) -> bool:
    """Whether a value is a row of numbers."""
    if isinstance(value, (Mapping, str)):
        return False
    found = finite_array(value)
    return found is not None and found.ndim == 1 and len(found) > 0


def plain(value: Any) -> Any:
    """Tables, lists, texts and numbers of Python, as a reader of TOML makes them; keys without a value are left out."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items() if entry is not None}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [plain(entry) for entry in value]
    return value


Given: TypeAlias = Mapping[str, Any]
"""A table as in a problem file."""
Place: TypeAlias = Sequence[float] | FloatArray
"""A place (x, y), or (x, y, z) in space."""
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

    An arm whose ``base`` is a table leaves the plane, and its obstacles are bodies, which are in metres, or tables::

        problem = ccm_opt.make_problem(
            "beside the post",
            arm={"links": 12, "link_length": 0.05, "radius": 0.02, "joint_limit_deg": 45,
                 "base": {"position": (0, 0, 0)}},
            obstacles={"post": {"cylinder": {"from": (0.3, -0.1, -1), "to": (0.3, -0.1, 1), "radius": 0.04}}},
            limits={"velocity": 1.0, "acceleration": 4.0},
            goal={"position": (0.45, 0.2, 0.1), "direction": (1, 0, 0)},
        )

    Args:
        name: also names the output folder.
        arm: as ``Arm.snake`` makes one, or ``[arm]``.
        goal: a goal as an object, a place for the tip, or ``[goal]``; several of them are reached in sequence.
        limits: of the joints, or ``[limits]``.
        room: (x low, y low, x high, y high), or its outline, whose holes are obstacles, or a whole workspace; in space
            its lower and upper corner, shape (2, 3), or None for no room.
        obstacles: shapely's geometries, see ``obstacles_of``, in space bodies, or tables of
            ``[[workspace.obstacles]]``; a list, or names with them.
        clearance: least gap between the arm's surface and walls; none when None, or that of the workspace.
        start: "straight", "folded", a pose, or ``[start]``.
        unit: of all lengths that are no objects: "m", "mm" or "in". People are told lengths in it, too.
        description: one line for people.
        joint_error_deg: of every joint at any time, with which the motion has to touch nothing [deg].
        planner: options, or ``[planner]``.
        simulation: options, or ``[simulation]``.
        verification: options, or ``[verification]``.
        folder: where the paths of meshes begin; needed where an obstacle names a mesh.

    Raises:
        ProblemFileError: with every defect, under the key that it has in a problem file.
        ProblemError: the unit or the arm is none at all, or a body shares the name of another obstacle.
    """
    expect_that(lambda: unit in METRES, unit, f"one of {', '.join(METRES)} for unit=")
    expect(arm, (Arm, Mapping), "a ccm_opt.Arm or a table for arm=", "ccm_opt.Arm.snake(…) makes one")
    in_space = arm.dimension == 3 if isinstance(arm, Arm) else isinstance(arm.get("base"), Mapping)
    issues = Issues()
    parts = PartTables(unit, issues, in_space)
    data = {
        "schema": 1,
        "space": 3 if in_space else 2,
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
    problem = check_data(plain(data), issues, "", None if folder is None else Path(folder))
    if problem is None:
        raise ProblemFileError(f"problem {name!r}", issues.located({}))
    # What was given as an object stays that object, to the last bit.
    given = {"arm": arm, "limits": limits, "start": start, "goal": goal}
    objects: dict[str, Any] = {key: part for key, part in given.items() if isinstance(part, _OBJECTS)}
    if parts.bodies:
        objects["workspace"] = replace(problem.workspace, obstacles=(*problem.workspace.obstacles, *parts.bodies))
    return replace(problem, **objects)


_OBJECTS = (Arm, Limits, TipGoal, JointPose)
_BODIES = get_args(Body)
