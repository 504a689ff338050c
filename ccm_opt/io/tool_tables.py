"""Tables of a tool in a problem file, and the capsules that contain its bodies."""

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.schema_tables import Box, Point, PositiveLength, Rules, Table, exactly
from ccm_opt.io.shape_tables import BarTable, CircleTable, Corners, Direction, SpacePoint, SphereTable, unit_length
from ccm_opt.robot.tool import Tool, ToolBody

_MOST_STRIPS = 8
"""Maximum number of capsules side by side that cover a box. Heuristic."""


class PlaneBarTable(Table):
    """Table of a capsule in the plane, given by both ends of its axis and its radius."""

    start: Annotated[Point, Field(alias="from")] = Field(description="First end of the axis.")
    end: Annotated[Point, Field(alias="to")] = Field(description="Second end of the axis.")
    radius: PositiveLength = Field(description="Radius of the capsule.")


class PlaneToolBodyTable(Table):
    """Table of a body of a planar arm's tool: exactly one of ``capsule``, ``circle`` and ``box``."""

    rules = Rules(exactly_one=("capsule", "circle", "box"))

    capsule: PlaneBarTable | None = Field(
        default=None, description="`{ from = [x, y], to = [x, y], radius = r }`, with round ends."
    )
    circle: CircleTable | None = Field(default=None, description="`{ center = [x, y], radius = r }`.")
    box: Box | None = Field(default=None, description="`[xmin, ymin, xmax, ymax]`, covered by a capsule.")

    def capsules(self) -> Iterator[ToolBody]:
        """Yield the capsules that contain the body."""
        if self.capsule is not None:
            yield ToolBody(np.array(self.capsule.start), np.array(self.capsule.end), self.capsule.radius)
        elif self.circle is not None:
            yield ToolBody(np.array(self.circle.center), np.array(self.circle.center), self.circle.radius)
        elif self.box is not None:
            yield from box_capsules(np.array(self.box[:2]), np.array(self.box[2:]))


class SpaceToolBodyTable(Table):
    """Table of a body of a tool in space: exactly one of ``capsule``, ``sphere``, ``cylinder`` and ``box``."""

    rules = Rules(exactly_one=("capsule", "sphere", "cylinder", "box"))

    capsule: BarTable | None = Field(
        default=None, description="`{ from = [x, y, z], to = [x, y, z], radius = r }`, with hemispherical ends."
    )
    sphere: SphereTable | None = Field(default=None, description="`{ center = [x, y, z], radius = r }`.")
    cylinder: BarTable | None = Field(
        default=None, description="As `capsule`, with flat ends; covered by a capsule about the same axis."
    )
    box: Corners | None = Field(
        default=None,
        description="`[[xmin, ymin, zmin], [xmax, ymax, zmax]]`, covered by capsules along its longest side.",
    )

    def capsules(self) -> Iterator[ToolBody]:
        """Yield the capsules that contain the body."""
        bar = self.capsule or self.cylinder
        if bar is not None:
            yield ToolBody(np.array(bar.start), np.array(bar.end), bar.radius)
        elif self.sphere is not None:
            yield ToolBody(np.array(self.sphere.center), np.array(self.sphere.center), self.sphere.radius)
        elif self.box is not None:
            yield from box_capsules(*np.array(self.box))


class PlaneToolTable(Table):
    """Table of a rigid tool on the last link of a planar arm, in the frame of that link: x along it, from its end."""

    tip: Point = Field(default=[0.0, 0.0], description="Point that goals are for.")
    direction: Annotated[list[float], Field(description="`[x, y]`"), exactly(2), AfterValidator(unit_length)] = Field(
        default=[1.0, 0.0], description="Direction in which the tool points, that goals are for."
    )
    bodies: list[PlaneToolBodyTable] = Field(default=[], description="Bodies of the tool, which collide.")


class SpaceToolTable(Table):
    """Table of a rigid tool on the last link of an arm in space, in the frame of that link: x along it from its end."""

    tip: SpacePoint = Field(default=[0.0, 0.0, 0.0], description="Point that goals are for.")
    direction: Direction = Field(
        default=[1.0, 0.0, 0.0], description="Direction in which the tool points, that goals are for; its roll follows."
    )
    bodies: list[SpaceToolBodyTable] = Field(default=[], description="Bodies of the tool, which collide.")


def box_capsules(low: FloatArray, high: FloatArray) -> Iterator[ToolBody]:
    """Yield capsules along the longest side of a box that contain it, side by side where it is flat.

    Args:
        low: lower corner, shape (d,) [m].
        high: upper corner, shape (d,) [m].
    """
    half = 0.5 * (high - low)
    longest, wide, *others = np.argsort(-half, kind="stable").tolist()
    thin = float(half[others[0]]) if others else 0.0
    strips = min(max(math.ceil(half[wide] / thin - 1e-9), 1), _MOST_STRIPS) if others else 1
    reach = np.zeros(len(low))
    reach[longest] = half[longest]
    for strip in range(strips):
        middle = 0.5 * (low + high)
        middle[wide] += (2 * strip + 1 - strips) * half[wide] / strips
        yield ToolBody(middle - reach, middle + reach, math.hypot(half[wide] / strips, thin))


def build_tool(table: PlaneToolTable | SpaceToolTable) -> Tool:
    """Return the tool that a table describes."""
    bodies = tuple(body for each in table.bodies for body in each.capsules())
    return Tool(np.array(table.tip), np.array(table.direction), bodies)
