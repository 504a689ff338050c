"""A plain RRT-Connect with swept checks, in C: what a sampling planner does with the same problems.

It knows nothing of the package's planners: uniform bends, one step of a fifth of the extent at a time, every motion
proved free by how far its links can move. A goal for the tip is given to it as poses there, which cost it no time.
"""

import ctypes
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from tests.benchmarks.swept_scene import MOST_POSES, POINTER, SweptScene, compiled

RANGE = 0.2
"""Longest step as a share of the extent of joint space: OMPL's default."""


@dataclass(frozen=True)
class PlainRun:
    """What came of one run.

    Attributes:
        way: bends from start to goal, shape (K, links) [rad], or None.
        seconds: CPU time.
        motions: that were checked.
    """

    way: FloatArray | None
    seconds: float
    motions: int


def plain_connect(problem: Problem, goals: FloatArray, seconds: float, seed: int) -> PlainRun:
    """Look for a motion to one of some goal poses.

    Args:
        problem: which starts from a joint pose.
        goals: bends of poses at the goal, shape (m, links) [rad].
        seconds: CPU time.
        seed: of the random numbers.
    """
    scene = SweptScene.of(problem)
    arm = problem.arm
    goals = np.ascontiguousarray(goals)
    way = np.zeros((MOST_POSES, arm.links))
    used = ctypes.c_double()
    motions = ctypes.c_long()
    search = compiled("plain_connect.c").plain_connect
    search.restype = ctypes.c_long
    count = search(
        ctypes.byref(scene.struct), POINTER(scene.start.ctypes.data), POINTER(goals.ctypes.data),
        ctypes.c_long(len(goals)), ctypes.c_double(RANGE * 2.0 * float(np.linalg.norm(arm.bend_limits))),
        ctypes.c_double(seconds), ctypes.c_uint64(seed), POINTER(way.ctypes.data), ctypes.c_long(MOST_POSES),
        ctypes.byref(used), ctypes.byref(motions),
    )  # fmt: skip
    return PlainRun(way[:count] if count else None, used.value, motions.value)
