"""Schema of problem files: tables of the arm in space and its base, and the file as a whole.

The other tables are in ``goal_tables``, ``scene_tables``, ``arm_tables``, ``option_tables`` and ``tool_tables``. Rules
between keys are in ``key_rules``, checks of arms and places in ``arm_rules`` and ``place_rules``, checks between
tables in ``table_reading``.

The description of a field gives the meaning of its key; ``docs/write_references.py`` generates the reference from
these descriptions.
"""

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, SerializationInfo, ValidationInfo, field_serializer, field_validator

from ccm_opt.core.arrays import BoolArray
from ccm_opt.io.arm_tables import ArmTable, ChainTable, arcs_before_bodies
from ccm_opt.io.goal_tables import GoalTable, PoseTable, SpaceGoalTable, SpacePoseTable
from ccm_opt.io.option_tables import LimitsTable, PlannerTable, SimulationTable, ToleranceTable, VerificationTable
from ccm_opt.io.quantities import Degrees, Length, NonNegative, Positive, Rules, Table, exactly, lengths, to_metres
from ccm_opt.io.scene_tables import ObstacleTable, SpaceObstacleTable, SpaceWorkspaceTable, WorkspaceTable
from ccm_opt.io.shape_tables import Direction, SpacePoint
from ccm_opt.io.tool_tables import PlaneLinkBodyTable, PlaneToolTable, SpaceLinkBodyTable, SpaceToolTable
from ccm_opt.problem import LengthUnit
from ccm_opt.robot.base_axes import MOST_AXES


class BaseAxisTable(Table):
    """Table of an axis between the ground and the base of an arm."""

    rules = Rules()

    kind: Literal["prismatic", "revolute"] = Field(description="Kind of the axis.")
    axis: Direction = Field(
        description=(
            "Its direction in the frame of the axis before it. All these frames are parallel to the world's where all "
            "axes are at zero."
        )
    )
    position: SpacePoint | None = Field(
        default=None,
        description=(
            "A point on a revolute axis, where all axes are at zero. Default: the position of the base. Only with "
            '`kind = "revolute"`.'
        ),
    )
    range: Annotated[list[Length], exactly(2)] | None = Field(
        default=None, description="`[lower, upper]` limit of a prismatic axis."
    )
    range_deg: Annotated[list[Degrees], exactly(2)] | None = Field(
        default=None, description="`[lower, upper]` limit of a revolute axis [deg]."
    )
    velocity: Positive = Field(description="Limit on its velocity [length/s, or rad/s].")
    acceleration: Positive = Field(description="Limit on its acceleration [length/s², or rad/s²].")
    force: Positive | None = Field(default=None, description="Force of a prismatic axis [N]. Default: none.")
    torque: Positive | None = Field(default=None, description="Torque of a revolute axis [N m]. Default: none.")
    inertia: NonNegative = Field(
        default=0.0,
        description="What its drive moves beside the arm: mass [kg], or moment of inertia of a revolute axis [kg m²].",
    )

    @field_validator("velocity", "acceleration")
    @classmethod
    def _in_metres(cls, value: float, info: ValidationInfo) -> float:
        return to_metres(value, info) if info.data.get("kind") == "prismatic" else value

    @field_serializer("velocity", "acceleration")
    def _in_unit(self, value: float, info: SerializationInfo) -> Any:
        return lengths(value, info) if self.kind == "prismatic" else value

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper limit of the position [m, rad]; both 0 if not given."""
        low, high = (self.range if self.kind == "prismatic" else self.range_deg) or (0.0, 0.0)
        return low, high


class BaseTable(Table):
    """Table of the position and orientation of the base of an arm in space."""

    position: SpacePoint = Field(
        description="Position of the first joint; it may touch a wall, but not lie inside one."
    )
    direction: Direction = Field(
        default=[1.0, 0.0, 0.0], description="Direction of the straight arm; a vector of any length but zero."
    )
    up: Direction = Field(
        default=[0.0, 0.0, 1.0],
        description=(
            "Axis about which the first bend of a joint turns while the arm is straight; its component along "
            "`direction` is ignored. Required if `direction` is along z."
        ),
    )
    axes: Annotated[list[BaseAxisTable], Field(min_length=1, max_length=MOST_AXES)] | None = Field(
        default=None,
        description=(
            f"`[[arm.base.axes]]`: up to {MOST_AXES} axes between the ground and the arm, from the ground; `position`, "
            "`direction` and `up` are then those where all axes are at zero. Not with `arm.feed`, which is the short "
            "form of one along `direction`. Default: none."
        ),
    )


_BODIES = "`[[arm.bodies]]`: rigid bodies on links ([what they are](problem-file.md#tools-and-bodies-on-links))."
_TOOL = Field(
    default=None,
    description=(
        "Rigid tool on the last link ([what it is](problem-file.md#tools-and-bodies-on-links)). Default: none; goals "
        "are for the end of the link."
    ),
)


class PlaneArmTable(ArmTable):
    """Table of a planar arm, with its tool and other bodies."""

    bodies: list[PlaneLinkBodyTable] = Field(default=[], description=_BODIES)
    tool: PlaneToolTable | None = _TOOL


class SpaceArmTable(ChainTable):
    """Table of an arm that moves in three dimensions."""

    base: BaseTable = Field(description="`{ position = [x, y, z], direction = [x, y, z], up = [x, y, z] }`.")
    axes: Literal["zyx"] = Field(default="zyx", description="Order of a ball joint's revolutes; the third stays at 0.")
    bodies: list[SpaceLinkBodyTable] = Field(default=[], description=_BODIES)
    tool: SpaceToolTable | None = _TOOL
    coupling: Annotated[list[Annotated[list[float], Field(min_length=1)]], Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Drives that move several joints ([how](arms.md#joints-that-share-a-drive)): a row for each bend, two a "
            "joint in the order of `joints_deg`, and a column for each drive, with the bend's change for a unit of the "
            "drive; no more than one number other than 0 a row. A bend whose row is 0 is locked. Default: each bend "
            "has its own drive."
        ),
    )

    @property
    def straight_joints(self) -> tuple[int, ...]:
        """Indices of the joints of sections that bend evenly at which bodies sit, and which therefore do not bend."""
        places = [(each.section - 1, each.at) for each in self.bodies if each.section is not None]
        before = arcs_before_bodies(places, [each.links for each in self.sections or ()])
        return tuple(arcs + 1 + k for k, arcs in enumerate(before))

    @property
    def moved(self) -> BoolArray | None:
        """Mask of the bends that drives of ``coupling`` move, shape (links, 2); None without a valid one."""
        if self.coupling is None or [len(row) for row in self.coupling] != 2 * self.links * [len(self.coupling[0])]:
            return None
        return np.asarray(np.any(np.array(self.coupling), axis=1).reshape(-1, 2), dtype=np.bool_)


OPTIONAL: Mapping[str, type[Table]] = {
    "planner": PlannerTable,
    "simulation": SimulationTable,
    "tolerance": ToleranceTable,
    "verification": VerificationTable,
}
"""Schemas of the optional tables of a problem file, by name."""
TABLES: Mapping[bool, Mapping[str, type[Table]]] = {
    False: {
        "workspace": WorkspaceTable,
        "workspace.obstacles": ObstacleTable,
        "arm": PlaneArmTable,
        "limits": LimitsTable,
        "start": PoseTable,
        "goal": GoalTable,
        **OPTIONAL,
    },
    True: {
        "workspace": SpaceWorkspaceTable,
        "workspace.obstacles": SpaceObstacleTable,
        "arm": SpaceArmTable,
        "limits": LimitsTable,
        "start": SpacePoseTable,
        "goal": SpaceGoalTable,
        **OPTIONAL,
    },
}
"""Schemas of the tables of a problem file, by name; planar arms under False, arms in space under True."""

_FOLDER_NAME = re.compile(r"\w(?:[\w .+-]*[\w+-])?")
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


def _folder_name(name: str) -> str:
    if not _FOLDER_NAME.fullmatch(name) or _RESERVED.fullmatch(name) or len(name.encode()) > 200:
        raise ValueError(
            "expected a name that can be a folder's: letters, digits, '-', '_', '+', and '.' or spaces inside, "
            "at most 200 bytes"
        )
    return name


class RootTable(Table):
    """Schema of a whole problem file: the keys above the first table, and the tables, each validated separately."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of the format.")
    space: Literal[2, 3] = Field(
        default=2,
        description="Dimension: 2 for an arm in the plane, 3 for an [arm in space](problem-file.md#arms-in-space).",
    )
    name: Annotated[str, AfterValidator(_folder_name)] = Field(
        description=(
            "Name of the problem and of its output folder: letters, digits, `-`, `_`, `+`, and `.` or spaces inside."
        )
    )
    description: str = Field(default="", description="One line about the problem, shown in lists.")
    units: LengthUnit = Field(
        default="m", description="Unit of all lengths in this file; curvatures are in its inverse."
    )
    workspace: dict[str, object] = Field(description="[Bounds and obstacles](#workspace).")
    arm: dict[str, object] = Field(description="[The arm](#arm).")
    limits: dict[str, object] = Field(description="[Limits of joints, feed and points](#limits).")
    start: dict[str, object] = Field(description="[Start pose](#start-and-goal).")
    goal: dict[str, object] | list[dict[str, object]] = Field(
        description="[Goal](#start-and-goal); several, written `[[goal]]`, are reached in sequence."
    )
    planner: dict[str, object] = Field(default_factory=dict, description="[Planner options](#planner).")
    simulation: dict[str, object] = Field(default_factory=dict, description="[Simulation options](#simulation).")
    tolerance: dict[str, object] = Field(
        default_factory=dict, description="[Errors that the motion must tolerate](#tolerance)."
    )
    verification: dict[str, object] = Field(
        default_factory=dict, description="[How strictly the plan is verified](#verification)."
    )
