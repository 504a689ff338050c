"""Curves of length 1 that links follow in the goal-pose NLP: numerical ones, and their symbols.

A curve has one curvature per direction in which it can bend. Its turns, which are the integrals of its curvatures over
arc length, and the integrals of the turns are known on every spline piece.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.lifted_curve import JointsAmongPieces, LiftedCurve
from ccm_opt.ik.row_program import Bounds, RowBlock, pinned_bounds
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import PIECES, Knots

_RANK = 1e-2
"""Fraction of the largest singular value below which a combination of curvatures counts as changing no bend. Measured:
those of arms of equal links have 0.1 at least; where links are longer than pieces and of several lengths some have 1e-4
to 1e-8, and would take curvatures of 1e4 to 1e7 for what the bends have beside a smooth curve."""


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
        means = np.diff(turned_twice(joint_arcs(links, shares)), axis=0) / np.array(shares)[:, None]
    else:
        means = links * np.diff(turned_twice(np.linspace(0.0, 1.0, links + 1)), axis=0)
    return np.diff(np.column_stack((np.ones(links), means)), axis=0, prepend=0.0)


def link_shares(arm: Arm) -> tuple[float, ...]:
    """Return the length of each link as a fraction of the arm's; empty if all are equal."""
    return () if arm.proportions is None else tuple((arm.lengths / arm.length).tolist())


def joint_arcs(links: int, shares: tuple[float, ...] = ()) -> FloatArray:
    """Return the arc lengths of the joints and the tip, shape (links + 1,).

    Args:
        links: number of links.
        shares: length of each link as a fraction of the whole; empty if all are equal.
    """
    if not shares:
        return np.arange(links + 1) / links
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
class FollowedCurve:
    """Symbols of a curve that bends in k directions, and the NLP constraints that define it.

    Attributes:
        segments: number of curvature segments K.
        directions: names of the directions.
        joint_arcs: arc lengths of the joints and the tip, shape (links + 1,).
    """

    segments: int
    directions: tuple[str, ...]
    joint_arcs: FloatArray

    @cached_property
    def parts(self) -> tuple[LiftedCurve, ...]:
        """Symbolic curve of each direction, with curvatures, turns and integrals of turns; all share their knots."""
        first = LiftedCurve(self.segments)
        return first, *(LiftedCurve(self.segments, first.arcs) for _ in self.directions[1:])

    @cached_property
    def joints(self) -> JointsAmongPieces:
        """Evaluation of the curve of any direction at the joints and the tip."""
        return JointsAmongPieces.from_curve(self.parts[0], self.joint_arcs)

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """All symbols of the curve, variables of the NLP, by name."""
        found = {"arcs": self.parts[0].arcs}
        for name, part in zip(self.directions, self.parts, strict=True):
            found |= {f"curvature {name}": part.curvatures, f"turned {name}": part.headings}
            found |= {f"integral {name}": part.integrals, f"bows {name}": part.bows}
        return found

    @property
    def costs(self) -> dict[str, ca.SX]:
        """Unweighted cost terms by name.

        They are "bending", ∫ κ² ds, twice the elastic energy of a unit rod; "knots", which pulls knots towards even
        spacing and segments towards equal length; and "bows", the mean square deviation of the curvatures from their
        chords between knots.
        """
        first = self.parts[0]
        lengths = first.segment_lengths
        shares = first.pieces.width / ca.vec(ca.repmat(lengths, PIECES, 1))
        return {
            "bending": ca.sum1(ca.vertcat(*(part.pieces.squared_curvature() for part in self.parts))),
            "knots": ca.sumsqr(shares - 1 / PIECES) + ca.sumsqr(lengths * self.segments - 1),
            "bows": ca.sumsqr(ca.vertcat(*(part.bows for part in self.parts))) / first.count,
        }

    def rows(self) -> tuple[RowBlock, ...]:
        """Return the NLP constraints that define splines, turns and integrals, and the order of knots and joints."""
        blocks: list[RowBlock] = []
        for name, part in zip(self.directions, self.parts, strict=True):
            splines, gaps, spacing = part.rows()
            blocks += [replace(each, names=tuple(f"{row}, {name}" for row in each.names)) for each in (splines, gaps)]
            if part is self.parts[0]:
                blocks += [spacing, self.joints.joint_order_rows()]
        return tuple(blocks)

    def numbers(self, values: Mapping[str, FloatArray]) -> CurveNumbers:
        """Return the numerical curve for values of the symbols by name, as a solver found them."""
        curvatures = np.stack([values[f"curvature {name}"] for name in self.directions])
        # In the plane the curve's turns start with the turn at its base.
        return CurveNumbers(values["arcs"], curvatures, values.get("base turn", values["turned left"][:1]))

    def values(self, curve: CurveNumbers) -> dict[str, FloatArray]:
        """Return the values of the symbols for a numerical curve, by name."""
        found = {"arcs": curve.arcs}
        inner = curve.arcs[:-1].reshape(self.segments, PIECES)[:, 1:].ravel()
        for index, (name, part) in enumerate(zip(self.directions, self.parts, strict=True)):
            # In the plane the turns are the headings of the curve, in space they are 0 at the base.
            flat = curve.turned(index, float(curve.base_turn[index]) if len(self.parts) == 1 else 0.0)
            found |= {
                f"curvature {name}": curve.curvatures[index],
                f"turned {name}": flat.heading_at(curve.arcs),
                f"integral {name}": flat.heading_integral_at(curve.arcs),
                f"bows {name}": flat.spline(inner, 2) / part.moment_scale,
            }
        return found

    def bounds(self) -> Bounds:
        """Return the bounds that give the curve the length 1 and start the integrals of its turns at 0, by name."""
        knots = self.parts[0].count + 1
        ends = np.full(knots, np.inf)
        ends[[0, -1]] = (0.0, 1.0)
        begin = np.append(0.0, np.full(knots - 1, np.inf))
        held = {"arcs": ends, **{f"integral {name}": begin for name in self.directions}}
        return {name: pinned_bounds(values) for name, values in held.items()}
