"""Tables of the arm in a problem file: links, sections with their division into links, and the feed axis."""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.quantities import (
    BaseBendLimits,
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
    PositiveSpeed,
    Rules,
    SectionBendLimits,
    Table,
    exactly,
    is_number,
)
from ccm_opt.robot.arc_sections import fitting_arcs
from ccm_opt.robot.arm import Arm, Axes

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
            "arc of constant curvature, in space in a plane of any azimuth, as tendons bend it (for all sections)."
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
            'With `drive = "section"`: limit on each of the two bends of the whole section, in the plane on its bend, '
            "in place of `joint_limit_deg`, which is that of one of its links."
        ),
    )
    tendons: TendonTable | None = Field(
        default=None,
        description=(
            'With `drive = "section"`: `{ radius = …, number = 3, angle_deg = 0 }`, of the tendons whose lengths are '
            "in `solution.npz`; in the plane only the radius, of two tendons, to the left and the right."
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


def _divided(section: Any, bends: int, places: Sequence[float] = ()) -> Any:
    """Return the data of a section that bends evenly with the values of its links in place of those of the whole.

    Other sections, and invalid values, which are reported elsewhere, are returned unchanged.

    Args:
        section: the data.
        bends: number of bends of a joint.
        places: fractions of its length at which bodies sit, where arcs end if that takes no more than twice as many.
    """
    if not isinstance(section, Mapping) or section.get("drive") != "section":
        return section
    row = dict(section)
    radius = row.get("radius")
    thin = min((each for each in (radius if isinstance(radius, list) else [radius]) if is_number(each)), default=0.0)
    count, each, bend = row.get("links"), row.get("joint_limit_deg"), row.get("bend_limit_deg")
    if count is None and is_number(row.get("length")) and is_number(bend) and thin > 0.0:
        least = fitting_arcs(row["length"], math.sqrt(bends) * math.radians(bend), thin)
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
    _BENDS: ClassVar[int] = 2
    """Number of bends of a joint."""

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
        of_each = [[at for own, at in places if own == k] for k in range(len(sections))]
        divided = [_divided(each, cls._BENDS, own) for each, own in zip(sections, of_each, strict=True)]
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

    _BENDS = 1

    base: Point = Field(description="Position of the first joint; it may touch a wall, but not lie inside one.")
    base_heading_deg: Degrees = Field(default=0.0, description="Heading of the straight arm.")
    axes: Axes = Field(
        default=Arm.axes, description="Order of a ball joint's revolutes; the paper's table has `\"zyz\"`."
    )
