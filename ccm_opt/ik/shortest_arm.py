"""The shortest arm with a pose at a goal near a given one, by nonlinear programs with the link length as a variable.

The unknowns are the positions P_0 … P_n of the joints and the tip, the length l of all links and the feed of the base:

    min l   subject to   |P_(j+1) − P_j| = l,   the angle between consecutive links within the joint limits,
                         the tip at the goal with its direction,   links clear of half-spaces about the obstacles.

The half-spaces are those of the nearest surfaces of every link, each for the point of the link that is nearest. They
hold near the pose about which they are drawn, and so positions move by a fraction of a link before they are drawn anew.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, in_space
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.ipopt_call import ipopt_answer
from ccm_opt.core.polyline import vector_headings
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.inverse_kinematics import configuration_from_positions

_ROUNDS = 40
"""Largest number of programs. Heuristic: an arm a fifth too long takes ten to twenty."""
_SETTLED = 1e-4
"""Relative change of the length below which the pose counts as the shortest."""
_LARGEST_MOVE, _LEAST_MOVE = 0.5, 0.01
"""Largest and least distance that a joint may move in one program, in link lengths. Heuristic."""
_GROWTH, _SHRINKAGE = 1.5, 0.4
"""Factors by which that distance grows after a program that succeeds, and shrinks after another. Heuristic."""
_TOLERANCE_USED = 0.9
"""Share of the goal's tolerances that is used; the rest is left to rounding."""
_NARROW = 0.1
"""Tolerance of a direction up to which it is kept by components across it [rad]; the cone of a narrow one has no
gradient on its axis."""
_PROXIMAL = 1e-3
"""Weight of squared moves, which makes poses of equal length distinct. Heuristic."""
_SHORTFALL_WEIGHT = 20.0
"""Weight of what clearance and joint limits lack at first. Heuristic: far above what it can save in length."""
_PLANES = 8
"""Largest number of half-spaces a link. Heuristic."""
_FREE_OF_TUBE = 1.5
"""Distance from the end of a guide tube up to which the joints of an arm that leaves it along its own shape stay
straight, in link lengths. Derived: the leader's paths leave the axis there."""
_ITERATIONS = 200


@dataclass(frozen=True)
class ShortPose:
    """Pose of an arm at a goal, with the length of its links.

    Attributes:
        link_length: length of each link [m].
        configuration: configuration of the arm with links of that length, shape (c,) [rad, m].
    """

    link_length: float
    configuration: FloatArray


@dataclass(eq=False)
class _Rows:
    """Constraints of a program with their bounds."""

    expressions: list[ca.SX] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)

    def add(self, expression: ca.SX, lower: float, upper: float = np.inf) -> None:
        """Add entries with common bounds."""
        column = ca.vec(expression)
        self.expressions.append(column)
        self.lower += [lower] * column.numel()
        self.upper += [upper] * column.numel()


def shortest_arm(
    problem: Problem, near: FloatArray, slack: float, least: float = 0.0, *, led: bool = True
) -> ShortPose | None:
    """Return the shortest arm with a pose at a problem's goal that is found from a pose of the problem's arm.

    Links are of one length. Contacts between links and loads are left to who plans a motion to the pose.

    Args:
        problem: problem of an arm of equal links without a tool, whose goal is one of the tip.
        near: pose from which the search begins, shape (c,) [rad, m].
        slack: share of the joint limits that is left unused; the arm keeps a like share of the distance by which the
            chord of a link cuts a bend at its limit, beyond its clearance.
        least: least length of a link [m].
        led: whether the pose is to be reached along the arm's own shape out of a guide tube, at the end of which joints
            stay straight.

    Returns:
        The pose; None if none was found that is free and within the limits.
    """
    arm = problem.arm
    goal = problem.goal.for_tip
    if goal is None:
        raise ProblemError("the goal is a pose of the whole arm, which has the arm's length")
    now = _Chain(arm.joint_positions_at(near), arm.link_length, float(near[-1]) if arm.base_axes else 0.0)
    bounds = _Bounds(slack, slack * arm.joint_limit * arm.link_length / 8.0, least, _FREE_OF_TUBE if led else 0.0)
    move = _LARGEST_MOVE
    for _ in range(_ROUNDS):
        found = _improved(problem, goal, now, replace(bounds, move=move))
        if found is None:
            move *= _SHRINKAGE
            if move < _LEAST_MOVE:
                break
            continue
        free = _gap(problem, found) >= 0.0
        settled = abs(found.link_length - now.link_length) < _SETTLED * now.link_length
        now = found
        if settled and free:
            break
        # Half-spaces that let links through walls were drawn too far from where the links are now.
        move = min(_GROWTH * move, _LARGEST_MOVE) if free else max(_SHRINKAGE * move, _LEAST_MOVE)
    return _pose(problem, now, bounds.ahead)


@dataclass(frozen=True)
class _Bounds:
    """Bounds of a program.

    Attributes:
        slack: share of the joint limits that is left unused.
        spare: gap beyond the required clearance [m].
        least: least length of a link [m].
        ahead: distance from the end of a guide tube up to which joints stay straight, in link lengths.
        move: largest change of a coordinate, in link lengths.
    """

    slack: float
    spare: float
    least: float
    ahead: float
    move: float = _LARGEST_MOVE


@dataclass(frozen=True, eq=False)
class _Chain:
    """Positions of joints and tip, shape (n + 1, d) [m], the length of each link and the feed of the base [m]."""

    points: FloatArray
    link_length: float
    feed: float


def _arm(problem: Problem, chain: _Chain) -> Arm:
    return replace(problem.arm, link_length=chain.link_length)


def _gap(problem: Problem, chain: _Chain) -> float:
    """Return the least gap of a chain beyond the required clearance, capped at the length of a link [m]."""
    link, segments = problem.arm.exposed_links(chain.points)
    kept = problem.arm.radii[link:] + problem.workspace.clearance
    reach = float(np.max(kept, initial=0.0)) + problem.arm.link_length
    gaps = problem.workspace.surface_tree.distances(in_space(segments), reach) - kept
    return float(np.min(gaps, initial=problem.arm.link_length))


def _pose(problem: Problem, chain: _Chain, ahead: float) -> ShortPose | None:
    """Return the pose of a chain; None if it is not free, or a bend exceeds its limit."""
    arm = _arm(problem, chain)
    steps = np.diff(chain.points, axis=0)
    steps *= chain.link_length / np.linalg.norm(steps, axis=1)[:, None]
    feed = float(np.clip(chain.feed, *arm.base_range))
    first = arm.base + feed * arm.direction
    points = first + np.concatenate((np.zeros((1, arm.dimension)), np.cumsum(steps, axis=0)))
    if arm.dimension == 3:
        q = configuration_from_positions(arm, points)
    else:
        headings = np.unwrap(np.append(arm.base_heading, vector_headings(steps)))
        q = arm.configuration(np.diff(headings), feed)
    bends = q[arm.coordinates.bends]
    bends[np.repeat(_straight(arm, chain, ahead), arm.bends_a_joint)] = 0.0
    q[arm.coordinates.bends] = bends
    free = _gap(problem, replace(chain, points=arm.joint_positions_at(q))) >= 0.0
    return ShortPose(chain.link_length, q) if free and bool(np.all(np.abs(bends) <= arm.bend_limits)) else None


def _straight(arm: Arm, chain: _Chain, ahead: float) -> BoolArray:
    """Return a mask of the joints that stay straight up to a distance from a guide tube's end, shape (n,)."""
    return arm.held(chain.feed - ahead * chain.link_length)


def _improved(problem: Problem, goal: TipGoal, now: _Chain, bounds: _Bounds) -> _Chain | None:
    """Return the chain with the shortest links near another, within bounds; None if the program has no solution."""
    arm = _arm(problem, now)
    d, n = arm.dimension, arm.links
    unit = problem.arm.link_length
    moves = ca.SX.sym("move", d, n + 1)
    length, feed, shortfall = ca.SX.sym("length"), ca.SX.sym("feed"), ca.SX.sym("shortfall")
    points = ca.DM(now.points.T / unit) + moves
    links = points[:, 1:] - points[:, :-1]
    direction = ca.DM(arm.direction)
    rows = _Rows()
    rows.add(points[:, 0] - (ca.DM(arm.base / unit) + feed * direction), 0.0, 0.0)
    _add_links(rows, arm, now, links, length, shortfall, bounds)
    if arm.base_axes:
        straight = int(np.sum(_straight(arm, now, bounds.ahead)))
        if straight < n:
            rows.add(feed + (straight - bounds.ahead) * length - arm.hole / unit, 0.0)
    _add_goal(rows, problem, goal, points[:, n] - ca.DM(goal.position / unit), links[:, n - 1], length)
    _add_half_spaces(rows, problem, now, moves, shortfall, bounds)
    x = ca.vertcat(ca.vec(moves), length, feed, shortfall)
    f = length + _SHORTFALL_WEIGHT * shortfall + _PROXIMAL * ca.sumsqr(moves)
    program: dict[str, Any] = {"x": x, "f": f, "g": ca.vertcat(*rows.expressions)}
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.max_iter": _ITERATIONS,
    }
    low, high = (end / unit for end in arm.base_range)
    count = moves.numel()
    answer, statistics = ipopt_answer(
        lambda: ca.nlpsol("shortest", "ipopt", program, options),
        np.concatenate((np.zeros(count), [now.link_length / unit, now.feed / unit, 0.0])),
        lbx=np.concatenate((np.full(count, -bounds.move), [bounds.least / unit, low, 0.0])),
        ubx=np.concatenate((np.full(count, bounds.move), [np.inf, high, np.inf])),
        lbg=np.array(rows.lower),
        ubg=np.array(rows.upper),
    )
    if statistics["return_status"] not in {"Solve_Succeeded", "Solved_To_Acceptable_Level"}:
        return None
    values = np.array(answer["x"]).ravel()
    moved = now.points + unit * values[:count].reshape(n + 1, d)
    return _Chain(moved, unit * float(values[count]), unit * float(values[count + 1]))


def _add_links(
    rows: _Rows, arm: Arm, now: _Chain, links: ca.SX, length: ca.SX, shortfall: ca.SX, bounds: _Bounds
) -> None:
    """Add that links are of one length, straight in a guide tube, and turn from one to the next within the limits."""
    direction = ca.DM(arm.direction)
    turns = np.minimum(np.append(arm.base_limit, np.full(arm.links - 1, arm.joint_limit)), np.pi)
    straight = _straight(arm, now, bounds.ahead)
    before = ca.horzcat(length * direction, links[:, :-1])
    for link in range(arm.links):
        if straight[link]:
            rows.add(links[:, link] - length * direction, 0.0, 0.0)
            continue
        rows.add(ca.sumsqr(links[:, link]) - length**2, 0.0, 0.0)
        if turns[link] < np.pi:
            cosine = np.cos((1.0 - bounds.slack) * turns[link])
            rows.add(ca.dot(before[:, link], links[:, link]) - cosine * length**2 + shortfall, 0.0)


def _add_goal(rows: _Rows, problem: Problem, goal: TipGoal, miss: ca.SX, link: ca.SX, length: ca.SX) -> None:
    """Add that the tip is at the goal, in the cube within its tolerance, and the last link in its direction."""
    arm, allowed = problem.arm, problem.tolerances
    half = _TOLERANCE_USED * allowed.position / (arm.link_length * np.sqrt(arm.dimension))
    rows.add(miss, -half, half)
    turn = _TOLERANCE_USED * allowed.heading
    if goal.direction is None or turn >= np.pi:
        return
    along = ca.dot(ca.DM(goal.direction), link)
    if turn > _NARROW:
        rows.add(along - np.cos(turn) * length, 0.0)
        return
    across = ca.DM(np.linalg.svd(goal.direction[:, None])[0][:, 1:].T) @ link
    most = np.sin(turn) / np.sqrt(arm.dimension - 1)
    rows.add(along, 0.0)
    rows.add(most * length - across, 0.0)
    rows.add(most * length + across, 0.0)


def _add_half_spaces(
    rows: _Rows, problem: Problem, now: _Chain, moves: ca.SX, shortfall: ca.SX, bounds: _Bounds
) -> None:
    """Add that the point of each link that is nearest to a surface keeps its distance from the surface's plane."""
    arm = problem.arm
    unit = arm.link_length
    link, segments = arm.exposed_links(now.points)
    segments = in_space(segments)
    kept = arm.radii[link:] + problem.workspace.clearance + bounds.spare
    reach = float(np.max(kept, initial=0.0)) + 2.0 * bounds.move * unit
    found = problem.workspace.surface_tree.planes(segments, reach, most=_PLANES)
    first = in_space(now.points)[link + found.link]
    along = in_space(now.points)[link + found.link + 1] - first
    begin, end = segments[found.link, 0], segments[found.link, 1]
    nearest = begin + found.share[:, None] * (end - begin)
    shares = np.einsum("rk,rk->r", nearest - first, along) / np.maximum(np.einsum("rk,rk->r", along, along), 1e-300)
    for k, (share, number) in enumerate(zip(shares.tolist(), (link + found.link).tolist(), strict=True)):
        moved = (1.0 - share) * moves[:, number] + share * moves[:, number + 1]
        normal = ca.DM(found.normal[k, : arm.dimension])
        lacking = (kept[found.link[k]] - found.gap[k]) / unit
        rows.add(ca.dot(normal, moved) + shortfall - lacking, 0.0)
