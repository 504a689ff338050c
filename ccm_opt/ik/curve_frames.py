"""Links that follow a symbolic curve in the goal-pose NLP: the interface, and its implementation in the plane.

Lengths are in units of the arm's length, axes are those of the straight arm at its base. A curve has one curvature per
direction in which it can bend. The turns of the curve, which are the integrals of its curvatures over arc length, and
the integrals of the turns are known on every spline piece. In the plane the turns are the headings of the curve; in
space they determine frames, which are propagated from joint to joint (``bishop_shooting``).
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.lifted_curve import JointsAmongPieces, LiftedCurve
from ccm_opt.ik.row_program import RowBlock, equal_to_zero
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration, Curve
from ccm_opt.robot.segment import PIECES, Knots

_RANK = 1e-9
"""Fraction of the largest singular value below which a combination of curvatures counts as changing no bend."""
Bounds = Mapping[str, tuple[FloatArray, FloatArray]]
"""Lower and upper bounds of symbols, by name."""


def bend_matrix(links: int, knots: int, shares: tuple[float, ...] = ()) -> FloatArray:
    """Return the matrix from a curve's base turn and knot curvatures to the joint bends of an arm in one direction.

    The curve has length 1 and a natural curvature spline with evenly spaced knots. The bend of a joint is the
    difference of the mean turns of the curve over the two links of the joint. Turns do not add in space, but bends do,
    to first order in the link length.

    Args:
        links: number of links.
        shares: length of each link as a fraction of the whole; empty if all are equal.
        knots: number of knots.

    Returns:
        Shape (links, knots + 1), with the column of the base turn first.
    """
    turned_twice = CubicSpline(np.linspace(0.0, 1.0, knots), np.eye(knots), bc_type="natural").antiderivative(2)
    if shares:
        means = np.diff(turned_twice(_arcs(shares)), axis=0) / np.array(shares)[:, None]
    else:
        means = links * np.diff(turned_twice(np.linspace(0.0, 1.0, links + 1)), axis=0)
    return np.diff(np.column_stack((np.ones(links), means)), axis=0, prepend=0.0)


def _arcs(shares: tuple[float, ...]) -> FloatArray:
    """Return the arc lengths of the joints and the tip for given lengths of the links, shape (links + 1,)."""
    return np.asarray(np.minimum(np.append(0.0, np.cumsum(shares)), 1.0))


@dataclass(frozen=True)
class CurveNumbers:
    """Numerical curve of length 1, of K curvature segments that bend in k directions.

    Attributes:
        arcs: arc lengths of the knots, shape (4 K + 1,).
        curvatures: curvatures at the knots, one row per direction of bending, shape (k, 4 K + 1).
        base_turn: turn of the curve at its base relative to the straight arm, shape (k,) [rad].
    """

    arcs: FloatArray
    curvatures: FloatArray
    base_turn: FloatArray

    @classmethod
    def near(cls, turns: FloatArray, segments: int, shares: tuple[float, ...] = ()) -> "CurveNumbers":
        """Return the curve with evenly spaced knots whose bends best match those of a pose in least squares.

        Args:
            turns: bends of each of the n joints in k directions, shape (n, k) [rad].
            segments: number of curvature segments K.
            shares: length of each link as a fraction of the whole; empty if all are equal.
        """
        knots = PIECES * segments + 1
        matrix = bend_matrix(len(turns), knots, shares)
        sizes = np.linalg.norm(matrix, axis=0)
        values = np.linalg.pinv(matrix / sizes, rcond=_RANK) @ turns / sizes[:, None]
        return cls(np.linspace(0.0, 1.0, knots), values[1:].T, values[0])

    def parts(self) -> tuple[list[float], list[FloatArray], list[Knots]]:
        """Return the length, the curvatures (5, k) and the three inner knots, as length fractions, of each segment."""
        arcs = self.arcs
        if np.any(np.diff(arcs) <= 0.0):  # after a failed solution knots may be out of order
            arcs = np.linspace(0.0, 1.0, len(arcs))
        first = np.arange(0, len(arcs) - 1, PIECES)
        inside = arcs[first[:, None] + np.arange(PIECES + 1)]
        lengths = np.diff(inside[:, [0, -1]], axis=1).ravel()
        shares = (inside[:, 1:-1] - inside[:, :1]) / lengths[:, None]
        values = [self.curvatures[:, start : start + PIECES + 1].T for start in first.tolist()]
        return lengths.tolist(), values, [(float(b), float(c), float(d)) for b, c, d in shares]

    def turned(self, direction: int, start: float = 0.0) -> Configuration:
        """Return the planar curve with the curvatures of one direction, whose headings are the turns in that direction.

        Args:
            direction: index of the direction.
            start: heading at the base [rad].
        """
        lengths, values, shares = self.parts()
        return Configuration.chain(np.zeros(2), start, lengths, [value[:, direction] for value in values], shares)


@dataclass(frozen=True, eq=False)
class CurveFrames(ABC):
    """Symbols of a curve and of links that follow the curve, and the NLP constraints that tie them together.

    Attributes:
        segments: number of curvature segments K.
        links: number of links n.
        shares: length of each link as a fraction of the arm's; empty if all are equal.
        along: direction of each link in the frame that its joint turns, d numbers a link; empty if all lie along x.
        up: up axis of the last link in that frame, three numbers; empty if the goal allows any roll.
    """

    segments: int
    links: int
    shares: tuple[float, ...] = ()
    along: tuple[float, ...] = ()
    up: tuple[float, ...] = ()
    directions: ClassVar[tuple[str, ...]]
    """Names of the k directions in which the curvatures bend the curve; a joint has one bend for each."""
    start_keeps_rows: ClassVar[bool]
    """Whether the start values satisfy every equation of the NLP although links do not exactly follow the curve."""

    @cached_property
    def parts(self) -> tuple[LiftedCurve, ...]:
        """Symbolic curve of each direction, with curvatures, turns and integrals of turns; all share their knots."""
        first = LiftedCurve(self.segments)
        return first, *(LiftedCurve(self.segments, first.arcs) for _ in self.directions[1:])

    @cached_property
    def joint_arcs(self) -> FloatArray:
        """Arc lengths of the joints and the tip, shape (links + 1,)."""
        return _arcs(self.shares) if self.shares else np.arange(self.links + 1) / self.links

    @property
    def per_length(self) -> ca.DM:
        """One over the length of each link, shape (links, 1)."""
        return 1.0 / ca.DM(self.shares) if self.shares else ca.DM.ones(self.links) * self.links

    @cached_property
    def joints(self) -> JointsAmongPieces:
        """Evaluation of the curve of any direction at the joints and the tip."""
        return JointsAmongPieces.from_curve(self.parts[0], self.joint_arcs)

    @cached_property
    def bends(self) -> ca.SX:
        """Bends of every joint, shape (k, n) [rad]."""
        return ca.SX.sym("bend", len(self.directions), self.links)

    @property
    @abstractmethod
    def lies(self) -> ca.SX:
        """Symbols of the orientation of every link, a heading (f = 1) or a quaternion (f = 4), shape (f, n)."""

    @property
    @abstractmethod
    def further_symbols(self) -> dict[str, ca.SX]:
        """Symbols by name that a subclass adds to those of the curves, the bends and the links."""

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """All symbols of curves, bends and links, variables of the NLP, by name."""
        found = {"arcs": self.parts[0].arcs}
        for name, part in zip(self.directions, self.parts, strict=True):
            found |= {f"curvature {name}": part.curvatures, f"turned {name}": part.headings}
            found |= {f"integral {name}": part.integrals, f"bows {name}": part.bows}
        return found | self.further_symbols | {"bends": self.bends, "links": self.lies}

    @property
    def parameters(self) -> dict[str, ca.SX]:
        """Parameters that a subclass adds to the NLP, by name."""
        return {}

    @property
    def costs(self) -> dict[str, ca.SX]:
        """Unweighted cost terms that a subclass adds to the objective of the NLP, by name; empty by default."""
        return {}

    def rows(self) -> tuple[RowBlock, ...]:
        """Return all NLP constraints: they define splines, turns and integrals, and make the links follow the curve."""
        blocks: list[RowBlock] = []
        for name, part in zip(self.directions, self.parts, strict=True):
            splines, gaps, spacing = part.rows()
            blocks += [replace(each, names=tuple(f"{row}, {name}" for row in each.names)) for each in (splines, gaps)]
            if part is self.parts[0]:
                blocks += [spacing, self.joints.joint_order_rows()]
        return (*blocks, *self.link_rows())

    @abstractmethod
    def link_rows(self) -> tuple[RowBlock, ...]:
        """Return the NLP constraints that turn the links by their joints' bends and make them follow the curve."""

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
    def turns_of(self, bends: FloatArray) -> FloatArray:
        """Convert the bend angles of n joints to rotations about the k axes of the curve's frame, both (n, k) [rad]."""

    @abstractmethod
    def lies_at(self, bends: FloatArray) -> FloatArray:
        """Return the orientations of links, shape (n, f), for given joint bends, shape (n, k) [rad]."""

    @abstractmethod
    def values(
        self, curve: CurveNumbers, lies: FloatArray, direction: FloatArray | None, beside: FloatArray | None = None
    ) -> dict[str, FloatArray]:
        """Return the values at a pose of the symbols and parameters that a subclass adds, by name.

        Args:
            curve: a curve near the pose.
            lies: orientations of the links, shape (n, f).
            direction: direction of the last link at the goal, shape (d,), or None.
            beside: unit vector perpendicular to the direction and to where up is at the goal, shape (3,), or None.
        """

    @abstractmethod
    def bounds(self, lies: FloatArray, direction: FloatArray | None, turned: float, rolled: float = 0.0) -> Bounds:
        """Return the bounds of the links and of added symbols, which hold the direction of the last link at the goal.

        Args:
            lies: orientations of the links of the start pose, shape (n, f).
            direction: direction of the last link at the goal, shape (d,), or None.
            turned: tolerance of the last link's direction [rad].
            rolled: tolerance of its roll [rad].
        """

    @abstractmethod
    def curve(self, arm: Arm, numbers: CurveNumbers, feed: float) -> Curve:
        """Return a numerical curve in metres and world axes.

        Args:
            arm: the arm.
            numbers: the curve in units of the arm's length and base axes.
            feed: displacement of the base [m].
        """

    def numbers(self, values: Mapping[str, FloatArray]) -> CurveNumbers:
        """Return the numerical curve for values of the symbols by name, as a solver found them."""
        curvatures = np.stack([values[f"curvature {name}"] for name in self.directions])
        # In the plane the curve's turns start with the turn at its base.
        return CurveNumbers(values["arcs"], curvatures, values.get("base turn", values["turned left"][:1]))

    def curve_values(self, curve: CurveNumbers) -> dict[str, FloatArray]:
        """Return the values of the symbols of all directions' curves for a numerical curve, by name."""
        found = {"arcs": curve.arcs}
        inner = curve.arcs[:-1].reshape(self.segments, PIECES)[:, 1:].ravel()
        for index, (name, part) in enumerate(zip(self.directions, self.parts, strict=True)):
            flat = self.turned(curve, index)
            found |= {
                f"curvature {name}": curve.curvatures[index],
                f"turned {name}": flat.heading_at(curve.arcs),
                f"integral {name}": flat.heading_integral_at(curve.arcs),
                f"bows {name}": flat.spline(inner, 2) / part.moment_scale,
            }
        return found

    def turned(self, curve: CurveNumbers, index: int) -> Configuration:
        """Return the planar curve with the curvatures of the direction ``index``, whose headings are the turns."""
        return curve.turned(index)

    def curve_bounds(self) -> Bounds:
        """Return the bounds that give the curve the length 1 and start the integrals of its turns at 0, by name."""
        knots = self.parts[0].count + 1
        ends = np.full(knots, np.inf)
        ends[[0, -1]] = (0.0, 1.0)
        begin = np.append(0.0, np.full(knots - 1, np.inf))
        held = {"arcs": ends, **{f"integral {name}": begin for name in self.directions}}
        return {name: pinned_bounds(values) for name, values in held.items()}


def pinned_bounds(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper bounds that fix variables at finite values and leave those with the value ∞ free."""
    return np.where(np.isfinite(values), values, -np.inf), values


class PlanarFrames(CurveFrames):
    """Links in the plane whose headings are the mean headings of a symbolic curve over the links.

    The headings of the links are sums of bends, and a mean heading follows from the integral of the curve's heading.
    Motions are planned with this mapping too, φ = A v.
    """

    directions = ("left",)
    start_keeps_rows = False

    @cached_property
    def lies(self) -> ca.SX:
        """Headings of the links relative to the straight arm, shape (1, n) [rad]."""
        return ca.SX.sym("heading", 1, self.links)

    @property
    def further_symbols(self) -> dict[str, ca.SX]:
        """Empty, since in the plane the symbols of the curve, the bends and the links suffice."""
        return {}

    def link_rows(self) -> tuple[RowBlock, ...]:
        """Return the NLP constraints φ_j = φ_(j−1) + bend_j and φ_j l = Θ(s_(j+1)) − Θ(s_j) for the link headings φ.

        Θ is the integral of the curve's heading, s_j the arc length of joint j and l the link length.
        """
        lack = self.lies - ca.horzcat(0, self.lies[:, :-1]) - self.bends
        turns = equal_to_zero(tuple(f"link {j + 1}: gap in its turn" for j in range(self.links)), ca.vec(lack))
        _, integrals = self.joints.at_joints(self.parts[0])
        means = self.per_length * (integrals[1:] - integrals[:-1])
        mapped = equal_to_zero(tuple(f"mapping of link {j + 1}" for j in range(self.links)), means - self.lies.T)
        return turns, mapped

    def link_axes(self, lies: ca.SX) -> tuple[ca.SX, ...]:
        """Return the axes of links, each of shape (2, e), from their headings φ, shape (1, e) [rad]."""
        return ca.vertcat(ca.cos(lies), ca.sin(lies)), ca.vertcat(-ca.sin(lies), ca.cos(lies))

    def joint_axes(self) -> tuple[ca.SX, ...]:
        """Return ones, shape (1, n), since every joint turns about the normal of the plane."""
        return (ca.SX.ones(1, self.links),)

    def turns_of(self, bends: FloatArray) -> FloatArray:
        """Return the joint bends themselves, since a planar bend is a turn to the left."""
        return bends

    def lies_at(self, bends: FloatArray) -> FloatArray:
        """Return the headings of the links, the cumulative sums of the joint bends, both of shape (n, 1) [rad]."""
        return np.cumsum(bends, axis=0)

    def values(
        self, curve: CurveNumbers, lies: FloatArray, direction: FloatArray | None, beside: FloatArray | None = None
    ) -> dict[str, FloatArray]:
        """Return an empty mapping, since no symbols are added in the plane."""
        del curve, lies, direction, beside
        return {}

    def bounds(self, lies: FloatArray, direction: FloatArray | None, turned: float, rolled: float = 0.0) -> Bounds:
        """Return bounds on the link headings that point the last link in the goal direction, within a tolerance.

        Args:
            lies: headings of the links of the start pose, whose number of whole turns is kept, shape (n, 1) [rad].
            direction: direction of the last link at the goal, shape (2,), or None for no bounds.
            turned: tolerance of the heading [rad].
            rolled: without effect in the plane.
        """
        del rolled
        if direction is None:
            return {}
        heading = float(np.arctan2(direction[1], direction[0]))
        if self.last_along is not None:
            heading -= float(np.arctan2(self.last_along[1], self.last_along[0]))
        heading += 2.0 * np.pi * np.round((float(lies[-1, 0]) - heading) / (2.0 * np.pi))
        free = np.full(self.links - 1, np.inf)
        return {"links": (np.append(-free, heading - turned), np.append(free, heading + turned))}

    def turned(self, curve: CurveNumbers, index: int) -> Configuration:
        """Return the planar curve itself, whose heading at the base is the turn there."""
        return curve.turned(index, float(curve.base_turn[index]))

    def curve(self, arm: Arm, numbers: CurveNumbers, feed: float) -> Configuration:
        """Return a numerical curve as a planar curve, in metres and world axes.

        Args:
            arm: the arm.
            numbers: the curve in units of the arm's length and base axes.
            feed: displacement of the base [m].
        """
        lengths, values, shares = numbers.parts()
        return Configuration.chain(
            arm.base + feed * arm.direction,
            arm.base_heading + float(numbers.base_turn[0]),
            [arm.length * length for length in lengths],
            [value[:, 0] / arm.length for value in values],
            shares,
        )
