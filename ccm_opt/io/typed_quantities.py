"""Units of a problem file: typed quantities, each of which validation turns into SI units and radians.

Lengths are multiplied by the metres in the file's unit, which the validation context carries as ``scale``. What a value
has to look like is said in the description of its type, for the pages.
"""

import math
import re
import sys
from typing import Annotated, TypeAlias, TypeGuard

import numpy as np
import shapely
from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from ccm_opt.io.issues import described

MAX_LENGTH = 1e9
"""Largest coordinate [m]; beyond it double precision no longer resolves a micrometre."""

LARGEST = 1e12
"""Largest number of any kind; no length, angle or limit of an arm comes near it, and squares of far larger ones are
infinite."""


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


def _ordered_box(corners: list[float]) -> list[float]:
    xmin, ymin, xmax, ymax = corners
    if not (xmin < xmax and ymin < ymax):
        raise ValueError("expected [xmin, ymin, xmax, ymax] with xmin < xmax and ymin < ymax")
    return corners


def _simple_ring(points: list[list[float]]) -> list[list[float]]:
    """Refuse an outline that crosses itself or has no area, and say near which vertex."""
    if max(abs(value) for point in points for value in point) > LARGEST:
        raise ValueError(f"expected coordinates of at most {LARGEST:g}")
    polygon = shapely.Polygon(points)
    if polygon.is_valid and polygon.area > 0.0:
        return points
    # GEOS gives the place of a crossing in brackets, for example "Self-intersection[1 2]".
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
    """The rule that a list has ``count`` entries, no fewer and no more."""

    def check(values: list[float]) -> list[float]:
        if len(values) != count:
            raise ValueError(f"expected exactly {count} entries, got {len(values)}")
        return values

    return AfterValidator(check)


def _is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a finite number; to Python true and false are numbers too, to a user they are not."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) <= sys.float_info.max


def _positive(value: object, place: str = "") -> float:
    if not (_is_number(value) and value > 0.0):
        raise ValueError(f"expected a positive number or a list of such{place}")
    return float(value)


def _positive_each(value: object) -> float | list[float]:
    """One number or a list of numbers, as floats; pydantic's own union would report every defect twice."""
    if not isinstance(value, list):
        return _positive(value)
    if not value:
        raise ValueError("expected a positive number or a list of such; the list is empty")
    return [_positive(entry, f"; [{k}] is {described(entry)}") for k, entry in enumerate(value)]


def _non_negative(value: object) -> float:
    if not (_is_number(value) and value >= 0.0):
        raise ValueError(f"expected a number that is not negative, or a list of such; got {described(value)}")
    return float(value)


def _non_negative_each(value: object) -> float | list[float]:
    """One number or a list of numbers, zero allowed, as floats."""
    if isinstance(value, list):
        return [_non_negative(entry) for entry in value]
    return _non_negative(value)


Length: TypeAlias = Annotated[float, Field(description="length"), AfterValidator(_to_metres)]
PositiveLength: TypeAlias = Annotated[float, Field(gt=0.0, description="length above 0"), AfterValidator(_to_metres)]
NonNegativeLength: TypeAlias = Annotated[
    float, Field(ge=0.0, description="length, 0 or more"), AfterValidator(_to_metres)
]
PositiveSpeed: TypeAlias = Annotated[float, Field(gt=0.0, description="length/s, above 0"), AfterValidator(_to_metres)]
PositiveAcceleration: TypeAlias = Annotated[
    float, Field(gt=0.0, description="length/s², above 0"), AfterValidator(_to_metres)
]
PositiveJerk: TypeAlias = Annotated[float, Field(gt=0.0, description="length/s³, above 0"), AfterValidator(_to_metres)]
Curvature: TypeAlias = Annotated[float, Field(description="1/length"), AfterValidator(_to_inverse_metres)]
Degrees: TypeAlias = Annotated[float, Field(description="degrees"), AfterValidator(math.radians)]
PositiveDegrees: TypeAlias = Annotated[
    float, Field(gt=0.0, description="degrees, above 0"), AfterValidator(math.radians)
]
BendLimitDegrees: TypeAlias = Annotated[
    float, Field(gt=0.0, le=180.0, description="degrees, above 0 and at most 180"), AfterValidator(math.radians)
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
]
Polyline: TypeAlias = Annotated[
    list[_Pair],
    Field(min_length=2, description="`[[x, y], …]`, two or more"),
    AfterValidator(_two_places),
    AfterValidator(_points_to_metres),
]
Box: TypeAlias = Annotated[list[Length], Field(description="four lengths"), exactly(4), AfterValidator(_ordered_box)]

PositiveEach: TypeAlias = Annotated[
    float | list[float], Field(description="number above 0, or a list of such"), BeforeValidator(_positive_each)
]
"""One positive number for all, or a list with one each."""
NonNegativeEach: TypeAlias = Annotated[
    float | list[float],
    Field(description="number, 0 or more, or a list of such"),
    BeforeValidator(_non_negative_each),
]
"""The same with zero allowed."""
NonNegative: TypeAlias = Annotated[float, Field(ge=0.0)]
