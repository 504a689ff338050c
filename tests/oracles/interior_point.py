"""The optimisation of a motion in the plane as one nonlinear program, solved by IPOPT with the exact Hessian.

Rows and objective are those of the sequential convex programming. Nothing is linearised, so it says how good the steps
are. Between two solutions it may leave the motion's homotopy class: what is not certified is given up.
"""

from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.ipopt_call import ipopt_call
from ccm_opt.planning.optimisation.interval_rows import IntervalRows
from ccm_opt.planning.optimisation.objective import Objective, WallNearness
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram
from ccm_opt.planning.settings import StepSettings
from ccm_opt.planning.swept_motion import PlanarSweep

_ITERATIONS = 200
"""Of IPOPT. Heuristic."""
_TOLERANCE = 1e-5
"""Of IPOPT. Heuristic."""
_SHORTENINGS = (1.0, 0.5, 0.25, 0.1)
"""Shares of the way to the solution that are tried until one is certified. Heuristic."""

_WIDER = 2.0
"""Rows this many times farther away than those of a sequential step are taken in. Heuristic."""


def interior_point(program: MotionProgram[PlanarSweep], coordinates: FloatArray) -> FloatArray:
    """Optimise a certified motion.

    Args:
        program: what to keep.
        coordinates: at the keyframes, shape (K + 1, p).

    Returns:
        Coordinates of a certified motion, shape (K + 1, p).
    """
    sweep = PlanarSweep(program.curve, coordinates)
    return _certified_part(program, sweep, _solution(program, sweep, program.rows(sweep)))


def _certified_part(program: MotionProgram[PlanarSweep], sweep: PlanarSweep, solution: FloatArray) -> FloatArray:
    """As much of the way to the solution as is certified."""
    change = solution - sweep.unknowns
    for share in _SHORTENINGS:
        ended = program.ended(sweep.unknowns + share * change)
        moved = sweep if ended is None else program.sweep(ended)
        if program.feasible(moved, sweep) and len(program.failures(moved.unknowns)) == 0:
            return moved.unknowns
    return sweep.unknowns


def _solution(program: MotionProgram[PlanarSweep], sweep: PlanarSweep, all_rows: IntervalRows) -> FloatArray:
    """Keyframes at which IPOPT ends, shape (K + 1, p)."""
    space = program.curve
    frames, p = sweep.unknowns.shape

    # The rows stay as they are for a whole solution, and keyframes travel farther in it than in one step.
    rows = program.active_rows(all_rows, sweep, _WIDER * program.row_reach)
    objective = program.objective(frames - 1)

    moving = ca.SX.sym("v", p, frames - 1)
    turning = ca.SX.sym("phi", space.arm.links, frames - 1)  # tied to v: keeps the derivatives sparse
    slack = ca.SX.sym("s", frames - 1)
    v = ca.horzcat(ca.DM(sweep.unknowns[0]), moving)
    headings = ca.horzcat(ca.DM(sweep.headings[0]), turning)
    offset = space.arm.headings(space.offset)
    tie = ca.vec(ca.DM(space.turns) @ moving + ca.repmat(ca.DM(offset), 1, frames - 1) - turning)
    points = _points(program, headings)

    # One slack an interval at a price, as in the QP: the start is infeasible as soon as the sag is counted.
    unit = program.unit
    inequalities = _row_values(rows, points, headings, space.arm.link_length) / unit - slack[rows.interval.tolist()]
    ends = _end_values(program, sweep, v, points)
    bends = ca.vec(ca.DM(space.bend_rows) @ (moving - ca.DM(sweep.unknowns[1:].T)))
    near = nearness_cost(program.nearness(all_rows, sweep), points, headings, space.arm.link_length)
    low, high = _bend_bounds(sweep, StepSettings.limit_share)

    problem = {
        "x": ca.vertcat(ca.vec(moving), ca.vec(turning), slack),
        "f": _objective(objective, v) + near + program.steps.price * ca.sum1(slack),
        "g": ca.vertcat(inequalities, ends, tie, bends),
    }
    options = {
        "ipopt.max_iter": _ITERATIONS,
        "ipopt.tol": _TOLERANCE,
        "ipopt.print_level": 0,
        "print_time": False,
    }

    size = moving.numel()
    zero = np.zeros(ends.numel() + tie.numel())
    # Slack begins at the worst row of its interval, so that IPOPT starts feasible but for the ends.
    worst = np.zeros(frames - 1)
    np.maximum.at(worst, rows.interval, rows.values(sweep) / unit)
    with ipopt_call():
        solver = ca.nlpsol("motion", "ipopt", problem, {**options, "ipopt.sb": "yes"})
        result = solver(
            x0=np.concatenate((sweep.unknowns[1:].ravel(), sweep.headings[1:].ravel(), worst)),
            lbx=np.concatenate((np.full(size + tie.numel(), -np.inf), np.zeros(frames - 1))),
            lbg=np.concatenate((np.full(len(rows), -np.inf), zero, low)),
            ubg=np.concatenate((np.zeros(len(rows)), zero, high)),
        )
    found = np.asarray(result["x"]).ravel()[:size].reshape(frames - 1, p)
    return np.vstack((sweep.unknowns[:1], found))


def _points(program: MotionProgram[PlanarSweep], headings: Any) -> tuple[Any, Any]:
    """Both coordinates of ``Sweep.points``, each (n + 3) × (K + 1)."""
    arm = program.curve.arm
    link, share = program.curve.arm.mount_end
    parts = []
    for direction, base in ((ca.cos(headings), arm.base[0]), (ca.sin(headings), arm.base[1])):
        joints = ca.vertcat(ca.DM.zeros(1, headings.shape[1]), arm.link_length * ca.cumsum(direction)) + base
        at_mount = (1.0 - share) * joints[link, :] + share * joints[link + 1, :]
        parts.append(ca.vertcat(joints, at_mount, base * ca.DM.ones(1, headings.shape[1])))
    return parts[0], parts[1]


def _row_values(rows: IntervalRows, points: tuple[Any, Any], headings: Any, link_length: float) -> Any:
    """Values of the rows, as ``IntervalRows.values``."""
    # CasADi flattens column by column: entry (i, k) of a matrix of h rows is at h k + i.
    height = points[0].shape[0]
    at = height * (rows.interval + rows.share.astype(np.intp))
    plus = (at + rows.plus).tolist()
    minus = (at + rows.minus % height).tolist()

    turns = headings[:, 1:] - headings[:, :-1]
    sag = ca.vertcat(ca.DM.zeros(1, turns.shape[1]), ca.cumsum(0.125 * link_length * turns**2))
    high = (sag.shape[0] * rows.interval + rows.high).tolist()
    low = (sag.shape[0] * rows.interval + rows.low).tolist()

    apart = [ca.vec(q)[plus] - ca.vec(q)[minus] for q in points]
    across = ca.DM(rows.normal[:, 0]) * apart[0] + ca.DM(rows.normal[:, 1]) * apart[1]
    return across + ca.vec(sag)[high] - ca.vec(sag)[low] + ca.DM(rows.constant)


def nearness_cost(costs: tuple[WallNearness, ...], points: tuple[Any, Any], headings: Any, link_length: float) -> Any:
    """What nearness to walls costs, as ``WallNearness.value``."""
    frames = headings.shape[1]
    total = 0.0
    for near in costs:
        lack = ca.fmax(1.0 + _row_values(near.rows, points, headings, link_length) / near.distance, 0.0)
        total = total + near.share(frames - 1) * ca.sumsqr(lack)
    return total


def _end_values(program: MotionProgram[PlanarSweep], sweep: PlanarSweep, v: Any, points: tuple[Any, Any]) -> Any:
    """What has to vanish at the last keyframe."""
    if program.end_fixed:
        return v[:, -1] - ca.DM(sweep.unknowns[-1])
    links = program.curve.arm.links
    goal = program.goal
    tip = ca.vertcat(points[0][links, -1] - goal.position[0], points[1][links, -1] - goal.position[1])
    if goal.heading is None:
        return tip
    # Linear, with the turn still to go taken from the last iterate: a goal heading is given only up to multiples of 2π.
    (turn,) = goal.turn(program.curve.pose(sweep.unknowns[-1]))
    heading = ca.DM(program.curve.turns[-1:]) @ (v[:, -1] - ca.DM(sweep.unknowns[-1])) - turn
    return ca.vertcat(tip, heading)


def _bend_bounds(sweep: PlanarSweep, limit_share: float) -> tuple[FloatArray, FloatArray]:
    """Least and largest change of every bend after the first keyframe, keyframe by keyframe."""
    bends = sweep.space.bends(sweep.configurations[1:])
    limits = limit_share * sweep.space.bend_limits
    return np.minimum(-limits - bends, 0.0).ravel(), np.maximum(limits - bends, 0.0).ravel()


def _objective(objective: Objective, v: Any) -> Any:
    """The value of the objective, as ``Objective.value``."""
    total = 0.0
    for metric, differences in (
        (objective.shape, v),
        (objective.first, v[:, 1:] - v[:, :-1]),
        (objective.second, v[:, 2:] - 2.0 * v[:, 1:-1] + v[:, :-2]),
    ):
        total = total + 0.5 * ca.sum1(ca.sum2(differences * (ca.DM(metric) @ differences)))
    return total
