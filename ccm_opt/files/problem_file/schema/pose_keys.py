"""Keys of start and goals."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator

from ccm_opt.files.problem_file.schema.table import Table
from ccm_opt.files.problem_file.typed_quantities import (
    Curvature,
    Degrees,
    Length,
    Point,
    PositiveDegrees,
    PositiveLength,
    exactly,
)
from ccm_opt.problem import Tolerances

CLOSEST_KNOTS = 1e-6
"""Of a segment, as a share of it; a spline through closer ones swings wildly."""


class SegmentTable(Table):
    """One curvature segment: a length, five curvature values, three knots."""

    length: PositiveLength
    """Of the segment; all together are as long as the arm (to 1e-6)."""
    curvature: Annotated[list[Curvature], exactly(5)]
    """`[Ca, Cb, Cc, Cd, Ce]` at its ends and at its knots."""
    knots: Annotated[list[float], exactly(3)] = Field(default=[0.25, 0.5, 0.75])
    """`[Sb, Sc, Sd]`, shares of its length, growing."""

    @field_validator("knots")
    @classmethod
    def _increasing(cls, knots: list[float]) -> list[float]:
        if np.min(np.diff([0.0, *knots, 1.0])) < CLOSEST_KNOTS:
            raise ValueError(f"expected three increasing numbers between 0 and 1, {CLOSEST_KNOTS:g} apart")
        return knots


class PoseTable(Table):
    """A whole-arm pose, one of shape, joints_deg, segments."""

    shape: Literal["straight", "folded"] | None = None
    """`"straight"`, or `"folded"` ([below](#start-and-goal))."""
    joints_deg: Annotated[list[Degrees], Field(min_length=1)] | None = None
    """One bend a joint, the first relative to the base heading."""
    segments: Annotated[list[SegmentTable], Field(min_length=1)] | None = None
    """`[{ length, curvature, knots }, …]`: a curve, whose mapping is the pose."""
    heading_deg: Degrees | None = None
    """With `segments` the heading at the base (default: the base heading); with `position` the heading of the last link
    (default: any)."""
    feed: Length | None = None
    """Place of the base on the feed axis, of a whole arm. Default: the least of its range."""


class StartTable(PoseTable):
    """Where the motion begins."""


class GoalTable(PoseTable):
    """Where the motion ends: a pose, or a position of the tip."""

    position: Point | None = None
    """Of the tip."""
    position_tolerance: PositiveLength = Tolerances.position
    """How far from the goal the tip may end."""
    heading_tolerance_deg: PositiveDegrees = Tolerances.heading
    """How far from the goal's heading the last link may end."""
    pause: Annotated[float, Field(ge=0.0)] = 0.0
    """How long the arm rests at this goal before the next [s]."""
