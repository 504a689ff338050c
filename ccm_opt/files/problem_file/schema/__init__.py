"""Every key of a problem file and its default, as pydantic models; validated values are in SI units and radians.

Rules between keys are in ``rules``, checks between tables in ``agreement``, checks of places in ``placement``.

Below each key stands what it means; the tables of the pages are made from that by ``docs/write_references.py``.
"""

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from ccm_opt.files.problem_file.schema.arm_keys import ArmTable, ChainTable, FeedTable, InertiaTable
from ccm_opt.files.problem_file.schema.limit_keys import LimitsTable, PointLimitTable
from ccm_opt.files.problem_file.schema.planning_keys import (
    PlannerTable,
    ToleranceTable,
    VerificationTable,
    WeightsTable,
)
from ccm_opt.files.problem_file.schema.pose_keys import GoalTable, PoseTable, SegmentTable, StartTable
from ccm_opt.files.problem_file.schema.room_keys import (
    CircleTable,
    ObstacleTable,
    SceneTable,
    WallTable,
    WorkspaceTable,
)
from ccm_opt.files.problem_file.schema.simulation_keys import DisturbancesTable, GainsTable, SimulationTable
from ccm_opt.files.problem_file.schema.space_keys import (
    BarTable,
    BaseTable,
    PlacementTable,
    SpaceArmTable,
    SpaceGoalTable,
    SpaceObstacleTable,
    SpacePoseTable,
    SpaceStartTable,
    SpaceWorkspaceTable,
    SphereTable,
)
from ccm_opt.files.problem_file.schema.table import Table
from ccm_opt.problem import LengthUnit

__all__ = [
    "ArmTable",
    "BarTable",
    "BaseTable",
    "ChainTable",
    "CircleTable",
    "DisturbancesTable",
    "FeedTable",
    "GainsTable",
    "GoalTable",
    "InertiaTable",
    "LimitsTable",
    "ObstacleTable",
    "PlacementTable",
    "PlannerTable",
    "PointLimitTable",
    "PoseTable",
    "RootTable",
    "SceneTable",
    "SegmentTable",
    "SimulationTable",
    "SpaceArmTable",
    "SpaceGoalTable",
    "SpaceObstacleTable",
    "SpacePoseTable",
    "SpaceStartTable",
    "SpaceWorkspaceTable",
    "SphereTable",
    "StartTable",
    "ToleranceTable",
    "VerificationTable",
    "WallTable",
    "WeightsTable",
    "WorkspaceTable",
]

_FOLDER_NAME = re.compile(r"\w(?:[\w .+-]*[\w+-])?")
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")


def _folder_name(name: str) -> str:
    if not _FOLDER_NAME.fullmatch(name) or _RESERVED.fullmatch(name) or len(name.encode()) > 200:
        raise ValueError(
            "expected a name for a folder: letters, digits, '-', '_', '+', '.' or blanks inside, at most 200 bytes"
        )
    return name


class RootTable(Table):
    """The keys above the first table, and the tables themselves, each validated by itself."""

    schema_version: Literal[1] = Field(alias="schema")
    """Version of the format."""
    space: Literal[2, 3] = 2
    """3 for an arm that [leaves the plane](space.md)."""
    name: Annotated[str, AfterValidator(_folder_name)]
    """Also the name of the output folder: letters, digits, `-`, `_`, `+`, and `.` or blanks inside."""
    description: str = ""
    """One line for people."""
    units: LengthUnit = "m"
    """Unit of all lengths in this file; curvatures are then per that unit."""
    workspace: dict[str, object]
    """[The room](#workspace)."""
    arm: dict[str, object]
    """[The arm](#arm)."""
    limits: dict[str, object]
    """[Its limits](#limits)."""
    start: dict[str, object]
    """[Where the motion begins](#start-and-goal)."""
    goal: dict[str, object] | list[dict[str, object]]
    """[Where it ends](#start-and-goal); several, written `[[goal]]`, in sequence."""
    planner: dict[str, object] = Field(default_factory=dict)
    """[How it is planned](#planner)."""
    simulation: dict[str, object] = Field(default_factory=dict)
    """[How it is simulated](#simulation)."""
    tolerance: dict[str, object] = Field(default_factory=dict)
    """[What it has to survive](#tolerance)."""
    verification: dict[str, object] = Field(default_factory=dict)
    """[How strictly it is judged](#verification)."""
