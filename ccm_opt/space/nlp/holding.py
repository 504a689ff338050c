"""What the joints of an arm in space have to bear where it stands still: torques by which gravity is held."""

import casadi as ca

from ccm_opt.nlp.constraints import RowBlock, not_negative
from ccm_opt.space.nlp.quaternions import axis


def holding_torques_in_space(links: ca.SX, points: ca.SX, weights: ca.SX, payload: ca.SX) -> ca.SX:
    """Torque about both axes of every joint that gravity asks of it, shape (2, n), in force times the arm's length.

    A joint turns about the z axis of the link before and about the y axis of its own.

    Args:
        links: quaternions of the links, shape (4, n).
        points: P, shape (3, n + 1).
        weights: force on each link's centre, in the axes of the base, shape (3, n) [N].
        payload: force on the tip, shape (3, 1) [N].
    """
    n = links.shape[1]
    centres = 0.5 * (points[:, 1:] + points[:, :-1])
    # Σ_{i ≥ j} (c_i - P_j) × w_i = Σ c_i × w_i - P_j × Σ w_i: two sums from the tip, so that it grows with the links.
    moment = ca.cross(points[:, n], payload)
    force = payload
    torques = []
    for link in reversed(range(n)):
        moment = moment + ca.cross(centres[:, link], weights[:, link])
        force = force + weights[:, link]
        about = moment - ca.cross(points[:, link], force)
        before = ca.SX([0.0, 0.0, 1.0]) if link == 0 else axis(links[:, link - 1], 2)
        torques.append(ca.vertcat(ca.dot(about, before), ca.dot(about, axis(links[:, link], 1))))
    return ca.horzcat(*reversed(torques))


def torque_rows_in_space(torques: ca.SX, limits: ca.SX) -> RowBlock:
    """|τ| ≤ limit of both bends of every joint, as shares of the limits, each of shape (2, n)."""
    shares = ca.vec(torques / limits)
    bends = [f"joint {joint + 1} {bend}" for joint in range(torques.shape[1]) for bend in "ab"]
    names = tuple(f"{bend}: torque {side}" for side in ("up", "down") for bend in bends)
    return not_negative(names, ca.vertcat(1 - shares, 1 + shares))
