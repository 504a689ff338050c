"""Exact collision check of a planar arm of zero radius with walls and itself, common to all planners of a comparison.

The check is written in C and called through ctypes, so that it is fast enough for a sampling-based planner that calls
it a million times. It shares no code with the package: links are segments, two segments cross if each has the ends of
the other on opposite sides, and all pairs of non-adjacent links are checked.
"""

import ctypes
import os
import shutil
import subprocess
import sysconfig
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem

SOURCE = r"""
#include <math.h>
#define MOST_LINKS 1024

static double side(const double *p, const double *q, const double *r) {
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
}

static int cross(const double *p, const double *q, const double *r, const double *s) {
    return side(p, q, r) * side(p, q, s) < 0.0 && side(r, s, p) * side(r, s, q) < 0.0;
}

/* room: x0 y0 x1 y1; walls: edges, 4 numbers each; free, 1, or 0 when something is crossed or a joint is outside */
int pose_is_free(const double *bends, int n, double l, const double *base, double heading, const double *room,
                 const double *walls, int edges) {
    static double at[2 * (MOST_LINKS + 1)];
    if (n > MOST_LINKS) return 0;
    at[0] = base[0];
    at[1] = base[1];
    for (int i = 0; i < n; ++i) {
        double *p = at + 2 * i;
        heading += bends[i];
        p[2] = p[0] + l * cos(heading);
        p[3] = p[1] + l * sin(heading);
        if (!(p[2] > room[0] && p[2] < room[2] && p[3] > room[1] && p[3] < room[3])) return 0;
    }
    for (int i = 0; i < n; ++i) {
        const double *p = at + 2 * i;
        for (int k = 0; k < edges; ++k)
            if (cross(p, p + 2, walls + 4 * k, walls + 4 * k + 2)) return 0;
        for (int j = i + 2; j < n; ++j) {
            const double *q = at + 2 * j;
            double x = p[0] - q[0], y = p[1] - q[1];
            if (x * x + y * y > 4.0001 * l * l) {
                /* both first joints are more than two links apart: skip the joints that cannot come near */
                j += (int)(sqrt(x * x + y * y) / l - 2.0001);
                continue;
            }
            if (cross(p, p + 2, q, q + 2)) return 0;
        }
    }
    return 1;
}
"""


@cache
def _library() -> ctypes.CDLL:
    """Compile the collision check, and return it as a loaded library.

    Raises:
        RuntimeError: no C compiler is found.
    """
    compiler = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise RuntimeError("got no C compiler, expected cc, gcc or clang: the comparison compiles its crossing check")
    folder = Path(tempfile.mkdtemp(prefix="crossings-"))
    source = folder / "crossings.c"
    library = folder / f"crossings{sysconfig.get_config_var('SHLIB_SUFFIX')}"
    source.write_text(SOURCE)
    subprocess.run([compiler, "-O3", "-shared", "-fPIC", "-o", str(library), str(source), "-lm"], check=True)
    loaded = ctypes.CDLL(str(library))
    shutil.rmtree(folder)
    double = ctypes.POINTER(ctypes.c_double)
    loaded.pose_is_free.argtypes = [
        double, ctypes.c_int, ctypes.c_double, double, ctypes.c_double, double, double, ctypes.c_int,
    ]  # fmt: skip
    return loaded


class CrossingCheck:
    """Collision check of configurations for one problem.

    Args:
        problem: problem with an arm of radius 0, walls of zero thickness and a rectangular workspace.
    """

    def __init__(self, problem: Problem) -> None:
        arm = problem.arm
        edges = [
            np.hstack((path[:-1], path[1:]))
            for path in (np.asarray(wall.core.coords) for wall in problem.workspace.obstacles)
        ]
        walls = np.ascontiguousarray(np.vstack(edges), dtype=np.float64)
        self._array = ctypes.c_double * arm.links
        self._links = arm.links
        self._length = arm.link_length
        self._heading = arm.base_heading
        self._keep = walls
        self._base = (ctypes.c_double * 2)(*arm.base)
        self._room = (ctypes.c_double * 4)(*problem.workspace.boundary.bounds)
        self._walls = walls.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        self._edges = len(walls)
        self._free = _library().pose_is_free

    def __call__(self, bends: list[float] | FloatArray) -> bool:
        """Return whether the arm with bend angles, shape (links,) [rad], is in the workspace without crossings."""
        values = self._array(*bends)
        return bool(
            self._free(
                values, self._links, self._length, self._base, self._heading, self._room, self._walls, self._edges
            )
        )

    def path_is_free(self, bends: FloatArray) -> bool:
        """Return whether K configurations, shape (K, links) [rad], are all free of crossings."""
        return all(self(pose) for pose in bends)


def densely(bends: FloatArray, step: float = 5e-4) -> FloatArray:
    """Return samples of a polyline in joint space, shape (N, links) [rad].

    Args:
        bends: vertices of the polyline, shape (K, links) [rad].
        step: maximum change of a bend angle between samples [rad].
    """
    counts = np.maximum(1, np.ceil(np.abs(np.diff(bends, axis=0)).max(axis=1) / step).astype(int))
    parts = [
        a + np.linspace(0.0, 1.0, count, endpoint=False)[:, None] * (b - a)
        for a, b, count in zip(bends[:-1], bends[1:], counts, strict=True)
    ]
    return np.vstack((*parts, bends[-1:]))
