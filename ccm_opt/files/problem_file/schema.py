"""Every key of a problem file and its default, as pydantic models; validated values are in SI units and radians.

Rules between keys are in ``rules``, checks between tables in ``agreement``, checks of places in ``placement``.
"""

import math
import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
import shapely
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from ccm_opt.files.problem_file.typed_quantities import (
    LARGEST,
    BendLimitDegrees,
    Box,
    Curvature,
    Degrees,
    Length,
    NonNegative,
    NonNegativeEach,
    NonNegativeLength,
    Point,
    Polyline,
    Positive,
    PositiveDegrees,
    PositiveEach,
    PositiveLength,
    Ring,
    Vector,
    exactly,
)
from ccm_opt.jointed.arm import Arm, Axes, MappingName
from ccm_opt.problem import (
    ControllerName,
    Disturbances,
    LengthUnit,
    MethodName,
    OptimiserName,
    PlannerOptions,
    RetimingName,
    SimulationOptions,
    Tolerances,
    VerificationOptions,
    Weights,
)

CLOSEST_KNOTS = 1e-6
"""Of a segment, as a share of it; a spline through closer ones swings wildly."""
MAX_LINKS = 400
"""Far more than any arm that has been planned for; planning for more would take hours."""


class Table(BaseModel):
    """A table: unknown keys, guessed types, and numbers that are not finite or beyond all measure are errors."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)

    @field_validator("*")
    @classmethod
    def _of_some_measure(cls, value: Any) -> Any:
        if any(abs(number) > LARGEST for number in _floats(value)):
            raise ValueError(f"expected at most {LARGEST:g} in size")
        return value


def _floats(value: object) -> Iterator[float]:
    """All floats of a value and of the lists in it."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _floats(part)


class CircleTable(Table):
    """A disc."""

    center: Point
    radius: PositiveLength


class WallTable(Table):
    """A polyline swept by a disc of half its thickness."""

    points: Polyline
    thickness: NonNegativeLength = 0.0


class ObstacleTable(Table):
    """One obstacle: exactly one of polygon, box, circle, wall; a polygon may have holes."""

    name: Annotated[str, Field(min_length=1)] | None = None
    polygon: Ring | None = None
    holes: Annotated[list[Ring], Field(min_length=1)] | None = None
    box: Box | None = None
    circle: CircleTable | None = None
    wall: WallTable | None = None

    @field_validator("holes")
    @classmethod
    def _inside(cls, holes: list[list[list[float]]] | None, info: ValidationInfo) -> list[list[list[float]]] | None:
        outline = info.data.get("polygon", ())
        if holes is not None and outline is None:
            raise ValueError("only allowed together with polygon")
        if holes is not None and outline and not shapely.Polygon(outline, holes).is_valid:
            raise ValueError("expected holes inside the polygon and apart from each other")
        return holes


class SceneTable(Table):
    """A drawing of obstacles, and how it is placed; lengths stay in the problem file's unit."""

    file: Annotated[str, Field(min_length=1)] | None = None
    scale: Positive = 1.0
    offset: Point = Field(default=[0.0, 0.0])
    curve_tolerance: PositiveLength | None = None
    wall_thickness: NonNegativeLength = 0.0


class WorkspaceTable(SceneTable):
    """The room, without its obstacles: those are validated one by one."""

    bounds: Box | None = None
    boundary: Ring | None = None
    clearance: NonNegativeLength = 0.0


class InertiaTable(Table):
    """Moments of inertia of the links about their centres [kg m²], one for all links or one each."""

    axial: PositiveEach
    transverse: PositiveEach


def _even(links: int) -> int:
    if links % 2:
        raise ValueError(f"expected an even number of links; try {links - 1 or 2} or {links + 1}")
    return links


class FeedTable(Table):
    """A linear axis that carries the base along the base heading."""

    range: Annotated[list[Length], exactly(2)]
    hole: Length | None = None

    @field_validator("range")
    @classmethod
    def _ordered(cls, ends: list[float]) -> list[float]:
        if not ends[0] < ends[1]:
            raise ValueError("expected [least, greatest] with least < greatest")
        return ends


class ArmTable(Table):
    """The arm."""

    links: Annotated[int, Field(ge=2, le=MAX_LINKS), AfterValidator(_even)]
    link_length: PositiveLength
    radius: NonNegativeLength
    base: Point
    base_heading_deg: Degrees = 0.0
    joint_limit_deg: BendLimitDegrees
    base_limit_deg: PositiveDegrees = 2.0 * math.pi
    self_collision: bool = True
    mount_length: NonNegativeLength | None = None
    link_mass: Positive | None = None
    masses: Annotated[list[Positive], Field(min_length=1)] | None = None
    inertia: InertiaTable | None = None
    axes: Axes = Arm.axes
    payload: NonNegative = 0.0
    rotor_inertia: NonNegativeEach = 0.0
    friction: NonNegativeEach = 0.0
    feed: FeedTable | None = None


class PointLimitTable(Table):
    """Bounds on the speed and the acceleration of a point of the arm."""

    at: NonNegativeLength
    velocity: Positive | None = None
    acceleration: Positive | None = None


class LimitsTable(Table):
    """Joint limits, each one number, one a ball joint, or one a revolute; limits of the feed axis, and of points."""

    velocity: PositiveEach
    acceleration: PositiveEach
    jerk: PositiveEach | None = None
    torque: PositiveEach | None = None
    feed_velocity: Positive | None = None
    feed_acceleration: Positive | None = None
    feed_jerk: Positive | None = None
    feed_force: Positive | None = None
    tip_velocity: Positive | None = None
    tip_acceleration: Positive | None = None
    points: list[PointLimitTable] = Field(default=[])


class SegmentTable(Table):
    """One curvature segment: a length, five curvature values, three knots."""

    length: PositiveLength
    curvature: Annotated[list[Curvature], exactly(5)]
    knots: Annotated[list[float], exactly(3)] = Field(default=[0.25, 0.5, 0.75])

    @field_validator("knots")
    @classmethod
    def _increasing(cls, knots: list[float]) -> list[float]:
        if np.min(np.diff([0.0, *knots, 1.0])) < CLOSEST_KNOTS:
            raise ValueError(f"expected three increasing numbers between 0 and 1, {CLOSEST_KNOTS:g} apart")
        return knots


class PoseTable(Table):
    """A whole-arm pose, one of shape, joints_deg, segments."""

    shape: Literal["straight", "folded"] | None = None
    joints_deg: Annotated[list[Degrees], Field(min_length=1)] | None = None
    segments: Annotated[list[SegmentTable], Field(min_length=1)] | None = None
    heading_deg: Degrees | None = None
    feed: Length | None = None


class StartTable(PoseTable):
    """Where the motion begins."""


class GoalTable(PoseTable):
    """Where the motion ends: a pose, or a position of the tip."""

    position: Point | None = None
    position_tolerance: PositiveLength = Tolerances.position
    heading_tolerance_deg: PositiveDegrees = Tolerances.heading
    pause: Annotated[float, Field(ge=0.0)] = 0.0


Weight = Annotated[float, Field(ge=0.0)]


class WeightsTable(Table):
    """How much each thing counts that planning makes small."""

    path_length: Weight = Weights.path_length
    smoothness: Weight = Weights.smoothness
    bending: Weight = Weights.bending
    clearance: Weight = Weights.clearance
    duration: Weight = Weights.duration


class PlannerTable(Table):
    """Which planner, how long, and with what."""

    method: MethodName = PlannerOptions.method
    mapping: MappingName = PlannerOptions.mapping
    time_limit: Positive = PlannerOptions.time_limit
    routes: Annotated[int, Field(ge=1)] = PlannerOptions.routes
    seed: Annotated[int, Field(ge=0)] = PlannerOptions.seed
    tries: Annotated[int, Field(ge=1)] = PlannerOptions.tries
    optimiser: OptimiserName = PlannerOptions.optimiser
    retiming: RetimingName = PlannerOptions.retiming
    wanted_gap: NonNegativeLength | None = PlannerOptions.wanted_gap
    effort_share: Annotated[float, Field(gt=0.0, le=1.0)] = PlannerOptions.effort_share
    weights: WeightsTable = WeightsTable()


class GainsTable(Table):
    """Gains of the PD law for every joint: proportional [N m/rad], derivative [N m s/rad]; else they suit the arm."""

    proportional: Positive | None = None
    derivative: Positive | None = None


class DisturbancesTable(Table):
    """What the simulated arm does otherwise than its controller believes."""

    mass_error: Annotated[float, Field(gt=-1.0)] = Disturbances.mass_error
    payload: NonNegative = Disturbances.payload
    friction: NonNegative = Disturbances.friction
    angle_noise_deg: Annotated[float, Field(ge=0.0), AfterValidator(math.radians)] = Disturbances.angle_noise
    velocity_noise: NonNegative = Disturbances.velocity_noise
    start_delay: NonNegative = Disturbances.start_delay
    seed: Annotated[int, Field(ge=0)] = Disturbances.seed


class SimulationTable(Table):
    """How the timed motion is simulated."""

    gravity: Vector = Field(default_factory=SimulationOptions().gravity.tolist)
    step: Positive = SimulationOptions.step
    controller: ControllerName = SimulationOptions.controller
    bandwidth: Positive = SimulationOptions.bandwidth
    gains: GainsTable = GainsTable()
    disturbances: DisturbancesTable = DisturbancesTable()


class ToleranceTable(Table):
    """Errors with which the motion has to touch nothing."""

    joint_error_deg: Annotated[float, Field(ge=0.0, lt=180.0), AfterValidator(math.radians)] = 0.0


class VerificationTable(Table):
    """How strictly plans are judged."""

    contact_tolerance: PositiveLength | None = VerificationOptions.contact_tolerance


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
    name: Annotated[str, AfterValidator(_folder_name)]
    description: str = ""
    units: LengthUnit = "m"
    workspace: dict[str, object]
    arm: dict[str, object]
    limits: dict[str, object]
    start: dict[str, object]
    goal: dict[str, object] | list[dict[str, object]]
    planner: dict[str, object] = Field(default_factory=dict)
    simulation: dict[str, object] = Field(default_factory=dict)
    tolerance: dict[str, object] = Field(default_factory=dict)
    verification: dict[str, object] = Field(default_factory=dict)
