"""Links in space whose joints are moved together by few drives, as variables of the goal-pose NLP.

Bends are q = C d for the drives d. A section that bends evenly is an arc of constant curvature, whose frames need no
integration: each of its arcs is the vertex of its two tangents, and the joint there turns by the rotation vector
(0, b, a). Its tangents are tan(x) / x times as long as half the arc, for half of its turn x (``robot.arc_sections``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.bishop_shooting import curve_in_space, link_quaternions, universal_turns
from ccm_opt.ik.row_program import Bounds, RowBlock, not_negative
from ccm_opt.ik.space_links import SpaceLinks, axis, chained_quaternions, quaternions_of, turned_by
from ccm_opt.ik.spline_curve import CurveNumbers, link_shares
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import SpaceConfiguration
from ccm_opt.robot.segment import PIECES

_SMOOTHED = 1e-8
"""Added to squared turns of arcs, so that the lengths of tangents are smooth where arcs are straight [rad²]. They
change by less than 1e-9 of their length."""
_TRAVEL_USED = 0.98
"""Fraction of the travel of a tendon that a pose may use, as of joint limits."""


@dataclass(frozen=True, eq=False)
class DrivenLinks(SpaceLinks):
    """Links in space whose bends are given by drives; there is no other curve than that of the links.

    Attributes:
        coupling: derivatives of the bends by the m drives, joint by joint, 2 n rows of m numbers.
        travels: fraction of its travel that each limited tendon takes for a unit of each drive, a row of m numbers for
            each tendon.
        arcs: half of the length of the arc about each joint, and 0 for the tip, as a fraction of the arm's length,
            n + 1 numbers; empty if joints are universal.
    """

    coupling: tuple[tuple[float, ...], ...] = ()
    travels: tuple[tuple[float, ...], ...] = ()
    arcs: tuple[float, ...] = ()
    bent_by = "drives"

    @cached_property
    def drives(self) -> ca.SX:
        """Values of the drives, shape (m, 1) [rad]."""
        return ca.SX.sym("drive", len(self.coupling[0]))

    @cached_property
    def bends(self) -> ca.SX:
        """Bends of every joint as expressions of the drives, shape (2, n) [rad]."""
        return ca.reshape(ca.sparsify(ca.DM(self.coupling)) @ self.drives, 2, self.links)

    @property
    def symbols(self) -> dict[str, ca.SX]:
        """Symbols of the tip, the drives and the links, by name."""
        return {**self.tip_symbols, "drives": self.drives, "links": self.lies}

    @cached_property
    def parameters(self) -> dict[str, ca.SX]:
        """Parameters of the tip and, where tendons are limited, the fractions "travel limits" of their travels."""
        limited = {"travel limits": ca.SX.sym("travel_limit", len(self.travels))} if self.travels else {}
        return self.tip_parameters | limited

    @property
    def costs(self) -> dict[str, ca.SX]:
        """Cost "bending", the sum over the joints of their squared turn over the arc length that it is spread over."""
        spread = self._spread
        bent = np.flatnonzero(spread > 0.0)
        squares = ca.sum1(self.bends[:, bent.tolist()] ** 2)
        return {"bending": ca.sum2(squares / ca.DM(spread[bent]).T)}

    @property
    def _spread(self) -> FloatArray:
        """Length over which the turn of each joint is spread, as a fraction of the arm's length, shape (n,)."""
        if self.arcs:
            return 2.0 * np.array(self.arcs[:-1])
        lengths = np.array(self.shares) if self.shares else np.full(self.links, 1.0 / self.links)
        return np.asarray(0.5 * (lengths + np.append(0.0, lengths[:-1])))

    def rows(self) -> tuple[RowBlock, ...]:
        """Return the NLP constraints that turn the links, define the last one's components and limit tendons."""
        links = (self.turning_rows(), self.tip_rows())
        if not self.travels:
            return links
        moved = ca.sparsify(ca.DM(self.travels)) @ self.drives
        limits = self.parameters["travel limits"]
        names = tuple(f"tendon {k + 1}: travel {way}" for way in ("in", "out") for k in range(len(self.travels)))
        return *links, not_negative(names, ca.vertcat(limits + moved, limits - moved))

    def joint_turns(self) -> ca.SX:
        """Return the quaternions by which the joints turn their links, shape (4, n)."""
        if not self.arcs:
            return universal_turns(self.bends)
        return turned_by(ca.vertcat(ca.SX.zeros(1, self.links), self.bends[1, :], self.bends[0, :]))

    def steps(self) -> ca.SX:
        """Return the vectors from the start to the end of every link, shape (3, n)."""
        if not self.arcs:
            return super().steps()
        legs = ca.horzcat(ca.DM(self.arcs[:-1]).T * ca.tan(self._halves) / self._halves, 0)
        return self.direction(self.lies) * ca.repmat(legs[:, :-1] + legs[:, 1:], 3, 1)

    @property
    def _halves(self) -> ca.SX:
        """Half of the turn of the arc about each joint, shape (1, n) [rad]."""
        return ca.sqrt(ca.sum1(self.bends**2) + _SMOOTHED) / 2

    def growths(self) -> tuple[ca.SX, ...]:
        """Return the derivatives of the tangents of the arc about each joint by its bends, (1, n) each; none of links.

        Both tangents grow alike.
        """
        if not self.arcs:
            return ()
        x = self._halves
        slope = ca.DM(self.arcs[:-1]).T * (x * (1 + ca.tan(x) ** 2) - ca.tan(x)) / (4 * x**3)
        return tuple(slope * self.bends[k, :] for k in range(2))

    def joint_axes(self) -> tuple[ca.SX, ...]:
        """Return the axes about which the joints turn all beyond them while the bends a and b change, each (3, n).

        Those of an arc are the columns of the left Jacobian of the rotation vector (0, b, a).
        """
        before = [axis(self.lies_before, k) for k in range(3)]
        if not self.arcs:
            return before[2], axis(self.lies, 1)
        a, b = ca.vertsplit(self.bends)
        square = a**2 + b**2 + 1e-16
        turn = ca.sqrt(square)
        half, third = 2 * (ca.sin(turn / 2) / turn) ** 2, (1 - ca.sin(turn) / turn) / square
        combined = (
            (half * b, third * a * b, 1 - third * b**2),
            (-half * a, 1 - third * a**2, third * a * b),
        )
        about_a, about_b = (
            sum((ca.repmat(part, 3, 1) * each for part, each in zip(parts, before, strict=True)), ca.SX(0))
            for parts in combined
        )
        return about_a, about_b

    def _lies_at(self, bends: FloatArray, base: FloatArray) -> FloatArray:
        """Return the quaternions of the links, shape (n, 4), for joint bends of shape (n, 2) [rad] on a turned base."""
        if not self.arcs:
            return link_quaternions(bends, base)
        return chained_quaternions(quaternions_of(np.column_stack((np.zeros(len(bends)), bends[:, ::-1]))), base)

    def values(
        self,
        bends: FloatArray,
        feed: FloatArray,
        direction: FloatArray | None,
        beside: FloatArray | None = None,
    ) -> dict[str, FloatArray]:
        """Return the values of the symbols and parameters at a pose, by name.

        Args:
            bends: bends of the joints, shape (n, 2) [rad].
            feed: positions of the axes that carry the base, as ``feed``.
            direction: direction of the last link at the goal, shape (3,), or None.
            beside: unit vector perpendicular to the direction and to where up is at the goal, shape (3,), or None.
        """
        lies = self._lies_at(bends, self.base_turn(feed))
        drives = np.linalg.pinv(np.array(self.coupling)) @ bends.ravel()
        found = {"drives": drives, "links": lies, "feed": feed, **self.tip_values(lies, direction, beside)}
        # The pose may use more of its limits than others.
        moved = np.abs(np.reshape(self.travels, (-1, len(drives))) @ drives)
        return found | ({"travel limits": np.maximum(moved, _TRAVEL_USED)} if self.travels else {})

    def bounds(self, last: FloatArray, direction: FloatArray | None, turned: float, rolled: float = 0.0) -> Bounds:
        """Return the bounds of the last link's direction and roll, by name.

        Args:
            last: unused.
            direction: direction of the last link at the goal, shape (3,), or None for no bounds on the components.
            turned: tolerance of the last link's direction [rad].
            rolled: tolerance of its roll [rad]; above a right angle, the roll is not held.
        """
        del last
        return self.tip_bounds(direction, turned, rolled)

    def bends_of(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """Return the bends of all joints, shape (2 n,) [rad], for values of the symbols by name."""
        return np.asarray(np.array(self.coupling) @ values["drives"])

    def curve(self, arm: Arm, _: Mapping[str, FloatArray], q: FloatArray) -> SpaceConfiguration:
        """Return the curve of the arm in metres and world axes: the arcs of sections, else one near the links.

        Args:
            arm: the arm.
            q: configuration with the positions of the axes that carry the base, shape (c,) [rad, m].
        """
        return curve_near_links(arm, q)


def curve_near_links(arm: Arm, q: FloatArray) -> SpaceConfiguration:
    """Return the curve of an arm in space: the arcs of its sections, else one near its links.

    Args:
        arm: the arm.
        q: configuration, shape (c,) [rad, m].
    """
    bends = q[: 2 * arm.links].reshape(-1, 2) * np.array([1.0, -1.0])
    if arm.sections is None:
        segments = max(arm.links // PIECES, 1)
        return curve_in_space(arm, CurveNumbers.near(bends, segments, link_shares(arm)), q)
    lengths = arm.sections.lengths
    turns = np.stack([bends[arm.sections.section_of_joint == k].sum(axis=0) for k in range(len(lengths))])
    base = arm.carried(q)
    return SpaceConfiguration.chain(
        base.place,
        base.rotation,
        lengths.tolist(),
        list(np.repeat((turns / lengths[:, None])[:, None], PIECES + 1, axis=1)),
    )
