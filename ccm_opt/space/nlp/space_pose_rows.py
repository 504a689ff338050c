"""Rows of the goal-pose NLP in space that hold for the links: their chain, the mapping, their regions, the goal.

Lengths are in units of the arm's length; the base is the origin and its direction, left and up are the axes.
"""

from functools import partial

import casadi as ca

from ccm_opt.nlp.constraints import RowBlock, equal_to_zero, not_negative
from ccm_opt.nlp.repeated_rows import Repeated, repeated_rows
from ccm_opt.space.nlp.bishop_shooting import BishopShooting, mean_direction
from ccm_opt.space.nlp.quaternions import axis, product


def turning_rows(bends: ca.SX, links: ca.SX) -> tuple[RowBlock, RowBlock]:
    """R_j = R_(j−1) Rz(a_j) Ry(b_j): the links turn by the bends of their joints; the first, and the others.

    Args:
        bends: (a, b) of every joint, shape (2, n) [rad].
        links: quaternions of the links, shape (4, n).
    """
    n = bends.shape[1]
    names = tuple(f"link {link + 1}: gap in {part} of its turn" for link in range(n) for part in "wxyz")
    return (
        equal_to_zero(names[:4], links[:, 0] - _turns(bends[:, 0])),
        repeated_rows(equal_to_zero, names[4:], Repeated(_turning, (bends[:, 1:], links[:, :-1], links[:, 1:]))),
    )


def place_rows(links: ca.SX, points: ca.SX, feed: ca.SX) -> tuple[RowBlock, RowBlock]:
    """P_0 lies as far along the direction as the base is carried, and P_(j+1) = P_j + l x_j.

    Args:
        links: quaternions of the links, shape (4, n).
        points: P, shape (3, n + 1).
        feed: position of the base, scalar.
    """
    n = links.shape[1]
    at_base = ("base: gap in x", "base: gap in y", "base: gap in z")
    of_links = tuple(f"link {link + 1}: gap in {name} of its end" for link in range(n) for name in "xyz")
    ends = Repeated(partial(_end_gap, 1.0 / n), (links, points[:, :-1], points[:, 1:]))
    return (
        equal_to_zero(at_base, points[:, 0] - ca.vertcat(feed, 0, 0)),
        repeated_rows(equal_to_zero, of_links, ends),
    )


def mapping_rows_in_space(curve: BishopShooting, links: ca.SX, stray: ca.SX, offsets: ca.SX) -> RowBlock:
    """Every link points as the curve does in the mean over the link, but for a share of its offset.

    Args:
        curve: the curve.
        links: quaternions of the links, shape (4, n).
        stray: share of the offsets that is kept, scalar.
        offsets: what the links' y and z axes have of the curve's direction, shape (2, n).
    """
    n = curve.links
    names = tuple(f"mapping of link {link + 1}, {side}" for link in range(n) for side in ("left", "up"))
    columns = (curve.means, curve.frames, links, ca.repmat(stray, 1, n))
    return repeated_rows(equal_to_zero, names, Repeated(_off_curve, columns, (offsets,)))


def side_rows(
    points: ca.SX, first_shares: ca.SX, normals: ca.SX, offsets: ca.SX, gap_shares: ca.SX, gap: ca.SX
) -> RowBlock:
    """Both ends of every link lie in its region with a gap to every side: n · P ≥ b + c g.

    Args:
        points: P, shape (3, n + 1).
        first_shares: where on each link the part begins that must lie inside, shape (n, 1).
        normals: of the sides, pointing inside, shape (3 · sides, n), those of a link in a column.
        offsets: b, shape (sides, n).
        gap_shares: c, shape (sides, n).
        gap: g, the same for all links.
    """
    sides, n = offsets.shape
    names = tuple(
        f"link {link + 1}: side {side + 1} of its region, at its {end}"
        for link in range(n)
        for end in ("start", "end")
        for side in range(sides)
    )
    columns = (points[:, :-1], points[:, 1:], ca.repmat(gap, 1, n))
    given = (first_shares.T, normals, offsets, gap_shares)
    return repeated_rows(not_negative, names, Repeated(_inside, columns, given))


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


def _turns(bends: ca.SX) -> ca.SX:
    """Turns by the bends of joints, shape (2, n) to (4, n)."""
    half_a = bends[0, :] / 2
    half_b = bends[1, :] / 2
    return ca.vertcat(
        ca.cos(half_a) * ca.cos(half_b),
        -ca.sin(half_a) * ca.sin(half_b),
        ca.cos(half_a) * ca.sin(half_b),
        ca.sin(half_a) * ca.cos(half_b),
    )


def _turning(bends: ca.SX, before: ca.SX, link: ca.SX) -> ca.SX:
    """What links lack of those before, turned by their joints, shape (4, n)."""
    turned: ca.SX = product(before, _turns(bends))
    return link - turned


def _end_gap(length: float, link: ca.SX, start: ca.SX, end: ca.SX) -> ca.SX:
    """What the ends of links lack of being a length from their starts along them, shape (3, n)."""
    return end - start - length * axis(link, 0)


def _off_curve(means: ca.SX, frame: ca.SX, link: ca.SX, stray: ca.SX, offsets: ca.SX) -> ca.SX:
    """What the y and z axes of links have of the curve's mean direction beyond their offsets, shape (2, n)."""
    directions = mean_direction(means)
    along = sum((ca.repmat(directions[k, :], 3, 1) * axis(frame, k) for k in range(3)), ca.SX(0))
    across = ca.vertcat(*(ca.sum1(axis(link, k) * along) for k in (1, 2)))
    return across - ca.repmat(stray, 2, 1) * offsets


def _inside(
    start: ca.SX, end: ca.SX, gap: ca.SX, first_share: ca.SX, normals: ca.SX, offsets: ca.SX, gap_shares: ca.SX
) -> ca.SX:
    """How far both ends of what links have in their regions lie inside, beyond the gap, shape (2 · sides, n)."""
    sides = offsets.shape[0]
    first = start + ca.repmat(first_share, 3, 1) * (end - start)
    asked = offsets + ca.repmat(gap, sides, 1) * gap_shares
    return ca.vertcat(*(_along(normals, held) - asked for held in (first, end)))


def _along(normals: ca.SX, points: ca.SX) -> ca.SX:
    """N · P for every side of a point's region, shape (sides, n)."""
    products = normals * ca.repmat(points, normals.shape[0] // 3, 1)
    return ca.vertcat(*(ca.sum1(products[side : side + 3, :]) for side in range(0, products.shape[0], 3)))
