"""Types of the quantities in a problem file, and the tables common to planar arms and arms in space.

The types convert between the units of a file and SI units. On validation, lengths are multiplied by ``scale`` of the
context, the metres per unit of the file; on serialisation, lengths are written in the ``unit`` of the context. The
description of a type says which values are valid and is used by the documentation.
"""

import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self, TypeAlias, TypeGuard

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
    model_validator,
)

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, LengthUnit, in_unit
from ccm_opt.io.issues import described, table_models
from ccm_opt.problem import (
    ControllerName,
    Disturbances,
    MethodName,
    OptimiserName,
    OrderName,
    PlannerOptions,
    RetimingName,
    SimulationOptions,
    TourEnd,
    VerificationOptions,
    Weights,
)
from ccm_opt.robot.arc_sections import fitting_arcs
from ccm_opt.robot.arm import Arm, Axes, MappingName

MAX_LENGTH = 1e9
"""Maximum absolute coordinate [m]; double precision no longer resolves a micrometre beyond this value."""

LARGEST = 1e12
"""Maximum absolute value of any number; no length, angle or limit of a real arm comes near, and the squares of much
larger numbers overflow."""


def _scale(info: ValidationInfo) -> float:
    return float((info.context or {}).get("scale", 1.0))


def to_metres(value: float, info: ValidationInfo) -> float:
    """Return a length of a file in metres.

    Raises:
        ValueError: it is too large.
    """
    metres = value * _scale(info)
    if abs(metres) > MAX_LENGTH:
        raise ValueError(f"expected lengths and coordinates of at most {MAX_LENGTH:g} m")
    return metres


def _to_inverse_metres(value: float, info: ValidationInfo) -> float:
    result = value / _scale(info)
    if not math.isfinite(result):
        raise ValueError("too large")
    return result


def lengths(values: npt.ArrayLike, info: SerializationInfo) -> Any:
    """Return lengths or points [m] in the ``unit`` of the serialisation context, as a number or nested lists."""
    metres = np.asarray(values, dtype=np.float64)
    given = np.array([in_unit(value, (info.context or {})["unit"]) for value in metres.flat])
    return given.reshape(metres.shape).tolist()


def _curvatures(value: float, info: SerializationInfo) -> float:
    return METRES[(info.context or {})["unit"]] * value


def _degrees(value: float) -> float:
    return float(np.rad2deg(value))


_METRES = AfterValidator(to_metres)
_UNIT = PlainSerializer(lengths)
RADIANS = AfterValidator(math.radians)
DEGREES = PlainSerializer(_degrees)


def _ordered_box(corners: list[float]) -> list[float]:
    xmin, ymin, xmax, ymax = corners
    if not (xmin < xmax and ymin < ymax):
        raise ValueError("expected [xmin, ymin, xmax, ymax] with xmin < xmax and ymin < ymax")
    return corners


def _simple_ring(points: list[list[float]]) -> list[list[float]]:
    """Return an outline (list of corners) unchanged if it is a simple polygon with area.

    Raises:
        ValueError: the outline crosses itself or has no area; the message names the corner nearest to the crossing.
    """
    if max(abs(value) for point in points for value in point) > LARGEST:
        raise ValueError(f"expected coordinates of at most {LARGEST:g}")
    polygon = shapely.Polygon(points)
    if polygon.is_valid and polygon.area > 0.0:
        return points
    # GEOS gives the coordinates of a crossing in brackets, for example "Self-intersection[1 2]".
    place = re.search(r"\[(\S+) (\S+)\]", shapely.is_valid_reason(polygon))
    if place is None or polygon.convex_hull.area == 0.0:
        raise ValueError("the outline encloses no area; expected at least three corners that are not collinear")
    crossing = np.array([float(place[1]), float(place[2])])
    k = int(np.argmin(np.linalg.norm(np.array(points) - crossing, axis=1)))
    x, y = crossing
    raise ValueError(
        f"the outline crosses or touches itself at ({x:.6g}, {y:.6g}), near its corner [{k}] "
        f"at ({points[k][0]:.6g}, {points[k][1]:.6g}); list the corners in order around the shape"
    )


def _two_places(points: list[list[float]]) -> list[list[float]]:
    if all(point == points[0] for point in points):
        raise ValueError("all points of the wall coincide; expected at least two different points")
    return points


def _points_to_metres(points: list[list[float]], info: ValidationInfo) -> list[list[float]]:
    return [[to_metres(value, info) for value in point] for point in points]


def exactly(count: int) -> AfterValidator:
    """Return a pydantic validator that accepts only lists of exactly ``count`` entries."""

    def check(values: list[float]) -> list[float]:
        if len(values) != count:
            raise ValueError(f"expected exactly {count} entries, got {len(values)}")
        return values

    return AfterValidator(check)


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a value is a finite number; booleans do not count, although Python treats them as numbers."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) <= sys.float_info.max


def _numbers_each(expected: str, *, zero: bool) -> BeforeValidator:
    """Return a pydantic validator for a positive number or a list of positive numbers.

    Pydantic's own validation of such a union would report each defect twice.

    Args:
        expected: description of a valid number, for the message.
        zero: whether 0 is valid.
    """

    def check(value: object) -> object:
        if value == []:
            raise ValueError(f"expected {expected} or a list of such; the list is empty")
        for k, entry in enumerate(value if isinstance(value, list) else [value]):
            if not (is_number(entry) and (entry > 0.0 or (zero and entry == 0.0))):
                place = f"; [{k}] is {described(entry)}" if isinstance(value, list) else ""
                raise ValueError(f"expected {expected} or a list of such{place}")
        return [float(entry) for entry in value] if isinstance(value, list) else float(value)  # type: ignore[arg-type]

    return BeforeValidator(check)


def _bend_limits(most: float) -> BeforeValidator:
    """Return a pydantic validator for a limit of bends in degrees, or a pair of limits, that converts to radians.

    Args:
        most: greatest valid limit [deg].
    """

    def check(value: object) -> object:
        pair = value if isinstance(value, list) else [value]
        numbers = [each for each in pair if is_number(each)]
        single = len(pair) == 1 and not isinstance(value, list)
        if len(numbers) != len(pair) or not (single or len(pair) == 2):
            raise ValueError("expected a number of degrees, or [a, b] in space")
        if min(numbers) < 0.0 or max(numbers) <= 0.0 or max(numbers) > most:
            above = "above 0" if single else "0 or more and not both 0"
            raise ValueError(f"expected {above}" + (f" and at most {most:g}" if math.isfinite(most) else ""))
        return math.radians(numbers[0]) if single else [math.radians(each) for each in numbers]

    return BeforeValidator(check)


def _degrees_each(values: float | list[float]) -> float | list[float]:
    return [_degrees(value) for value in values] if isinstance(values, list) else _degrees(values)


Length: TypeAlias = Annotated[float, Field(description="length"), _METRES, _UNIT]
PositiveLength: TypeAlias = Annotated[float, Field(gt=0.0, description="length above 0"), _METRES, _UNIT]
NonNegativeLength: TypeAlias = Annotated[float, Field(ge=0.0, description="length, 0 or more"), _METRES, _UNIT]
PositiveSpeed: TypeAlias = Annotated[float, Field(gt=0.0, description="length/s, above 0"), _METRES, _UNIT]
PositiveAcceleration: TypeAlias = Annotated[float, Field(gt=0.0, description="length/s², above 0"), _METRES, _UNIT]
PositiveJerk: TypeAlias = Annotated[float, Field(gt=0.0, description="length/s³, above 0"), _METRES, _UNIT]
Curvature: TypeAlias = Annotated[
    float, Field(description="1/length"), AfterValidator(_to_inverse_metres), PlainSerializer(_curvatures)
]
Degrees: TypeAlias = Annotated[float, Field(description="degrees"), RADIANS, DEGREES]
PositiveDegrees: TypeAlias = Annotated[float, Field(gt=0.0, description="degrees, above 0"), RADIANS, DEGREES]
BendLimitDegrees: TypeAlias = Annotated[
    float, Field(gt=0.0, le=180.0, description="degrees, above 0 and at most 180"), RADIANS, DEGREES
]
SectionBendLimits: TypeAlias = Annotated[
    float | list[float],
    Field(description="degrees, above 0 and at most 180, or `[a, b]`"),
    _bend_limits(180.0),
    PlainSerializer(_degrees_each),
]
BaseBendLimits: TypeAlias = Annotated[
    float | list[float],
    Field(description="degrees, above 0, or `[a, b]`"),
    _bend_limits(math.inf),
    PlainSerializer(_degrees_each),
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
    Field(description="number above 0, or list of such numbers"),
    _numbers_each("a positive number", zero=False),
]
"""A positive number for all joints or links, or a list with one positive number for each."""
NonNegativeEach: TypeAlias = Annotated[
    float | list[float],
    Field(description="number, 0 or more, or list of such numbers"),
    _numbers_each("a number that is not negative", zero=True),
]
"""A non-negative number for all joints, or a list with one non-negative number for each."""
NonNegative: TypeAlias = Annotated[float, Field(ge=0.0)]


class Rules(NamedTuple):
    """Rules between the keys of one table of a problem file.

    Attributes:
        exactly_one: keys of which exactly one must be given; empty for no such rule.
        otherwise: another way to satisfy ``exactly_one``, in words, appended to the error message.
        at_most_one: two keys of which at most one may be given.
        needs: for each key that requires others, the keys of which at least one must be given too.
        replaces: for each key that stands for required ones, these.
    """

    exactly_one: tuple[str, ...] = ()
    otherwise: str = ""
    at_most_one: tuple[str, ...] = ()
    needs: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    replaces: Mapping[str, tuple[str, ...]] = MappingProxyType({})


class Table(BaseModel):
    """Base class of the tables of a problem file; refuses unknown keys, wrong types, and infinite or huge numbers."""

    rules: ClassVar[Rules] = Rules()

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        frozen=True,
        defer_build=True,  # most files use only some of the tables
    )

    @classmethod
    def from_object(cls, part: object, **given: object) -> Self:
        """Return a table filled from an object, whose attributes are named like the keys without the suffix ``_deg``.

        Args:
            part: the object; None if all values come from ``given``.
            given: values of keys that are not attributes of the object; None omits a key.
        """
        nested = table_models(cls)
        attributes = {name: getattr(part, name.removesuffix("_deg"), None) for name in cls.model_fields} | given
        values: dict[str, Any] = {name: _plain(value, nested.get(name)) for name, value in attributes.items()}
        return cls.model_construct(**{name: value for name, value in values.items() if value is not None})

    def written(self, unit: LengthUnit) -> dict[str, Any]:
        """Return the table as plain data for a file, with lengths in ``unit`` and angles in degrees.

        Keys that were not set explicitly are left out.
        """
        return self.model_dump(by_alias=True, exclude_unset=True, context={"unit": unit}, warnings=False)

    @property
    def values(self) -> dict[str, Any]:
        """All values of the table in SI units and radians, by key without the suffix ``_deg``."""
        return {name.removesuffix("_deg"): getattr(self, name) for name in type(self).model_fields}

    @field_validator("*")
    @classmethod
    def _measured_type(cls, value: Any) -> Any:
        if any(abs(number) > LARGEST for number in _floats(value)):
            raise ValueError(f"expected at most {LARGEST:g} in size")
        return value


def _plain(value: object, table: type[BaseModel] | None) -> object:
    """Return a value as plain lists and numbers, with objects converted to a nested table of the given class."""
    if isinstance(value, (list, tuple)):
        return [_plain(each, table) for each in value]
    if table is not None and issubclass(table, Table) and value is not None and not isinstance(value, Table):
        return table.from_object(value)
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _floats(value: object) -> Iterator[float]:
    """Yield the value itself if it is a float, else all floats in nested lists."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _floats(part)


MAX_LINKS = 400
"""Maximum number of links, far above that of real arms; planning for more would take hours."""


class InertiaTable(Table):
    """Table of the links' moments of inertia about their centres [kg m²], one value for all links or one per link."""

    axial: PositiveEach = Field(description="Moment about the link's axis [kg m²].")
    transverse: PositiveEach = Field(description="Moment about an axis across the link, through its centre [kg m²].")


def _even(links: int, info: ValidationInfo) -> int:
    # A section of any number of links may make an arm of an odd number.
    if links % 2 and not info.data.get("sections", True):
        raise ValueError(f"expected an even number of links; try {links - 1 or 2} or {links + 1}")
    return links


def _both_ends(value: Any) -> Any:
    """Return the radii of a section as a list: one radius for a number, both end radii for a list (unchanged)."""
    return [value] if is_number(value) else value


class FeedTable(Table):
    """Table of the feed axis, a linear axis that moves the base along the base heading."""

    range: Annotated[list[Length], exactly(2)] = Field(
        description="`[lower, upper]` limit of the base's position on the axis."
    )
    hole: Length | None = Field(
        default=None,
        description="Position of the end of the guide tube on the axis. Default: the upper end of the range.",
    )

    @field_validator("range")
    @classmethod
    def _ordered(cls, ends: list[float]) -> list[float]:
        if not ends[0] < ends[1]:
            raise ValueError("expected [lower, upper] with lower < upper")
        return ends


class TendonTable(Table):
    """Table of the tendons that bend a section evenly; they run along the whole arm up to the section's end."""

    radius: PositiveLength = Field(description="Distance of the tendons from the arm's axis.")
    number: Literal[3, 4] = Field(default=3, description="Number of tendons, evenly spread about the axis.")
    angle_deg: Degrees = Field(
        default=0.0, description="Angle of the first about the axis, from left (y) towards up (z) of the straight arm."
    )
    travel: PositiveLength | None = Field(
        default=None,
        description="Limit on how far the length of a tendon differs from that along the straight arm. Default: none.",
    )
    speed: PositiveSpeed | None = Field(
        default=None, description="Limit on the rate of change of the length of a tendon. Default: none."
    )


class SectionTable(Table):
    """Table of a section of the arm, whose links are equal or taper evenly."""

    drive: Literal["joints", "section"] = Field(
        default="joints",
        description=(
            'What bends the section: `"joints"`, each by itself, or `"section"`, all alike, so that the section is an '
            "arc of constant curvature in a plane of any azimuth, as tendons bend it (in space, for all sections)."
        ),
    )
    links: Annotated[int, Field(ge=1, le=MAX_LINKS)] = Field(
        description=(
            'Number of links of the section; odd or even. With `drive = "section"` the number of arcs into which '
            "planning divides it, by default so many that no link is farther from its arc than a tenth of the radius."
        )
    )
    length: PositiveLength | None = Field(
        default=None, description='With `drive = "section"`: arc length of the section, in place of `link_length`.'
    )
    bend_limit_deg: PositiveDegrees | None = Field(
        default=None,
        description=(
            'With `drive = "section"`: limit on each of the two bends of the whole section, in place of '
            "`joint_limit_deg`, which is that of one of its links."
        ),
    )
    tendons: TendonTable | None = Field(
        default=None,
        description=(
            'With `drive = "section"`: `{ radius = …, number = 3, angle_deg = 0 }`, of the tendons whose lengths are '
            "in `solution.npz`."
        ),
    )
    link_length: PositiveLength = Field(description="Length of each of its links.")
    radius: Annotated[list[NonNegativeLength], Field(min_length=1, max_length=2), BeforeValidator(_both_ends)] = Field(
        description=(
            "Radius of its links; or `[at the base's end, at the tip's end]`, between which they taper evenly: each "
            "link is then a capsule with the greater radius of its two ends, which contains the cone."
        )
    )
    joint_limit_deg: SectionBendLimits = Field(
        description=(
            "Limit on the bends of its joints; in space `[a, b]` limits each of the two, and 0 locks one. That of the "
            "arm's first joint is `arm.base_limit_deg`."
        )
    )
    mass: Positive | None = Field(
        default=None,
        description=(
            'Mass of each of its links [kg]; with `drive = "section"` of the whole section, to be given where torques '
            "are limited. Default: that of `arm.link_mass` or `arm.masses`; 0.1 of a section that bends evenly."
        ),
    )
    locked: list[Annotated[int, Field(ge=1)]] = Field(
        default_factory=list, description="Joints of the section, counted from 1, that stay straight."
    )

    @field_validator("locked")
    @classmethod
    def _existing(cls, joints: list[int], info: ValidationInfo) -> list[int]:
        count = info.data.get("links", math.inf)
        if max(joints, default=0) > count:
            raise ValueError(f"the section has {count} joints; expected their numbers, from 1")
        return joints

    @field_validator("length", "bend_limit_deg")
    @classmethod
    def _in_place_of_links(cls, value: float | None) -> float | None:
        # Where they are allowed, the values of the links have been computed from them.
        if value is not None:
            raise ValueError('expected only with drive = "section", and not together with those of its links')
        return value

    @field_validator("tendons")
    @classmethod
    def _of_driven(cls, tendons: TendonTable | None, info: ValidationInfo) -> TendonTable | None:
        if tendons is not None and info.data.get("drive") == "joints":
            raise ValueError('expected only with drive = "section"')
        return tendons

    @property
    def radii(self) -> FloatArray:
        """Radius of each link, shape (links,) [m]."""
        ends = np.linspace(self.radius[0], self.radius[-1], self.links + 1)
        return np.maximum(ends[:-1], ends[1:])

    @property
    def limits(self) -> FloatArray:
        """Maximum absolute value of both bends of each joint, which are one in the plane, shape (links, 2) [rad]."""
        limits = np.empty((self.links, 2))
        limits[:] = self.joint_limit_deg
        limits[np.array(self.locked, dtype=np.intp) - 1] = 0.0
        return limits


SECTION_KEYS = ("links", "link_length", "radius", "joint_limit_deg")
"""Keys of the whole arm that are computed from its sections, where sections are given."""


def _places_of_bodies(bodies: Any) -> list[tuple[int, float]]:
    """Return where the data of bodies have them along sections: section, from 0, and fraction; for valid data only."""
    rows = [each for each in bodies if isinstance(each, Mapping)] if isinstance(bodies, list) else []
    given = [(row.get("section"), row.get("at", 1.0)) for row in rows]
    return [(k - 1, float(at)) for k, at in given if type(k) is int and is_number(at) and 0.0 < at <= 1.0]


def arcs_before_bodies(places: Sequence[tuple[int, float]], counts: Sequence[int]) -> list[int]:
    """Return the numbers of arcs from the base to where bodies divide links of sections that bend evenly, ascending.

    Args:
        places: section of each body, from 0, and fraction of its length.
        counts: number of arcs of each section.
    """
    own = [(k, arc_ending_at(at, counts[k])) for k, at in places if 0 <= k < len(counts)]
    return sorted({sum(counts[:k]) + arc + 1 for k, arc in own if arc is not None} - {sum(counts)})


def _divided(section: Any, places: Sequence[float] = ()) -> Any:
    """Return the data of a section that bends evenly with the values of its links in place of those of the whole.

    Other sections, and invalid values, which are reported elsewhere, are returned unchanged.

    Args:
        section: the data.
        places: fractions of its length at which bodies sit, where arcs end if that takes no more than twice as many.
    """
    if not isinstance(section, Mapping) or section.get("drive") != "section":
        return section
    row = dict(section)
    radius = row.get("radius")
    thin = min((each for each in (radius if isinstance(radius, list) else [radius]) if is_number(each)), default=0.0)
    count, each, bend = row.get("links"), row.get("joint_limit_deg"), row.get("bend_limit_deg")
    if count is None and is_number(row.get("length")) and is_number(bend) and thin > 0.0:
        least = fitting_arcs(row["length"], math.radians(bend), thin)
        fitting = (n for n in range(least, max(2 * least, MOST_ARCS_AT_BODIES) + 1) if _end_arcs(places, n))
        count = row["links"] = next(fitting, least)
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        return row
    if row.get("link_length") is None and is_number(row.get("length")):
        row["link_length"] = row.pop("length") / count
    if each is None and is_number(bend):
        row["joint_limit_deg"] = row.pop("bend_limit_deg") / count
    return row


MOST_ARCS_AT_BODIES = 20
"""Number of arcs up to which a section is divided so that arcs end where its bodies sit. Heuristic: planning takes
longer with more."""
_AT_END = 1e-6
"""Largest distance of a body from the end of an arc, in arcs, that counts as none."""


def _end_arcs(places: Sequence[float], count: int) -> bool:
    """Return whether arcs of a section of so many end at places along it, given as fractions of its length."""
    return all(abs(place * count - round(place * count)) <= _AT_END for place in places)


def arc_ending_at(place: float, count: int) -> int | None:
    """Return the index of the arc of a section of so many that ends at a fraction of its length; None if none does."""
    return round(place * count) - 1 if _end_arcs((place,), count) and place > 0.0 else None


def _whole_of(sections: list[Any], places: Sequence[tuple[int, float]]) -> dict[str, Any]:
    """Return the values of the whole arm's keys that follow from its sections, and from the places of bodies on them.

    These are the total number of links, the mean link length, and the maximum of radii and joint limits, locked joints
    and the first left out; for invalid sections, whose defects are reported elsewhere, valid placeholders.
    """
    rows = [each for each in sections if isinstance(each, Mapping)]

    def numbers(key: str) -> list[float]:
        values = [row.get(key) for row in rows]
        return [v for value in values for v in (value if isinstance(value, list) else [value]) if is_number(v)]

    counts = [int(count) for count in numbers("links")]
    lengths = numbers("link_length")
    if len(counts) != len(sections) or len(lengths) != len(sections):
        return {"links": 2, "link_length": 1.0, "radius": 0.0, "joint_limit_deg": 1.0}  # the sections are at fault
    # The first and the last link of sections that bend evenly are halves of links.
    links = sum(counts)
    if any(row.get("drive") == "section" for row in rows):
        links += 1 + len(arcs_before_bodies(places, counts))
    mean = float(np.dot(counts, lengths)) / links if links else 1.0
    widest = max(numbers("radius"), default=0.0)
    bending = [row for k, row in enumerate(rows) if _unlocked(row, int(k == 0)) > 0]
    given = [row.get("joint_limit_deg") for row in bending or rows[:1]]
    limits = [v for limit in given for v in (limit if isinstance(limit, list) else [limit]) if is_number(v)]
    return {"links": links, "link_length": mean, "radius": widest, "joint_limit_deg": max(limits, default=0.0)}


def _unlocked(section: Mapping[str, Any], first: int) -> int:
    """Return the number of joints of a section, from index ``first`` on, that are not locked."""
    locked = section.get("locked")
    numbers = {number for number in locked if is_number(number)} if isinstance(locked, list) else set()
    count = int(section["links"])
    return count - first - sum(first < number <= count for number in numbers)


class ChainTable(Table):
    """Keys that the tables of planar arms and of arms in space have in common."""

    rules = Rules(at_most_one=("link_mass", "masses"), replaces=dict.fromkeys(("sections", "urdf"), SECTION_KEYS))

    urdf: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "URDF of the arm ([what is read](problem-file.md#urdf)), in place of `sections` or the keys of equal "
            "links. The path is relative to the problem file and must stay within its folder, unless "
            "`--allow-outside` is given (in Python `allow_outside=True`)."
        ),
    )
    sections: Annotated[list[SectionTable], Field(min_length=1)] | None = Field(
        default=None,
        description=(
            "Sections from the base outward, written `[[arm.sections]]`, for links that differ: in place of `links`, "
            "`link_length`, `radius` and `joint_limit_deg`."
        ),
    )
    links: Annotated[int, Field(ge=2, le=MAX_LINKS), AfterValidator(_even)] = Field(
        description="Number of equal links, each with a ball joint at its base; even."
    )
    link_length: PositiveLength = Field(description="Length of a link.")
    radius: NonNegativeLength = Field(description="Radius of the links, which are capsules about their axes.")
    joint_limit_deg: BendLimitDegrees = Field(
        description="Limit on the bend of every joint but the first; in space, on each of its two bends."
    )
    base_limit_deg: BaseBendLimits = Field(
        default=2.0 * math.pi,
        description="Limit on the bend of the first joint; in space on each of its two bends, or `[a, b]` on each.",
    )
    self_collision: bool = Field(
        default=True,
        description="Whether links with at least two links and π r of arm between them must not touch.",
    )
    mount_length: NonNegativeLength | None = Field(
        default=None,
        description="Length of arm next to the base that may touch obstacles. Default: the first link's radius.",
    )
    link_mass: Positive | None = Field(default=None, description="Mass of every link [kg]. Default: 0.1.")
    masses: Annotated[list[Positive], Field(min_length=1)] | None = Field(
        default=None, description="Mass of each link [kg], in place of `link_mass`."
    )
    inertia: InertiaTable | None = Field(
        default=None,
        description=(
            "Moments of inertia `{ axial = …, transverse = … }` about a link's centre [kg m²]. Default: "
            "solid cylinders."
        ),
    )
    payload: NonNegative = Field(default=0.0, description="Point mass at the tip [kg].")
    rotor_inertia: NonNegativeEach = Field(
        default=0.0,
        description=(
            "Inertia of the drives, reflected to the joints [kg m²]; a list has one value per ball joint "
            "or per revolute."
        ),
    )
    friction: NonNegativeEach = Field(
        default=0.0, description="Viscous friction of the joints [N m s/rad]; a list as for `rotor_inertia`."
    )
    feed: FeedTable | None = Field(
        default=None,
        description=(
            "`{ range = [lower, upper], hole = … }`: linear axis that moves the base along the base heading "
            "([how](problem-file.md#feed-axis)). Default: fixed base."
        ),
    )

    @model_validator(mode="before")
    @classmethod
    def _with_whole(cls, data: Any) -> Any:
        """Return the data with the keys of the whole arm computed from its sections; unchanged without sections."""
        sections = data.get("sections") if isinstance(data, Mapping) else None
        if not isinstance(sections, list) or not sections:
            return data
        places = _places_of_bodies(data.get("bodies"))
        divided = [_divided(each, [at for own, at in places if own == k]) for k, each in enumerate(sections)]
        return {**data, "sections": divided, **_whole_of(divided, places)}

    @property
    def bends_evenly(self) -> bool:
        """Whether the sections of the arm bend evenly."""
        return self.sections is not None and any(each.drive == "section" for each in self.sections)

    @property
    def straight_joints(self) -> tuple[int, ...]:
        """Indices of the joints of sections that bend evenly at which bodies sit, and which therefore do not bend."""
        return ()

    @property
    def base_limits(self) -> FloatArray:
        """Maximum absolute value of both bends of the first joint unless locked, shape (2,) [rad]."""
        limits = np.empty(2)
        limits[:] = self.base_limit_deg
        return limits

    def bend_limit(self, joint: int, bend: int = 0) -> tuple[str, float]:
        """Return the key that limits a bend (index from 0) of a joint (index from 0), and the limit [rad]."""
        still = [np.zeros((1, 2))] if self.bends_evenly else []  # the first of sections that bend evenly
        limits = None
        if self.sections is not None:
            limits = np.concatenate([*still, *(each.limits for each in self.sections)])
            for straight in self.straight_joints:
                limits = np.insert(limits, straight, 0.0, axis=0)
        if joint == 0 and (limits is None or np.any(limits[0])):
            return "base_limit_deg", float(self.base_limits[bend])
        return "joint_limit_deg", self.joint_limit_deg if limits is None else float(limits[joint, bend])


class ArmTable(ChainTable):
    """Table of a planar arm."""

    base: Point = Field(description="Position of the first joint; it may touch a wall, but not lie inside one.")
    base_heading_deg: Degrees = Field(default=0.0, description="Heading of the straight arm.")
    axes: Axes = Field(
        default=Arm.axes, description="Order of a ball joint's revolutes; the paper's table has `\"zyz\"`."
    )


class PointLimitTable(Table):
    """Table of the limits on speed and acceleration of one point of the arm."""

    at: NonNegativeLength = Field(description="Arc length of the point from the base, along the links.")
    velocity: PositiveSpeed | None = Field(default=None, description="Limit on the point's speed. Default: none.")
    acceleration: PositiveAcceleration | None = Field(
        default=None, description="Limit on the point's acceleration. Default: none."
    )


class LimitsTable(Table):
    """Table of limits of joints (one value for all, per ball joint, or per revolute), feed axis, and points."""

    velocity: PositiveEach = Field(description="Joint velocity [rad/s].")
    acceleration: PositiveEach = Field(description="Joint acceleration [rad/s²].")
    jerk: PositiveEach | None = Field(
        default=None, description="Joint jerk [rad/s³]. Default: none, accelerations may jump."
    )
    torque: PositiveEach | None = Field(default=None, description="Joint torque [N m]. Default: none.")
    feed_velocity: PositiveSpeed | None = Field(
        default=None, description="Velocity of the feed axis; required if there is one."
    )
    feed_acceleration: PositiveAcceleration | None = Field(
        default=None, description="Acceleration of the feed axis; required if there is one."
    )
    feed_jerk: PositiveJerk | None = Field(
        default=None, description="Jerk of the feed axis. Default: none, its acceleration may jump."
    )
    feed_force: Positive | None = Field(default=None, description="Force of the feed axis [N]. Default: none.")
    tip_velocity: PositiveSpeed | None = Field(
        default=None, description=("Speed of the tip, in any direction. Default: none.")
    )
    tip_acceleration: PositiveAcceleration | None = Field(
        default=None, description="Acceleration of the tip, in any direction. Default: none."
    )
    points: list[PointLimitTable] = Field(
        default=[],
        description="`[{ at = s, velocity = …, acceleration = … }, …]`: the same for other points of the arm.",
    )


class GainsTable(Table):
    """Table of the PD gains of every joint, proportional [N m/rad] and derivative [N m s/rad]; by default tuned."""

    proportional: Positive | None = Field(
        default=None, description="Proportional gain [N m/rad]. Default: tuned for the arm, or to the other gain."
    )
    derivative: Positive | None = Field(
        default=None, description="Derivative gain [N m s/rad]. Default: tuned for the arm, or to the other gain."
    )


class DisturbancesTable(Table):
    """Table of the differences between the simulated arm and the model that the controller uses."""

    mass_error: Annotated[float, Field(gt=-1.0)] = Field(
        default=Disturbances.mass_error,
        description="Relative error of the link masses: 0.1 makes the links 10 % heavier than modelled.",
    )
    payload: NonNegative = Field(default=Disturbances.payload, description="Mass at the tip that the model lacks [kg].")
    friction: NonNegative = Field(
        default=Disturbances.friction,
        description="Viscous friction of every revolute that the model lacks [N m s/rad].",
    )
    angle_noise_deg: Annotated[float, Field(ge=0.0), RADIANS, DEGREES] = Field(
        default=Disturbances.angle_noise,
        description=("Standard deviation of the measured angles [deg]; in the plane, of the bends only."),
    )
    velocity_noise: NonNegative = Field(
        default=Disturbances.velocity_noise,
        description="Standard deviation of the measured velocities [rad/s], likewise.",
    )
    start_delay: NonNegative = Field(
        default=Disturbances.start_delay,
        description="Time for which the brakes still hold the arm after the motion has begun [s].",
    )
    seed: Annotated[int, Field(ge=0)] = Field(default=Disturbances.seed, description="Seed of the noise.")


class SimulationTable(Table):
    """Table of the settings for simulating the timed motion under closed-loop control."""

    gravity: Vector = Field(
        default_factory=SimulationOptions().gravity.tolist,
        description="Gravity in 3-D [m/s²]; the plane of planar arms is (x, z).",
    )
    step: Positive = Field(default=SimulationOptions.step, description="Integration step [s].")
    controller: ControllerName = Field(default=SimulationOptions.controller, description="Control law.")
    bandwidth: Positive = Field(
        default=SimulationOptions.bandwidth,
        description=(
            "Natural frequency for which both control laws are tuned, at the joints and on the feed axis [1/s]."
        ),
    )
    gains: GainsTable = Field(
        default=GainsTable(),
        description=(
            "Gains of the PD law at every joint: `{ proportional = …, derivative = … }` [N m/rad, N m s/rad]. "
            "Default: [tuned for the arm](dynamics.md#the-closed-loop) at this bandwidth."
        ),
    )
    disturbances: DisturbancesTable = Field(
        default=DisturbancesTable(),
        description="How the simulated arm differs from the controller's model ([below](#simulation-disturbances)).",
    )


Weight = Annotated[float, Field(ge=0.0)]


class WeightsTable(Table):
    """Table of the weights of the costs that planning minimises."""

    path_length: Weight = Field(default=Weights.path_length, description="Joint travel along the motion.")
    smoothness: Weight = Field(
        default=Weights.smoothness, description="Changes of the joint steps from keyframe to keyframe."
    )
    bending: Weight = Field(default=Weights.bending, description="Curvature of the arm.")
    clearance: Weight = Field(
        default=Weights.clearance,
        description=(
            "Proximity to walls that are nearer than 3 % of the arm's length. With 0, motions run close to "
            "`workspace.clearance`, which is kept in any case."
        ),
    )
    duration: Weight = Field(
        default=Weights.duration,
        description=(
            "Steps and changes of steps of each joint, relative to its velocity and acceleration limit: a "
            "proxy for the duration, useful where joints have different limits."
        ),
    )


class PlannerTable(Table):
    """Table of the choice of planner, its time limit and its options."""

    method: MethodName = Field(
        default=PlannerOptions.method,
        description=(
            'Planner: `"nlp"`, that of this package, or `"hill-climbing"`, [that of the '
            "paper](the-paper-claim-by-claim.md)."
        ),
    )
    mapping: MappingName = Field(
        default=PlannerOptions.mapping,
        description='Mapping from a curve to joints; `"even-joints"` is that of the paper.',
    )
    time_limit: Positive = Field(
        default=PlannerOptions.time_limit,
        description=(
            "CPU time after which the search stops [s]; CPU time, so that the result does not depend "
            "on the load of the machine. Three times as much wall time ends it too."
        ),
    )
    routes: Annotated[int, Field(ge=1)] = Field(
        default=PlannerOptions.routes,
        description="Number of corridors tried, shortest first; in the plane only.",
    )
    seed: Annotated[int, Field(ge=0)] = Field(
        default=PlannerOptions.seed,
        description=(
            "Seed of the order of candidates, of the sampled goal poses and of the trees; 0 tries the most "
            "promising candidate first. The same seed gives the same plan."
        ),
    )
    tries: Annotated[int, Field(ge=1)] = Field(
        default=PlannerOptions.tries,
        description=(
            "Number of plans made, with `seed` and the seeds after it, each with an equal share of the remaining "
            "time. The fastest is taken of those whose least gap is at least 0.9 of the largest. With "
            "`hill-climbing`, which samples nothing, only 1 is accepted."
        ),
    )
    optimiser: OptimiserName = Field(
        default=PlannerOptions.optimiser,
        description='Optimisation of the motion over all keyframes; `"none"` keeps the motion as it was found.',
    )
    retiming: RetimingName = Field(
        default=PlannerOptions.retiming,
        description=(
            'How the path is timed: `"toppra"`, as fast as the limits allow; or `"paul"`, as in the paper: constant '
            "velocity between keyframes with smooth transitions at them. The transitions leave the "
            "certified path a little; they are shortened until the verifier accepts the motion."
        ),
    )
    wanted_gap: NonNegativeLength | None = Field(
        default=PlannerOptions.wanted_gap,
        description=(
            "Preferred clearance, beyond radius and `workspace.clearance`, of [the goal "
            "pose](how-a-motion-is-found.md) and the motion; a passage that allows less gets as much as it allows. "
            "With 0, only `workspace.clearance` is kept. What the motion keeps is [in its record](clearance.md), and "
            "`solve --pareto` shows what other values cost. Planar motions that follow a leader on a feed axis keep "
            "the clearance of its path; `hill-climbing` ignores it. Default: 1.5 % of the arm's length or half "
            "its radius, whichever is less."
        ),
    )
    effort_share: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=PlannerOptions.effort_share,
        description=(
            "Fraction of the drives' limits (velocity, acceleration, jerk, torque, and those of the feed axis) "
            "that plans use; the rest is reserved for [the "
            "controller](dynamics.md#what-a-plan-leaves-to-the-controller). Limits on the tip and on other "
            "points are used in full."
        ),
    )
    follow_within: PositiveLength | None = Field(
        default=PlannerOptions.follow_within,
        description=(
            "Most that an arm on a feed axis may leave [the path of its tip](arms.md#how-well-the-arm-follows): a hard "
            "limit on every plan, which the verifier checks. Only together with `arm.feed`. Default: no bound."
        ),
    )
    order: OrderName = Field(
        default=PlannerOptions.order,
        description=(
            'Order of several goals: `"given"`, or `"free"`, the one that takes least time '
            "([how](#goals-in-free-order)); goals that are not reached are then left out."
        ),
    )
    end: TourEnd = Field(
        default=PlannerOptions.end,
        description=(
            'Where a motion to goals in free order ends: at any goal (`"free"`), at the last one of the file '
            '(`"last"`), or back at the start (`"start"`).'
        ),
    )
    weights: WeightsTable = Field(
        default=WeightsTable(), description="Weights of the costs ([below](#planner-weights))."
    )


class ToleranceTable(Table):
    """Table of the joint errors under which the motion must remain collision-free."""

    joint_error_deg: Annotated[float, Field(ge=0.0, lt=180.0), RADIANS, DEGREES] = Field(
        default=0.0,
        description=(
            "Joint error that the motion must tolerate: with every joint off by up to this angle, independently and "
            "at all times, the clearance is still kept. 0: not required."
        ),
    )


class VerificationTable(Table):
    """Table of the settings that determine how strictly plans are verified."""

    contact_tolerance: PositiveLength | None = Field(
        default=VerificationOptions.contact_tolerance,
        description=(
            "Shortfall of the clearance up to which a motion is accepted, at most a thousandth of the "
            "arm's length; motions "
            "that start or end in contact may use half of it. It covers rounding; safety distances belong in "
            "`workspace.clearance`. Default: [a millionth of the arm's length](guarantees.md)."
        ),
    )
