"""An oracle for timed motions that shares nothing with the package's certificate and verifier: many poses, shapely."""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.solution import JointTrajectory
from tests.scenes import sweep_gaps

LEAST_SUBSTEPS = 4
TRAVEL = 1e-3
"""No joint of the arm moves farther than this between two poses that are looked at [m]."""
CHUNK = 32
"""Poses for which nearby obstacles are looked up together."""
ROUNDING = 1e-9
HAIR = 1e-6
"""How far before the hole a joint may bend already, for rounding [m]."""
STRAIGHT = 1e-9
"""Bend of a joint that is straight [rad]."""


@dataclass(frozen=True)
class Sweep:
    """What the oracle saw.

    Attributes:
        poses: how many it looked at.
        wall_gap: least gap to a wall, not told apart beyond 0.1 m [m].
        self_gap: least gap between distant links, likewise [m].
        violations: what the motion breaks, in words.
    """

    poses: int
    wall_gap: float
    self_gap: float
    violations: tuple[str, ...]


def sweep(problem: Problem, trajectory: JointTrajectory) -> Sweep:
    """Look at a motion, linear between its samples, at poses so near each other that little can happen between."""
    arm = problem.arm
    rows = densely(problem, trajectory.positions)
    bends = rows[:, : arm.links]
    walls, own = least_gaps(problem, rows)
    points = arm.joint_positions_at(rows)
    broken = {
        f"{-1e3 * walls:.3f} mm into a wall": walls < -ROUNDING,
        f"{-1e3 * own:.3f} mm into itself": own < -ROUNDING,
        "outside the room": not shapely.contains_xy(problem.workspace.boundary, points.reshape(-1, 2)).all(),
        "joint limit": bool(np.any(np.abs(bends) > arm.bend_limits + ROUNDING)),
        "misses the goal": not reaches(problem, rows[-1]),
        "bent in the guide tube": bent_in_tube(problem, rows),
    }
    return Sweep(len(rows), walls, own, tuple(name for name, is_broken in broken.items() if is_broken))


def bent_in_tube(problem: Problem, rows: FloatArray) -> bool:
    """Whether a joint bends that has not passed the hole, or the base leaves its range, in rows (T, c)."""
    arm = problem.arm
    if arm.feed is None:
        return False
    feed = rows[:, -1]
    places = feed[:, None] + arm.link_length * np.arange(arm.links)
    inside = places < arm.feed.hole - HAIR
    beyond = np.any((feed < arm.feed.low - ROUNDING) | (feed > arm.feed.high + ROUNDING))
    return bool(beyond or np.any(np.abs(rows[:, : arm.links][inside]) > STRAIGHT))


def least_gaps(problem: Problem, rows: FloatArray) -> tuple[float, float]:
    """Least gap to a wall and between distant links at rows (T, c), neither told apart beyond 0.1 m [m]."""
    arm = problem.arm
    poses = arm.poses(rows)
    gaps = [sweep_gaps(arm, problem.workspace, poses[k : k + CHUNK]) for k in range(0, len(poses), CHUNK)]
    walls, own = (float(min(values)) for values in zip(*gaps, strict=True))
    return walls, own


def densely(problem: Problem, rows: FloatArray) -> FloatArray:
    """Samples of bends and feed (T, c), each interval divided so that no joint moves far in a step [rad, m]."""
    points = problem.arm.joint_positions_at(rows)
    travel = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
    counts = np.maximum(LEAST_SUBSTEPS, np.ceil(travel / TRAVEL).astype(int))
    parts = [
        a + np.linspace(0.0, 1.0, count, endpoint=False)[:, None] * (b - a)
        for a, b, count in zip(rows[:-1], rows[1:], counts, strict=True)
    ]
    return np.vstack((*parts, rows[-1:]))


def reaches(problem: Problem, row: FloatArray) -> bool:
    """Whether a row of bends, and perhaps of a feed, shape (c,), is the goal, within its tolerances."""
    arm = problem.arm
    goal = problem.goal
    if not isinstance(goal, TipGoal):
        bends = getattr(goal, "bends", None)
        if bends is None:
            return False
        wanted = bends if arm.feed is None else np.append(bends, getattr(goal, "feed", 0.0))
        return bool(np.allclose(row, wanted, rtol=0.0, atol=1e-6))
    headings = arm.headings(row[: arm.links])
    off = float(np.hypot(*(arm.joint_positions_at(row)[-1] - goal.position)))
    turn = 0.0 if goal.heading is None else abs(float(np.angle(np.exp(1j * (headings[-1] - goal.heading)))))
    return off <= problem.tolerances.position and turn <= problem.tolerances.heading
