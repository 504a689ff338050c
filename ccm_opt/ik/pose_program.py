"""The goal-pose program in the plane: variables, rows and costs.

Lengths are in units of the arm's length, the base is the origin.

Every term is a share: of the wanted gap, of the limits, of one radian. The weights are in ``PoseSettings`` times those
of the problem's ``[planner.weights]``.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca

from ccm_opt.ik.curve_program import RowBlock, equal_to_zero, not_negative
from ccm_opt.ik.lifted_curve import LiftedCurve, mapping_rows
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.row_program import RowProgram
from ccm_opt.robot.segment import PIECES

_WINDOW = 1
"""Spline pieces on either side of the one in which a joint lies at first, among which the joint may come to lie while
knots move. A wider one costs building time, a narrower one holds the knots (measured: with 1 building takes three
quarters of the time that 2 takes, and the poses of clutter are the same)."""
_LEAST_PIECE = 0.08
"""Least share of its segment that a piece between knots keeps (as the configuration NLP has it)."""


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


def goal_row(tip: ca.SX, goal: ca.SX, room: ca.SX) -> RowBlock:
    """|P_n - goal|² ≤ room²: the tip lies in a ball; over 2 room, so that at the edge the row is a length.

    Args:
        tip: P_n, shape (d, 1).
        goal: middle of the ball, shape (d, 1).
        room: its radius, scalar and positive.
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


def lack_of_room(gap: ca.SX, wanted: ca.SX) -> ca.SX:
    """1 - g/wanted: what the tightest link lacks of the wanted gap."""
    return 1 - gap / wanted


def bending(curve: LiftedCurve) -> ca.SX:
    """∫ κ² ds, twice the elastic energy of a unit rod."""
    return ca.sum1(curve.pieces.squared_curvature())


def uneven_knots(curve: LiftedCurve) -> ca.SX:
    """Σ (a_i / L_k - ¼)² + Σ (K L_k - 1)²: pulls knots towards even spacing, and segments towards equal length."""
    lengths = curve.segment_lengths
    shares = curve.pieces.width / ca.vec(ca.repmat(lengths, PIECES, 1))
    return ca.sumsqr(shares - 1 / PIECES) + ca.sumsqr(lengths * curve.segments - 1)


def rough_curvature(curve: LiftedCurve) -> ca.SX:
    """Mean square of what the curvature leaves its chords by between knots."""
    return ca.sumsqr(curve.bows) / curve.count


def distance_from(link_headings: ca.SX, near: ca.SX) -> ca.SX:
    """Sum of the squared turns of the joints from a pose [rad²]: what is near in the joints is soon reached."""
    turned = link_headings - near
    return turned[0] ** 2 + ca.sumsqr(turned[1:] - turned[:-1])


def holding_effort(torques: ca.SX, limits: ca.SX) -> ca.SX:
    """Mean square of the torques that gravity asks for, as shares of their limits."""
    return ca.sumsqr(torques / limits) / torques.numel()


PARTS = ("room", "bending", "distance", "torque", "knots", "bows")
"""Names of the parts of the objective, in the order of their weights among the parameters."""


@dataclass(frozen=True)
class PoseSize:
    """What the symbolic part depends on.

    Attributes:
        links: number of links.
        sides: sides of every joint's region, padded.
        loaded: whether torques are limited.
        segments: curvature segments of the curve.
        window: pieces about a joint, see ``mapping_rows``.
        least_piece: least share of its segment that a piece keeps.
    """

    links: int
    sides: int
    loaded: bool
    segments: int
    window: int
    least_piece: float

    @classmethod
    def from_settings(cls, links: int, sides: int, *, loaded: bool, settings: PoseSettings) -> "PoseSize":
        """The size of a question."""
        return cls(links, sides, loaded, settings.segments_for(links), _WINDOW, _LEAST_PIECE)


@dataclass(frozen=True, eq=False)
class PoseParameters:
    """Symbols of what changes from question to question; lengths in units of the arm's length.

    Attributes:
        weights: of the parts of the objective, shape (6, 1).
        wanted_gap: scalar.
        near: link headings to stay near, shape (links, 1) [rad].
        base_heading: of the straight arm [rad].
        bend_limits: shape (links, 1) [rad].
        first_shares: where on each link the part begins that must be inside its region, shape (links, 1).
        goal: middle of the disc that the tip lies in, shape (2, 1).
        goal_room: its radius, scalar.
        normals: of the regions' sides, shape (2, (links + 1) · sides).
        offsets: shape (sides, links + 1).
        link_weights: force on each link's centre, shape (2, links) [N]; empty when torque is not limited.
        payload: force on the tip, shape (2, 1) [N]; likewise.
        torque_limits: over the arm's length, shape (links, 1) [N]; likewise.
    """

    weights: ca.SX
    wanted_gap: ca.SX
    near: ca.SX
    base_heading: ca.SX
    bend_limits: ca.SX
    first_shares: ca.SX
    goal: ca.SX
    goal_room: ca.SX
    normals: ca.SX
    offsets: ca.SX
    link_weights: ca.SX
    payload: ca.SX
    torque_limits: ca.SX

    @classmethod
    def symbols(cls, size: PoseSize) -> "PoseParameters":
        """Fresh symbols."""
        loaded = size.links if size.loaded else 0
        return cls(
            weights=ca.SX.sym("weight", len(PARTS)),
            wanted_gap=ca.SX.sym("wanted_gap"),
            near=ca.SX.sym("near", size.links),
            base_heading=ca.SX.sym("base_heading"),
            bend_limits=ca.SX.sym("bend_limit", size.links),
            first_shares=ca.SX.sym("first_share", size.links),
            goal=ca.SX.sym("goal", 2),
            goal_room=ca.SX.sym("goal_room"),
            normals=ca.SX.sym("normal", 2, (size.links + 1) * size.sides),
            offsets=ca.SX.sym("offset", size.sides, size.links + 1),
            link_weights=ca.SX.sym("link_weight", 2, loaded),
            payload=ca.SX.sym("payload", 2 if size.loaded else 0),
            torque_limits=ca.SX.sym("torque_limit", loaded),
        )

    @property
    def column(self) -> Any:
        """All of them in one column."""
        return ca.vertcat(*(ca.vec(value) for value in vars(self).values()))


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseProgram(RowProgram):
    """The symbolic part of the goal-pose NLP.

    Attributes:
        size: what it was built for.
        curve: symbols of the curve.
        link_headings: φ, shape (links, 1) [rad].
        points: joint and tip positions, shape (2, links + 1).
        gap: g, scalar.
    """

    size: PoseSize
    curve: LiftedCurve
    link_headings: ca.SX
    points: ca.SX
    gap: ca.SX
    parameters: PoseParameters

    @property
    def pose(self) -> tuple[ca.SX, ca.SX]:
        """The headings of the links, and no feed."""
        return self.link_headings, ca.SX(0)

    @property
    def variables(self) -> ca.SX:
        """The curve, φ, P and g in one column."""
        return ca.vertcat(self.curve.variables, self.link_headings, ca.vec(self.points), self.gap)


# Few sizes are met in one problem, and a program keeps a built solver of some megabytes alive.
@lru_cache(maxsize=4)
def pose_program(size: PoseSize) -> PoseProgram:
    """Symbols, rows and objective for a size; nothing is solved."""
    curve = LiftedCurve(size.segments)
    link_headings = ca.SX.sym("heading", size.links)
    points = ca.SX.sym("point", 2, size.links + 1)
    gap = ca.SX.sym("gap")
    given = PoseParameters.symbols(size)
    rows = [
        *curve.rows(size.least_piece),
        *mapping_rows(curve, link_headings, size.window),
        chain_rows(link_headings, points),
        joint_limit_rows(link_headings, given.base_heading, given.bend_limits),
        region_rows(points, given.first_shares, given.normals, given.offsets, gap),
        goal_row(points[:, size.links], given.goal, given.goal_room),
    ]
    parts = {
        "room": lack_of_room(gap, given.wanted_gap),
        "bending": bending(curve),
        "knots": uneven_knots(curve),
        "bows": rough_curvature(curve),
        "distance": distance_from(link_headings, given.near),
        "torque": ca.SX(0),
    }
    if size.loaded:
        torques = holding_torques(points, given.link_weights, given.payload)
        rows.append(torque_rows(torques, given.torque_limits))
        parts["torque"] = holding_effort(torques, given.torque_limits)
    parts = {name: parts[name] for name in PARTS}
    return PoseProgram(
        size=size,
        curve=curve,
        link_headings=link_headings,
        points=points,
        gap=gap,
        parameters=given,
        rows=tuple(rows),
        parts=parts,
        objective=ca.dot(given.weights, ca.vertcat(*parts.values())),
    )
