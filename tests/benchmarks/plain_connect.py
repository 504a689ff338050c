"""A plain RRT-Connect with swept checks, in C: what a sampling planner does with the same problems.

It knows nothing of the package's planners: uniform bends, one step of a fifth of the extent at a time, every motion
proved free by how far its links can move. A goal for the tip is given to it as poses there, which cost it no time.
"""

import ctypes
import shutil
import subprocess
import sysconfig
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import JointPose, Problem

RANGE = 0.2
"""Longest step as a share of the extent of joint space: OMPL's default."""
MOST_POSES = 4096
"""Of a way."""
_POINTER = ctypes.c_void_p


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


class _SceneStruct(ctypes.Structure):
    """``Scene`` of plain_connect.c."""

    _fields_ = (
        *((name, ctypes.c_long) for name in ("links", "edges", "first_pair", "mount_link")),
        *((name, ctypes.c_double) for name in ("length", "radius", "gap", "heading", "mount_share")),
        *((name, _POINTER) for name in ("base", "limits", "walls", "rounding")),
    )


@cache
def _library() -> ctypes.CDLL:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise RuntimeError("got no C compiler, expected cc, gcc or clang: the comparison compiles its sampling planner")
    folder = Path(tempfile.mkdtemp(prefix="plain-connect-"))
    library = folder / f"plain_connect{sysconfig.get_config_var('SHLIB_SUFFIX')}"
    source = Path(__file__).with_suffix(".c")
    subprocess.run([compiler, "-O3", "-march=native", "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)
    loaded = ctypes.CDLL(str(library))
    shutil.rmtree(folder)
    loaded.plain_connect.restype = ctypes.c_long
    return loaded


def plain_connect(problem: Problem, goals: FloatArray, seconds: float, seed: int) -> PlainRun:
    """Look for a motion to one of some goal poses.

    Args:
        problem: which starts from a joint pose.
        goals: bends of poses at the goal, shape (m, links) [rad].
        seconds: CPU time.
        seed: of the random numbers.
    """
    if not isinstance(problem.start, JointPose):
        raise TypeError("the problem has to start from a joint pose")
    arm = problem.arm
    edges = []
    rounding = []
    for wall in problem.workspace.walls:
        rings = wall.core.exterior if isinstance(wall.core, shapely.Polygon) else wall.core
        points = shapely.get_coordinates(rings)
        if len(points) == 1:
            points = np.vstack((points, points))
        edges.append(np.hstack((points[:-1], points[1:])))
        rounding.append(np.full(len(points) - 1, wall.rounding))
    link, share = arm.mount_end
    limits = arm.bend_limits
    arrays = [np.ascontiguousarray(a) for a in (arm.base, limits, np.vstack(edges), np.concatenate(rounding))]
    scene = _SceneStruct(
        arm.links, len(arrays[2]), arm.first_self_pair if arm.self_collision else 0, link,
        arm.link_length, arm.radius, arm.radius + problem.workspace.clearance, arm.base_heading, share,
        *(array.ctypes.data for array in arrays),
    )  # fmt: skip
    start = np.ascontiguousarray(problem.start.bends)
    goals = np.ascontiguousarray(goals)
    way = np.zeros((MOST_POSES, arm.links))
    used = ctypes.c_double()
    motions = ctypes.c_long()
    count = _library().plain_connect(
        ctypes.byref(scene), _POINTER(start.ctypes.data), _POINTER(goals.ctypes.data), ctypes.c_long(len(goals)),
        ctypes.c_double(RANGE * 2.0 * float(np.linalg.norm(limits))), ctypes.c_double(seconds), ctypes.c_uint64(seed),
        _POINTER(way.ctypes.data), ctypes.c_long(MOST_POSES), ctypes.byref(used), ctypes.byref(motions),
    )  # fmt: skip
    return PlainRun(way[:count] if count else None, used.value, motions.value)
