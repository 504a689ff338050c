"""The verifier's own model of bodies on links: further parts of the chain behind a link, which never turn against it.

Each capsule of a body is a straight part of the chain. The parts that lead from one to the next, on to the tool's tip
or back to the end of the link, have no body and are compared with nothing. ``scene.tool_links`` models bodies likewise,
for planning; the verifier deliberately does not use it.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.robot.tool import TOOL, RigidBody, Tool, ToolLinks
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.drives import section_joints, section_of

_BALL = 1e-4
"""Length of the axis that a body without length gets, in link lengths. Heuristic."""
_SAME = 1e-9
"""Distance of places that count as one, in link lengths. Derived: rounding."""
_NEIGHBOURS = 0.05
"""Gap on the straight arm up to which a body counts as near another part of it around a bend, as a fraction of the sum
of both radii; that of ``scene.tool_links``."""


def motion_of(arm: Arm, time: FloatArray, positions: FloatArray, deviation: FloatArray | None = None) -> ChainMotion:
    """Return the motion of an arm with its bodies, from the arm's coordinates.

    Args:
        arm: the arm.
        time: sample times, shape (T,) [s].
        positions: coordinates at the samples, shape (T, c) [rad, m].
        deviation: bound on how far each link, with the bodies on it, may be from this motion in each step, shape
            (T − 1, links) [m]; None if the motion is exact.
    """
    if not arm.rigid_bodies:
        return ChainMotion(arm, time, positions, deviation)
    whole = arm_with_bodies(arm)
    if whole.tool_links is None:
        return ChainMotion(whole, time, positions, deviation)
    if deviation is not None:
        deviation = deviation[:, whole.tool_links.carriers]
    bends = arm.coordinates.joints
    joints = np.repeat(whole.tool_links.own, arm.bends_a_joint)
    longer = np.zeros((len(positions), len(joints) + positions.shape[1] - bends))
    longer[:, : len(joints)][:, joints] = positions[:, :bends]
    longer[:, len(joints) :] = positions[:, bends:]
    return ChainMotion(whole, time, longer, deviation)


def arm_reaching_bodies(arm: Arm) -> Arm:
    """Return an arm without bodies whose links are so long that no point of a body is farther from its link's joint."""
    if not arm.rigid_bodies:
        return arm
    lengths = arm.lengths.copy()
    for body in arm.rigid_bodies:
        places = [place for capsule in body.bodies for place in (capsule.start, capsule.end)]
        places += [body.tip] if isinstance(body, Tool) else []
        out = max((float(np.linalg.norm(place)) for place in places), default=0.0)
        lengths[body.link] = max(lengths[body.link], arm.lengths[body.link] + out)
    mean, none = float(lengths.mean()), np.ones(arm.links * arm.bends_a_joint)
    proportions = arm.proportions or Proportions(lengths, np.ones(arm.links), none)
    longer = replace(proportions, lengths=lengths / mean)
    return replace(arm, bodies=(), tool=None, link_length=mean, proportions=longer)


@dataclass(eq=False)
class _Parts:
    """Links and parts of bodies, in the order of the chain.

    Attributes:
        arm: the arm.
        carrier: index of the link that each is or is fixed to.
        name: name of the body of each; empty for links.
        step: vector along each in the frame of its link [m].
        start: its start, from the end of that link [m].
        radius: radius of each [m]; -1 without a body.
    """

    arm: Arm
    carrier: list[int] = field(default_factory=list)
    name: list[str] = field(default_factory=list)
    step: list[FloatArray] = field(default_factory=list)
    start: list[FloatArray] = field(default_factory=list)
    radius: list[float] = field(default_factory=list)

    def add_link(self, link: int) -> None:
        """Add a link of the arm."""
        step = np.zeros(self.arm.dimension)
        step[0] = self.arm.lengths[link]
        self._add(link, "", step, -step, float(self.arm.radii[link]))

    def add_body(self, link: int, name: str, body: RigidBody) -> None:
        """Add the parts of a body, from the end of its link."""
        unit = self.arm.link_length
        place = np.zeros(self.arm.dimension)
        goals: list[tuple[FloatArray, float]] = []
        for capsule in body.bodies:
            one, other = capsule.start, capsule.end
            if float(np.linalg.norm(one - other)) < _BALL * unit:
                beside = 0.5 * _BALL * unit * np.eye(len(place))[0]
                one, other = one - beside, one + beside
            goals += [(one, -1.0), (other, capsule.radius)]
        goals.append((body.tip if isinstance(body, Tool) else np.zeros(len(place)), -1.0))
        for goal, radius in goals:
            if float(np.linalg.norm(goal - place)) > _SAME * unit:
                self._add(link, name, goal - place, place, radius)
                place = goal

    def _add(self, link: int, name: str, step: FloatArray, start: FloatArray, radius: float) -> None:
        self.carrier.append(link)
        self.name.append(name)
        self.step.append(step)
        self.start.append(start)
        self.radius.append(radius)


def _where(arm: Arm, link: int) -> str:
    """Return in words where a link ends: of sections that bend evenly, at which fraction of which section."""
    if arm.sections is None:
        return f"on link {link + 1}"
    for number, joints in enumerate(section_joints(arm.sections), start=1):
        if link in joints:
            return f"at {(int(np.searchsorted(joints, link)) + 1) / len(joints):.4g} of section {number}"
    raise ValueError("a body on a section is at the end of an arc")


def arm_with_bodies(arm: Arm) -> Arm:
    """Return the arm with its bodies as further parts of the chain."""
    parts = _Parts(arm)
    for link in range(arm.links):
        parts.add_link(link)
        for body in arm.bodies:
            if body.link % arm.links == link:
                parts.add_body(link, f"the body {_where(arm, link)}", body)
    if arm.tool is not None:
        parts.add_body(arm.links - 1, TOOL, arm.tool)
    count = len(parts.carrier)
    ahead = np.eye(arm.dimension)[0]
    direction = ahead if arm.tool is None else arm.tool.direction
    up = np.array([0.0, 0.0, 1.0])
    if arm.tool is not None and arm.dimension == 3:
        # Only the part perpendicular to the direction counts; it has no length where a goal could not use it.
        up = up if arm.tool.up is None else arm.tool.up
        up = np.cross(np.cross(arm.tool.direction, up), arm.tool.direction)
    if count == arm.links and np.array_equal(direction, ahead) and up[2] == 1.0:
        return replace(arm, bodies=(), tool=None)
    own = np.array([not name for name in parts.name])
    each = arm.bends_a_joint
    lengths = np.sqrt(np.sum(np.square(parts.step), axis=1))
    lengths[own] = arm.lengths
    radii = np.maximum(parts.radius, 0.0)
    mean, widest = float(lengths.mean()), float(radii.max())
    limits = np.zeros((count, each))
    limits[own] = 1.0 if arm.proportions is None else arm.proportions.limits.reshape(-1, each)
    one = np.ones(count)
    links = ToolLinks(
        carriers=np.array(parts.carrier),
        names=tuple(parts.name),
        turns=_relative_turns(np.array(parts.step), own),
        bare=np.array(parts.radius) < 0.0,
        distant=_compared(parts, own),
        near_starts=0.0 * one,
        near_ends=one,
        direction=direction,
        up=up,
    )
    return replace(
        arm,
        links=count,
        link_length=mean,
        radius=widest,
        masses=one,
        inertia_axial=one,
        inertia_transverse=one,
        rotor_inertia=0.0,
        friction=0.0,
        proportions=Proportions(lengths / mean, radii / (widest or 1.0), limits.ravel()),
        sections=None if arm.sections is None else _with_parts(arm.sections, own),
        bodies=(),
        tool=None,
        tool_links=links,
    )


def _with_parts(sections: ArcSections, own: BoolArray) -> ArcSections:
    """Return sections that bend evenly with further joints that do not bend, those of the parts of bodies."""
    links = np.flatnonzero(own)
    bending = {int(links[joint]) for joints in section_joints(sections) for joint in joints}
    return replace(sections, straight=tuple(joint for joint in range(1, len(own)) if joint not in bending))


def _relative_turns(steps: FloatArray, own: BoolArray) -> FloatArray:
    """Return the turn of each part against the one before it, where the arm is straight.

    Args:
        steps: vectors along the parts in the frames of their links, shape (m, d) [m].
        own: mask of the links of the arm, shape (m,).

    Returns:
        Angles, shape (m,) [rad], in the plane; rotations, shape (m, 3, 3), in space.
    """
    if steps.shape[1] == 2:
        before = np.vstack(([[1.0, 0.0]], steps[:-1]))
        sine = before[:, 0] * steps[:, 1] - before[:, 1] * steps[:, 0]
        return np.asarray(np.arctan2(sine, np.sum(before * steps, axis=1)))
    frames = [np.eye(3)]
    for step, is_link in zip(steps, own, strict=True):
        if is_link:
            frames.append(np.eye(3))
            continue
        # Householder: the reflection that swaps x with the direction, and a second one that makes it a rotation.
        along = step / np.linalg.norm(step)
        sign = -1.0 if along[0] > 0.0 else 1.0
        normal = sign * along - np.eye(3)[0]
        reflection = np.eye(3) - 2.0 * np.outer(normal, normal) / (normal @ normal)
        frames.append(reflection @ np.diag([sign, 1.0, -sign]))
    return np.array([before.T @ after for before, after in pairwise(frames)])


def _compared(parts: _Parts, own: BoolArray) -> BoolArray:
    """Return a mask of the pairs of a part of the chain and a later one that must stay apart, shape (m, m).

    Links of the arm stay apart as they do without bodies. A capsule of a body stays apart from the capsules and links
    that are not fixed to its own link and not near it while the arm is straight.
    """
    from ccm_opt.verification.selfcollision import far_along_arm, segment_distances  # noqa: PLC0415 - which imports this

    arm = parts.arm
    count = len(own)
    compared = np.zeros((count, count), dtype=bool)
    compared[np.ix_(own, own)] = far_along_arm(replace(arm, bodies=(), tool=None))
    ends_of_links = np.cumsum(arm.lengths)
    carrier, radius = np.array(parts.carrier), np.array(parts.radius)
    one = np.array(parts.start)
    one[:, 0] += ends_of_links[carrier]
    other = one + np.array(parts.step)
    solid = radius >= 0.0
    for part in np.flatnonzero(~own & solid):
        apart = segment_distances(*np.broadcast_arrays(one[part], other[part], one, other))
        both = radius + radius[part]
        far = solid & (carrier != carrier[part]) & (apart - both > _NEIGHBOURS * both)
        compared[part, part:] |= far[part:]
        compared[:part, part] |= far[:part]
    return compared


def uncompared_bodies(arm: Arm) -> list[str]:
    """Return a remark for each link that a body may touch, since it does so, or nearly does, on the straight arm."""
    links = arm_with_bodies(arm).tool_links if arm.rigid_bodies and arm.self_collision else None
    if links is None:
        return []
    found: dict[tuple[str, str], None] = {}
    for part in np.flatnonzero(~links.own & ~links.bare):
        apart = ~(links.distant[part] | links.distant[:, part]) & (links.carriers != links.carriers[part])
        near = links.carriers[apart & links.own].tolist()
        found |= dict.fromkeys((links.names[part], section_of(arm, link) or f"link {link + 1}") for link in near)
    return [
        f"clearance between {name} and {number}, which are near each other on the straight arm, was not checked"
        for name, number in found
    ]
