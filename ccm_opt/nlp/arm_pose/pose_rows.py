"""Rows of the goal-pose NLP that hold for the links: their chain, their joint limits, their regions, what they bear.

Lengths are in units of the arm's length, the base is the origin.
"""

import casadi as ca

from ccm_opt.nlp.constraints import RowBlock, equal_to_zero, not_negative


def chain_rows(link_headings: ca.SX, points: ca.SX) -> RowBlock:
    """P_{j+1} = P_j + l (cos φ_j, sin φ_j): the links as they lie.

    Args:
        link_headings: φ, shape (links, 1) [rad].
        points: P, shape (2, links + 1); the base is held by its bounds.
    """
    links = link_headings.numel()
    steps = ca.horzcat(ca.cos(link_headings), ca.sin(link_headings)).T / links
    names = tuple(f"link {j + 1}: {axis} of its end" for j in range(links) for axis in ("x", "y"))
    return equal_to_zero(names, ca.vec(points[:, 1:] - points[:, :-1] - steps))


def joint_limit_rows(link_headings: ca.SX, base_heading: ca.SX, limits: ca.SX) -> RowBlock:
    """|φ_j - φ_{j-1}| ≤ limit, the first against the base heading."""
    bends = link_headings - ca.vertcat(base_heading, link_headings[:-1])
    names = tuple(f"joint {j + 1}: bend {side}" for side in ("left", "right") for j in range(bends.numel()))
    return not_negative(names, ca.vertcat(limits - bends, limits + bends))


def region_rows(points: ca.SX, first_shares: ca.SX, normals: ca.SX, offsets: ca.SX, gap: ca.SX) -> RowBlock:
    """N · P + g ≤ b at every joint and the tip: both ends of a link lie in its region with a gap to every side.

    Args:
        points: P, shape (2, links + 1).
        first_shares: where on each link the part begins that must lie inside, shape (links, 1).
        normals: shape (2, (links + 1) · sides), the sides of a joint in a row.
        offsets: shape (sides, links + 1).
        gap: g, the same for all links.
    """
    sides, joints = offsets.shape
    links = joints - 1
    starts = points[:, :-1] + ca.repmat(first_shares.T, 2, 1) * (points[:, 1:] - points[:, :-1])
    held = _repeated(ca.horzcat(starts, points[:, links]), sides)
    rows = ca.vec(offsets) - gap - normals[0, :].T * held[0, :].T - normals[1, :].T * held[1, :].T
    ends = [*((j + 1, "start") for j in range(links)), (links, "end")]
    names = tuple(f"link {link}: side {k + 1} of its region, at its {end}" for link, end in ends for k in range(sides))
    return not_negative(names, rows)


def _repeated(columns: ca.SX, times: int) -> ca.SX:
    """Every column so many times in a row."""
    indices = [column for column in range(columns.shape[1]) for _ in range(times)]
    return columns[:, indices]


def goal_rows(tip: ca.SX, goal: ca.SX, room: ca.SX) -> RowBlock:
    """|P_n - goal|² ≤ room²: the tip lies in a disc; over 2 room, so that at the edge the row is a length.

    Args:
        tip: P_n, shape (2, 1).
        goal: middle of the disc, shape (2, 1).
        room: radius of the disc, scalar and positive.
    """
    return not_negative(("tip: distance from its goal",), 0.5 * (room - ca.sumsqr(tip - goal) / room))


def holding_torques(points: ca.SX, weights: ca.SX, payload: ca.SX) -> ca.SX:
    """Torque about every joint that gravity asks of it, shape (links, 1), in units of force times the arm's length.

    Args:
        points: P, shape (2, links + 1).
        weights: force on each link's centre, shape (2, links) [N].
        payload: force on the tip, shape (2, 1) [N].
    """
    links = points.shape[1] - 1
    centres = 0.5 * (points[:, 1:] + points[:, :-1])
    # Σ_{i ≥ j} (c_i - P_j) × w_i = Σ c_i × w_i - P_j × Σ w_i: two sums from the tip, so that it grows with the links.
    moment = _cross(points[:, links], payload)
    force = payload
    torques = []
    for link in reversed(range(links)):
        moment = moment + _cross(centres[:, link], weights[:, link])
        force = force + weights[:, link]
        torques.append(moment - _cross(points[:, link], force))
    return ca.vertcat(*reversed(torques))


def torque_rows(torques: ca.SX, limits: ca.SX) -> RowBlock:
    """|τ_j| ≤ limit, as shares of the limit."""
    names = tuple(f"joint {j + 1}: torque {side}" for side in ("up", "down") for j in range(torques.numel()))
    return not_negative(names, ca.vertcat(1 - torques / limits, 1 + torques / limits))


def _cross(a: ca.SX, b: ca.SX) -> ca.SX:
    return a[0] * b[1] - a[1] * b[0]
