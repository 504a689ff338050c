"""The goal-pose NLP as data: symbols, named rows and cost parts, built once for a number of links and sides."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca

from ccm_opt.nlp.arm_pose import pose_costs
from ccm_opt.nlp.arm_pose.lifted_curve import LiftedCurve
from ccm_opt.nlp.arm_pose.link_mapping import mapping_rows
from ccm_opt.nlp.arm_pose.pose_rows import (
    chain_rows,
    goal_rows,
    holding_torques,
    joint_limit_rows,
    region_rows,
    torque_rows,
)
from ccm_opt.nlp.arm_pose.pose_settings import PoseSettings
from ccm_opt.nlp.row_program import RowProgram

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
        return cls(links, sides, loaded, settings.segments, settings.window, settings.least_piece)


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
        goal_rows(points[:, size.links], given.goal, given.goal_room),
    ]
    parts = {
        "room": pose_costs.lack_of_room(gap, given.wanted_gap),
        "bending": pose_costs.bending(curve),
        "knots": pose_costs.uneven_knots(curve),
        "bows": pose_costs.rough_curvature(curve),
        "distance": pose_costs.distance_from(link_headings, given.near),
        "torque": ca.SX(0),
    }
    if size.loaded:
        torques = holding_torques(points, given.link_weights, given.payload)
        rows.append(torque_rows(torques, given.torque_limits))
        parts["torque"] = pose_costs.holding_effort(torques, given.torque_limits)
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
