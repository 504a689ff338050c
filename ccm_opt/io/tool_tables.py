"""Tables of rigid bodies on links, tools among them, in a problem file, and the capsules that contain their bodies."""

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, PrivateAttr, ValidationInfo, field_validator

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import file_length
from ccm_opt.io.arm_tables import arc_ending_at
from ccm_opt.io.body_covers import Cover, mesh_cover, region_cover
from ccm_opt.io.quantities import Box, NonNegative, Point, Positive, PositiveLength, Ring, Rules, Table, exactly
from ccm_opt.io.shape_tables import (
    BarTable,
    CircleTable,
    Corners,
    Direction,
    PlacementTable,
    SpacePoint,
    SphereTable,
    unit_length,
)
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.link_bodies import SolidMoments
from ccm_opt.robot.tool import INERTIA_ROUNDING, RigidBody, Tool, ToolBody, in_link, second_moments
from ccm_opt.scene.bodies import MeshBody

_MOST_STRIPS = 8
"""Maximum number of capsules side by side that cover a box. Heuristic."""


class PlaneBarTable(Table):
    """Table of a capsule in the plane, given by both ends of its axis and its radius."""

    start: Annotated[Point, Field(alias="from")] = Field(description="First end of the axis.")
    end: Annotated[Point, Field(alias="to")] = Field(description="Second end of the axis.")
    radius: PositiveLength = Field(description="Radius of the capsule.")


class PlaneToolBodyTable(Table):
    """Table of a body of a planar arm's tool: exactly one of ``capsule``, ``circle``, ``box`` and ``polygon``."""

    rules = Rules(exactly_one=("capsule", "circle", "box", "polygon"))

    capsule: PlaneBarTable | None = Field(
        default=None, description="`{ from = [x, y], to = [x, y], radius = r }`, with round ends."
    )
    circle: CircleTable | None = Field(default=None, description="`{ center = [x, y], radius = r }`.")
    box: Box | None = Field(default=None, description="`[xmin, ymin, xmax, ymax]`, covered by a capsule.")
    polygon: Ring | None = Field(
        default=None, description="Corners of a simple polygon, in order; covered by up to eight capsules."
    )

    @cached_property
    def cover(self) -> Cover | None:
        """The capsules that contain a polygon; None for other bodies."""
        return None if self.polygon is None else region_cover(np.array(self.polygon))

    @property
    def notes(self) -> Iterator[str]:
        """What the user is told of the capsules."""
        if self.cover is not None:
            yield f"the polygon of {len(self.polygon or ())} corners is {cover_words(self.cover)}"

    @property
    def moments(self) -> SolidMoments:
        """Moments of the body as a solid: a disc is a ball, a box is as deep as its shorter side."""
        if self.polygon is not None:
            return SolidMoments.of_prism(np.array(self.polygon))
        if self.box is not None:
            low, high = np.array(self.box[:2]), np.array(self.box[2:])
            deep = 0.5 * float(np.min(high - low))
            return SolidMoments.of_box(np.array([low[0], -deep, low[1]]), np.array([high[0], deep, high[1]]))
        (body,) = self.capsules()
        return SolidMoments.of_round_bar(in_link(body.start), in_link(body.end), body.radius, round_ends=True)

    def capsules(self) -> Iterator[ToolBody]:
        """Yield the capsules that contain the body."""
        if self.capsule is not None:
            yield ToolBody(np.array(self.capsule.start), np.array(self.capsule.end), self.capsule.radius)
        elif self.circle is not None:
            yield ToolBody(np.array(self.circle.center), np.array(self.circle.center), self.circle.radius)
        elif self.box is not None:
            yield from box_capsules(np.array(self.box[:2]), np.array(self.box[2:]))
        elif self.cover is not None:
            yield from self.cover.capsules


class SpaceToolBodyTable(Table):
    """Table of a body of a tool in space: one of ``capsule``, ``sphere``, ``cylinder``, ``box`` and ``mesh``."""

    rules = Rules(
        exactly_one=("capsule", "sphere", "cylinder", "box", "mesh"),
        needs=dict.fromkeys(("scale", "up", "pose"), ("mesh",)),
    )

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
    mesh: Annotated[str, Field(min_length=1)] | None = Field(
        default=None,
        description="Mesh or solids of a file, as of [obstacles](problem-file.md#meshes); covered by up to 8 capsules.",
    )
    scale: Positive | None = Field(
        default=None, description="Mesh only: length of one unit of its file, as of obstacles. Default: 1."
    )
    up: Literal["y", "z"] | None = Field(
        default=None, description='Mesh only: axis of the file that becomes z, as of obstacles. Default: `"z"`.'
    )
    pose: PlacementTable | None = Field(
        default=None, description="Mesh only: its pose in the frame of the link. Default: that of the frame."
    )
    _covered: tuple[MeshBody, Cover] | None = PrivateAttr(None)

    def cover_with(self, mesh: MeshBody) -> None:
        """Cover the mesh, which was read from the file, with capsules."""
        frame = mesh.placement.rotation
        self._covered = (mesh, mesh_cover(mesh.vertices, mesh.faces, frame, mesh.margin))

    @property
    def notes(self) -> Iterator[str]:
        """What the user is told of the file and the capsules."""
        if self._covered is not None:
            body, cover = self._covered
            yield f"{body.file}, {body.triangles_read} triangles, is {cover_words(cover)}"
            yield from body.notes
            yield from body.mended

    @property
    def encloses(self) -> bool:
        """Whether the body has a volume, unlike an open mesh."""
        return self._covered is None or (self._covered[0].closed and bool(self._covered[0].shells.orientable.all()))

    @property
    def moments(self) -> SolidMoments:
        """Moments of the body as a solid."""
        if self._covered is not None:
            mesh, _ = self._covered
            shells = mesh.shells
            faces = np.where(shells.turned[:, None], mesh.faces[:, ::-1], mesh.faces)
            parts = [faces[shells.number == k] for k in range(len(shells.closed))]
            return SolidMoments.of_all([SolidMoments.of_mesh(mesh.vertices, part) for part in parts])
        if self.box is not None:
            return SolidMoments.of_box(*np.array(self.box))
        (body,) = self.capsules()
        return SolidMoments.of_round_bar(body.start, body.end, body.radius, round_ends=self.cylinder is None)

    def capsules(self) -> Iterator[ToolBody]:
        """Yield the capsules that contain the body."""
        bar = self.capsule or self.cylinder
        if bar is not None:
            yield ToolBody(np.array(bar.start), np.array(bar.end), bar.radius)
        elif self.sphere is not None:
            yield ToolBody(np.array(self.sphere.center), np.array(self.sphere.center), self.sphere.radius)
        elif self.box is not None:
            yield from box_capsules(*np.array(self.box))
        elif self._covered is not None:
            yield from self._covered[1].capsules


def cover_words(cover: Cover) -> str:
    """Return in words by how much the capsules of a cover are larger than what they contain."""
    count = f"{len(cover.capsules)} capsules, which stand" if len(cover.capsules) > 1 else "a capsule, which stands"
    return f"covered by {count} out from the convex hulls of its parts by up to {file_length(cover.stands_out)}"


def _moments(values: list[float]) -> list[float]:
    """Return moments of inertia as (xx, yy, zz, xy, xz, yz).

    Raises:
        ValueError: no body has these moments.
    """
    if len(values) not in {3, 6}:
        raise ValueError(f"expected [xx, yy, zz] or [xx, yy, zz, xy, xz, yz], got {len(values)} numbers")
    given = values if len(values) == 6 else [*values, 0.0, 0.0, 0.0]
    least = float(np.linalg.eigvalsh(second_moments(_tensor(given)))[0])
    if least < -INERTIA_ROUNDING * max(map(abs, values)):
        raise ValueError("no body has these moments of inertia: each is at most the sum of the other two")
    return given


def _tensor(values: list[float]) -> FloatArray:
    """Return moments of inertia (xx, yy, zz, xy, xz, yz) as a matrix, shape (3, 3)."""
    xx, yy, zz, xy, xz, yz = values
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class _RigidTable(Table):
    """Keys of the mass of a rigid body on a link."""

    rules = Rules(needs={"centre": ("mass",), "inertia": ("mass",), "mass": ("bodies", "centre")})

    mass: NonNegative = Field(default=0.0, description="Its mass [kg].")

    @field_validator("centre", "inertia", check_fields=False)
    @classmethod
    def _of_a_mass(cls, value: Any, info: ValidationInfo) -> Any:
        if info.data.get("mass") == 0.0:
            raise ValueError("no effect without a mass above 0")
        return value


class PlaneRigidTable(_RigidTable):
    """Table of a rigid body on a link of a planar arm, in the frame of that link: x along it, from its end."""

    bodies: list[PlaneToolBodyTable] = Field(default=[], description="Its bodies, which collide.")
    centre: Point | None = Field(default=None, description="Its centre of mass. Default: that of solid `bodies`.")
    inertia: Annotated[float, Field(ge=0.0)] | None = Field(
        default=None,
        description="Its moment of inertia about an axis across the plane through `centre` [kg m²]. Default: as solid.",
    )

    def tensor(self, whole: SolidMoments | None) -> FloatArray:
        """Return the moments of inertia as those of a flat body, shape (3, 3) [kg m²].

        Args:
            whole: moments of the bodies as a solid; None if there are none.
        """
        solid = 0.0 if whole is None else self.mass / whole.volume * whole.inertia[1, 1]
        about = float(solid) if self.inertia is None else self.inertia
        return np.diag([0.5 * about, about, 0.5 * about])


class SpaceRigidTable(_RigidTable):
    """Table of a rigid body on a link of an arm in space, in the frame of that link: x along it, from its end."""

    bodies: list[SpaceToolBodyTable] = Field(default=[], description="Its bodies, which collide.")
    centre: SpacePoint | None = Field(default=None, description="Its centre of mass. Default: that of solid `bodies`.")
    inertia: Annotated[list[float], AfterValidator(_moments)] | None = Field(
        default=None,
        description=(
            "Its moments of inertia about `centre` [kg m²], `[xx, yy, zz]` or `[xx, yy, zz, xy, xz, yz]` with signs as "
            "in URDF. Default: as solid."
        ),
    )

    def tensor(self, whole: SolidMoments | None) -> FloatArray:
        """Return the moments of inertia, shape (3, 3) [kg m²]; arguments as in the plane."""
        if self.inertia is not None:
            return _tensor(self.inertia)
        return np.zeros((3, 3)) if whole is None else self.mass / whole.volume * whole.inertia


class PlaneToolTable(PlaneRigidTable):
    """Table of a rigid tool on the last link of a planar arm, in the frame of that link: x along it, from its end."""

    tip: Point = Field(default=[0.0, 0.0], description="Point that goals are for.")
    direction: Annotated[list[float], Field(description="`[x, y]`"), exactly(2), AfterValidator(unit_length)] = Field(
        default=[1.0, 0.0], description="Direction in which the tool points, that goals are for."
    )


class SpaceToolTable(SpaceRigidTable):
    """Table of a rigid tool on the last link of an arm in space, in the frame of that link: x along it from its end."""

    tip: SpacePoint = Field(default=[0.0, 0.0, 0.0], description="Point that goals are for.")
    direction: Direction = Field(
        default=[1.0, 0.0, 0.0], description="Direction in which the tool points, that goals are for."
    )
    up: Direction | None = Field(
        default=None,
        description=(
            "Direction that is up for the tool, for goals with `up`: its part perpendicular to `direction` counts. "
            "Default: z."
        ),
    )


_LINK = Field(ge=1, description="Number of the link that carries it, from 1.")


class PlaneLinkBodyTable(PlaneRigidTable):
    """Table of a rigid body on a link of a planar arm, in the frame of that link: x along it, from its end."""

    link: int = _LINK


class SpaceLinkBodyTable(SpaceRigidTable):
    """Table of a rigid body on an arm in space: on a link, in its frame (x along it, from its end), or on a section.

    On a section that bends evenly, the frame is that of the arc at a place along it: x along its tangent.
    """

    rules = Rules(exactly_one=("link", "section"), needs={**_RigidTable.rules.needs, "at": ("section",)})

    link: int | None = Field(
        default=None, ge=1, description="Number of the link that carries it, from 1. Default: none."
    )
    section: int | None = Field(
        default=None,
        ge=1,
        description='In place of `link`, with `drive = "section"`: the section, from 1. Default: none.',
    )
    at: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        default=1.0,
        description=(
            "Where it sits along the section: a fraction of its length, at which an arc ends; sections are divided "
            "into up to twice as many arcs as they need, or 20, for it."
        ),
    )


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


def _rigid(table: PlaneRigidTable | SpaceRigidTable) -> dict[str, Any]:
    """Return the fields of the ``RigidBody`` that a table describes, without its link; solid unless it says else."""
    # Bodies of no known kind are reported as they are read.
    rows = [each for each in table.bodies if any(True for _ in each.capsules())]
    parts: dict[str, Any] = {
        "bodies": tuple(body for each in rows for body in each.capsules()),
        "notes": tuple(words for each in rows for words in each.notes),
    }
    if table.mass == 0.0 or (table.centre is None and not rows):
        return parts
    solid = all(each.encloses for each in rows if isinstance(each, SpaceToolBodyTable))
    whole = SolidMoments.of_all([each.moments for each in rows]) if rows and solid else None
    centre: FloatArray | None = None if table.centre is None else np.array(table.centre)
    if centre is None and whole is not None:
        centre = whole.centre if isinstance(table, SpaceRigidTable) else whole.centre[[0, 2]]
    return parts | {"mass": table.mass, "centre": centre, "inertia": table.tensor(whole)}


def build_tool(table: PlaneToolTable | SpaceToolTable) -> Tool:
    """Return the tool that a table describes."""
    up = None if isinstance(table, PlaneToolTable) or table.up is None else np.array(table.up)
    return Tool(**_rigid(table), tip=np.array(table.tip), direction=np.array(table.direction), up=up)


def build_bodies(
    tables: Sequence[PlaneLinkBodyTable | SpaceLinkBodyTable], sections: ArcSections | None
) -> tuple[RigidBody, ...]:
    """Return the rigid bodies on links, or on sections that bend evenly, which tables describe."""
    return tuple(RigidBody(**_rigid(table), link=_carrier(table, sections)) for table in tables)


def _carrier(table: PlaneLinkBodyTable | SpaceLinkBodyTable, sections: ArcSections | None) -> int:
    """Return the index of the link that carries a body; of those of sections, which others report, perhaps another."""
    if isinstance(table, PlaneLinkBodyTable) or table.section is None:
        return (table.link or 1) - 1
    if sections is None or table.section > len(sections.counts):
        return 0
    section = table.section - 1
    arc = arc_ending_at(table.at, int(sections.counts[section]))
    return 0 if arc is None else sections.link_ending_at(section, arc)
