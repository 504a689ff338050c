"""What the joints of an arm in space have to bear where it stands still: torques by which gravity is held."""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.bishop_shooting import axis
from ccm_opt.ik.curve_program import RowBlock, equal_to_zero, not_negative


@dataclass(frozen=True, eq=False)
class HoldingLoads:
    """What gravity asks of the joints, as variables of the program.

    A torque is a sum over all links beyond its joint. Where the sums are variables every row has to do with neighbours
    alone; written out, the program would take three times as long to build.

    Attributes:
        moments: of the weights from each link on, about the base, shape (3, n), in force times the arm's length.
        shares: torques of both bends of every joint as shares of their limits, shape (2, n).
    """

    moments: ca.SX
    shares: ca.SX

    @classmethod
    def symbols(cls, links: int) -> "HoldingLoads":
        """Fresh symbols for so many links; 0 where torque is not limited."""
        return cls(ca.SX.sym("moment", 3, links), ca.SX.sym("torque_share", 2, links))

    @property
    def variables(self) -> ca.SX:
        """All of them in one column."""
        return ca.vertcat(ca.vec(self.moments), ca.vec(self.shares))

    def rows(
        self, links: ca.SX, points: ca.SX, weights: ca.SX, payload: ca.SX, limits: ca.SX
    ) -> tuple[RowBlock, RowBlock, RowBlock]:
        """That they are the loads of a pose, and |τ| ≤ limit.

        Args:
            links: quaternions of the links, shape (4, n).
            points: P, shape (3, n + 1).
            weights: force on each link's centre, in the axes of the base, shape (3, n).
            payload: force on the tip, shape (3, 1).
            limits: of the torques over the arm's length, in the same unit of force, shape (2, n).
        """
        n = links.shape[1]
        beyond = ca.horzcat(self.moments[:, 1:], ca.cross(points[:, n], payload))
        moments = ca.horzcat(*(_moment_of(points, weights, link) for link in range(n)))
        torques = _torques(links, points, self.moments, weights, payload)
        joints = [f"joint {joint + 1} {bend}" for joint in range(n) for bend in "ab"]
        of_links = tuple(f"link {link + 1}: gap in its moment about {name}" for link in range(n) for name in "xyz")
        of_joints = tuple(f"{joint}: gap in its torque" for joint in joints)
        sides = tuple(f"{joint}: torque {side}" for side in ("up", "down") for joint in joints)
        shares = ca.vec(self.shares)
        return (
            equal_to_zero(of_links, ca.vec(self.moments - beyond - moments)),
            equal_to_zero(of_joints, ca.vec(self.shares - torques / limits)),
            not_negative(sides, ca.vertcat(1 - shares, 1 + shares)),
        )


def holding_loads(
    links: FloatArray, points: FloatArray, weights: FloatArray, payload: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The loads of a pose as numbers.

    Args:
        links: quaternions of the links, shape (n, 4).
        points: of the joints and the tip, over the arm's length, in the axes of the base, shape (n + 1, 3).
        weights: force on each link's centre, shape (n, 3).
        payload: force on the tip, shape (3,).

    Returns:
        Moments of the weights from each link on, shape (n, 3), and torques of both bends, shape (n, 2), in force times
        the arm's length.
    """
    moments, torques = _loads_of(len(links))(links.T, points.T, weights.T, payload)
    return np.array(moments).T, np.array(torques).T


@lru_cache(maxsize=4)
def _loads_of(n: int) -> ca.Function:
    """(quaternions, points, weights, payload) to moments and torques, column by column."""
    links = ca.SX.sym("link", 4, n)
    points = ca.SX.sym("point", 3, n + 1)
    weights = ca.SX.sym("weight", 3, n)
    payload = ca.SX.sym("payload", 3)
    moments = [ca.cross(points[:, n], payload)]
    for link in reversed(range(n)):
        moments.append(moments[-1] + _moment_of(points, weights, link))
    found = ca.horzcat(*moments[:0:-1])
    torques = _torques(links, points, found, weights, payload)
    return ca.Function("holding_loads", [links, points, weights, payload], [found, torques])


def _moment_of(points: ca.SX, weights: ca.SX, link: int) -> ca.SX:
    """Moment of a link's weight about the base."""
    centre = 0.5 * (points[:, link] + points[:, link + 1])
    return ca.cross(centre, weights[:, link])


def _torques(links: ca.SX, points: ca.SX, moments: ca.SX, weights: ca.SX, payload: ca.SX) -> ca.SX:
    """Torques about the axes of every joint: z of the link before, and y of its own, shape (2, n)."""
    n = links.shape[1]
    # Σ_{i ≥ j} (c_i - P_j) × w_i = Σ c_i × w_i - P_j × Σ w_i
    before = ca.horzcat(ca.SX([0.0, 0.0, 1.0]), axis(links[:, :-1], 2))
    own = axis(links, 1)
    force = payload
    torques = []
    for link in reversed(range(n)):
        force = force + weights[:, link]
        about = moments[:, link] - ca.cross(points[:, link], force)
        torques.append(ca.vertcat(ca.dot(about, before[:, link]), ca.dot(about, own[:, link])))
    return ca.horzcat(*reversed(torques))
