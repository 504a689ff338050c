"""The reference: the same rows and objective as one nonlinear program, solved by IPOPT with the exact Hessian.

Slower than ``sequential_convex``, mostly for building the derivatives; nothing is linearised, so it says how good the
steps are. Between two solutions it may leave the motion's homotopy class: what is not certified is given up.
"""

from typing import Any

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.ipopt_call import ipopt_call
from ccm_opt.motion.optimisation.clearance_rows import Rows
from ccm_opt.motion.optimisation.nearness import Nearness
from ccm_opt.motion.optimisation.objective import Objective
from ccm_opt.motion.optimisation.sequential_convex import PRICE, Program, active_rows
from ccm_opt.motion.optimisation.swept_motion import Sweep, mount_end
from ccm_opt.motion.step import LIMIT_SHARE, pose_in

ROUNDS = 2
"""Solutions, the sweep regions renewed between them."""
WIDER = 2.0
"""Rows this many times farther away than those of a sequential step are taken in."""
ITERATIONS = 200
_SHORTENINGS = (1.0, 0.5, 0.25, 0.1)


def interior_point(program: Program, coordinates: FloatArray, rounds: int = ROUNDS) -> FloatArray:
    """Optimise a certified motion.

    Args:
        program: what to keep.
        coordinates: at the keyframes, shape (K + 1, p).
        rounds: solutions of the nonlinear program.

    Returns:
        Coordinates of the last certified motion, shape (K + 1, p).
    """
    for _ in range(rounds):
        if program.deadline.passed():
            break
        sweep = Sweep(program.space, coordinates)
        coordinates = _certified_part(program, sweep, _solution(program, sweep, program.make_rows(sweep)))
    return coordinates


def _certified_part(program: Program, sweep: Sweep, solution: FloatArray) -> FloatArray:
    """As much of the way to the solution as is certified."""
    change = solution - sweep.coordinates
    for share in _SHORTENINGS:
        moved = Sweep(program.space, program.ended(sweep.coordinates + share * change))
        if program.feasible(moved, sweep) and len(program.failures(moved.headings)) == 0:
            return moved.coordinates
    return sweep.coordinates


def _solution(program: Program, sweep: Sweep, all_rows: Rows) -> FloatArray:
    """Keyframes at which IPOPT ends, shape (K + 1, p)."""
    import casadi as ca  # noqa: PLC0415 - loaded only when asked for

    space, (frames, p) = program.space, sweep.coordinates.shape
    rows, objective = active_rows(all_rows, sweep, WIDER * program.active), program.objective(frames - 1)
    moving = ca.SX.sym("v", p, frames - 1)
    turning = ca.SX.sym("phi", space.arm.links, frames - 1)  # tied to v: keeps the derivatives sparse
    slack = ca.SX.sym("s", frames - 1)
    v = ca.horzcat(ca.DM(sweep.coordinates[0]), moving)
    headings = ca.horzcat(ca.DM(sweep.headings[0]), turning)
    tie = ca.vec(ca.DM(space.matrix) @ moving + ca.repmat(ca.DM(space.offset), 1, frames - 1) - turning)
    points = _points(ca, program, headings)
    unit = space.arm.length / 24.0
    inequalities = _row_values(ca, rows, points, headings, space.arm.link_length) / unit - slack[rows.interval.tolist()]
    ends = _end_values(ca, program, sweep, v, points)
    bends = ca.vec(ca.DM(objective.bend_rows) @ (moving - ca.DM(sweep.coordinates[1:].T)))
    near = _nearness(ca, program.nearness(all_rows, sweep), points, headings, space.arm.link_length)
    low, high = _bend_bounds(sweep)
    problem = {
        "x": ca.vertcat(ca.vec(moving), ca.vec(turning), slack),
        "f": _objective(ca, objective, v) + near + PRICE * ca.sum1(slack),
        "g": ca.vertcat(inequalities, ends, tie, bends),
    }
    options = {"ipopt.max_iter": ITERATIONS, "ipopt.tol": 1e-5, "ipopt.print_level": 0, "print_time": False}
    size, zero = moving.numel(), np.zeros(ends.numel() + tie.numel())
    worst = np.zeros(frames - 1)
    np.maximum.at(worst, rows.interval, rows.values(sweep) / unit)
    with ipopt_call():
        solver = ca.nlpsol("motion", "ipopt", problem, {**options, "ipopt.sb": "yes"})
        result = solver(
            x0=np.concatenate((sweep.coordinates[1:].ravel(), sweep.headings[1:].ravel(), worst)),
            lbx=np.concatenate((np.full(size + tie.numel(), -np.inf), np.zeros(frames - 1))),
            lbg=np.concatenate((np.full(len(rows), -np.inf), zero, low)),
            ubg=np.concatenate((np.zeros(len(rows)), zero, high)),
        )
    found = np.asarray(result["x"]).ravel()[:size].reshape(frames - 1, p)
    return np.vstack((sweep.coordinates[:1], found))


def _points(ca: Any, program: Program, headings: Any) -> tuple[Any, Any]:
    """Both coordinates of ``Sweep.points``, each (n + 2) × (K + 1)."""
    arm, (link, share) = program.space.arm, mount_end(program.space.arm)
    parts = []
    for direction, base in ((ca.cos(headings), arm.base[0]), (ca.sin(headings), arm.base[1])):
        joints = ca.vertcat(ca.DM.zeros(1, headings.shape[1]), arm.link_length * ca.cumsum(direction)) + base
        parts.append(ca.vertcat(joints, (1.0 - share) * joints[link, :] + share * joints[link + 1, :]))
    return parts[0], parts[1]


def _row_values(ca: Any, rows: Rows, points: tuple[Any, Any], headings: Any, link_length: float) -> Any:
    """Values of the rows, as ``Rows.values``."""
    height = points[0].shape[0]
    at = height * (rows.interval + rows.side)
    plus, minus = (at + rows.plus).tolist(), (at + rows.minus).tolist()
    turns = headings[:, 1:] - headings[:, :-1]
    sag = ca.vertcat(ca.DM.zeros(1, turns.shape[1]), ca.cumsum(0.125 * link_length * turns**2))
    high = (sag.shape[0] * rows.interval + rows.high).tolist()
    low = (sag.shape[0] * rows.interval + rows.low).tolist()
    apart = [ca.vec(q)[plus] - ca.vec(q)[minus] for q in points]
    across = ca.DM(rows.normal[:, 0]) * apart[0] + ca.DM(rows.normal[:, 1]) * apart[1]
    return across + ca.vec(sag)[high] - ca.vec(sag)[low] + ca.DM(rows.constant)


def _nearness(ca: Any, near: Nearness | None, points: tuple[Any, Any], headings: Any, link_length: float) -> Any:
    """What nearness to walls costs, as ``Nearness.value``."""
    if near is None:
        return 0.0
    lack = ca.fmax(1.0 + _row_values(ca, near.rows, points, headings, link_length) / near.distance, 0.0)
    links, frames = headings.shape
    return near.share(links, frames - 1) * ca.sumsqr(lack)


def _end_values(ca: Any, program: Program, sweep: Sweep, v: Any, points: tuple[Any, Any]) -> Any:
    """What has to vanish at the last keyframe."""
    if program.end_fixed:
        return v[:, -1] - ca.DM(sweep.coordinates[-1])
    links, goal = program.space.arm.links, program.goal
    tip = ca.vertcat(points[0][links, -1] - goal.position[0], points[1][links, -1] - goal.position[1])
    if goal.heading is None:
        return tip
    turn = goal.turn(pose_in(program.space, sweep.coordinates[-1]))
    heading = ca.DM(program.space.matrix[-1:]) @ (v[:, -1] - ca.DM(sweep.coordinates[-1])) - turn
    return ca.vertcat(tip, heading)


def _bend_bounds(sweep: Sweep) -> tuple[FloatArray, FloatArray]:
    """Least and largest change of every bend after the first keyframe, keyframe by keyframe."""
    arm = sweep.space.arm
    bends, limits = arm.bends(sweep.headings[1:]), LIMIT_SHARE * arm.bend_limits
    return np.minimum(-limits - bends, 0.0).ravel(), np.maximum(limits - bends, 0.0).ravel()


def _objective(ca: Any, objective: Objective, v: Any) -> Any:
    """The value of the objective, as ``Objective.value``."""
    total = 0.0
    for metric, differences in (
        (objective.shape, v),
        (objective.first, v[:, 1:] - v[:, :-1]),
        (objective.second, v[:, 2:] - 2.0 * v[:, 1:-1] + v[:, :-2]),
    ):
        total = total + 0.5 * ca.sum1(ca.sum2(differences * (ca.DM(metric) @ differences)))
    return total
