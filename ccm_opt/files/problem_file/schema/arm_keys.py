"""Keys of the arm."""

import math
from typing import Annotated

from pydantic import AfterValidator, Field, field_validator

from ccm_opt.files.problem_file.schema.table import Table
from ccm_opt.files.problem_file.typed_quantities import (
    BendLimitDegrees,
    Degrees,
    Length,
    NonNegative,
    NonNegativeEach,
    NonNegativeLength,
    Point,
    Positive,
    PositiveDegrees,
    PositiveEach,
    PositiveLength,
    exactly,
)
from ccm_opt.jointed.arm import Arm, Axes

MAX_LINKS = 400
"""Far more than any arm that has been planned for; planning for more would take hours."""


class InertiaTable(Table):
    """Moments of inertia of the links about their centres [kg m²], one for all links or one each."""

    axial: PositiveEach
    """About the axis of a link [kg m²]."""
    transverse: PositiveEach
    """Across it [kg m²]."""


def _even(links: int) -> int:
    if links % 2:
        raise ValueError(f"expected an even number of links; try {links - 1 or 2} or {links + 1}")
    return links


class FeedTable(Table):
    """A linear axis that carries the base along the base heading."""

    range: Annotated[list[Length], exactly(2)]
    """`[least, greatest]` place of the base on the axis."""
    hole: Length | None = None
    """Where the guide tube ends, on the axis. Default: the greatest place of the base."""

    @field_validator("range")
    @classmethod
    def _ordered(cls, ends: list[float]) -> list[float]:
        if not ends[0] < ends[1]:
            raise ValueError("expected [least, greatest] with least < greatest")
        return ends


class ChainTable(Table):
    """What arms in the plane and in space have in common."""

    links: Annotated[int, Field(ge=2, le=MAX_LINKS), AfterValidator(_even)]
    """Equal links, with a ball joint at the base of each; an even number."""
    link_length: PositiveLength
    """Of a link."""
    radius: NonNegativeLength
    """Of the discs swept along the links."""
    joint_limit_deg: BendLimitDegrees
    """Bound on the bend of every joint but the first; in space on each of its two bends."""
    base_limit_deg: PositiveDegrees = 2.0 * math.pi
    """Bound on the bend of the first joint; in space on each of its two bends."""
    self_collision: bool = True
    """Whether links with at least max(2 l, π r) of arm between them keep their axes 2 r apart."""
    mount_length: NonNegativeLength | None = None
    """Length of arm, from the base, that may touch obstacles. Default: `radius`."""
    link_mass: Positive | None = None
    """Mass of every link [kg]. Default: 0.1."""
    masses: Annotated[list[Positive], Field(min_length=1)] | None = None
    """Mass of each link [kg], in place of `link_mass`."""
    inertia: InertiaTable | None = None
    """`{ axial = …, transverse = … }` about a link's centre [kg m²]. Default: solid cylinders."""
    payload: NonNegative = 0.0
    """Mass of a point at the tip [kg]."""
    rotor_inertia: NonNegativeEach = 0.0
    """Of the drives as seen at the joints [kg m²]; a list has one a ball joint or one a revolute."""
    friction: NonNegativeEach = 0.0
    """Viscous friction of the joints [N m s/rad], given likewise."""
    feed: FeedTable | None = None
    """`{ range = [least, greatest], hole = … }`: an axis that carries the base along the base heading
    ([how](problem-file.md#feed-axis)). Default: the base is fixed."""


class ArmTable(ChainTable):
    """The arm in its plane."""

    base: Point
    """Of the first joint; it may touch a wall, not stand inside one."""
    base_heading_deg: Degrees = 0.0
    """Heading of the straight arm."""
    axes: Axes = Arm.axes
    """Order of a ball's revolutes; `"zyz"` as in the paper's table."""
