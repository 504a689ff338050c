"""Distances in space: building the tree, clearance of 24 links, half-spaces, grids, by the number of triangles.

    python -m tests.benchmarks.bench_surfaces --triangles 10000 100000 1000000

The scene is a duct of 80 mm, meshed ever more finely, and arms of 24 links of 40 mm in it: about its axis, 12 mm from
its wall, and across all of its surroundings. User CPU, medians of five. Set OMP_NUM_THREADS=1.
"""

import argparse
import resource
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.scene.distances.surface_tree import DEFAULT_DISTANCES, SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from tests.benchmarks.bench_planning import head, row

REACH = 0.026
"""Radius of 12 mm and a third of a link beyond it [m]."""
LENGTH = 0.04


def main() -> None:
    """Parse the options, measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--triangles", nargs="+", type=int, default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--leaf", nargs="+", type=int, default=[DEFAULT_DISTANCES.leaf])
    options = parser.parse_args()
    arms = {"axis": arm(0.0), "wall": arm(0.028), "anywhere": anywhere(np.random.default_rng(1))}
    columns = [f"{name}: {what}" for name in arms for what in ("distances", "planes")]
    head("triangles", "leaf", "build [s]", *(f"{column} [µs]" for column in columns), "grid of 200 k [s]", "peak [MB]")
    for count in options.triangles:
        scene = duct(count)
        for leaf in options.leaf:
            settings = replace(DEFAULT_DISTANCES, leaf=leaf)
            build = seconds(1, SurfaceTree.from_triangles, scene, settings)
            tree = SurfaceTree.from_triangles(scene, settings)
            times: list[float] = []
            for segments in arms.values():
                times += (seconds(50, tree.distances, segments, REACH), seconds(10, tree.planes, segments, REACH))
            grid = seconds(1, tree.grid, np.array([-0.1, -0.06, -0.06]), 2.6e-3, (420, 22, 22), REACH)
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
            figures = (f"{1e6 * time:.0f}" for time in times)
            row(len(scene), leaf, f"{build:.2f}", *figures, f"{grid:.2f}", f"{peak:.0f}")


def duct(count: int) -> TriangleSoup:
    """A duct of about so many triangles along x, 1.1 m long, of a radius of 40 mm."""
    around = max(int(np.sqrt(count / 2.0 * 0.25 / 1.1)), 8)
    along = max(count // (2 * around), 1)
    x = np.linspace(-0.1, 1.0, along + 1)
    turn = np.linspace(0.0, 2.0 * np.pi, around + 1)
    grid = np.stack(np.broadcast_arrays(x[:, None], 0.04 * np.cos(turn), 0.04 * np.sin(turn)), axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    halves = [np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))]
    triangles = np.concatenate(halves)
    return TriangleSoup(triangles, np.zeros(len(triangles)), np.zeros(len(triangles), dtype=np.intp), ("duct",))


def arm(aside: float) -> FloatArray:
    """An arm along the duct, so far from its axis, shape (24, 2, 3)."""
    x = LENGTH * np.arange(25) - 0.05
    points = np.stack((x, aside * np.cos(0.3 * x), aside * np.sin(0.3 * x)), axis=1)
    return np.stack((points[:-1], points[1:]), axis=1)


def anywhere(rng: np.random.Generator) -> FloatArray:
    """Links one by one in and around the duct, shape (24, 2, 3)."""
    start = rng.uniform([-0.1, -0.1, -0.1], [1.0, 0.1, 0.1], (24, 3))
    line = rng.normal(size=(24, 3))
    return np.stack((start, start + LENGTH * line / np.linalg.norm(line, axis=1)[:, None]), axis=1)


def seconds(times: int, work: Callable[..., object], *arguments: object) -> float:
    """User CPU of some work, the median of five [s]."""
    taken = []
    for _ in range(5):
        begun = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        for _ in range(times):
            work(*arguments)
        taken.append((resource.getrusage(resource.RUSAGE_SELF).ru_utime - begun) / times)
    return float(np.median(taken))


if __name__ == "__main__":
    main()
