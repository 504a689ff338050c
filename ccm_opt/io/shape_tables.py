"""Types of points and tables of shapes in problem files, which obstacles and tools have in common."""

import math
from typing import Annotated, Any, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, SerializationInfo, ValidationInfo

from ccm_opt.io.quantities import (
    DEGREES,
    RADIANS,
    Degrees,
    Length,
    Point,
    PositiveLength,
    Rules,
    Table,
    exactly,
    is_number,
    lengths,
    to_metres,
)

SHORTEST = 1e-9
"""Minimum norm of direction vectors and quaternions; rounding would determine the direction of shorter ones."""


def unit_length(values: list[float]) -> list[float]:
    """Return a vector scaled to length 1.

    Raises:
        ValueError: the vector is zero.
    """
    length = math.hypot(*values)
    if length < SHORTEST:
        raise ValueError(f"expected numbers that are not all zero; their length is {length:g}")
    return [value / length for value in values]


def _ordered_corners(corners: list[list[float]]) -> list[list[float]]:
    low, high = corners
    if not all(least < greatest for least, greatest in zip(low, high, strict=True)):
        raise ValueError("expected [[xmin, ymin, zmin], [xmax, ymax, zmax]] with every minimum below its maximum")
    return corners


def _file_or_points(value: object, info: ValidationInfo) -> object:
    """Return the path of a scan, or points in metres.

    Raises:
        ValueError: the value is neither, or has no points.
    """
    if isinstance(value, str) and value:
        return value
    if not isinstance(value, list) or not value:
        raise ValueError('expected the path of a scan, for example "gallery.ply", or points [[x, y], …]')
    for k, point in enumerate(value):
        if not (isinstance(point, list) and len(point) == 2 and all(map(is_number, point))):
            raise ValueError(f"expected a point [x, y]; [{k}] is another value")
    return [[to_metres(number, info) for number in point] for point in value]


def _written_points(value: Any, info: SerializationInfo) -> Any:
    return value if isinstance(value, str) else lengths(value, info)


ScanPoints: TypeAlias = Annotated[
    str | list[list[float]],
    Field(description="text, or `[[x, y], …]`"),
    BeforeValidator(_file_or_points),
    PlainSerializer(_written_points),
]


def _increasing(values: list[float]) -> list[float]:
    least, greatest = values
    if not least < greatest:
        raise ValueError("expected the least value below the greatest")
    return values


SpacePoint: TypeAlias = Annotated[list[Length], Field(description="`[x, y, z]`"), exactly(3)]
Corners: TypeAlias = Annotated[
    list[SpacePoint], Field(description="two corners"), exactly(2), AfterValidator(_ordered_corners)
]
Direction: TypeAlias = Annotated[list[float], Field(description="`[x, y, z]`"), exactly(3), AfterValidator(unit_length)]
PlaneDirection: TypeAlias = Annotated[
    list[float], Field(description="`[x, y]`"), exactly(2), AfterValidator(unit_length)
]
Distances: TypeAlias = Annotated[
    list[PositiveLength], Field(description="`[least, greatest]`"), exactly(2), AfterValidator(_increasing)
]
FieldOfView: TypeAlias = Annotated[
    float, Field(gt=0.0, le=170.0, description="degrees, above 0 and at most 170"), RADIANS, DEGREES
]
RightAngle: TypeAlias = Annotated[
    float, Field(gt=0.0, le=90.0, description="degrees, above 0 and at most 90"), RADIANS, DEGREES
]
Quaternion: TypeAlias = Annotated[
    list[float], Field(description="four numbers"), exactly(4), AfterValidator(unit_length)
]
Turns: TypeAlias = Annotated[list[Degrees], Field(description="three angles"), exactly(3)]
Bends: TypeAlias = Annotated[list[Degrees], Field(description="`[a, b]`"), exactly(2)]


class PlacementTable(Table):
    """Table of the pose of a solid: a rotation about the origin, followed by a translation."""

    rules = Rules(at_most_one=("rotation_deg", "quaternion"))

    position: SpacePoint = Field(default=[0.0, 0.0, 0.0], description="Position of the origin of the body's own frame.")
    rotation_deg: Turns | None = Field(
        default=None, description="Rotations about the fixed axes x, y and z, in this order. Default: none."
    )
    quaternion: Quaternion | None = Field(
        default=None, description="Rotation as `[w, x, y, z]`, of any length but zero, in place of `rotation_deg`."
    )


class SphereTable(Table):
    """Table of a spherical obstacle."""

    center: SpacePoint = Field(description="Centre of the sphere.")
    radius: PositiveLength = Field(description="Radius of the sphere.")


class BarTable(Table):
    """Table of a cylinder or capsule, given by both ends of its axis and its radius."""

    start: Annotated[SpacePoint, Field(alias="from")] = Field(description="First end of the axis.")
    end: Annotated[SpacePoint, Field(alias="to")] = Field(description="Second end of the axis.")
    radius: PositiveLength = Field(description="Radius of the bar.")


class CircleTable(Table):
    """Table of a disc-shaped planar obstacle."""

    center: Point = Field(description="Centre of the disc.")
    radius: PositiveLength = Field(description="Radius of the disc.")
