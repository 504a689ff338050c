"""Symbolic nonlinear program (NLP) for a pose of the arm at a goal of its tip, in the plane and in space.

The program consists of named variables, constraint rows and costs. Lengths are in units of the arm's length; the base
is the origin, and the axes are those of the straight arm at its base.

Every cost is dimensionless: relative to the preferred clearance, to a limit, or to one radian. Costs are weighted by
``PoseSettings`` times the problem's ``[planner.weights]``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca

from ccm_opt.ik.bishop_shooting import BishopFrames
from ccm_opt.ik.driven_links import DrivenLinks
from ccm_opt.ik.link_frames import LinkFrames, PlanarFrames
from ccm_opt.ik.row_program import RowBlock, RowProgram, Symbols, equal_to_zero, not_negative


@dataclass(frozen=True)
class PoseSize:
    """Size of a symbolic goal-pose program, for which it is built once.

    Attributes:
        dimension: number of coordinates of a point, 2 or 3.
        links: number of links.
        sides: number of sides of the convex region of every joint, including padding.
        segments: number of curvature segments of the curve.
        loaded: whether joint torques are limited.
        shares: length of each link as a fraction of the arm's; empty if all are equal.
        along: direction of each link in the frame in which it is turned by its joint, ``dimension`` numbers a link;
            empty if all lie along x.
        up: up axis of the last link in that frame, three numbers; empty if the goal allows any roll.
        coupling: derivatives of the bends by the drives that move several together, joint by joint, a row for each of
            the 2 ``links`` bends; empty if every bend has its own.
        travels: fraction of its travel that each limited tendon takes for a unit of each drive, a row a tendon.
        carrier: axes that carry the base, as in ``LinkFrames``; empty for a feed.
        arcs: half of the length of the arc about each joint, and 0 for the tip, as a fraction of the arm's length;
            empty if joints are no arcs.
    """

    dimension: int
    links: int
    sides: int
    segments: int
    loaded: bool
    shares: tuple[float, ...] = ()
    along: tuple[float, ...] = ()
    up: tuple[float, ...] = ()
    coupling: tuple[tuple[float, ...], ...] = ()
    travels: tuple[tuple[float, ...], ...] = ()
    arcs: tuple[float, ...] = ()
    carrier: tuple[tuple[float, ...], ...] = ()

    def frames(self) -> LinkFrames:
        """Return the symbols of the links, and of what bends them."""
        links = (self.links, self.shares, self.along, self.up, self.carrier)
        if self.coupling:
            return DrivenLinks(*links, coupling=self.coupling, travels=self.travels, arcs=self.arcs)
        return (PlanarFrames if self.dimension == 2 else BishopFrames)(*links, segments=self.segments)


@dataclass(frozen=True, eq=False)
class HoldingLoads:
    """Joint torques that hold an arm of n links still under gravity, as variables and constraints of an NLP.

    Points have d coordinates; moments have one component in the plane and three in space. Forces are divided by a
    common unit of force.

    A torque is a sum over all links beyond its joint. With these sums as variables, every constraint involves
    neighbouring links only; with the sums written out, the program would take three times as long to build.

    Attributes:
        points: positions P of the joints and the tip, shape (d, n + 1).
        axes: rotation axes, one array of shape (1, n) or (3, n) for each of the k bends of a joint.
        weights: force on the centre of each link, shape (d, n).
        payload: force on the tip, shape (d, 1).
        limits: torque limits, shape (k, n), or (m, 1) of m drives.
        coupling: derivatives of the bends, joint by joint, by drives that move several together, shape (k n, m); None
            if every bend has its own.
        growths: how much longer the links before and behind each joint get with each of the k bends, shape (1, n) each;
            empty if they do not.
    """

    points: ca.SX
    axes: tuple[ca.SX, ...]
    weights: ca.SX
    payload: ca.SX
    limits: ca.SX
    coupling: ca.DM | None = None
    growths: tuple[ca.SX, ...] = ()

    @cached_property
    def symbols(self) -> dict[str, ca.SX]:
        """Symbols by name: "moments", shape (1 or 3, n), and "torque shares", shape (k, n) or (m, 1).

        Column j of the moments is the moment about the base of the weights of link j, all later links and the payload.
        "torque shares" are torques as fractions of their limits.
        """
        links = self.weights.shape[1]
        return {
            "moments": ca.SX.sym("moment", self.axes[0].shape[0], links),
            "torque shares": ca.SX.sym("torque_share", *self.limits.shape),
        }

    def values(self) -> tuple[ca.SX, ca.SX]:
        """Return expressions for the moments, and for the torques as fractions of their limits, at a pose.

        Their shapes are those of ``symbols``, whose start values they give.
        """
        moments = [_moment(self.points[:, -1], self.payload)]
        for link in reversed(range(self.weights.shape[1])):
            moments.append(moments[-1] + self._link_moment(link))
        found = ca.horzcat(*moments[:0:-1])
        return found, self._torques(found) / self.limits

    def rows(self) -> tuple[RowBlock, RowBlock, RowBlock]:
        """Return the constraints that define moments and torques, and the limits of the torques, in three blocks."""
        moments, shares = self.symbols.values()
        links = range(self.weights.shape[1])
        beyond = ca.horzcat(moments[:, 1:], _moment(self.points[:, -1], self.payload))
        own = ca.horzcat(*(self._link_moment(link) for link in links))
        joints = [f"joint {link + 1}{bend}" for link in links for bend in ([""], [" a", " b"])[len(self.axes) - 1]]
        if self.coupling is not None:
            joints = [f"drive {number + 1}" for number in range(self.coupling.shape[1])]
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

    def _link_moment(self, link: int) -> ca.SX:
        """Return the moment about the base of the weight of the link with the given index."""
        return _moment(0.5 * (self.points[:, link] + self.points[:, link + 1]), self.weights[:, link])

    def _torques(self, moments: ca.SX) -> ca.SX:
        """Return the torques about the k axes of every joint, shape (k, n), or of the drives, shape (m, 1).

        They follow from the moments about the base.
        """
        # Σ_{i ≥ j} (c_i - P_j) × w_i = Σ c_i × w_i - P_j × Σ w_i
        beyond = [self.payload]
        for link in reversed(range(self.weights.shape[1])):
            beyond.append(beyond[-1] + self.weights[:, link])
        forces = ca.horzcat(*beyond[::-1])
        links = range(self.weights.shape[1])
        whole = ca.horzcat(*(moments[:, link] - _moment(self.points[:, link], forces[:, link]) for link in links))
        torques = ca.vertcat(*(ca.sum1(whole * axis) for axis in self.axes))
        if self.growths:
            # What pulls at the middle and beyond the end of each link, along it.
            steps = self.points[:, 1:] - self.points[:, :-1]
            along = steps / ca.repmat(ca.sqrt(ca.sum1(steps**2)), steps.shape[0], 1)
            pull = ca.sum1(along * 0.5 * (forces[:, :-1] + forces[:, 1:]))
            both = pull + ca.horzcat(0, pull[:, :-1])
            torques += ca.vertcat(*(growth * both for growth in self.growths))
        return torques if self.coupling is None else self.coupling.T @ ca.vec(torques)


def _moment(place: ca.SX, force: ca.SX) -> ca.SX:
    """Return the moment about the origin of a force at a position, both of shape (d, 1); a scalar in the plane."""
    if place.numel() == 3:
        return ca.cross(place, force)
    return place[0] * force[1] - place[1] * force[0]


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseProgram(RowProgram):
    """Symbolic NLP whose solution is a pose of the arm with its tip at a goal.

    Attributes:
        size: size for which the program was built.
        frames: symbols of the links, and of what bends them.
        loads: torques that hold the arm under gravity; None if torque is not limited.
        magnitude: order of magnitude of the objective, by which the solver divides it: the largest of the user's
            weights, at least 1.
    """

    size: PoseSize
    frames: LinkFrames
    loads: HoldingLoads | None
    magnitude: float = 1.0


def place_rows(frames: LinkFrames, points: ca.SX) -> tuple[RowBlock, RowBlock]:
    """Return the constraints of forward kinematics: P_0 where the base is, P_(j+1) = P_j + l_j x_j for every link.

    Args:
        frames: symbols of the n links, with their directions x_j.
        points: positions P of the joints and the tip, shape (d, n + 1).

    Returns:
        The constraints on the base, and those on the links.
    """
    n = frames.links
    d = points.shape[0]
    at_base = tuple(f"base: gap in {name}" for name in "xyz"[:d])
    of_links = tuple(f"link {link + 1}: gap in {name} of its end" for link in range(n) for name in "xyz"[:d])
    gaps = points[:, 1:] - points[:, :-1] - frames.steps()
    return (
        equal_to_zero(at_base, points[:, 0] - frames.base_place()),
        equal_to_zero(of_links, ca.vec(gaps)),
    )


def region_rows(points: ca.SX, gap: ca.SX, given: Symbols) -> RowBlock:
    """Return the constraints that keep both ends of every link in the link's convex region, with a common clearance.

    They are n · P ≥ b + c g for every side (n, b) of the region of every joint and of the tip. The factor c is the
    fraction of the clearance that the side requires. If the first part of a link may touch obstacles, only the rest of
    the link is kept in the region.

    Args:
        points: positions P of the joints and the tip, shape (d, links + 1).
        gap: clearance g, equal for all links, a scalar.
        given: parameters by name: "first shares", the fraction of each link at which its constrained part starts, and
            "normals", "offsets" and "gap shares" of the sides.
    """
    sides, joints = given["offsets"].shape
    links = joints - 1
    ends = [*((j + 1, "start") for j in range(links)), (links, "end")]
    names = tuple(f"link {link}: side {k + 1} of its region, at its {end}" for link, end in ends for k in range(sides))
    shares = ca.repmat(given["first shares"].T, points.shape[0], 1)
    held = ca.horzcat(points[:, :-1] + shares * (points[:, 1:] - points[:, :-1]), points[:, links])
    products = given["normals"] * ca.repmat(held, sides, 1)
    reached = ca.reshape(ca.sum1(ca.reshape(products, points.shape[0], sides * joints)), sides, joints)
    return not_negative(names, ca.vec(reached - given["offsets"] - gap * given["gap shares"]))


def goal_row(tip: ca.SX, goal: ca.SX, room: ca.SX) -> RowBlock:
    """Return the constraint that keeps the tip in a ball of radius r about the goal, |tip - goal|² ≤ r².

    It is divided by 2 r, so that its value near the surface of the ball is approximately a distance.

    Args:
        tip: position of the tip, shape (d, 1).
        goal: centre of the ball, shape (d, 1).
        room: radius r of the ball, a positive scalar.
    """
    return not_negative(("tip: distance from its goal",), 0.5 * (room - ca.sumsqr(tip - goal) / room))


def _parameters(size: PoseSize, frames: LinkFrames) -> dict[str, ca.SX]:
    """Return the parameters of the goal-pose NLP, except the weights, as symbols by name.

    They stand for the goal, the arm's surroundings and the loads, which change from one solution to the next.
    """
    d = size.dimension
    near = ca.SX.sym("near", len(frames.directions), size.links)
    found = {
        "wanted gap": ca.SX.sym("wanted_gap"),
        "near": near,
        "first shares": ca.SX.sym("first_share", size.links),
        "goal": ca.SX.sym("goal", d),
        "goal room": ca.SX.sym("goal_room"),
        "normals": ca.SX.sym("normal", d * size.sides, size.links + 1),
        "offsets": ca.SX.sym("offset", size.sides, size.links + 1),
        "gap shares": ca.SX.sym("gap_share", size.sides, size.links + 1),
        **frames.parameters,
    }
    if size.carrier:
        found |= {name: ca.SX.sym(name.replace(" ", "_"), len(size.carrier)) for name in ("near feed", "feed weights")}
    if size.loaded:
        found |= {
            "link weights": ca.SX.sym("link_weight", d, size.links),
            "payload": ca.SX.sym("payload", d),
            "torque limits": ca.SX.sym("torque_limit", *((len(size.coupling[0]), 1) if size.coupling else near.shape)),
        }
    return found


def _distance(size: PoseSize, frames: LinkFrames, given: Mapping[str, ca.SX]) -> ca.SX:
    """Return the squared difference of all bends from those of a reference pose, and of the axes that carry the base.

    A feed does not count.
    """
    squares = ca.sumsqr(frames.bends - given["near"])
    if size.carrier:
        squares += ca.sumsqr(given["feed weights"] * (frames.feed - given["near feed"]))
    return squares


# A problem has few sizes, and each program keeps a built solver of some megabytes alive.
@lru_cache(maxsize=4)
def pose_program(size: PoseSize) -> PoseProgram:
    """Return the goal-pose NLP of a size, with its symbols, constraints and objective; nothing is solved."""
    frames = size.frames()
    points = ca.SX.sym("point", size.dimension, size.links + 1)
    gap = ca.SX.sym("gap")
    given = _parameters(size, frames)
    rows = [
        *frames.rows(),
        *place_rows(frames, points),
        region_rows(points, gap, Symbols(given)),
        goal_row(points[:, size.links], given["goal"], given["goal room"]),
    ]
    costs = dict(frames.costs)
    parts = {
        # The fraction of the preferred clearance that the tightest link lacks.
        "room": 1 - gap / given["wanted gap"],
        "bending": costs.pop("bending"),
        "distance": _distance(size, frames, given),
        **costs,
    }
    unknowns = {**frames.symbols, "points": points, "feed": frames.feed}
    loads = None
    if size.loaded:
        forces = (given["link weights"], given["payload"], given["torque limits"])
        coupling = ca.sparsify(ca.DM(size.coupling)) if size.coupling else None
        loads = HoldingLoads(points, frames.joint_axes(), *forces, coupling, frames.growths())
        rows += loads.rows()
        shares = loads.symbols["torque shares"]
        parts["torque"] = ca.sumsqr(shares) / shares.numel()
        unknowns |= loads.symbols
    weights = ca.SX.sym("weight", len(parts))
    return PoseProgram(
        size=size,
        frames=frames,
        loads=loads,
        unknowns=Symbols(unknowns | {"gap": gap}),
        parameters=Symbols({"weights": weights, **given}),
        rows=tuple(rows),
        parts=parts,
        objective=ca.dot(weights, ca.vertcat(*parts.values())),
    )
