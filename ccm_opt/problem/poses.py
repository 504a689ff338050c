"""Start poses, goals and intermediate goals of a motion, with the tolerances of reaching them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self, TypeAlias

import numpy as np

from ccm_opt.core.arguments import Arguments, finite_array, in_words, is_number
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import LengthUnit
from ccm_opt.core.polyline import unit_vector
from ccm_opt.robot.arm import Arm, MappingName
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.coordinates import FEED, Coordinates
from ccm_opt.robot.mapping import map_curve
from ccm_opt.robot.tool import across
from ccm_opt.scene.surface_pieces import surface_centre
from ccm_opt.scene.workspace import Workspace


@dataclass(frozen=True)
class JointPose:
    """A pose of the whole arm, given by its joint angles; may be the start or a goal of a motion.

    Attributes:
        bends: bend angles of the joints of n links, shape (n,) [rad]; in space, angles about the local z axis and then
            the new y axis, shape (n, 2).
        feed: position of the base on its feed axis [m], or of the k axes that carry it, shape (k,) [m, rad]; 0 without
            them.
        curve: backbone curve to which the joints were fitted, positioned for a feed of 0; None if the joint angles
            alone define the pose. A motion reaches the pose when the arm follows the curve, by any mapping.
        mapping: name of the method that fits the joints to the curve.
        name: name of the goal in messages and pictures; empty for none, and at the start.
    """

    bends: FloatArray
    feed: FloatArray | float = 0.0
    curve: Configuration | None = None
    mapping: MappingName = "least-squares"
    name: str = ""
    direction: ClassVar[None] = None
    heading: ClassVar[None] = None
    via: ClassVar[tuple[FloatArray, ...]] = ()
    path: ClassVar[None] = None
    look_at: ClassVar[None] = None
    up: ClassVar[None] = None
    for_tip: ClassVar[None] = None

    @property
    def for_joints(self) -> "JointPose":
        """This pose itself, since as a goal it gives all joints; None in the case of a ``TipGoal``."""
        return self

    @classmethod
    def along(cls, arm: Arm, curve: Configuration, mapping: MappingName = "least-squares", feed: float = 0.0) -> Self:
        """Return the pose of a planar arm whose joints are fitted to a backbone curve.

        Args:
            arm: the arm, as long as the curve.
            curve: the backbone curve, positioned for a feed of 0.
            mapping: name of the method that fits the joints to the curve.
            feed: position of the base on its feed axis [m]; 0 without one.

        Raises:
            ProblemError: arm and curve differ in length, or the mapping does not exist for this curve.
        """
        return cls(map_curve(arm, curve, mapping), feed, curve, mapping)

    @classmethod
    def of_degrees(
        cls,
        bends_deg: Sequence[float] | Sequence[Sequence[float]] | FloatArray,
        *,
        feed: float = 0.0,
        unit: LengthUnit = "m",
    ) -> "JointPose":
        """Return a pose from joint angles in degrees and a feed in a unit of choice.

        Args:
            bends_deg: bend angles of the joints of n links, shape (n,), in space (n, 2) [deg].
            feed: position of the base on its feed axis, in ``unit``; 0 without one.
            unit: unit of the feed: "m", "mm" or "in".

        Raises:
            ProblemError: an argument is invalid; the message lists every defect.
        """
        given = Arguments("this pose", unit)
        found = finite_array(bends_deg)
        given.must(
            found is not None and (found.ndim == 1 or (found.ndim == 2 and found.shape[1] == 2)),
            f"bends_deg: expected a list of numbers, or in space of pairs of numbers, got {in_words(bends_deg)}",
        )
        carried = given.length("feed", feed)
        given.refuse()
        return cls(np.deg2rad(np.asarray(found)), carried)

    def headings(self, arm: Arm) -> FloatArray:
        """Return the headings of the n links of a planar arm in this pose, shape (n,) [rad]."""
        return arm.headings(self.bends)

    @classmethod
    def from_configuration(cls, q: FloatArray, coordinates: Coordinates) -> "JointPose":
        """Return the pose that corresponds to a configuration.

        Args:
            q: configuration with c coordinates, shape (c,) [rad, m].
            coordinates: layout of the coordinates.
        """
        bends = q[coordinates.bends]
        if coordinates.bends_a_joint > 1:
            bends = bends.reshape(-1, coordinates.bends_a_joint)
        if coordinates.base_names in {(), (FEED,)}:
            return cls(bends.copy(), float(coordinates.advance(q)))
        return cls(bends.copy(), q[coordinates.base].copy())

    def configuration(self, arm: Arm) -> FloatArray:
        """Return the pose as a configuration of the given arm, with one entry per coordinate, shape (c,) [rad, m]."""
        return arm.configuration(self.bends, self.feed)

    def whole(self, arm: Arm) -> FloatArray | None:
        """Return the configuration that this pose, as a goal, requires of the whole arm, shape (c,) [rad, m]."""
        return self.configuration(arm)

    def tip(self, arm: Arm) -> FloatArray:
        """Return the position of the tip in this pose, shape (2,) in the plane or (3,) in space [m]."""
        return np.asarray(arm.joint_positions_at(self.configuration(arm))[-1])


@dataclass(frozen=True)
class Tolerances:
    """Maximum deviations at a goal.

    Attributes:
        position: of the tip position [m].
        heading: of the heading or direction of the last link [rad].
        roll: of the roll about the goal's direction, if the goal has an up direction [rad].
    """

    position: float = 1e-3
    heading: float = float(np.deg2rad(1.0))
    roll: float = float(np.deg2rad(1.0))


@dataclass(frozen=True)
class LookAt:
    """A place that the arm looks at with its tip or tool, from any place where these conditions hold.

    The direction of the last link, or of the tool, is the optical axis; roll about it is free. The line of sight, from
    the tip to the place, must be free of obstacles and of the arm, with a thin cone about it whose apex is the place.

    Attributes:
        place: the place, usually on a surface, shape (2,) or (3,) [m].
        distance: least and greatest distance of the tip from the place [m].
        field_of_view: full angle of the field of view about the optical axis, in which the place must lie [rad].
        normal: outward unit normal of the surface at the place, shape (2,) or (3,); None if it does not matter.
        angle: greatest angle between the normal and the line of sight [rad]; without effect if there is no normal.
    """

    place: FloatArray
    distance: tuple[float, float]
    field_of_view: float
    normal: FloatArray | None = None
    angle: float = 0.5 * np.pi

    @property
    def tolerances(self) -> Tolerances:
        """Tolerances of a goal at the place itself that every tip from which the arm may look keeps."""
        return Tolerances(self.distance[1], np.pi)


@dataclass(frozen=True)
class Coverage:
    """A share of surfaces that the arm has to see, piece by piece, from the goals at which it comes to rest.

    Edges in the plane and triangles in space are divided into equal pieces without an edge longer than ``spacing``. A
    piece counts with its length or area. It is seen from a tip if its centre is: within the distances, the field of
    view and the angle, and with a free line of sight as for ``LookAt``.

    Attributes:
        surfaces: names of obstacles; "room" for the walls of the room.
        share: least fraction of the surfaces that is seen, above 0 and at most 1.
        spacing: greatest length of an edge of a piece [m].
        distance: least and greatest distance of the tip from what it sees [m].
        field_of_view: full angle of the field of view about the optical axis [rad].
        angle: greatest angle between the line of sight and the normal of the surface, to either side [rad].
        within: lower and upper corner of a box, shape (2, d) [m]: only pieces with their centres in it count; None for
            all.
    """

    surfaces: tuple[str, ...]
    share: float
    spacing: float
    distance: tuple[float, float]
    field_of_view: float
    angle: float = 0.5 * np.pi
    within: FloatArray | None = None


@dataclass(frozen=True)
class TipGoal:
    """A goal for position and direction of the arm's tip, which leaves all other joints free.

    In the plane ``heading`` is the angle of ``direction``. Either may be given; if both are given, ``heading`` applies.

    Attributes:
        position: position of the tip, shape (2,) or (3,) [m].
        direction: unit vector along the last link, shape (2,) or (3,); None if any direction is allowed.
        via: positions that the tip must pass before the goal, in order, each of shape (3,) [m]; empty in the plane.
        heading: heading of the last link in the plane [rad]; None in space, and if any heading is allowed.
        path: points of a path in space that the tip follows to the goal, from where it starts, shape (m ≥ 2, 3) [m];
            None if the way is free. The path is the natural cubic spline through the points over their chord lengths.
        look_at: what the arm looks at from this goal, see ``looking``; None if the goal is the position itself.
        up: where the tool's up axis, or the z axis of the last link, points as seen along ``direction``, shape (3,),
            not parallel to it; None if any roll about the direction is allowed.
        name: name of the goal in messages and pictures; empty for none.
    """

    position: FloatArray
    direction: FloatArray | None = None
    via: tuple[FloatArray, ...] = ()
    heading: float | None = None
    path: FloatArray | None = None
    look_at: LookAt | None = None
    up: FloatArray | None = None
    name: str = ""
    for_joints: ClassVar[None] = None

    @property
    def for_tip(self) -> "TipGoal":
        """This goal itself, since it constrains the tip only; None in the case of a ``JointPose``."""
        return self

    def __post_init__(self) -> None:
        # Values that are no number or no vector are left alone here: the problem that gets the goal refuses them.
        if is_number(self.heading):
            object.__setattr__(self, "direction", unit_vector(self.heading))
        elif self.direction is not None and np.shape(self.direction) == (2,):
            object.__setattr__(self, "heading", float(np.arctan2(self.direction[1], self.direction[0])))

    def whole(self, _arm: Arm) -> FloatArray | None:
        """Return None, since a goal for the tip does not determine the configuration of the whole arm."""
        return None

    def tip(self, _arm: Arm) -> FloatArray:
        """Return the required position of the tip, shape (2,) or (3,) [m]."""
        return self.position

    def roll_of(self, up: FloatArray) -> float:
        """Return the angle about the goal's direction from its up direction to another one, in space [rad].

        Both are seen along the direction. The goal must have an up direction.

        Args:
            up: the other direction, shape (3,).
        """
        direction = np.asarray(self.direction)
        above = across(np.asarray(self.up), direction)
        return float(np.arctan2(up @ np.cross(direction, above), up @ above))

    @classmethod
    def looking(cls, look_at: LookAt) -> "TipGoal":
        """Return the goal of looking at a place; its tolerances must be ``look_at.tolerances``."""
        return cls(look_at.place, look_at=look_at)

    @classmethod
    def seeing(cls, coverage: Coverage, workspace: Workspace) -> "TipGoal":
        """Return the goal that stands for surfaces to be seen, for which the views are found later."""
        return cls(surface_centre(workspace, coverage.surfaces))

    @classmethod
    def at(
        cls,
        position: Sequence[float] | FloatArray,
        heading_deg: float | None = None,
        *,
        direction: Sequence[float] | FloatArray | None = None,
        up: Sequence[float] | FloatArray | None = None,
        unit: LengthUnit = "m",
    ) -> "TipGoal":
        """Return a goal for the tip from a position in a unit of choice and, in the plane, a heading in degrees.

        Args:
            position: position of the tip, (x, y), or (x, y, z) in space, in ``unit``.
            heading_deg: heading of the last link in the plane [deg]; None if any heading is allowed.
            direction: direction of the last link in space, a vector of any length; None if any direction is allowed.
            up: where the up axis of the tool, or of the last link, points in space as seen along ``direction``, a
                vector of any length; None if any roll is allowed.
            unit: unit of the position: "m", "mm" or "in".

        Raises:
            ProblemError: an argument is invalid; the message lists every defect.
        """
        given = Arguments("this goal", unit)
        found = finite_array(position)
        in_space = found is not None and found.shape == (3,)
        names = "numbers (x, y, z)" if in_space else "numbers (x, y)"
        place = given.metres * given.numbers("position", position, 3 if in_space else 2, names)
        if not in_space:
            given.must(direction is None, "direction: only allowed in space; expected heading_deg in the plane")
            given.must(up is None, "up: only allowed in space; in the plane nothing rolls")
            heading = None if heading_deg is None else given.number("heading_deg", heading_deg)
            given.refuse()
            return cls(place, heading=None if heading is None else float(np.deg2rad(heading)))
        given.must(heading_deg is None, "heading_deg: only allowed in the plane; expected direction in space")
        along = None if direction is None else given.numbers("direction", direction, 3, names)
        given.must(along is None or bool(np.any(along)), "direction: expected a nonzero vector")
        above = None if up is None else given.numbers("up", up, 3, names)
        given.must(above is None or bool(np.any(above)), "up: expected a nonzero vector")
        given.refuse()
        pointing = None if along is None else along / np.linalg.norm(along)
        return cls(place, pointing, up=None if above is None else above / np.linalg.norm(above))


Goal: TypeAlias = TipGoal | JointPose


def name_suffix(goal: Goal) -> str:
    """Return the name of a goal as messages add it to its number; empty without a name."""
    return f" ('{goal.name}')" if goal.name else ""


@dataclass(frozen=True)
class Stop:
    """An intermediate goal, at which the arm comes to rest.

    Attributes:
        goal: goal at which the arm stops.
        tolerances: maximum deviation from the goal.
        pause: time for which the arm rests at the goal [s].
    """

    goal: Goal
    tolerances: Tolerances
    pause: float = 0.0
