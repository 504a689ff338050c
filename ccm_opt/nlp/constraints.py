"""Constraints of the configuration NLP: each function returns a block of named rows.

Lengths are in units of the arm's length.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ccm_opt.continuum.segment import PIECES
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.nlp.curve_ode import SUBSTEPS, SegmentFlow


@dataclass(frozen=True)
class RowBlock:
    """A block of constraint rows: ``lower <= expression <= upper``, one name a row."""

    names: tuple[str, ...]
    expression: ca.SX
    lower: FloatArray
    upper: FloatArray


def equal_to_zero(names: tuple[str, ...], expression: ca.SX) -> RowBlock:
    """Rows that must vanish."""
    return RowBlock(names, expression, np.zeros(len(names)), np.zeros(len(names)))


def not_negative(names: tuple[str, ...], expression: ca.SX) -> RowBlock:
    """Rows that must be zero or more."""
    return RowBlock(names, expression, np.zeros(len(names)), np.full(len(names), np.inf))


def gap_closing(k: int, flow: SegmentFlow, following: ca.SX) -> RowBlock:
    """X_{k+1} = F(X_k, U_k): a segment ends where the next one begins."""
    what = ("x", "y", "heading", "curvature", "arc length")
    return equal_to_zero(tuple(f"segment {k}: gap in {name} at its end" for name in what), following - flow.end)


def base_at_stub_end(state: ca.SX, stub: ca.SX) -> RowBlock:
    """The first segment begins at the end of the base's straight stub; the base is the origin."""
    names = ("base: x", "base: y")
    return equal_to_zero(names, state[:2] - stub * ca.vertcat(ca.cos(state[2]), ca.sin(state[2])))


def knot_spacing(k: int, control: ca.SX, fraction: ca.SX) -> RowBlock:
    """a_i ≥ fraction · L_k: spline knots keep apart."""
    widths = control[4:8]
    names = tuple(f"segment {k}: spacing of knots {i} and {i + 1}" for i in range(PIECES))
    return not_negative(names, widths - fraction * ca.sum1(widths))


def certified_curvature(k: int, control: ca.SX, flow: SegmentFlow) -> RowBlock:
    """B_i ≥ |Bernstein coefficients of κ on piece i|, so B_i bounds |κ| on the whole piece."""
    names = []
    rows = []
    for i in range(PIECES):
        for j in range(4):
            rows += [control[8 + i] - flow.bernstein[i, j], control[8 + i] + flow.bernstein[i, j]]
            names += [f"segment {k}: curvature of piece {i} {side} its bound" for side in ("above", "below minus")]
    return not_negative(tuple(names), ca.vertcat(*rows))


def certified_containment(
    k: int, control: ca.SX, flow: SegmentFlow, normals: ca.SX, offsets: ca.SX, ends: tuple[bool, bool] = (False, False)
) -> RowBlock:
    """A_k P + B_i (a_i/m)²/8 ≤ b_k at both ends of every sub-step, so the whole curve stays in the region.

    Between two points h apart along the curve it leaves their chord by at most B t(1-t) h²/2, t in [0, 1] (the error
    of linear interpolation, de Boor, chapter II), and the region is convex. Margins α² B h²/2 and (1-α)² B h²/2 at
    the two points cover that for every α. Everywhere α = 1/2; where the arm itself begins or ends α = 0 leaves that
    point without margin, since a base or a goal may touch the wall.

    Args:
        k: number of the segment.
        control: U_k.
        flow: the segment's points.
        normals: shape (half-planes, 2).
        offsets: shape (half-planes, 1).
        ends: whether the segment's start is the arm's base, and its end the arm's tip.
    """
    names = []
    rows = []
    shares = _margin_shares(ends)
    for i in range(PIECES):
        sagitta = control[8 + i] * (control[4 + i] / SUBSTEPS) ** 2 / 2
        for j in range(SUBSTEPS + 1):
            point = SUBSTEPS * i + j
            rows.append(offsets - normals @ flow.points[:, point] - shares[i, j] * sagitta)
            names += [
                f"segment {k}: piece {i} at point {point}, side {row} of its region" for row in range(normals.shape[0])
            ]
    return not_negative(tuple(names), ca.vertcat(*rows))


def _margin_shares(ends: tuple[bool, bool]) -> FloatArray:
    """Share of B h²/2 kept as margin by each piece at each of its points, shape (PIECES, SUBSTEPS + 1)."""
    shares = np.full((PIECES, SUBSTEPS + 1), 0.25)
    if ends[0]:
        shares[0, :2] = [0.0, 1.0]
    if ends[1]:
        shares[-1, -2:] = [1.0, 0.0]
    return shares
