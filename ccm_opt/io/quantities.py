"""Types of the quantities in a problem file, and the base class of its tables.

The types convert between the units of a file and SI units. On validation, lengths are multiplied by ``scale`` of the
context, the metres per unit of the file; on serialisation, lengths are written in the ``unit`` of the context. The
description of a type says which values are valid and is used by the documentation.
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


Weight = Annotated[float, Field(ge=0.0)]
