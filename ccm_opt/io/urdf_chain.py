"""The chain of joints of a robot as an arm: the straight line of the arm, its joints along it, and its frame.

A chain is an arm if, at zero, the axes of its revolutes meet one line at right angles: the line is the x axis of the
arm, each place on it where axes meet is a joint, and the axes of all joints are parallel to two directions, z and y. A
joint turns about z, then about y, or about one of the two; a third revolute of a joint is held at zero. Where the
origins of joints lie on their own axes does not matter, nor do the frames of links.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import file_length
from ccm_opt.io.urdf import MOVING, Joint, Link, Robot
from ccm_opt.robot.arm import Axes
from ccm_opt.scene.bodies import RigidPlacement

_ASKEW = 1e-3
"""Angle up to which axes count as parallel or perpendicular [rad]. Heuristic: files that give π/2 as 1.57 pass."""
_ASIDE = 1e-3
"""Distance, as a fraction of the chain's extent, up to which axes count as meeting the line of the arm. Heuristic."""
_SAME = 1e-6
"""Distance along the arm, as a fraction of the chain's extent, up to which joints count as one. Derived: places written
with six digits."""
_ALIKE = 1e-5
"""Excess of the cosine between directions over 1 up to which candidates for the direction of the arm are alike."""


@dataclass(frozen=True, eq=False)
class PlacedLink:
    """A link in its place when all joints are at zero.

    Attributes:
        link: the link.
        placement: placement in the frame of the root link.
        joint: name of the joint that carries the link; empty for the root.
    """

    link: Link
    placement: RigidPlacement
    joint: str = ""


@dataclass(frozen=True, eq=False)
class PlacedJoint:
    """A moving joint in its place when all joints are at zero.

    Attributes:
        joint: the joint.
        place: a point of its axis in the frame of the root link, shape (3,) [m].
        axis: its axis in that frame, a unit vector, shape (3,).
    """

    joint: Joint
    place: FloatArray
    axis: FloatArray

    @property
    def name(self) -> str:
        """Name of the joint, for messages."""
        return f"joint '{self.joint.name}'"


Part: TypeAlias = tuple[PlacedLink, ...]
"""Links that are fixed to each other, that nearest to the root first."""


@dataclass(frozen=True, eq=False)
class Chain:
    """Moving joints one after the other, and the rigid parts between them.

    Attributes:
        joints: the moving joints from the root outward.
        parts: the rigid parts: the first carries the first joint, each other is carried by a joint.
    """

    joints: tuple[PlacedJoint, ...]
    parts: tuple[Part, ...]


def moving_chain(robot: Robot) -> Chain:
    """Return the moving joints of a robot if they form a chain.

    Raises:
        ProblemError: they do not, or a joint is of a kind that is not read; the message names the joint.
    """
    name, placement, carrier = robot.root, RigidPlacement(), ""
    joints: list[PlacedJoint] = []
    parts: list[Part] = []
    while True:
        part: list[PlacedLink] = []
        moving: list[tuple[PlacedJoint, RigidPlacement]] = []
        pending = [PlacedLink(robot.links[name], placement, carrier)]
        while pending:
            placed = pending.pop(0)
            part.append(placed)
            for each in robot.joints:
                if each.parent != placed.link.name:
                    continue
                there = each.placement.placed(placed.placement)
                if each.kind == "fixed":
                    pending.append(PlacedLink(robot.links[each.child], there, each.name))
                    continue
                _refuse_kind(each)
                moving.append((PlacedJoint(each, there.position, there.rotation @ each.axis), there))
        parts.append(tuple(part))
        if not moving:
            return Chain(tuple(joints), tuple(parts))
        if len(moving) > 1:
            raise ProblemError(
                f"{moving[1][0].name} branches off beside {moving[0][0].name}; expected joints one after the other: "
                f"make "
                "those that do not belong to the arm fixed"
            )
        ((joint, placement),) = moving
        joints.append(joint)
        name, carrier = joint.joint.child, joint.joint.name


def _refuse_kind(joint: Joint) -> None:
    """Raise an error for a joint that has more than one degree of freedom, or does not move by itself."""
    if joint.kind not in MOVING:
        raise ProblemError(f"joint '{joint.name}' is {joint.kind}; expected revolute, continuous or fixed")
    if joint.mimic:
        raise ProblemError(
            f"joint '{joint.name}' follows '{joint.mimic}' (mimic); expected joints that move by themselves"
        )


@dataclass(frozen=True, eq=False)
class Revolute:
    """A revolute of a joint of the arm.

    Attributes:
        joint: the joint of the file.
        sense: +1 if it turns about the arm's axis, −1 if about its negative.
    """

    joint: Joint
    sense: float


@dataclass(frozen=True, eq=False)
class ArmJoint:
    """A joint of the arm, of one to three revolutes.

    Attributes:
        place: distance from the first joint along the arm [m].
        revolutes: its revolutes about z, about y and the third; None where it has none.
        parts: numbers of the parts that its revolutes carry; the last is a link of the arm.
    """

    place: float
    revolutes: tuple[Revolute | None, Revolute | None, Revolute | None]
    parts: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class JointedLine:
    """A chain as an arm.

    Attributes:
        chain: the chain.
        frame: placement of the frame of the first joint: x along the straight arm.
        axes: order of the revolutes of a joint.
        joints: the joints of the arm.
        feed: the prismatic joint that carries the arm along its line, with its sense; None if there is none.
        askew: greatest angle between an axis of the file and that of the arm [rad].
        aside: greatest distance of an axis of the file from the line of the arm [m].
    """

    chain: Chain
    frame: RigidPlacement
    axes: Axes
    joints: tuple[ArmJoint, ...]
    feed: Revolute | None
    askew: float
    aside: float

    def along(self, points: FloatArray) -> FloatArray:
        """Return points (..., 3) of the root's frame in the frame of the first joint, shape (..., 3) [m]."""
        return np.asarray((points - self.frame.position) @ self.frame.rotation)


def jointed_line(chain: Chain, *, in_space: bool) -> JointedLine:
    """Return a chain as an arm in space or in the plane.

    Raises:
        ProblemError: the chain is no such arm; the message names the joint.
    """
    sliding = [joint for joint in chain.joints if joint.joint.kind == "prismatic"]
    turning = tuple(joint for joint in chain.joints if joint.joint.kind != "prismatic")
    if len(turning) < 2:
        raise ProblemError(f"it has {len(turning)} revolute joints; expected at least two")
    extent = _extent(chain)
    origin, x = _line(turning, chain, extent)
    feed = _feed(sliding, chain, x)
    bends = np.abs(np.stack([joint.axis for joint in turning]) @ x) < 0.5
    groups = list(_groups(turning, bends, origin, x, extent))
    first = next(joint for joint, bent in zip(turning, bends, strict=True) if bent)
    classes = {joint.joint.name: _class(joint, first, x) for joint, bent in zip(turning, bends, strict=True) if bent}
    frame_of = _space_frame if in_space else _plane_frame
    y, z, axes = frame_of(groups, classes, x)
    frame = RigidPlacement(origin + groups[0][0] * x, np.column_stack((x, y, z)))
    shift = len(chain.joints) - len(turning)
    joints = []
    number = shift
    for place, members in groups:
        slots = _slots(members, frame.rotation, axes)
        joints.append(ArmJoint(place - groups[0][0], slots, tuple(range(number + 1, number + len(members) + 1))))
        number += len(members)
    askew = max(_askew(joint, frame.rotation) for joint in turning)
    aside = float(np.max(_offsets(turning, bends, origin, x)))
    return JointedLine(chain, frame, axes, tuple(joints), feed, askew, aside)


def _extent(chain: Chain) -> float:
    points = [*(joint.place for joint in chain.joints), *(each.placement.position for each in chain.parts[-1])]
    return float(np.linalg.norm(np.ptp(np.stack(points), axis=0))) or 1.0


def _line(turning: Sequence[PlacedJoint], chain: Chain, extent: float) -> tuple[FloatArray, FloatArray]:
    """Return a point of the line of the arm, (3,) [m], and its direction outward, (3,).

    Of several candidates that is the line which most axes meet at right angles.

    Raises:
        ProblemError: an axis does not meet that line as it should; the message names the joint.
    """
    axes = np.stack([joint.axis for joint in turning])
    places = np.stack([joint.place for joint in turning])
    ends = np.stack([each.placement.position for each in chain.parts[-1]])
    best: tuple[tuple[int, int], FloatArray] | None = None
    for x in _directions(axes, places, ends):
        across = np.abs(axes @ x)
        bends = across < np.sin(_ASKEW)
        fits = bends | (np.linalg.norm(axes - np.sign(axes @ x)[:, None] * x, axis=1) < _ASKEW)
        off = _offsets(turning, bends, _point(turning, bends & fits, x), x)
        score = (int(np.sum(~fits | (off > _ASIDE * extent))), -int(np.sum(bends)))
        if best is None or score < best[0]:
            best = score, x
    assert best is not None  # noqa: S101 - there is a direction for every axis
    x = best[1]
    for joint in turning:
        lean = float(np.arccos(np.clip(abs(joint.axis @ x), 0.0, 1.0)))
        if _ASKEW < lean < 0.5 * np.pi - _ASKEW:
            raise ProblemError(
                f"{joint.name}: at zero its axis is {np.rad2deg(lean):.4g}° off the line of the arm; expected a right "
                "angle, on an arm that is straight at zero (π/2 needs more digits than 1.57)"
            )
    bends = np.abs(axes @ x) < 0.5
    if not np.any(bends):
        raise ProblemError("all joints turn about the line of the arm; expected joints that bend it")
    origin = _point(turning, bends, x)
    off = _offsets(turning, bends, origin, x)
    worst = int(np.argmax(off))
    if off[worst] > _ASIDE * extent:
        by = file_length(float(off[worst]), 4)
        raise ProblemError(
            f"{turning[worst].name}: at zero its axis passes the line of the arm at a distance of {by}; "
            "expected axes that meet one line: an arm that is straight at zero, without offsets between its axes"
        )
    outward = float(np.sum((places[bends] - places[bends][0]) @ x))
    if abs(outward) < _SAME * extent:  # a single joint
        outward = float(np.sum((ends - places[bends][0]) @ x))
    return origin, x if outward >= 0.0 else -x


def _directions(axes: FloatArray, places: FloatArray, ends: FloatArray) -> Iterator[FloatArray]:
    """Yield unit vectors that may be the direction of the arm, (3,), no two alike."""
    first = axes[0]
    crossed = np.concatenate((np.cross(axes[1:], first), np.cross(axes[1:], axes[:-1])))
    across = np.concatenate((places[1:], ends)) - places[0]
    across = across - np.outer(across @ first, first)
    seen: list[FloatArray] = []
    for vector in (*crossed[np.linalg.norm(crossed, axis=1) > 0.1], *across[::-1], *axes):
        length = float(np.linalg.norm(vector))
        if length == 0.0:
            continue
        x = vector / length
        if all(abs(x @ other) < 1.0 - _ALIKE for other in seen):
            seen.append(x)
            yield x


def _point(turning: Sequence[PlacedJoint], used: BoolArray, x: FloatArray) -> FloatArray:
    """Return the point nearest to the first joint on the line along x that the axes meet best, shape (3,) [m]."""
    begin = turning[0].place
    normals = np.array([np.cross(x, joint.axis) for joint, use in zip(turning, used, strict=True) if use])
    if not len(normals):
        return begin
    steps = np.array([joint.place - begin for joint, use in zip(turning, used, strict=True) if use])
    found = np.linalg.lstsq(normals, np.sum(normals * steps, axis=1), rcond=1e-9)[0]
    return np.asarray(begin + found - (found @ x) * x)


def _offsets(turning: Sequence[PlacedJoint], bends: BoolArray, origin: FloatArray, x: FloatArray) -> FloatArray:
    """Return the distance of every joint's axis from the line of the arm, shape (n,) [m]."""
    steps = np.stack([joint.place for joint in turning]) - origin
    normals = np.cross(x, np.stack([joint.axis for joint in turning]))
    across = np.linalg.norm(steps - np.outer(steps @ x, x), axis=1)
    return np.asarray(np.where(bends, np.abs(np.sum(normals * steps, axis=1)), across))


def _feed(sliding: Sequence[PlacedJoint], chain: Chain, x: FloatArray) -> Revolute | None:
    """Return the prismatic joint that comes before all others and moves along the arm.

    Raises:
        ProblemError: there is another prismatic joint.
    """
    for joint in sliding:
        along = float(joint.axis @ x)
        if joint is not chain.joints[0] or 1.0 - abs(along) > 0.5 * _ASKEW**2:
            raise ProblemError(
                f"{joint.name} is prismatic; expected revolute joints, after at most one that moves the arm along "
                f"its line"
            )
    return Revolute(sliding[0].joint, float(np.sign(sliding[0].axis @ x))) if sliding else None


_Group: TypeAlias = tuple[float, tuple[PlacedJoint, ...]]
"""Place along the arm of revolutes that make up a joint, and the revolutes."""


def _groups(
    turning: Sequence[PlacedJoint], bends: BoolArray, origin: FloatArray, x: FloatArray, extent: float
) -> Iterator[_Group]:
    """Yield the revolutes that meet in one place, from the base outward.

    Raises:
        ProblemError: a joint lies behind the one before, or turns about the arm where no other bends it.
    """
    place = 0.0
    members: list[PlacedJoint] = []
    for joint, bent in zip(turning, bends, strict=True):
        here = float((joint.place - origin) @ x) if bent else place
        if not bent and not members:
            raise ProblemError(f"{joint.name} turns about the line of the arm; expected a joint that bends it")
        if members and here < place - _SAME * extent:
            back = file_length(place - here, 4)
            raise ProblemError(f"{joint.name} lies {back} behind {members[-1].name} along the arm; expected it beyond")
        if members and here > place + _SAME * extent:
            yield place, tuple(members)
            members = []
        place = here if not members else place
        members.append(joint)
    yield place, tuple(members)


def _class(joint: PlacedJoint, first: PlacedJoint, x: FloatArray) -> int:
    """Return 0 if a joint's axis is parallel to that of the first that bends the arm, 1 if perpendicular.

    Raises:
        ProblemError: it is neither.
    """
    turn = np.arctan2(np.cross(first.axis, joint.axis) @ x, first.axis @ joint.axis)
    quarter = int(np.round(turn / (0.5 * np.pi)))
    if abs(turn - quarter * 0.5 * np.pi) > _ASKEW:
        raise ProblemError(
            f"{joint.name}: its axis is turned by {np.rad2deg(turn):.4g}° about the arm from that of {first.name}; "
            f"expected "
            "a multiple of 90°"
        )
    return quarter % 2


_Classes: TypeAlias = dict[str, int]
"""For the name of every joint that bends the arm, 0 or 1: about which of two perpendicular directions it turns."""


def _space_frame(groups: Sequence[_Group], classes: _Classes, x: FloatArray) -> tuple[FloatArray, FloatArray, Axes]:
    """Return the y and z axes of an arm in space, each (3,), and the order of a joint's revolutes.

    Raises:
        ProblemError: a joint has two revolutes about one axis, or joints turn about the two in a different order.
    """
    order: int | None = None
    for _, members in groups:
        kinds = [classes.get(joint.joint.name, 2) for joint in members]
        for k, (one, other) in enumerate(pairwise(kinds)):
            if one in {other, 2} or k > 1 or (k == 1 and other != 2):
                raise ProblemError(
                    f"{members[k + 1].name} turns in the same place as {members[k].name}; expected two axes across "
                    f"the arm, "
                    "perpendicular to each other, and at most one along it after them"
                )
            if other != 2 and order not in {None, one}:
                raise ProblemError(
                    f"{members[k].name} and {members[k + 1].name} turn in another order than the joints before; "
                    f"expected "
                    "the same order along the arm"
                )
            order = one if other != 2 else order
    upright = _axis_of(groups, classes, 0), _axis_of(groups, classes, 1)
    if order is None:
        # Any: the one that is more upright in the frame of the root, so that ``up`` is what users expect.
        heights = [-1.0 if axis is None else abs(axis[2]) for axis in upright]
        order = int(heights[1] > heights[0] + _ASKEW)
    z = upright[order]
    assert z is not None  # noqa: S101 - the order is that of axes found
    z = z - (z @ x) * x
    z /= np.linalg.norm(z)
    return np.cross(z, x), z, "zyx"


def _axis_of(groups: Sequence[_Group], classes: _Classes, kind: int) -> FloatArray | None:
    """Return the axis of the first joint of a class, shape (3,); None if there is none."""
    found = (joint.axis for _, members in groups for joint in members if classes.get(joint.joint.name) == kind)
    return next(found, None)


def _plane_frame(groups: Sequence[_Group], classes: _Classes, x: FloatArray) -> tuple[FloatArray, FloatArray, Axes]:
    """Return the axes y, normal to the plane of the arm, and z, each (3,), and the order of a joint's revolutes.

    Raises:
        ProblemError: not every joint has a revolute about one normal, or other revolutes than the model has.
    """
    normals = []
    for kind in (0, 1):
        without = [members for _, members in groups if kind not in {classes.get(joint.joint.name) for joint in members}]
        if not without and (axis := _axis_of(groups, classes, kind)) is not None:
            normals.append((kind, axis))
        elif without:
            lacking = without[0][0]
    if not normals:
        raise ProblemError(
            f"{lacking.name} does not bend the arm in the plane of the joints before; write space = 3 for an arm in "
            f"space"
        )
    kind, y = max(normals, key=lambda each: abs(each[1][1]))
    y = y - (y @ x) * x
    y /= np.linalg.norm(y)
    if y[1] < -1.0 + _ASKEW:
        y = -y
    axes: set[Axes] = set()
    for _, members in groups:
        kinds = [classes.get(joint.joint.name, 2) for joint in members]
        at = kinds.index(kind)
        before, after = kinds[:at], kinds[at + 1 :]
        if len(before) > 1 or len(after) > 1 or 2 in before or kind in after:
            raise ProblemError(
                f"{members[-1].name} turns in the same place as {members[0].name}, which is not supported"
            )
        axes.update("zyx" if other == 2 else "zyz" for other in after)
    if len(axes) > 1:
        raise ProblemError("the third axes of its joints differ; expected all along the arm, or all across it")
    return y, np.cross(x, y), next(iter(axes), "zyx")


def _slots(
    members: Sequence[PlacedJoint], rotation: FloatArray, axes: Axes
) -> tuple[Revolute | None, Revolute | None, Revolute | None]:
    """Return the revolutes of a joint by their axis: z, y, and x or again z."""
    slots: list[Revolute | None] = [None, None, None]
    for joint in members:
        along = joint.axis @ rotation
        k = int(np.argmax(np.abs(along)))
        slot = 2 - k
        if slot == 0 and axes == "zyz" and slots[1] is not None:
            slot = 2
        slots[slot] = Revolute(joint.joint, float(np.sign(along[k])))
    return slots[0], slots[1], slots[2]


def _askew(joint: PlacedJoint, rotation: FloatArray) -> float:
    """Return the angle between a joint's axis and the nearest axis of the arm's frame [rad]."""
    along = joint.axis @ rotation
    rest = np.delete(along, int(np.argmax(np.abs(along))))
    return float(np.arctan2(np.linalg.norm(rest), np.max(np.abs(along))))
