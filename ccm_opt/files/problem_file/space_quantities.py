"""Places, directions and turns in space, as they stand in a problem file."""

import math
from typing import Annotated, TypeAlias

from pydantic import AfterValidator, Field

from ccm_opt.files.problem_file.typed_quantities import Degrees, Length, exactly

SHORTEST = 1e-9
"""Directions and quaternions shorter than this have lost the digits that say where they point."""


def _unit(values: list[float]) -> list[float]:
    length = math.hypot(*values)
    if length < SHORTEST:
        raise ValueError(f"expected numbers that are not all zero; their length is {length:g}")
    return [value / length for value in values]


def _ordered_corners(corners: list[list[float]]) -> list[list[float]]:
    low, high = corners
    if not all(least < greatest for least, greatest in zip(low, high, strict=True)):
        raise ValueError("expected [[xmin, ymin, zmin], [xmax, ymax, zmax]] with every least below its greatest")
    return corners


SpacePoint: TypeAlias = Annotated[list[Length], Field(description="`[x, y, z]`"), exactly(3)]
Corners: TypeAlias = Annotated[
    list[SpacePoint], Field(description="two corners"), exactly(2), AfterValidator(_ordered_corners)
]
Direction: TypeAlias = Annotated[list[float], Field(description="`[x, y, z]`"), exactly(3), AfterValidator(_unit)]
Quaternion: TypeAlias = Annotated[list[float], Field(description="four numbers"), exactly(4), AfterValidator(_unit)]
Turns: TypeAlias = Annotated[list[Degrees], Field(description="three angles"), exactly(3)]
Bends: TypeAlias = Annotated[list[Degrees], Field(description="`[a, b]`"), exactly(2)]
