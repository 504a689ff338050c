"""Types of the quantities in a problem file, and the tables common to arms in the plane and in space.

The types convert between the units of a file and SI units: on validation lengths are multiplied by ``scale`` of the
context, the metres per unit of the file; on serialisation they are written in the ``unit`` of the context. The
description of a type, used by the documentation, says which values are valid.
"""

import math
import re
import sys
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeAlias, TypeGuard

import numpy as np
import numpy.typing as npt
import shapely
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    SerializationInfo,
    ValidationInfo,
    field_validator,
)

from ccm_opt.core.length_words import METRES, LengthUnit, in_unit
from ccm_opt.io.issues import described, table_models
from ccm_opt.problem import (
    ControllerName,
    Disturbances,
    MethodName,
    OptimiserName,
    PlannerOptions,
    RetimingName,
    SimulationOptions,
    VerificationOptions,
    Weights,
)
from ccm_opt.robot.arm import Arm, Axes, MappingName

MAX_LENGTH = 1e9
"""Largest coordinate [m]; beyond it double precision no longer resolves a micrometre."""

LARGEST = 1e12
"""Largest number of any kind; no length, angle or limit of an arm comes near it, and the squares of far larger numbers
overflow."""


def _scale(info: ValidationInfo) -> float:
    return float((info.context or {}).get("scale", 1.0))


def _to_metres(value: float, info: ValidationInfo) -> float:
    metres = value * _scale(info)
    if abs(metres) > MAX_LENGTH:
        raise ValueError(f"expected lengths and coordinates of at most {MAX_LENGTH:g} m")
    return metres


def _to_inverse_metres(value: float, info: ValidationInfo) -> float:
    result = value / _scale(info)
    if not math.isfinite(result):
        raise ValueError("too large")
    return result


def _lengths(values: npt.ArrayLike, info: SerializationInfo) -> Any:
    """Return lengths or points [m] in the unit of the context, as a number or nested lists."""
    metres = np.asarray(values, dtype=np.float64)
    given = np.array([in_unit(value, (info.context or {})["unit"]) for value in metres.flat])
    return given.reshape(metres.shape).tolist()


def _curvatures(value: float, info: SerializationInfo) -> float:
    return METRES[(info.context or {})["unit"]] * value


def _degrees(value: float) -> float:
    return float(np.rad2deg(value))


_METRES = AfterValidator(_to_metres)
_UNIT = PlainSerializer(_lengths)
_RADIANS = AfterValidator(math.radians)
_DEGREES = PlainSerializer(_degrees)


def _ordered_box(corners: list[float]) -> list[float]:
    xmin, ymin, xmax, ymax = corners
    if not (xmin < xmax and ymin < ymax):
        raise ValueError("expected [xmin, ymin, xmax, ymax] with xmin < xmax and ymin < ymax")
    return corners


def _simple_ring(points: list[list[float]]) -> list[list[float]]:
    """Return an outline unchanged, or refuse one that crosses itself or has no area.

    Raises:
        ValueError: the outline is refused; the message names the nearest corner.
    """
    if max(abs(value) for point in points for value in point) > LARGEST:
        raise ValueError(f"expected coordinates of at most {LARGEST:g}")
    polygon = shapely.Polygon(points)
    if polygon.is_valid and polygon.area > 0.0:
        return points
    # GEOS gives the coordinates of a crossing in brackets, for example "Self-intersection[1 2]".
    place = re.search(r"\[(\S+) (\S+)\]", shapely.is_valid_reason(polygon))
    if place is None or polygon.convex_hull.area == 0.0:
        raise ValueError("the outline encloses no area; expected at least three corners that are not in one line")
    crossing = np.array([float(place[1]), float(place[2])])
    k = int(np.argmin(np.linalg.norm(np.array(points) - crossing, axis=1)))
    x, y = crossing
    raise ValueError(
        f"the outline crosses or touches itself at ({x:.6g}, {y:.6g}), near its corner [{k}] "
        f"at ({points[k][0]:.6g}, {points[k][1]:.6g}); list the corners in order round the shape"
    )


def _two_places(points: list[list[float]]) -> list[list[float]]:
    if all(point == points[0] for point in points):
        raise ValueError("all points of the wall are the same; expected at least two different ones")
    return points


def _points_to_metres(points: list[list[float]], info: ValidationInfo) -> list[list[float]]:
    return [[_to_metres(value, info) for value in point] for point in points]


def exactly(count: int) -> AfterValidator:
    """Return a validator that accepts lists of exactly ``count`` entries."""

    def check(values: list[float]) -> list[float]:
        if len(values) != count:
            raise ValueError(f"expected exactly {count} entries, got {len(values)}")
        return values

    return AfterValidator(check)


def _is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite number; booleans, which are numbers to Python, do not count."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) <= sys.float_info.max


def _numbers_each(expected: str, *, zero: bool) -> BeforeValidator:
    """Return a validator for one positive number or a list of such; pydantic's own union would report defects twice.

    Args:
        expected: what is expected, in words, for the message.
        zero: whether 0 is allowed.
    """

    def check(value: object) -> object:
        if value == []:
            raise ValueError(f"expected {expected} or a list of such; the list is empty")
        for k, entry in enumerate(value if isinstance(value, list) else [value]):
            if not (_is_number(entry) and (entry > 0.0 or (zero and entry == 0.0))):
                place = f"; [{k}] is {described(entry)}" if isinstance(value, list) else ""
                raise ValueError(f"expected {expected} or a list of such{place}")
        return [float(entry) for entry in value] if isinstance(value, list) else float(value)  # type: ignore[arg-type]

    return BeforeValidator(check)


Length: TypeAlias = Annotated[float, Field(description="length"), _METRES, _UNIT]
PositiveLength: TypeAlias = Annotated[float, Field(gt=0.0, description="length above 0"), _METRES, _UNIT]
NonNegativeLength: TypeAlias = Annotated[float, Field(ge=0.0, description="length, 0 or more"), _METRES, _UNIT]
PositiveSpeed: TypeAlias = Annotated[float, Field(gt=0.0, description="length/s, above 0"), _METRES, _UNIT]
PositiveAcceleration: TypeAlias = Annotated[float, Field(gt=0.0, description="length/s², above 0"), _METRES, _UNIT]
PositiveJerk: TypeAlias = Annotated[float, Field(gt=0.0, description="length/s³, above 0"), _METRES, _UNIT]
Curvature: TypeAlias = Annotated[
    float, Field(description="1/length"), AfterValidator(_to_inverse_metres), PlainSerializer(_curvatures)
]
Degrees: TypeAlias = Annotated[float, Field(description="degrees"), _RADIANS, _DEGREES]
PositiveDegrees: TypeAlias = Annotated[float, Field(gt=0.0, description="degrees, above 0"), _RADIANS, _DEGREES]
BendLimitDegrees: TypeAlias = Annotated[
    float, Field(gt=0.0, le=180.0, description="degrees, above 0 and at most 180"), _RADIANS, _DEGREES
]
Positive: TypeAlias = Annotated[float, Field(gt=0.0)]
Point: TypeAlias = Annotated[list[Length], Field(description="`[x, y]`"), exactly(2)]
Vector: TypeAlias = Annotated[list[float], Field(description="`[x, y, z]`"), exactly(3)]

_Pair: TypeAlias = Annotated[list[float], exactly(2)]
Ring: TypeAlias = Annotated[
    list[_Pair],
    Field(min_length=3, description="`[[x, y], …]`, three or more"),
    AfterValidator(_simple_ring),
    AfterValidator(_points_to_metres),
    _UNIT,
]
Polyline: TypeAlias = Annotated[
    list[_Pair],
    Field(min_length=2, description="`[[x, y], …]`, two or more"),
    AfterValidator(_two_places),
    AfterValidator(_points_to_metres),
    _UNIT,
]
Box: TypeAlias = Annotated[list[Length], Field(description="four lengths"), exactly(4), AfterValidator(_ordered_box)]

PositiveEach: TypeAlias = Annotated[
    float | list[float],
    Field(description="number above 0, or a list of such"),
    _numbers_each("a positive number", zero=False),
]
"""One positive number for all, or a list with one for each."""
NonNegativeEach: TypeAlias = Annotated[
    float | list[float],
    Field(description="number, 0 or more, or a list of such"),
    _numbers_each("a number that is not negative", zero=True),
]
"""One non-negative number for all, or a list with one for each."""
NonNegative: TypeAlias = Annotated[float, Field(ge=0.0)]


class Rules(NamedTuple):
    """Rules between the keys of a table.

    Attributes:
        exactly_one: keys of which exactly one must be given; empty for no such rule.
        otherwise: another way to satisfy ``exactly_one``, in words, appended to its message.
        at_most_one: two keys of which at most one may be given.
        needs: for a key, the keys of which at least one must be given with it.
    """

    exactly_one: tuple[str, ...] = ()
    otherwise: str = ""
    at_most_one: tuple[str, ...] = ()
    needs: Mapping[str, tuple[str, ...]] = MappingProxyType({})


class Table(BaseModel):
    """Base class of all tables: unknown keys, wrong types, and numbers that are not finite or too large are errors."""

    rules: ClassVar[Rules] = Rules()

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        frozen=True,
        defer_build=True,  # most files use only some of the tables
    )

    @classmethod
    def of(cls, part: object, **own: object) -> Self:
        """Return the table of an object, whose attributes have the names of the keys without the suffix ``_deg``.

        Args:
            part: the object.
            own: values of keys that are no such attributes; None leaves a key out.
        """
        nested = table_models(cls)
        said = {name: getattr(part, name.removesuffix("_deg"), None) for name in cls.model_fields} | own
        values: dict[str, Any] = {name: _plain(value, nested.get(name)) for name, value in said.items()}
        return cls.model_construct(**{name: value for name, value in values.items() if value is not None})

    def written(self, unit: LengthUnit) -> dict[str, Any]:
        """Return the keys that are set, with lengths in ``unit`` and angles in degrees."""
        return self.model_dump(by_alias=True, exclude_unset=True, context={"unit": unit}, warnings=False)

    @property
    def values(self) -> dict[str, Any]:
        """All values in SI units and radians, by their keys without the suffix ``_deg``."""
        return {name.removesuffix("_deg"): getattr(self, name) for name in type(self).model_fields}

    @field_validator("*")
    @classmethod
    def _measured_type(cls, value: Any) -> Any:
        if any(abs(number) > LARGEST for number in _floats(value)):
            raise ValueError(f"expected at most {LARGEST:g} in size")
        return value


def _plain(value: object, table: type[BaseModel] | None) -> object:
    """Return a value as plain lists and numbers, with objects converted to the given kind of table."""
    if isinstance(value, (list, tuple)):
        return [_plain(each, table) for each in value]
    if table is not None and issubclass(table, Table) and value is not None and not isinstance(value, Table):
        return table.of(value)
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _floats(value: object) -> Iterator[float]:
    """Yield a value that is a float, or all floats in nested lists."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _floats(part)


MAX_LINKS = 400
"""Largest number of links, far above any real arm; planning for more would take hours."""


class InertiaTable(Table):
    """Moments of inertia of the links about their centres [kg m²], one for all links or one each."""

    axial: PositiveEach = Field(description="About the axis of a link [kg m²].")
    transverse: PositiveEach = Field(description="Across it [kg m²].")


def _even(links: int) -> int:
    if links % 2:
        raise ValueError(f"expected an even number of links; try {links - 1 or 2} or {links + 1}")
    return links


class FeedTable(Table):
    """A linear axis that carries the base along the base heading."""

    range: Annotated[list[Length], exactly(2)] = Field(description="`[least, greatest]` place of the base on the axis.")
    hole: Length | None = Field(
        default=None, description="Where the guide tube ends, on the axis. Default: the greatest place of the base."
    )

    @field_validator("range")
    @classmethod
    def _ordered(cls, ends: list[float]) -> list[float]:
        if not ends[0] < ends[1]:
            raise ValueError("expected [least, greatest] with least < greatest")
        return ends


class ChainTable(Table):
    """What arms in the plane and in space have in common."""

    rules = Rules(at_most_one=("link_mass", "masses"))

    links: Annotated[int, Field(ge=2, le=MAX_LINKS), AfterValidator(_even)] = Field(
        description="Equal links, with a ball joint at the base of each; an even number."
    )
    link_length: PositiveLength = Field(description="Of a link.")
    radius: NonNegativeLength = Field(description="Of the discs swept along the links.")
    joint_limit_deg: BendLimitDegrees = Field(
        description=("Bound on the bend of every joint but the first; in space on each of its two bends.")
    )
    base_limit_deg: PositiveDegrees = Field(
        default=2.0 * math.pi, description=("Bound on the bend of the first joint; in space on each of its two bends.")
    )
    self_collision: bool = Field(
        default=True,
        description=("Whether links with at least max(2 l, π r) of arm between them keep their axes 2 r apart."),
    )
    mount_length: NonNegativeLength | None = Field(
        default=None, description=("Length of arm, from the base, that may touch obstacles. Default: `radius`.")
    )
    link_mass: Positive | None = Field(default=None, description="Mass of every link [kg]. Default: 0.1.")
    masses: Annotated[list[Positive], Field(min_length=1)] | None = Field(
        default=None, description="Mass of each link [kg], in place of `link_mass`."
    )
    inertia: InertiaTable | None = Field(
        default=None,
        description=("`{ axial = …, transverse = … }` about a link's centre [kg m²]. Default: solid cylinders."),
    )
    payload: NonNegative = Field(default=0.0, description="Mass of a point at the tip [kg].")
    rotor_inertia: NonNegativeEach = Field(
        default=0.0,
        description=("Of the drives as seen at the joints [kg m²]; a list has one a ball joint or one a revolute."),
    )
    friction: NonNegativeEach = Field(
        default=0.0, description="Viscous friction of the joints [N m s/rad], given likewise."
    )
    feed: FeedTable | None = Field(
        default=None,
        description=(
            "`{ range = [least, greatest], hole = … }`: an axis that carries the base along the base heading "
            "([how](problem-file.md#feed-axis)). Default: the base is fixed."
        ),
    )


class ArmTable(ChainTable):
    """The arm in its plane."""

    base: Point = Field(description="Of the first joint; it may touch a wall, not stand inside one.")
    base_heading_deg: Degrees = Field(default=0.0, description="Heading of the straight arm.")
    axes: Axes = Field(default=Arm.axes, description="Order of a ball's revolutes; `\"zyz\"` as in the paper's table.")


class PointLimitTable(Table):
    """Bounds on the speed and the acceleration of a point of the arm."""

    at: NonNegativeLength = Field(description="Arc length of the point from the base, along the links.")
    velocity: PositiveSpeed | None = Field(default=None, description="Of the point. Default: none.")
    acceleration: PositiveAcceleration | None = Field(default=None, description="Of the point. Default: none.")


class LimitsTable(Table):
    """Joint limits, each one number, one a ball joint, or one a revolute; limits of the feed axis, and of points."""

    velocity: PositiveEach = Field(description="Of the joints [rad/s].")
    acceleration: PositiveEach = Field(description="Of the joints [rad/s²].")
    jerk: PositiveEach | None = Field(
        default=None, description="Of the joints [rad/s³]; for smooth motions. Default: accelerations may jump."
    )
    torque: PositiveEach | None = Field(default=None, description="Of the joints [N m]. Default: not limited.")
    feed_velocity: PositiveSpeed | None = Field(
        default=None, description="Of the feed axis; required where there is one."
    )
    feed_acceleration: PositiveAcceleration | None = Field(
        default=None, description="Of the feed axis; required where there is one."
    )
    feed_jerk: PositiveJerk | None = Field(
        default=None, description="Of the feed axis. Default: its acceleration may jump."
    )
    feed_force: Positive | None = Field(default=None, description="Of the feed axis [N]. Default: not limited.")
    tip_velocity: PositiveSpeed | None = Field(
        default=None, description="Of the tip in the plane, in any direction. Default: not limited."
    )
    tip_acceleration: PositiveAcceleration | None = Field(
        default=None, description="Of the tip in the plane, in any direction. Default: not limited."
    )
    points: list[PointLimitTable] = Field(
        default=[],
        description=("`[{ at = s, velocity = …, acceleration = … }, …]`: the same of other points of the arm."),
    )


class GainsTable(Table):
    """Gains of the PD law for every joint: proportional [N m/rad], derivative [N m s/rad]; else they suit the arm."""

    proportional: Positive | None = Field(
        default=None, description="[N m/rad]. Default: what suits the arm, or the other gain."
    )
    derivative: Positive | None = Field(
        default=None, description="[N m s/rad]. Default: what suits the arm, or the other gain."
    )


class DisturbancesTable(Table):
    """What the simulated arm does otherwise than its controller believes."""

    mass_error: Annotated[float, Field(gt=-1.0)] = Field(
        default=Disturbances.mass_error, description="Share by which links are heavier."
    )
    payload: NonNegative = Field(default=Disturbances.payload, description="Further mass at the tip [kg].")
    friction: NonNegative = Field(
        default=Disturbances.friction, description="Further viscous friction of every revolute [N m s/rad]."
    )
    angle_noise_deg: Annotated[float, Field(ge=0.0), _RADIANS, _DEGREES] = Field(
        default=Disturbances.angle_noise,
        description=(
            "Standard deviation of measured angles [deg]; of the bends alone while the arm moves in its plane."
        ),
    )
    velocity_noise: NonNegative = Field(
        default=Disturbances.velocity_noise, description="Standard deviation of measured speeds [rad/s], likewise."
    )
    start_delay: NonNegative = Field(
        default=Disturbances.start_delay,
        description="Time for which brakes still hold the arm when the motion begins [s].",
    )
    seed: Annotated[int, Field(ge=0)] = Field(default=Disturbances.seed, description="Of the noise.")


class SimulationTable(Table):
    """How the timed motion is simulated."""

    gravity: Vector = Field(
        default_factory=SimulationOptions().gravity.tolist, description="In 3-D [m/s²]; in the plane that is (x, z)."
    )
    step: Positive = Field(default=SimulationOptions.step, description="Of the integration [s].")
    controller: ControllerName = Field(default=SimulationOptions.controller, description="Control law.")
    bandwidth: Positive = Field(
        default=SimulationOptions.bandwidth,
        description=("Natural frequency that both laws are tuned for, on joints and on the feed axis [1/s]."),
    )
    gains: GainsTable = Field(
        default=GainsTable(),
        description=(
            "Of the PD law, for every joint: `{ proportional = …, derivative = … }` [N m/rad, N m s/rad]. "
            "Default: what [suits the arm](dynamics.md#the-closed-loop) at this bandwidth."
        ),
    )
    disturbances: DisturbancesTable = Field(
        default=DisturbancesTable(),
        description="In what the simulated arm differs ([below](#simulation-disturbances)).",
    )


Weight = Annotated[float, Field(ge=0.0)]


class WeightsTable(Table):
    """How much each thing counts that planning makes small."""

    path_length: Weight = Field(default=Weights.path_length, description="Turns of the joints along the motion.")
    smoothness: Weight = Field(default=Weights.smoothness, description="Changes of these turns.")
    bending: Weight = Field(default=Weights.bending, description="The arm's curvature.")
    clearance: Weight = Field(
        default=Weights.clearance,
        description=(
            "Nearness to walls, where they are nearer than 3 % of the arm's length. At 0 motions run close to "
            "`workspace.clearance`; it is kept in any case."
        ),
    )
    duration: Weight = Field(
        default=Weights.duration,
        description=(
            "Turns and changes of turns, each joint's against its own velocity and acceleration limit: a "
            "stand-in for the duration, of use where joints have different limits."
        ),
    )


class PlannerTable(Table):
    """Which planner, how long, and with what."""

    method: MethodName = Field(
        default=PlannerOptions.method,
        description=(
            '`"nlp"`, this package\'s own planner, or `"hill-climbing"`, [the paper\'s](the-paper-claim-by-claim.md).'
        ),
    )
    mapping: MappingName = Field(
        default=PlannerOptions.mapping, description='How a curve becomes joints; `"even-joints"` is the paper\'s.'
    )
    time_limit: Positive = Field(
        default=PlannerOptions.time_limit,
        description=(
            "CPU time of the process after which the search stops [s], so that what is found does not depend "
            "on what else the machine does. Three times as much wall time ends it too."
        ),
    )
    routes: Annotated[int, Field(ge=1)] = Field(
        default=PlannerOptions.routes,
        description="Corridors tried, shortest first; refused in space, where none are sought.",
    )
    seed: Annotated[int, Field(ge=0)] = Field(
        default=PlannerOptions.seed,
        description=(
            "Of the order in which candidates are tried, of the poses at the goal that are drawn, and of the "
            "trees; 0 tries the most promising candidate first. The same seed gives the same plan."
        ),
    )
    tries: Annotated[int, Field(ge=1)] = Field(
        default=PlannerOptions.tries,
        description=(
            "So many plans are made, with `seed` and the seeds after it, each with an equal share of the time "
            "that is left; of those that keep nine tenths of the room that the roomiest keeps the shortest "
            "motion is taken. The paper's planner draws nothing, so more than one try is refused."
        ),
    )
    optimiser: OptimiserName = Field(
        default=PlannerOptions.optimiser,
        description='How the motion is optimised over all keyframes; by `"none"` it stays as it was found.',
    )
    retiming: RetimingName = Field(
        default=PlannerOptions.retiming,
        description=(
            'How the path is timed: `"toppra"`, as fast as the limits allow; or `"paul"`, the paper\'s: joints '
            "move at constant speed between keyframes and turn smoothly at each. The second leaves the "
            "certified path a little, so shorter turns are tried until the verifier accepts the motion."
        ),
    )
    wanted_gap: NonNegativeLength | None = Field(
        default=PlannerOptions.wanted_gap,
        description=(
            "Room beyond radius and clearance that [the goal pose](how-a-motion-is-found.md) and the motion keep where "
            "there is so much; where a passage has less, as much as it has. 0: no more than the clearance is "
            "asked for. What the motion kept is [in its record](room.md), and `solve --pareto` shows what "
            "other gaps would cost. Motions that follow a leader on a feed axis keep the room of its path, "
            "and the paper's planner keeps none. Default: 1.5 % of the arm's length or half its radius, "
            "whichever is less."
        ),
    )
    effort_share: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=PlannerOptions.effort_share,
        description=(
            "Share of the drives' limits (velocity, acceleration, jerk, torque, and those of the feed axis) "
            "that plans use; the rest is left to [the "
            "controller](dynamics.md#what-a-plan-leaves-to-the-controller). Limits on the tip and on other "
            "points are used in full."
        ),
    )
    weights: WeightsTable = Field(
        default=WeightsTable(), description="What planning makes small ([below](#planner-weights))."
    )


class ToleranceTable(Table):
    """Errors with which the motion has to touch nothing."""

    joint_error_deg: Annotated[float, Field(ge=0.0, lt=180.0), _RADIANS, _DEGREES] = Field(
        default=0.0,
        description=(
            "Error of every joint, at every time another, with which nothing may come nearer than the "
            "clearance; 0 asks for nothing."
        ),
    )


class VerificationTable(Table):
    """How strictly plans are judged."""

    contact_tolerance: PositiveLength | None = Field(
        default=VerificationOptions.contact_tolerance,
        description=(
            "Gap that may be missing before a motion is refused; motions that begin or end in contact may use "
            "half of it. It is there for rounding, a thousandth of the arm's length at most: a clearance "
            "belongs into `workspace.clearance`. Default: [a millionth of the arm's length](guarantees.md)."
        ),
    )
