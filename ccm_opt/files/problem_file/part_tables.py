"""Parts of a problem, objects or plain values, as the tables of a problem file that say the same."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import shapely

from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file.build import build_arm
from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.problem_data import (
    Table,
    goal_table,
    obstacle_in_unit,
    workspace_table,
)
from ccm_opt.files.problem_file.scene_file import obstacle_table
from ccm_opt.files.problem_file.schema import ArmTable
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.shaped_obstacles import named_shapes, parts_of
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arguments import Arguments, finite_array
from ccm_opt.ground.length_units import METRES, LengthUnit
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import CurvePose, JointPose, TipGoal

Part = TypeVar("Part")


@dataclass(frozen=True)
class PartTables:
    """Makes tables of parts; a value that is no such part stays as it is, for the rules of files to refuse.

    Attributes:
        unit: in which lengths are given and written.
        issues: receives what is wrong with a part that has no table.
    """

    unit: LengthUnit
    issues: Issues

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
            holes = [Obstacle(f"hole {k}", shapely.Polygon(ring)) for k, ring in enumerate(room.interiors, start=1)]
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
        if not isinstance(pose, (TipGoal, JointPose, CurvePose)):
            return pose
        built = arm if isinstance(arm, Arm) else self._built(arm)
        # An arm that cannot be built has defects of its own, which are told; the pose is told of when it has none.
        return {"shape": "straight"} if built is None else goal_table(pose, built, self.unit)

    def _built(self, arm: object) -> Arm | None:
        """The arm of a table, or None where it has defects."""
        probe = Issues()
        table = probe.validate(ArmTable, plain(arm), ("arm",), METRES[self.unit])
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
