"""Reading of URDF files into links and joints, without regard to what kind of robot they describe.

Unlike XML tools for robots, the reader refuses what it cannot represent exactly, by the name of the link or joint.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arguments import LARGEST
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.xml_document import parsed_xml
from ccm_opt.scene.bodies import RigidPlacement

MOVING = ("revolute", "continuous", "prismatic")
"""Types of joints with one degree of freedom."""
KNOWN_JOINTS = (*MOVING, "fixed", "floating", "planar")
"""All types of joints in URDF."""
_SHORTEST_AXIS = 1e-6
"""Norm below which the axis of a joint counts as zero."""
_LEAST_MASS = 1e-12
"""Mass below which a link has none [kg]: frames get as little where programs load no link without mass."""


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass of a link.

    Attributes:
        mass: mass [kg].
        centre: centre of mass in the link's frame, shape (3,) [m].
        inertia: moments of inertia about the centre, in the axes of the link's frame, shape (3, 3) [kg m²].
    """

    mass: float
    centre: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, eq=False)
class CollisionShape:
    """A collision body of a link.

    Attributes:
        kind: "box", "sphere", "cylinder", "capsule" or "mesh"; round shapes have their axis along z.
        size: sides of a box; radius, and length without caps, of a round shape [m]; scale of a mesh along its axes.
        placement: placement in the link's frame.
        file: file of a mesh, as written.
    """

    kind: str
    size: tuple[float, ...]
    placement: RigidPlacement
    file: str = ""


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid body of a robot; ``inertial`` is None for a link without mass."""

    name: str
    inertial: Inertial | None = None
    collisions: tuple[CollisionShape, ...] = ()


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two links.

    Attributes:
        name: name of the joint.
        kind: type, one of ``KNOWN_JOINTS``.
        parent: name of the link that carries the joint.
        child: name of the link that it moves.
        placement: placement of the child at zero, in the parent's frame.
        axis: axis of a moving joint, a unit vector in the child's frame, shape (3,).
        lower: lower bound on the position, soft limits included [rad, m].
        upper: upper bound [rad, m].
        velocity: bound on the velocity [rad/s, m/s]; 0 if none is given.
        effort: bound on torque or force [N m, N]; 0 if none is given.
        damping: viscous friction [N m s/rad].
        friction: dry friction [N m].
        mimic: name of the joint that it follows; empty if it moves by itself.
    """

    name: str
    kind: str
    parent: str
    child: str
    placement: RigidPlacement
    axis: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = 0.0
    effort: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    mimic: str = ""


@dataclass(frozen=True, eq=False)
class Robot:
    """The links and joints of a URDF file, which form a tree.

    Attributes:
        name: name of the robot.
        links: links by name.
        joints: joints in the order of the file.
        root: name of the link that no joint moves.
    """

    name: str
    links: Mapping[str, Link]
    joints: tuple[Joint, ...]
    root: str


def read_urdf(content: bytes) -> Robot:
    """Return the robot that a URDF file describes.

    Raises:
        ProblemError: the content is not a URDF, its links and joints form no tree, or a value is invalid; the message
            names the link or joint.
    """
    if b"<xacro:" in content:
        raise ProblemError("it has xacro macros; expected a URDF, for example from 'xacro arm.urdf.xacro > arm.urdf'")
    root, _ = parsed_xml(content)
    if root.tag != "robot":
        raise ProblemError(f"expected the outermost element robot, got {root.tag}")
    links = [_link(element) for element in root.findall("link")]
    joints = [_joint(element) for element in root.findall("joint")]
    for what, names in (("links", [each.name for each in links]), ("joints", [each.name for each in joints])):
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise ProblemError(f"two {what} have the name '{twice[0]}'")
    named = {link.name: link for link in links}
    return Robot(root.get("name", ""), named, tuple(joints), _root(named, joints))


def _root(links: Mapping[str, Link], joints: list[Joint]) -> str:
    """Return the name of the link that no joint moves.

    Raises:
        ProblemError: there is not exactly one, or a joint refers to a link that does not exist or is moved already.
    """
    carried: dict[str, Joint] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise ProblemError(f"joint '{joint.name}' refers to the link '{end}', which does not exist")
        if joint.child in carried:
            raise ProblemError(f"joints '{carried[joint.child].name}' and '{joint.name}' both carry '{joint.child}'")
        carried[joint.child] = joint
    roots = [name for name in links if name not in carried]
    if len(roots) != 1:
        listed = ", ".join(f"'{name}'" for name in roots[:3]) or "none"
        raise ProblemError(f"expected exactly one link that no joint carries; there is {listed}")
    reached, left = {roots[0]}, list(joints)
    while left:
        further = [joint for joint in left if joint.parent in reached]
        if not further:
            raise ProblemError(f"joint '{left[0].name}' is part of a loop")
        reached.update(joint.child for joint in further)
        left = [joint for joint in left if joint.child not in reached]
    return roots[0]


def _link(element: ET.Element) -> Link:
    name = _name(element, "link")
    where = f"link '{name}'"
    inertial = element.find("inertial")
    shapes = tuple(_shape(each, where) for each in element.findall("collision"))
    return Link(name, None if inertial is None else _inertial(inertial, where), shapes)


def _name(element: ET.Element, what: str) -> str:
    name = element.get("name", "")
    if not name:
        raise ProblemError(f"a {what} has no name")
    return name


def _inertial(element: ET.Element, where: str) -> Inertial | None:
    """Return the mass of a link; None if it has none."""
    mass = _one(element.find("mass"), "value", where, 0.0)
    if mass < 0.0:
        raise ProblemError(f"{where}: its mass is {mass:g} kg; expected 0 or more")
    placement = _placement(element, where)
    about = element.find("inertia")
    entries = {key: _one(about, key, where, 0.0) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
    inertia = np.array(
        [
            [entries["ixx"], entries["ixy"], entries["ixz"]],
            [entries["ixy"], entries["iyy"], entries["iyz"]],
            [entries["ixz"], entries["iyz"], entries["izz"]],
        ]
    )
    turn = placement.rotation
    return None if mass < _LEAST_MASS else Inertial(mass, placement.position, turn @ inertia @ turn.T)


def _shape(element: ET.Element, where: str) -> CollisionShape:
    geometry = element.find("geometry")
    found = [] if geometry is None else [each for each in geometry if each.tag]
    if len(found) != 1:
        raise ProblemError(f"{where}: a collision body has {len(found)} shapes; expected one")
    shape = found[0]
    placement = _placement(element, where)
    if shape.tag == "box":
        size = _numbers(shape, "size", 3, where)
    elif shape.tag == "sphere":
        size = (_one(shape, "radius", where),)
    elif shape.tag in {"cylinder", "capsule"}:
        size = (_one(shape, "radius", where), _one(shape, "length", where))
    elif shape.tag == "mesh":
        scale = _numbers(shape, "scale", 3, where, (1.0, 1.0, 1.0))
        return CollisionShape("mesh", scale, placement, shape.get("filename", ""))
    else:
        expected = "box, sphere, cylinder, capsule or mesh"
        raise ProblemError(f"{where}: a collision body is of the kind '{shape.tag}'; expected {expected}")
    if min(size) < 0.0:
        raise ProblemError(f"{where}: a {shape.tag} has a negative size")
    return CollisionShape(shape.tag, size, placement)


def _joint(element: ET.Element) -> Joint:
    name = _name(element, "joint")
    where = f"joint '{name}'"
    kind = element.get("type", "")
    if kind not in KNOWN_JOINTS:
        raise ProblemError(f"{where}: its type is '{kind}'; expected one of {', '.join(KNOWN_JOINTS)}")
    parent, child = (
        end.get("link", "") if (end := element.find(tag)) is not None else "" for tag in ("parent", "child")
    )
    axis = np.array(_numbers(element.find("axis"), "xyz", 3, where, (1.0, 0.0, 0.0)))
    length = float(np.linalg.norm(axis))
    if kind in MOVING and length < _SHORTEST_AXIS:
        raise ProblemError(f"{where}: its axis is zero")
    lower, upper = _range(element, kind, where)
    limit, mimic, dynamics = (element.find(tag) for tag in ("limit", "mimic", "dynamics"))
    return Joint(
        name,
        kind,
        parent,
        child,
        _placement(element, where),
        axis / (length or 1.0),
        lower,
        upper,
        velocity=abs(_one(limit, "velocity", where, 0.0)),
        effort=abs(_one(limit, "effort", where, 0.0)),
        damping=_one(dynamics, "damping", where, 0.0),
        friction=_one(dynamics, "friction", where, 0.0),
        mimic="" if mimic is None else mimic.get("joint", "?"),
    )


def _range(element: ET.Element, kind: str, where: str) -> tuple[float, float]:
    """Return the lower and upper bound on the position of a joint, within its soft limits."""
    if kind not in {"revolute", "prismatic"}:
        return -np.inf, np.inf
    limit = element.find("limit")
    lower, upper = _one(limit, "lower", where, 0.0), _one(limit, "upper", where, 0.0)
    soft = element.find("safety_controller")
    lower = max(lower, _one(soft, "soft_lower_limit", where, lower))
    upper = min(upper, _one(soft, "soft_upper_limit", where, upper))
    if lower > upper:
        raise ProblemError(f"{where}: its lower limit, {lower:g}, is above its upper one, {upper:g}")
    return lower, upper


def _placement(element: ET.Element, where: str) -> RigidPlacement:
    origin = element.find("origin")
    xyz = np.array(_numbers(origin, "xyz", 3, where, (0.0, 0.0, 0.0)))
    return RigidPlacement.turned(xyz, np.array(_numbers(origin, "rpy", 3, where, (0.0, 0.0, 0.0))))


def _one(element: ET.Element | None, key: str, where: str, default: float | None = None) -> float:
    return _numbers(element, key, 1, where, None if default is None else (default,))[0]


def _numbers(
    element: ET.Element | None, key: str, count: int, where: str, default: tuple[float, ...] | None = None
) -> tuple[float, ...]:
    """Return the numbers in an attribute of an element, or a default if the attribute or the element is missing."""
    text = None if element is None else element.get(key)
    if text is None:
        if default is not None:
            return default
        raise ProblemError(f"{where}: {key} is missing")
    values = _parsed(text)
    if len(values) != count:
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise ProblemError(f"{where}: {key} is '{text[:60]}'; expected {wanted}")
    return values


def _parsed(text: str) -> tuple[float, ...]:
    """Return the numbers in a text; none if any word is not a finite number."""
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        return ()
    return values if all(abs(value) <= LARGEST for value in values) else ()
