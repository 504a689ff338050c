"""What the joints of an arm have to bear where it stands still: torques by which gravity is held.

Points have d coordinates; moments about them one in the plane and three in space. Forces are over a unit of force, and
lengths over the arm's.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from ccm_opt.ik.curve_program import RowBlock, equal_to_zero, not_negative


@dataclass(frozen=True, eq=False)
class HoldingLoads:
    """What gravity asks of the joints, as variables of the program.

    A torque is a sum over all links beyond its joint. Where the sums are variables every row has to do with neighbours
    alone; written out, the program would take three times as long to build.

    Attributes:
        points: P, shape (d, n + 1).
        axes: what every joint turns about by each of its k bends, shapes (1, n) or (3, n).
        weights: force on each link's centre, shape (d, n).
        payload: force on the tip, shape (d, 1).
        limits: of the torques, shape (k, n).
    """

    points: ca.SX
    axes: tuple[ca.SX, ...]
    weights: ca.SX
    payload: ca.SX
    limits: ca.SX

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """Moments of the weights from each link on, about the base, and torques as shares of their limits."""
        links = self.weights.shape[1]
        return {
            "moments": ca.SX.sym("moment", self.axes[0].shape[0], links),
            "torque shares": ca.SX.sym("torque_share", len(self.axes), links),
        }

    def values(self) -> tuple[ca.SX, ca.SX]:
        """The same as expressions of all links at once, for their numbers at a pose."""
        moments = [_moment(self.points[:, -1], self.payload)]
        for link in reversed(range(self.weights.shape[1])):
            moments.append(moments[-1] + self._of_link(link))
        found = ca.horzcat(*moments[:0:-1])
        return found, self._torques(found) / self.limits

    def rows(self) -> tuple[RowBlock, RowBlock, RowBlock]:
        """That they are the loads of a pose, and |τ| ≤ limit."""
        moments, shares = self.symbols.values()
        links = range(self.weights.shape[1])
        beyond = ca.horzcat(moments[:, 1:], _moment(self.points[:, -1], self.payload))
        own = ca.horzcat(*(self._of_link(link) for link in links))
        joints = [f"joint {link + 1}{bend}" for link in links for bend in ([""], [" a", " b"])[len(self.axes) - 1]]
        about = "xyz"[-moments.shape[0] :]
        of_links = tuple(f"link {link + 1}: gap in its moment about {name}" for link in links for name in about)
        of_joints = tuple(f"{joint}: gap in its torque" for joint in joints)
        sides = tuple(f"{joint}: torque {side}" for side in ("up", "down") for joint in joints)
        flat = ca.vec(shares)
        return (
            equal_to_zero(of_links, ca.vec(moments - beyond - own)),
            equal_to_zero(of_joints, ca.vec(shares - self._torques(moments) / self.limits)),
            not_negative(sides, ca.vertcat(1 - flat, 1 + flat)),
        )

    def _of_link(self, link: int) -> ca.SX:
        """Moment of a link's weight about the base."""
        return _moment(0.5 * (self.points[:, link] + self.points[:, link + 1]), self.weights[:, link])

    def _torques(self, moments: ca.SX) -> ca.SX:
        """Torques about the axes of every joint, shape (k, n)."""
        # Σ_{i ≥ j} (c_i - P_j) × w_i = Σ c_i × w_i - P_j × Σ w_i
        force = self.payload
        about = []
        for link in reversed(range(self.weights.shape[1])):
            force = force + self.weights[:, link]
            about.append(moments[:, link] - _moment(self.points[:, link], force))
        whole = ca.horzcat(*reversed(about))
        return ca.vertcat(*(ca.sum1(whole * axis) for axis in self.axes))


def _moment(place: ca.SX, force: ca.SX) -> ca.SX:
    """Moment of a force at a place; one number in the plane."""
    if place.numel() == 3:
        return ca.cross(place, force)
    return place[0] * force[1] - place[1] * force[0]
