"""A scene as the sampling planners of the comparison see it: links, limits and wall edges in C arrays.

Their programs are compiled when they are asked for; the structure is ``Scene`` of swept_links.h.
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

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Problem

POINTER = ctypes.c_void_p
MOST_LINKS = 400
"""That swept_links.h has room for."""
MOST_POSES = 4096
"""Of a way that comes back."""


class SceneStruct(ctypes.Structure):
    """``Scene`` of swept_links.h."""

    _fields_ = (
        *((name, ctypes.c_long) for name in ("links", "edges", "first_pair", "mount_link")),
        *((name, ctypes.c_double) for name in ("length", "radius", "gap", "heading", "mount_share")),
        *((name, POINTER) for name in ("base", "limits", "walls", "rounding")),
    )


@dataclass(frozen=True)
class SweptScene:
    """The structure, with the arrays that it points to kept alive beside it.

    Attributes:
        struct: to be passed by reference.
        arrays: base, limits, walls and rounding.
        start: bends, shape (links,) [rad].
    """

    struct: SceneStruct
    arrays: tuple[FloatArray, ...]
    start: FloatArray

    @classmethod
    def of(cls, problem: Problem) -> "SweptScene":
        """The scene of a problem.

        Raises:
            TypeError: when the problem does not start from a joint pose.
            ValueError: when the arm has more links than the programs have room for.
        """
        if not isinstance(problem.start, JointPose):
            raise TypeError("the problem has to start from a joint pose")
        arm = problem.arm
        if arm.links > MOST_LINKS:
            raise ValueError(f"got {arm.links} links, expected at most {MOST_LINKS}")
        edges = [np.empty((0, 4))]
        rounding = [np.empty(0)]
        for wall in problem.workspace.walls:
            rings = shapely.get_rings(wall.core) if isinstance(wall.core, shapely.Polygon) else [wall.core]
            for ring in rings:
                points = shapely.get_coordinates(ring)
                if len(points) == 1:
                    points = np.vstack((points, points))
                edges.append(np.hstack((points[:-1], points[1:])))
                rounding.append(np.full(len(points) - 1, wall.rounding))
        link, share = arm.mount_end
        values = (arm.base, arm.bend_limits, np.vstack(edges), np.concatenate(rounding))
        arrays = tuple(np.ascontiguousarray(value) for value in values)
        struct = SceneStruct(
            arm.links, len(arrays[2]), int(arm.next_self_pairs[0, 0]) if arm.self_collision else 0, link,
            arm.link_length, arm.radius, arm.radius + problem.workspace.clearance, arm.base_heading, share,
            *(array.ctypes.data for array in arrays),
        )  # fmt: skip
        return cls(struct, arrays, np.ascontiguousarray(problem.start.bends))


@cache
def compiled(source: str, *options: str) -> ctypes.CDLL:
    """A program of this folder as a library.

    Args:
        source: file name.
        options: further ones of the compiler.

    Raises:
        RuntimeError: without a compiler, or when it fails.
    """
    names = ("c++", "g++", "clang++") if source.endswith(".cpp") else ("cc", "gcc", "clang")
    compiler = next(filter(None, map(shutil.which, names)), None)
    if compiler is None:
        raise RuntimeError(f"got no compiler for {source}, expected one of {', '.join(names)}")
    folder = Path(tempfile.mkdtemp(prefix="benchmark-"))
    library = folder / f"library{sysconfig.get_config_var('SHLIB_SUFFIX')}"
    path = Path(__file__).with_name(source)
    command = [compiler, "-O3", "-march=native", "-shared", "-fPIC", "-o", str(library), str(path), *options, "-lm"]
    try:
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{source} was not compiled: {done.stderr.strip().splitlines()[-1]}")
        return ctypes.CDLL(str(library))
    finally:
        shutil.rmtree(folder)
