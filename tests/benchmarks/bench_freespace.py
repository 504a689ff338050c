"""Times free space among 10–300 random polygons: ``python -m tests.benchmarks.bench_freespace``.

Each figure is the median CPU time of this process over several scenes [ms]. Room sides grow with the number of
polygons, so that they stand equally dense (30 polygons of 30–90 mm in 2.4 m square), except where ``dense`` is said.
"""

import time
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from ccm_opt.scene.free_space import FreeSpace
from tests.freespace_scenes import SIDE, clutter

MARGIN = 0.02
SCENES = 7
ROWS = ((10, False), (30, False), (80, True), (80, False), (300, True), (300, False))
COLUMNS = ("n", "side", "triangles", "cells", "inflate", "mesh", "routes", "merge", "corridor", "taut", "regions")


def timed(stage: Callable[[], object]) -> tuple[float, object]:
    """CPU time [ms] and result of one call."""
    begun = time.process_time()
    result = stage()
    return 1e3 * (time.process_time() - begun), result


def measure(count: int, seed: int, side: float) -> list[float]:
    """The figures of one scene, in the order of the columns from ``triangles`` on."""
    space = FreeSpace(clutter(count, seed, side), MARGIN)
    inflate, _ = timed(lambda: space.polygons)
    triangulate, mesh = timed(lambda: space.triangulation)
    ends = space.snapped(np.array([[0.1, 0.1], [side - 0.1, side - 0.1]]))
    routing, _ = timed(lambda: space.routes(ends[0], ends[1], 5))
    merge, partition = timed(lambda: space.corridor_maker.partition)
    routes = space.routes(ends[0], ends[1], 1)
    if not routes:
        return []
    corridor, made = timed(lambda: space.corridor(routes[0]))
    arm = np.column_stack(
        [np.interp(np.linspace(0, 1, 97), np.linspace(0, 1, len(routes[0].taut)), x) for x in routes[0].taut.T]
    )
    taut, _ = timed(lambda: space.taut_path(arm))
    return [len(mesh), len(partition.cells), inflate, triangulate, routing, merge, corridor, taut, len(made.regions)]


def main() -> None:
    """Print the table."""
    table = Table(*COLUMNS, title=f"free space, margin {MARGIN} m, medians of {SCENES} scenes, ms of CPU time")
    for count, dense in ROWS:
        side = SIDE if dense else SIDE * (count / 30) ** 0.5
        figures = [row for row in (measure(count, seed, side) for seed in range(SCENES)) if row]
        if not figures:
            table.add_row(str(count) + " dense" * dense, f"{side:.2f}", "start and goal not connected in any scene")
            continue
        medians = np.median(figures, axis=0)
        cells = (f"{x:.0f}" if k in {0, 1, 8} else f"{x:.1f}" for k, x in enumerate(medians))
        table.add_row(str(count) + " dense" * dense, f"{side:.2f}", *cells)
    Console().print(table)


if __name__ == "__main__":
    main()
