"""Multiple shooting of a curve in space with frames that do not twist.

Lengths are in units of the arm's length. The turns U_i(s) = ∫ κ_i ds and their integrals over the arc are known on
every piece of the splines, as in the plane, and tied from knot to knot. The equations of the frame, t' = κ1 n1 + κ2 n2
and n_i' = −κ_i t, have no such solution; they are shot from joint to joint. Over a link of length h, with Ω_i the turn
of the whole link and ψ_i the mean over the link of the turn from its beginning, Magnus' series gives the turn

    (ρ, −Ω2, Ω1) in the axes (t, n1, n2),  ρ = ψ1 Ω2 − ψ2 Ω1,

to the fourth order in h; where the curve is plane it is exact. Frames are unit quaternions (w, x, y, z).
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.curve_program import RowBlock, equal_to_zero
from ccm_opt.ik.lifted_curve import JointsAmongPieces, LiftedCurve
from ccm_opt.ik.row_program import Repeated, repeated_rows


def product(first: ca.SX, second: ca.SX) -> Any:
    """Hamilton's products, column by column: the second turn in the axes of the first."""
    return ca.vertcat(*_product_of(ca.vertsplit(first), ca.vertsplit(second)))


def _product_of(first: Iterable[Any], second: Iterable[Any]) -> tuple[Any, Any, Any, Any]:
    """Parts of Hamilton's product, of symbols or numbers."""
    w, x, y, z = first
    a, b, c, d = second
    return (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


def turned_by(vectors: ca.SX) -> ca.SX:
    """Turns by rotation vectors, shape (3, n) [rad]."""
    angle = ca.sqrt(ca.sum1(vectors**2) + 1e-16)  # smooth at no turn, and otherwise the same but for rounding
    share = ca.sin(angle / 2) / angle
    return ca.vertcat(ca.cos(angle / 2), ca.repmat(share, 3, 1) * vectors)


def axis(quaternions: ca.SX, number: int) -> ca.SX:
    """The x, y or z axis (0, 1 or 2) after each turn, a column of its matrix, shape (3, n)."""
    w, x, y, z = ca.vertsplit(quaternions)
    if number == 0:
        return ca.vertcat(w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y))
    if number == 1:
        return ca.vertcat(2 * (x * y - w * z), w**2 - x**2 + y**2 - z**2, 2 * (y * z + w * x))
    return ca.vertcat(2 * (x * z + w * y), 2 * (y * z - w * x), w**2 - x**2 - y**2 + z**2)


def chained_quaternions(turns: FloatArray) -> FloatArray:
    """Products of turns one after the other, shape (n, 4), as numbers; continuous in sign."""
    chained = np.empty_like(turns)
    latest = np.array([1.0, 0.0, 0.0, 0.0])
    for step, turn in enumerate(turns):
        latest = np.array(_product_of(latest, turn))
        chained[step] = latest
    return chained


def quaternions_of(vectors: FloatArray) -> FloatArray:
    """Turns by rotation vectors as numbers, shape (n, 3) to (n, 4)."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.concatenate((np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors), axis=1)


DIRECTIONS = ("left", "up")
"""What the two curvatures bend the curve to."""


@dataclass(frozen=True, eq=False)
class BishopShooting:
    """Symbols of a curve in space and the rows that make them one.

    Attributes:
        segments: number of curvature segments K.
        links: number of links n, over which the frame is shot.
    """

    segments: int
    links: int

    @cached_property
    def parts(self) -> tuple[LiftedCurve, LiftedCurve]:
        """Both curvatures with their turns and integrals, on the same knots."""
        first = LiftedCurve(self.segments)
        return first, LiftedCurve(self.segments, first.arcs)

    @cached_property
    def base_turn(self) -> ca.SX:
        """Turn of the curve at its base, to the left and upwards, shape (2, 1) [rad]."""
        return ca.SX.sym("base_turn", 2)

    @cached_property
    def turns(self) -> ca.SX:
        """Ω of every link, shape (2, n) [rad]."""
        return ca.SX.sym("turn", 2, self.links)

    @cached_property
    def means(self) -> ca.SX:
        """ψ of every link, shape (2, n) [rad]."""
        return ca.SX.sym("mean", 2, self.links)

    @cached_property
    def frames(self) -> ca.SX:
        """Frames of the curve at the beginning of every link, shape (4, n)."""
        return ca.SX.sym("frame", 4, self.links)

    @property
    def variables(self) -> ca.SX:
        """All symbols in one column: knots; each curvature's values, turns, integrals and bows; then the frames'."""
        first, second = self.parts
        each = [ca.vertcat(part.curvatures, part.headings, part.integrals, part.bows) for part in (first, second)]
        flat = [ca.vec(symbols) for symbols in (self.turns, self.means, self.frames)]
        return ca.vertcat(first.arcs, *each, self.base_turn, *flat)

    def rows(self, least_piece: float, window: int) -> tuple[RowBlock, ...]:
        """Spline equations, turns and integrals from knot to knot, links' turns, and frames from joint to joint.

        Args:
            least_piece: least share of its segment that a piece keeps.
            window: pieces about a joint that are looked at, see ``mapping_rows`` of the plane.
        """
        blocks: list[RowBlock] = []
        for index, (name, part) in enumerate(zip(DIRECTIONS, self.parts, strict=True)):
            splines, gaps, spacing = part.rows(least_piece)
            joints = JointsAmongPieces.of(part, self.links, window)
            blocks += [_named(name, block) for block in (splines, gaps, self._link_turns(index, joints))]
            if index == 0:  # the knots are shared
                blocks += [spacing, joints.kept_among()]
        return (*blocks, *self._frame_gaps())

    def _link_turns(self, index: int, joints: JointsAmongPieces) -> RowBlock:
        """Ω_i = U(s_(j+1)) − U(s_j) and ψ_i = (1/h) ∫ U ds − U(s_j) of every link."""
        part = self.parts[index]
        turn, integral = joints.sums_over_pieces()
        whole = turn[1:, :] - turn[:-1, :]
        mean = self.links * (integral[1:, :] - integral[:-1, :]) - turn[:-1, :]
        turned = part.headings[joints.first.tolist()]
        integrals = part.integrals[joints.first.tolist()]
        linear = ca.vertcat(
            turned[1:] - turned[:-1] - self.turns[index, :].T,
            self.links * (integrals[1:] - integrals[:-1]) - turned[:-1] - self.means[index, :].T,
        )
        kinds = ("turn of link {}", "mean turn of link {}")
        names = tuple(f"mapping: {kind.format(link + 1)}" for kind in kinds for link in range(self.links))
        return repeated_rows(equal_to_zero, names, joints.turns_and_integrals(), ca.vertcat(whole, mean), linear)

    def _frame_gaps(self) -> tuple[RowBlock, RowBlock]:
        """The frame at a joint is that at the joint before, carried over the link between."""
        first = turned_by(ca.vertcat(0, -self.base_turn[1], self.base_turn[0]))
        names = tuple(f"link {link + 1}: gap in {part} of its frame" for link in range(self.links) for part in "wxyz")
        columns = (self.frames[:, :-1], self.turns[:, :-1], self.means[:, :-1], self.frames[:, 1:])
        return (
            equal_to_zero(names[:4], self.frames[:, 0] - first),
            repeated_rows(equal_to_zero, names[4:], Repeated(_frame_gap, columns)),
        )


def mean_direction(means: ca.SX) -> ca.SX:
    """Mean direction of the curve over links, in the axes of the frames at their beginnings, shape (3, n).

    Args:
        means: ψ, shape (2, n) [rad].
    """
    angle = _lengths(means)
    return ca.vertcat(ca.cos(angle), ca.repmat(ca.sin(angle) / angle, 2, 1) * means)


def _frame_gap(before: ca.SX, turns: ca.SX, means: ca.SX, frame: ca.SX) -> ca.SX:
    """What frames lack of those before, carried over links with these Ω and ψ, column by column."""
    left, up = ca.vertsplit(turns)
    mean_left, mean_up = ca.vertsplit(means)
    carried: ca.SX = product(before, turned_by(ca.vertcat(mean_left * up - mean_up * left, -up, left)))
    return frame - carried


def _named(direction: str, block: RowBlock) -> RowBlock:
    return replace(block, names=tuple(f"{name}, {direction}" for name in block.names))


def _lengths(vectors: ca.SX) -> ca.SX:
    """Lengths of columns, with a smooth least value far below what matters, so that sin(x)/x has a derivative at 0."""
    return ca.sqrt(ca.sum1(vectors**2) + 1e-16)
