"""The goal-pose program in space: variables, rows and costs.

Lengths are in units of the arm's length; the base is the origin and its direction, left and up are the axes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.ik import pose_program as pose_costs
from ccm_opt.ik.bishop_shooting import DIRECTIONS, BishopShooting, axis, mean_direction, product
from ccm_opt.ik.curve_program import RowBlock, equal_to_zero, not_negative
from ccm_opt.ik.holding import HoldingLoads
from ccm_opt.ik.pose_program import PoseSize, goal_row
from ccm_opt.ik.row_program import Repeated, RowProgram, repeated_rows


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


SPACE_PARTS = ("room", "bending", "distance", "knots", "bows", "stray", "torque")
"""Names of the parts of the objective, in the order of their weights among the parameters."""


@dataclass(frozen=True, eq=False)
class SpacePoseParameters:
    """Symbols of what changes from question to question; lengths in units of the arm's length, axes of its base.

    Attributes:
        weights: of the parts of the objective, shape (7, 1).
        wanted_gap: scalar.
        near: bends to stay near, shape (2, n) [rad].
        first_shares: where on each link the part begins that must be inside its region, shape (n, 1).
        goal: middle of the ball that the tip lies in, shape (3, 1).
        goal_room: its radius, scalar.
        across: two unit vectors across the direction asked for, shape (3, 2).
        normals: of the regions' sides, inwards, shape (3 · sides, n).
        offsets: shape (sides, n).
        gap_shares: shape (sides, n).
        offsets_from_curve: what the links of the start have of the curve's directions across them, shape (2, n).
        link_weights: force on each link's centre over all weight, shape (3, n); empty when torque is not limited.
        payload: force on the tip over all weight, shape (3, 1); likewise.
        torque_limits: over the arm's length and all weight, of both bends of every joint, shape (2, n); likewise.
    """

    weights: ca.SX
    wanted_gap: ca.SX
    near: ca.SX
    first_shares: ca.SX
    goal: ca.SX
    goal_room: ca.SX
    across: ca.SX
    normals: ca.SX
    offsets: ca.SX
    gap_shares: ca.SX
    offsets_from_curve: ca.SX
    link_weights: ca.SX
    payload: ca.SX
    torque_limits: ca.SX

    @classmethod
    def symbols(cls, size: PoseSize) -> "SpacePoseParameters":
        """Fresh symbols."""
        loaded = size.links if size.loaded else 0
        return cls(
            weights=ca.SX.sym("weight", len(SPACE_PARTS)),
            wanted_gap=ca.SX.sym("wanted_gap"),
            near=ca.SX.sym("near", 2, size.links),
            first_shares=ca.SX.sym("first_share", size.links),
            goal=ca.SX.sym("goal", 3),
            goal_room=ca.SX.sym("goal_room"),
            across=ca.SX.sym("across", 3, 2),
            normals=ca.SX.sym("normal", 3 * size.sides, size.links),
            offsets=ca.SX.sym("offset", size.sides, size.links),
            gap_shares=ca.SX.sym("gap_share", size.sides, size.links),
            offsets_from_curve=ca.SX.sym("offset_from_curve", 2, size.links),
            link_weights=ca.SX.sym("link_weight", 3, loaded),
            payload=ca.SX.sym("payload", 3 if size.loaded else 0),
            torque_limits=ca.SX.sym("torque_limit", 2, loaded),
        )

    @property
    def column(self) -> Any:
        """All of them in one column."""
        return ca.vertcat(*(ca.vec(value) for value in vars(self).values()))


@dataclass(frozen=True, eq=False, kw_only=True)
class SpacePoseProgram(RowProgram):
    """The symbolic part of the goal-pose NLP in space.

    Attributes:
        size: what it was built for.
        curve: symbols of the curve.
        bends: (a, b) of every joint, shape (2, n) [rad].
        links: quaternions of the links, shape (4, n).
        points: joint and tip positions, shape (3, n + 1).
        feed: position of the base, scalar.
        tip_parts: what the last link has of the axes across the goal's direction, shape (2, 1).
        stray: share of the start's offsets from its curve that the pose keeps, scalar.
        loads: what gravity asks of the joints; of no links where torque is not limited.
        gap: g, scalar.
    """

    size: PoseSize
    curve: BishopShooting
    bends: ca.SX
    links: ca.SX
    points: ca.SX
    feed: ca.SX
    tip_parts: ca.SX
    stray: ca.SX
    loads: HoldingLoads
    gap: ca.SX
    parameters: SpacePoseParameters

    @property
    def pose(self) -> tuple[ca.SX, ca.SX]:
        """The bends in the order of the coordinates, and the feed over the arm's length."""
        return ca.vec(self.bends), self.feed

    @property
    def variables(self) -> ca.SX:
        """The curve, bends, links, points, feed, the tip's parts, what strays, the loads and the gap in one column."""
        flat = [ca.vec(symbols) for symbols in (self.bends, self.links, self.points)]
        rest = (self.feed, self.tip_parts, self.stray, self.loads.variables, self.gap)
        return ca.vertcat(self.curve.variables, *flat, *rest)

    @cached_property
    def places(self) -> Mapping[str, slice]:
        """Where the variables stand in the column, by name."""
        first, _ = self.curve.parts
        knots = first.count + 1
        links = self.size.links
        sizes = {"arcs": knots}
        for direction in DIRECTIONS:
            each = (("curvature", knots), ("turned", knots), ("integral", knots), ("bows", first.bows.numel()))
            sizes |= {f"{name} {direction}": size for name, size in each}
        sizes |= {"base turn": 2, "turns": 2 * links, "means": 2 * links, "frames": 4 * links}
        sizes |= {"bends": 2 * links, "links": 4 * links, "points": 3 * (links + 1)}
        sizes |= {"feed": 1, "tip parts": 2, "stray": 1, "loads": self.loads.variables.numel(), "gap": 1}
        stops = np.cumsum(list(sizes.values())).tolist()
        return {name: slice(stop - size, stop) for (name, size), stop in zip(sizes.items(), stops, strict=True)}


# Few sizes are met in one problem, and a program keeps a built solver of some megabytes alive.
@lru_cache(maxsize=4)
def space_pose_program(size: PoseSize) -> SpacePoseProgram:
    """Symbols, rows and objective for a size; nothing is solved."""
    curve = BishopShooting(size.segments, size.links)
    bends = ca.SX.sym("bend", 2, size.links)
    links = ca.SX.sym("link", 4, size.links)
    points = ca.SX.sym("point", 3, size.links + 1)
    feed = ca.SX.sym("feed")
    tip_parts = ca.SX.sym("tip_part", 2)
    stray = ca.SX.sym("stray")
    loads = HoldingLoads.symbols(size.links if size.loaded else 0)
    gap = ca.SX.sym("gap")
    given = SpacePoseParameters.symbols(size)
    rows = [
        *curve.rows(size.least_piece, size.window),
        *turning_rows(bends, links),
        *place_rows(links, points, feed),
        mapping_rows_in_space(curve, links, stray, given.offsets_from_curve),
        side_rows(points, given.first_shares, given.normals, given.offsets, given.gap_shares, gap),
        goal_row(points[:, size.links], given.goal, given.goal_room),
        tip_direction_rows(links[:, size.links - 1], given.across, tip_parts),
    ]
    first, second = curve.parts
    parts = {
        "room": pose_costs.lack_of_room(gap, given.wanted_gap),
        "bending": pose_costs.bending(first) + pose_costs.bending(second),
        "distance": ca.sumsqr(bends - given.near),
        "knots": pose_costs.uneven_knots(first),
        "bows": pose_costs.rough_curvature(first) + pose_costs.rough_curvature(second),
        "stray": stray**2 * ca.sumsqr(given.offsets_from_curve),
        "torque": ca.SX(0),
    }
    if size.loaded:
        rows += loads.rows(links, points, given.link_weights, given.payload, given.torque_limits)
        parts["torque"] = ca.sumsqr(loads.shares) / loads.shares.numel()
    return SpacePoseProgram(
        size=size,
        curve=curve,
        bends=bends,
        links=links,
        points=points,
        feed=feed,
        tip_parts=tip_parts,
        stray=stray,
        loads=loads,
        gap=gap,
        parameters=given,
        rows=tuple(rows),
        parts=parts,
        objective=ca.dot(given.weights, ca.vertcat(*(parts[name] for name in SPACE_PARTS))),
    )
