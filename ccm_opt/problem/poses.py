"""Where a motion begins, ends and stops on the way, and how near its goals count."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeAlias

import numpy as np

from ccm_opt.core.arguments import Arguments, finite_array
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.expected import in_words
from ccm_opt.core.length_words import LengthUnit
from ccm_opt.core.polyline import unit_vector
from ccm_opt.robot.arm import Arm, MappingName
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.robot.mapping import map_curve


@dataclass(frozen=True)
class JointPose:
    """A whole-arm pose given by its joints.

    Attributes:
        bends: shape (links,) [rad].
        feed: position of the base on its feed axis [m]; 0 without one.
        curve: that the arm is laid along, as it lies when the feed axis is at 0; None where there is none. A motion
            counts as there when the arm lies along it, by whichever mapping.
        mapping: how it is laid there.
    """

    bends: FloatArray
    feed: float = 0.0
    curve: Configuration | None = None
    mapping: MappingName = "least-squares"

    @classmethod
    def along(cls, arm: Arm, curve: Configuration, mapping: MappingName = "least-squares", feed: float = 0.0) -> Self:
        """Lay an arm along a curve in the plane, by one of the mappings from curves to joints.

        Args:
            arm: the arm, as long as the curve.
            curve: as it lies when the feed axis is at 0.
            mapping: how the joints are placed.
            feed: position of the base on its feed axis [m]; 0 without one.

        Raises:
            ProblemError: the lengths differ, or the mapping does not exist for this curve.
        """
        return cls(arm.bends(map_curve(arm, curve, mapping)), feed, curve, mapping)

    @classmethod
    def of_degrees(
        cls, bends_deg: Sequence[float] | FloatArray, *, feed: float = 0.0, unit: LengthUnit = "m"
    ) -> "JointPose":
        """A pose from bends in degrees, and the feed in the unit of length that suits.

        Raises:
            ProblemError: with all that is wrong with them.
        """
        given = Arguments("this pose", unit)
        found = finite_array(bends_deg)
        given.must(
            found is not None and found.ndim == 1, f"bends_deg: expected a list of numbers, got {in_words(bends_deg)}"
        )
        carried = given.length("feed", feed)
        given.refuse()
        return cls(np.deg2rad(np.asarray(found)), carried)

    def headings(self, arm: Arm) -> FloatArray:
        """Headings of the links in the plane, of a curve to the last bit its mapping; shape (links,) [rad]."""
        return arm.headings(self.bends) if self.curve is None else map_curve(arm, self.curve, self.mapping)

    @classmethod
    def from_configuration(cls, q: FloatArray, coordinates: Coordinates) -> "JointPose":
        """The pose of a configuration, shape (c,) [rad, m]."""
        return cls(q[coordinates.bends], float(coordinates.advance(q)))

    def configuration(self, arm: Arm) -> FloatArray:
        """The pose as a configuration of an arm, shape (c,) [rad, m]."""
        return arm.configuration(self.bends, self.feed)


@dataclass(frozen=True)
class TipGoal:
    """A goal for the tip alone.

    Attributes:
        position: shape (2,) [m].
        heading: [rad], or None when any heading will do.
    """

    position: FloatArray
    heading: float | None = None

    @property
    def direction(self) -> FloatArray | None:
        """Where the last link points, a unit vector of shape (2,), or None when any direction will do."""
        return None if self.heading is None else unit_vector(self.heading)

    @property
    def via(self) -> tuple[FloatArray, ...]:
        """Places that the tip passes on its way; none in the plane."""
        return ()

    @classmethod
    def at(
        cls, position: Sequence[float] | FloatArray, heading_deg: float | None = None, *, unit: LengthUnit = "m"
    ) -> "TipGoal":
        """A goal in the unit of length that suits, its heading in degrees.

        Args:
            position: of the tip, (x, y).
            heading_deg: of the last link [deg], or None when any heading will do.
            unit: of the position: "m", "mm" or "in".

        Raises:
            ProblemError: with all that is wrong with them.
        """
        given = Arguments("this goal", unit)
        place = given.metres * given.numbers("position", position, 2, "numbers (x, y)")
        heading = None if heading_deg is None else given.number("heading_deg", heading_deg)
        given.refuse()
        return cls(place, None if heading is None else float(np.deg2rad(heading)))


Goal: TypeAlias = TipGoal | JointPose


@dataclass(frozen=True)
class Tolerances:
    """How near the goal the motion must end: position [m] and heading [rad]."""

    position: float = 1e-3
    heading: float = float(np.deg2rad(1.0))


@dataclass(frozen=True)
class Stop:
    """A goal on the way, at which the motion comes to rest.

    Attributes:
        goal: where the arm stops.
        tolerances: how near the goal counts.
        pause: how long it rests there [s].
    """

    goal: Goal
    tolerances: Tolerances
    pause: float = 0.0
