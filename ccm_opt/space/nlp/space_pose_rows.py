"""Rows of the goal-pose NLP in space that hold for the links: their chain, the mapping, their regions, the goal.

Lengths are in units of the arm's length; the base is the origin and its direction, left and up are the axes.
"""

import casadi as ca

from ccm_opt.nlp.constraints import RowBlock, equal_to_zero, not_negative
from ccm_opt.space.nlp.bishop_shooting import BishopShooting
from ccm_opt.space.nlp.quaternions import axis, product


def turning_rows(bends: ca.SX, links: ca.SX) -> RowBlock:
    """R_j = R_(j−1) Rz(a_j) Ry(b_j): the links turn by the bends of their joints.

    Args:
        bends: (a, b) of every joint, shape (2, n) [rad].
        links: quaternions of the links, shape (4, n).
    """
    n = bends.shape[1]
    half_a = bends[0, :] / 2
    half_b = bends[1, :] / 2
    turns = ca.vertcat(
        ca.cos(half_a) * ca.cos(half_b),
        -ca.sin(half_a) * ca.sin(half_b),
        ca.cos(half_a) * ca.sin(half_b),
        ca.sin(half_a) * ca.cos(half_b),
    )
    turned = ca.horzcat(turns[:, 0], product(links[:, :-1], turns[:, 1:]))
    names = tuple(f"link {link + 1}: gap in {part} of its turn" for link in range(n) for part in "wxyz")
    return equal_to_zero(names, ca.vec(links - turned))


def place_rows(links: ca.SX, points: ca.SX, feed: ca.SX) -> RowBlock:
    """P_(j+1) = P_j + l x_j, and P_0 as far along the direction as the base is carried.

    Args:
        links: quaternions of the links, shape (4, n).
        points: P, shape (3, n + 1).
        feed: position of the base, scalar.
    """
    n = links.shape[1]
    steps = axis(links, 0) / n
    before = ca.horzcat(ca.vertcat(feed, 0, 0), points[:, :-1] + steps)
    at_base = ("base: gap in x", "base: gap in y", "base: gap in z")
    of_links = tuple(f"link {link + 1}: gap in {name} of its end" for link in range(n) for name in "xyz")
    return equal_to_zero((*at_base, *of_links), ca.vec(points - before))


def mapping_rows_in_space(curve: BishopShooting, links: ca.SX, offsets: ca.SX) -> RowBlock:
    """Every link points as the curve does in the mean over the link, but for its offset.

    Args:
        curve: the curve.
        links: quaternions of the links, shape (4, n).
        offsets: what the links' y and z axes have of the curve's direction, shape (2, n).
    """
    directions = curve.directions()
    along = sum((ca.repmat(directions[k, :], 3, 1) * axis(curve.frames, k) for k in range(3)), ca.SX(0))
    rows = ca.vertcat(*(ca.sum1(axis(links, k) * along) for k in (1, 2))) - offsets
    names = tuple(f"mapping of link {link + 1}, {side}" for link in range(curve.links) for side in ("left", "up"))
    return equal_to_zero(names, ca.vec(rows))


def side_rows(
    points: ca.SX, first_shares: ca.SX, normals: ca.SX, offsets: ca.SX, gap_shares: ca.SX, gap: ca.SX
) -> RowBlock:
    """Both ends of every link lie in its region with a gap to every side: n · P ≥ b + c g.

    Args:
        points: P, shape (3, n + 1).
        first_shares: where on each link the part begins that must lie inside, shape (n, 1).
        normals: of the sides, pointing inside, shape (3, n · sides), those of a link in a row.
        offsets: b, shape (sides, n).
        gap_shares: c, shape (sides, n).
        gap: g, the same for all links.
    """
    sides, n = offsets.shape
    starts = points[:, :-1] + ca.repmat(first_shares.T, 3, 1) * (points[:, 1:] - points[:, :-1])
    rows = []
    for held in (starts, points[:, 1:]):
        repeated = held[:, [link for link in range(n) for _ in range(sides)]]
        rows.append(ca.sum1(normals * repeated).T - ca.vec(offsets) - gap * ca.vec(gap_shares))
    names = tuple(
        f"link {link + 1}: side {side + 1} of its region, at its {end}"
        for end in ("start", "end")
        for link in range(n)
        for side in range(sides)
    )
    return not_negative(names, ca.vertcat(*rows))


def tip_place_row(tip: ca.SX, goal: ca.SX, room: ca.SX) -> RowBlock:
    """|P_n − goal|² ≤ room²: the tip lies in a ball; over 2 room, so that at the edge the row is a length."""
    return not_negative(("tip: distance from its goal",), 0.5 * (room - ca.sumsqr(tip - goal) / room))


def tip_direction_rows(last: ca.SX, across: ca.SX, parts: ca.SX) -> RowBlock:
    """What the last link has of the two axes across the goal's direction; bounds keep it within the tolerance.

    Args:
        last: quaternion of the last link, shape (4, 1).
        across: two unit vectors across the direction that is asked for, shape (3, 2).
        parts: symbols of these two, shape (2, 1).
    """
    names = ("tip: gap in its direction", "tip: gap in its direction, across")
    return equal_to_zero(names, across.T @ axis(last, 0) - parts)
