"""An oracle for timed motions that shares nothing with the package's certificate and verifier: many poses, shapely."""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.solution import JointTrajectory
from tests.scenes import sweep_gaps

LEAST_SUBSTEPS = 4
TRAVEL = 1e-3
"""No joint of the arm moves farther than this between two poses that are looked at [m]."""
CHUNK = 32
"""Poses for which nearby obstacles are looked up together."""
ROUNDING = 1e-9


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
    bends = densely(problem, trajectory.bend_angles)
    headings = arm.headings(bends)
    walls, own = least_gaps(problem, bends)
    points = arm.joint_positions(headings)
    broken = {
        f"{-1e3 * walls:.3f} mm into a wall": walls < -ROUNDING,
        f"{-1e3 * own:.3f} mm into itself": own < -ROUNDING,
        "outside the room": not shapely.contains_xy(problem.workspace.boundary, points.reshape(-1, 2)).all(),
        "joint limit": bool(np.any(np.abs(bends) > arm.bend_limits + ROUNDING)),
        "misses the goal": not reaches(problem, bends[-1]),
    }
    return Sweep(len(bends), walls, own, tuple(name for name, is_broken in broken.items() if is_broken))


def least_gaps(problem: Problem, bends: FloatArray) -> tuple[float, float]:
    """Least gap to a wall and between distant links at poses (T, links), neither told apart beyond 0.1 m [m]."""
    arm = problem.arm
    headings = arm.headings(bends)
    gaps = [sweep_gaps(arm, problem.workspace, headings[k : k + CHUNK]) for k in range(0, len(headings), CHUNK)]
    walls, own = (float(min(values)) for values in zip(*gaps, strict=True))
    return walls, own


def densely(problem: Problem, bends: FloatArray) -> FloatArray:
    """Samples of bends (T, links), each interval divided so that no joint moves far in a step [rad]."""
    points = problem.arm.joint_positions(problem.arm.headings(bends))
    travel = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
    counts = np.maximum(LEAST_SUBSTEPS, np.ceil(travel / TRAVEL).astype(int))
    parts = [
        a + np.linspace(0.0, 1.0, count, endpoint=False)[:, None] * (b - a)
        for a, b, count in zip(bends[:-1], bends[1:], counts, strict=True)
    ]
    return np.vstack((*parts, bends[-1:]))


def reaches(problem: Problem, bends: FloatArray) -> bool:
    """Whether a pose (links,) is the goal, within its tolerances."""
    arm = problem.arm
    goal = problem.goal
    if not isinstance(goal, TipGoal):
        wanted = getattr(goal, "bends", None)
        return wanted is not None and bool(np.allclose(bends, wanted, rtol=0.0, atol=1e-6))
    headings = arm.headings(bends)
    off = float(np.hypot(*(arm.joint_positions(headings)[-1] - goal.position)))
    turn = 0.0 if goal.heading is None else abs(float(np.angle(np.exp(1j * (headings[-1] - goal.heading)))))
    return off <= problem.tolerances.position and turn <= problem.tolerances.heading
