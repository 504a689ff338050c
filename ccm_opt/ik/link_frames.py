"""Links of an arm as symbols of the goal-pose NLP: the interface, and links in the plane that follow a curve.

Lengths are in units of the arm's length, axes are those of the straight arm at its base.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.row_program import Bounds, RowBlock, equal_to_zero
from ccm_opt.ik.spline_curve import CurveNumbers, FollowedCurve, joint_arcs
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration, Curve


@dataclass(frozen=True, eq=False)
class LinkFrames(ABC):
    """Symbols of the links of an arm and of what bends them, and the NLP constraints that tie them together.

    Attributes:
        links: number of links n.
        shares: length of each link as a fraction of the arm's; empty if all are equal.
        along: direction of each link in the frame that its joint turns, d numbers a link; empty if all lie along x.
        up: up axis of the last link in that frame, three numbers; empty if the goal allows any roll.
        carrier: axes that carry the base, from the ground, in space: 1 where it is revolute and 0 where it is
            prismatic, its direction and a point on it, seven numbers each; empty for a feed along the first axis.
    """

    links: int
    shares: tuple[float, ...] = ()
    along: tuple[float, ...] = ()
    up: tuple[float, ...] = ()
    carrier: tuple[tuple[float, ...], ...] = ()
    directions: ClassVar[tuple[str, ...]]
    """Names of the k directions in which joints bend; a joint has one bend for each."""
    start_keeps_rows: ClassVar[bool]
    """Whether the start values satisfy every equation of the NLP."""
    bent_by: ClassVar[str] = "bends"
    """Name of the symbols that bend the joints."""

    @cached_property
    def bends(self) -> ca.SX:
        """Bends of every joint, shape (k, n) [rad]."""
        return ca.SX.sym("bend", len(self.directions), self.links)

    @cached_property
    def feed(self) -> ca.SX:
        """Positions of the axes that carry the base, shape (k, 1); that of a feed, scalar."""
        return ca.SX.sym("feed", max(len(self.carrier), 1))

    def base_place(self) -> ca.SX:
        """Return the position of the first joint, shape (d, 1)."""
        return ca.vertcat(self.feed, ca.SX.zeros(len(self.directions)))

    @property
    @abstractmethod
    def lies(self) -> ca.SX:
        """Symbols of the orientation of every link, a heading (f = 1) or a quaternion (f = 4), shape (f, n)."""

    @property
    @abstractmethod
    def symbols(self) -> dict[str, ca.SX]:
        """All symbols of links and of what bends them, variables of the NLP, by name."""

    @property
    def parameters(self) -> dict[str, ca.SX]:
        """Parameters that a subclass adds to the NLP, by name."""
        return {}

    @property
    @abstractmethod
    def costs(self) -> dict[str, ca.SX]:
        """Unweighted cost terms by name, "bending" first, ∫ κ² ds over the arm."""

    @abstractmethod
    def rows(self) -> tuple[RowBlock, ...]:
        """Return all NLP constraints that tie the symbols together."""

    def steps(self) -> ca.SX:
        """Return the vectors from the start to the end of every link, shape (d, n)."""
        return self.direction(self.lies) / ca.repmat(self.per_length.T, len(self.directions) + 1, 1)

    def growths(self) -> tuple[ca.SX, ...]:
        """Return how much longer both links at a joint get with each bend, (1, n) a bend; empty if they do not."""
        return ()

    @property
    def per_length(self) -> ca.DM:
        """One over the length of each link, shape (links, 1)."""
        return 1.0 / ca.DM(self.shares) if self.shares else ca.DM.ones(self.links) * self.links

    def direction(self, lies: ca.SX) -> ca.SX:
        """Return the directions of the links, shape (d, n), from their orientations, shape (f, n)."""
        axes = self.link_axes(lies)
        if not self.along:
            return axes[0]
        along = ca.DM(np.reshape(self.along, (self.links, -1)).T)
        return sum((axis * ca.repmat(along[k, :], along.shape[0], 1) for k, axis in enumerate(axes)), ca.SX(0))

    @property
    def last_along(self) -> FloatArray | None:
        """Direction of the last link in the frame in which it is turned by its joint, shape (d,); None if it is x."""
        return np.reshape(self.along, (self.links, -1))[-1] if self.along else None

    @abstractmethod
    def link_axes(self, lies: ca.SX) -> tuple[ca.SX, ...]:
        """Return the d axes of e links, each of shape (d, e), from their orientations, shape (f, e)."""

    @abstractmethod
    def joint_axes(self) -> tuple[ca.SX, ...]:
        """Return the rotation axes of every joint, one array per bend, (1, n) in the plane, (3, n) in space."""

    @abstractmethod
    def values(
        self,
        bends: FloatArray,
        feed: FloatArray,
        direction: FloatArray | None,
        beside: FloatArray | None = None,
    ) -> dict[str, FloatArray]:
        """Return the values of the symbols and parameters at a pose, by name.

        Args:
            bends: bends of the joints, shape (n, k) [rad].
            feed: positions of the axes that carry the base, as ``feed``.
            direction: direction of the last link at the goal, shape (d,), or None.
            beside: unit vector perpendicular to the direction and to where up is at the goal, shape (3,), or None.
        """

    @abstractmethod
    def bounds(self, last: FloatArray, direction: FloatArray | None, turned: float, rolled: float = 0.0) -> Bounds:
        """Return the bounds of the symbols but those that bend the joints; they hold the tip's direction at the goal.

        Args:
            last: orientation of the last link in the start pose, shape (f,).
            direction: direction of the last link at the goal, shape (d,), or None.
            turned: tolerance of the last link's direction [rad].
            rolled: tolerance of its roll [rad].
        """

    def bends_of(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """Return the bends of all joints, shape (k n,) [rad], for values of the symbols by name."""
        return values["bends"]

    @abstractmethod
    def curve(self, arm: Arm, values: Mapping[str, FloatArray], q: FloatArray) -> Curve:
        """Return the curve that the links follow, in metres and world axes.

        Args:
            arm: the arm.
            values: values of the symbols by name.
            q: configuration with the positions of the axes that carry the base, shape (c,) [rad, m].
        """


@dataclass(frozen=True, eq=False)
class PlanarFrames(LinkFrames):
    """Links in the plane whose headings are the mean headings of a symbolic curve over the links.

    The headings of the links are sums of bends, and a mean heading follows from the integral of the curve's heading.
    Motions are planned with this mapping too, φ = A v.

    Attributes:
        segments: number of curvature segments of the curve.
    """

    segments: int = 1
    directions = ("left",)
    start_keeps_rows = False

    @cached_property
    def followed(self) -> FollowedCurve:
        """The curve whose mean headings the links have."""
        return FollowedCurve(self.segments, self.directions, joint_arcs(self.links, self.shares))

    @cached_property
    def lies(self) -> ca.SX:
        """Headings of the links relative to the straight arm, shape (1, n) [rad]."""
        return ca.SX.sym("heading", 1, self.links)

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """All symbols of the curve, the bends and the links, by name."""
        return self.followed.symbols | {"bends": self.bends, "links": self.lies}

    @property
    def costs(self) -> dict[str, ca.SX]:
        """Costs of the curve."""
        return self.followed.costs

    def rows(self) -> tuple[RowBlock, ...]:
        """Return all NLP constraints: they define the curve, and make the links follow it."""
        return (*self.followed.rows(), *self.link_rows())

    def link_rows(self) -> tuple[RowBlock, ...]:
        """Return the NLP constraints φ_j = φ_(j−1) + bend_j and φ_j l = Θ(s_(j+1)) − Θ(s_j) for the link headings φ.

        Θ is the integral of the curve's heading, s_j the arc length of joint j and l the link length.
        """
        lack = self.lies - ca.horzcat(0, self.lies[:, :-1]) - self.bends
        turns = equal_to_zero(tuple(f"link {j + 1}: gap in its turn" for j in range(self.links)), ca.vec(lack))
        _, integrals = self.followed.joints.at_joints(self.followed.parts[0])
        means = self.per_length * (integrals[1:] - integrals[:-1])
        mapped = equal_to_zero(tuple(f"mapping of link {j + 1}" for j in range(self.links)), means - self.lies.T)
        return turns, mapped

    def link_axes(self, lies: ca.SX) -> tuple[ca.SX, ...]:
        """Return the axes of links, each of shape (2, e), from their headings φ, shape (1, e) [rad]."""
        return ca.vertcat(ca.cos(lies), ca.sin(lies)), ca.vertcat(-ca.sin(lies), ca.cos(lies))

    def joint_axes(self) -> tuple[ca.SX, ...]:
        """Return ones, shape (1, n), since every joint turns about the normal of the plane."""
        return (ca.SX.ones(1, self.links),)

    def values(
        self,
        bends: FloatArray,
        feed: FloatArray,
        direction: FloatArray | None,
        beside: FloatArray | None = None,
    ) -> dict[str, FloatArray]:
        """Return the values at a pose of the symbols, those of the nearest curve, by name.

        Args:
            bends: bends of the joints, shape (n, 1) [rad].
            feed: position of the base on its feed axis, shape (1,).
            direction: unused.
            beside: unused.
        """
        del direction, beside
        nearest = CurveNumbers.near(bends, self.segments, self.shares)
        return self.followed.values(nearest) | {"bends": bends, "links": np.cumsum(bends, axis=0), "feed": feed}

    def bounds(self, last: FloatArray, direction: FloatArray | None, turned: float, rolled: float = 0.0) -> Bounds:
        """Return the curve's bounds and those on the link headings that point the last link in the goal direction.

        Args:
            last: heading of the last link in the start pose, whose number of whole turns is kept, shape (1,) [rad].
            direction: direction of the last link at the goal, shape (2,), or None for no bounds.
            turned: tolerance of the heading [rad].
            rolled: without effect in the plane.
        """
        del rolled
        curve = self.followed.bounds()
        if direction is None:
            return curve
        heading = float(np.arctan2(direction[1], direction[0]))
        if self.last_along is not None:
            heading -= float(np.arctan2(self.last_along[1], self.last_along[0]))
        heading += 2.0 * np.pi * np.round((float(last[0]) - heading) / (2.0 * np.pi))
        free = np.full(self.links - 1, np.inf)
        return {**curve, "links": (np.append(-free, heading - turned), np.append(free, heading + turned))}

    def curve(self, arm: Arm, values: Mapping[str, FloatArray], q: FloatArray) -> Configuration:
        """Return the curve that the links follow as a planar curve, in metres and world axes.

        Args:
            arm: the arm.
            values: values of the symbols by name.
            q: configuration with the position of the base on its feed axis, shape (c,) [rad, m].
        """
        numbers = self.followed.numbers(values)
        lengths, curvatures, shares = numbers.parts()
        return Configuration.chain(
            arm.base + arm.coordinates.advance(q) * arm.direction,
            arm.base_heading + float(numbers.base_turn[0]),
            [arm.length * length for length in lengths],
            [value[:, 0] / arm.length for value in curvatures],
            shares,
        )
