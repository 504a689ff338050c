"""Sections of an arm of unequal links in diagnoses: their names and keys, and the parts of the arm that end with them.

Whatever the pose, the part of an arm from its base to the end of a section ends within the length of the links beyond
it of the goal. So a way of that length, wide enough for the thinnest of its links, leads there, or there is no plan.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Goal, JointPose, Problem, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.link_bodies import cylinder_inertia

_THINNER = 0.95
"""Ratio of radii from which a part of the arm counts as thinner than one that ends before. Heuristic."""
_MOST_PARTS = 4
"""Greatest number of parts that are examined, the whole arm among them. Heuristic: each takes a search."""


@dataclass(frozen=True)
class Section:
    """Successive links of an arm.

    Attributes:
        number: index among the sections of the arm.
        first: index of its first link.
        end: index of the first link beyond it.
    """

    number: int
    first: int
    end: int

    @property
    def name(self) -> str:
        """Name in messages, counted from 1."""
        return f"section {self.number + 1}"

    def key(self, name: str) -> str:
        """Return the path of a key of the section in the problem file."""
        return f"arm.sections[{self.number}].{name}"


def sections_of(arm: Arm) -> tuple[Section, ...]:
    """Return the sections of an arm of unequal links, as its file has them; else runs of equal links."""
    assert arm.proportions is not None  # noqa: S101 - said by who asks
    counts = arm.proportions.counts
    if not counts:
        each = np.column_stack((arm.lengths, arm.radii))
        starts = np.flatnonzero(np.append(True, np.any(each[1:] != each[:-1], axis=1)))
        counts = tuple(np.diff(np.append(starts, arm.links)).tolist())
    ends = np.cumsum(counts).tolist()
    return tuple(Section(k, end - count, end) for k, (count, end) in enumerate(zip(counts, ends, strict=True)))


def link_words(arm: Arm, link: int) -> str:
    """Return the name of a link (index from 0) in messages, with its section if links differ."""
    if arm.sections is not None:
        return arm.sections.name_at(link)
    words = f"link {link + 1}"
    return words if arm.proportions is None else f"{words} of {section_at(arm, link).name}"


def section_at(arm: Arm, link: int) -> Section:
    """Return the section of an arm of unequal links that has a link (index from 0)."""
    return next(each for each in sections_of(arm) if link < each.end)


def with_section(arm: Arm, section: Section, key: str, factor: float) -> Arm:
    """Return an arm one of whose sections has another ``link_length``, ``radius`` or ``joint_limit_deg``.

    Args:
        arm: the arm, of unequal links.
        section: the section.
        key: the key.
        factor: ratio of the new value to the old one.
    """
    assert arm.proportions is not None  # noqa: S101 - said by who asks
    own = np.ones(arm.links)
    own[section.first : section.end] = factor
    if key == "link_length":
        lengths = arm.lengths * own
        proportions = replace(arm.proportions, lengths=lengths / np.mean(lengths))
        changed = replace(arm, link_length=float(np.mean(lengths)), proportions=proportions)
    elif key == "radius":
        radii = arm.radii * own
        widest = float(np.max(radii))
        mount = float(radii[0]) if arm.mount_length == arm.radii[0] else arm.mount_length
        proportions = replace(arm.proportions, radii=radii / widest)
        changed = replace(arm, radius=widest, mount_length=mount, proportions=proportions)
    else:
        k = arm.bends_a_joint
        shares = arm.proportions.limits.copy()
        shares[k:] *= np.repeat(own, k)[k:]
        greatest = float(np.max(shares[k:], initial=0.0)) or 1.0
        shares[k:] /= greatest
        proportions = replace(arm.proportions, limits=shares)
        return replace(arm, joint_limit=arm.joint_limit * greatest, proportions=proportions)
    return as_cylinders(arm, changed)


def as_cylinders(old: Arm, new: Arm) -> Arm:
    """Return a new arm, with inertias of solid cylinders if the inertias of the old arm are of this kind."""
    given = (old.inertia_axial, old.inertia_transverse)
    if new.radius <= 0.0 or not all(map(np.allclose, given, _cylinder_inertia(old))):
        return new
    axial, transverse = _cylinder_inertia(new)
    return replace(new, inertia_axial=axial, inertia_transverse=transverse)


def _cylinder_inertia(arm: Arm) -> tuple[FloatArray, FloatArray]:
    return cylinder_inertia(arm.masses, arm.radii, arm.lengths)


@dataclass(frozen=True)
class Part:
    """The part of an arm from its base to the end of a section.

    Attributes:
        arm: the arm.
        section: the section that ends the part.
        radius: radius of the thinnest link of the part [m].
        beyond: length of the links beyond it [m].
    """

    arm: Arm
    section: Section
    radius: float
    beyond: float

    def problem(self, whole: Problem) -> Problem:
        """Return a problem for the part alone, as an arm of equal links, that ends near the goals for the tip."""
        length = float(self.arm.joint_places[self.section.end])
        links = 2 * ((self.section.end + 1) // 2)
        each = np.ones(links)
        arm = replace(
            self.arm,
            links=links,
            link_length=length / links,
            radius=self.radius,
            mount_length=min(self.arm.mount_length, length),
            masses=each,
            inertia_axial=each,
            inertia_transverse=each,
            rotor_inertia=0.0,
            friction=0.0,
            proportions=None,
            sections=None,
            coupled=None,
        )
        straight = JointPose(np.zeros((links, 2) if arm.dimension == 3 else links), arm.base_range[0])

        rates = np.ones(3 * links)

        def near(goal: Goal) -> Goal:
            return straight if goal.for_tip is None else replace(goal.for_tip, direction=None, look_at=None, up=None)

        def widened(tolerances: Tolerances) -> Tolerances:
            return replace(tolerances, position=tolerances.position + self.beyond)

        return replace(
            whole,
            arm=arm,
            limits=replace(whole.limits, velocity=rates, acceleration=rates, torque=None, jerk=None, points=()),
            start=straight,
            goal=near(whole.goal),
            tolerances=widened(whole.tolerances),
            stops=tuple(
                replace(stop, goal=near(stop.goal), tolerances=widened(stop.tolerances)) for stop in whole.stops
            ),
        )

    def keys(self, bounds: dict[str, float]) -> dict[str, float]:
        """Return bounds on the radius and the link length of the part's arm by the keys of sections."""
        links = 2 * ((self.section.end + 1) // 2)
        found = {key: value for key, value in bounds.items() if key not in {"arm.radius", "arm.link_length"}}
        if "arm.radius" in bounds:
            found[self.section.key("radius")] = bounds["arm.radius"]
        if "arm.link_length" in bounds:
            lacking = links * bounds["arm.link_length"] - float(self.arm.joint_places[self.section.end])
            found |= longer_sections(self.arm, lacking)
        return found


def longer_sections(arm: Arm, lacking: float) -> dict[str, float]:
    """Return by key the link length of each section with which the arm would be longer by a length [m]."""
    if arm.proportions is None:
        return {"arm.link_length": arm.link_length + lacking / arm.links}
    return {
        section.key("link_length"): float(arm.lengths[section.first]) + lacking / (section.end - section.first)
        for section in sections_of(arm)
    }


def parts_of(arm: Arm) -> tuple[Part, ...]:
    """Return the parts of an arm of unequal links to be examined, the thickest first, the whole arm last."""
    ends = [
        Part(arm, each, float(np.min(arm.radii[: each.end])), float(arm.places_from_tip[each.end]))
        for each in sections_of(arm)
    ]
    thick = [part for part, following in pairwise(ends) if following.radius < _THINNER * part.radius]
    step = -(-len(thick) // (_MOST_PARTS - 1)) or 1
    return (*thick[::step], ends[-1])
