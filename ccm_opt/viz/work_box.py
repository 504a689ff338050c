"""Boxes around what is to be seen of a motion in space."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.scene.surfaces import box_about

_NEAR = 0.12
"""Distance from the obstacles up to which a fed arm is shown, as a fraction of the obstacles' extent. Heuristic."""
_ABOUT = 0.2
"""Distance from the motion up to which obstacles are shown, as a fraction of the motion's extent. Heuristic."""


def corners(box: FloatArray) -> FloatArray:
    """Return all corners, shape (2^d, d), of an axis-parallel box given by two opposite corners, shape (2, d) [m]."""
    dimension = box.shape[1]
    counted = np.arange(2**dimension)[:, None] >> np.arange(dimension) & 1
    return np.asarray(np.where(counted == 1, box[1], box[0]))


def work_box(problem: Problem, points: FloatArray, ends: FloatArray | None = None) -> FloatArray:
    """Return the visible box around a motion in space, as lower and upper corner, shape (2, 3) [m].

    Of an arm that is fed into the scene nothing is visible that lies far behind the obstacles.

    Args:
        problem: the problem, which gives arm, goals and obstacles.
        points: positions of joints and tip in all poses, shape (..., 3) [m].
        ends: those in poses that must be visible; None for all.
    """
    shown = (points if ends is None else ends).reshape(-1, 3)
    goals = np.array([stop.goal.tip(problem.arm) for stop in problem.goals])
    extent = problem.workspace.extent_of_bodies
    sides = np.array([[-1.0], [1.0]])
    if extent is not None and problem.arm.coordinates.base_names:
        ahead = problem.arm.base_rotation[:, 0]
        behind = float(np.min(corners(extent) @ ahead)) - _NEAR * float(np.max(np.ptp(extent, axis=0)))
        near = shown[shown @ ahead >= behind]
        shown = near if len(near) else shown
    box = box_about(np.concatenate((shown, goals)))
    box = box + 2.0 * float(np.max(problem.arm.radii)) * sides
    if extent is not None:
        # Enough is shown of a duct that the arm goes through to see where it leads.
        about = box + _ABOUT * float(np.max(np.ptp(box, axis=0))) * sides
        box = np.stack((
            np.minimum(box[0], np.maximum(extent[0], about[0])), np.maximum(box[1], np.minimum(extent[1], about[1]))
        ))  # fmt: skip
    return box
