"""Time the configuration NLP: ``python -m tests.benchmarks.bench_configuration``.

Prints medians of user CPU with built solvers: 100 random reachable poses in open space, a hand-made corridor at
several length ratios, and clutter of polygons along the shortest route (its free space is not counted).
"""

# ruff: noqa: T201 - a benchmark prints its figures
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ccm_opt.core.errors import ConfigurationNotFound
from ccm_opt.core.polyline import path_length
from ccm_opt.ik.configuration_task import ConfigurationTask
from ccm_opt.ik.find_configuration import find_configuration
from ccm_opt.scene.corridor import Route
from ccm_opt.scene.free_space import FreeSpace
from tests.freespace_scenes import clutter
from tests.nlp_corridors import ANY_HEADING, open_task, random_pose, s_bend

RATIOS = (1.05, 1.2, 1.5)
TIGHTEST_BEND = 22.6
"""κmax L of 24 links with joints of 60 degrees, nine tenths of it used."""


def report(name: str, tasks: Iterable[ConfigurationTask]) -> None:
    """Solve every task once and print successes and times."""
    tasks = list(tasks)
    for task in tasks:
        with suppress(ConfigurationNotFound):  # builds what is shared
            find_configuration(task)
    seconds = []
    solved = 0
    for task in tasks:
        begin = time.process_time()
        try:
            find_configuration(task)
            solved += 1
        except ConfigurationNotFound:
            pass
        seconds.append(time.process_time() - begin)
    median, late, longest = 1e3 * np.quantile(seconds, (0.5, 0.9, 1.0))
    print(f"{name:34s} {solved:3d}/{len(tasks):3d}  median {median:6.1f}  90 % {late:7.1f}  longest {longest:7.1f} ms")


def corridor_tasks() -> list[ConfigurationTask]:
    """The S-bend at three length ratios and four goal headings."""
    way = s_bend()
    goal = np.array([0.9, 0.5])
    return [
        ConfigurationTask(np.zeros(2), ANY_HEADING, ratio * way.route.length, 18.0, goal, heading, way)
        for ratio in RATIOS
        for heading in (None, -0.8, 0.0, 0.8)
    ]


def clutter_tasks(obstacles: int, seeds: int) -> list[ConfigurationTask]:
    """Random ends in random clutter, along the shortest route."""
    return [clutter_task(obstacles, seed) for seed in range(seeds)]


def clutter_task(obstacles: int, seed: int) -> ConfigurationTask:
    """One random pair of ends at least 0.8 m apart; the tip heads on within a radian of the route's last leg."""
    room = FreeSpace(clutter(obstacles, seed), 0.021)
    rng = np.random.default_rng(100 + seed)
    while True:
        ends = rng.uniform(0.1, 2.3, (2, 2))
        if np.hypot(*(ends[1] - ends[0])) < 0.8 or not room.contains(ends).all():
            continue
        routes = room.routes(ends[0], ends[1], 1)
        if routes:
            break
    taut = room.sleeve_path(routes[0].sleeve, ends[0], ends[1])
    length = path_length(taut) * RATIOS[seed % len(RATIOS)]
    leg = taut[-1] - taut[-2]
    way = room.corridor(Route(routes[0].sleeve, taut, path_length(taut)))
    heading = float(np.arctan2(leg[1], leg[0])) + rng.uniform(-1.0, 1.0)
    return ConfigurationTask(ends[0], ANY_HEADING, length, TIGHTEST_BEND / length, ends[1], heading, way)


def main() -> None:
    """Run all groups."""
    generator = np.random.default_rng(1)
    poses = [open_task(random_pose(generator)) for _ in range(100)]
    report("open space, base heading fixed", poses)
    report("open space, base turns", [replace(task, base_heading_range=ANY_HEADING) for task in poses])
    report("open space, tip heading free", [replace(task, goal_heading=None) for task in poses])
    report("S-bend, 3 regions", corridor_tasks())
    for obstacles in (10, 20, 40, 60):
        report(f"clutter of {obstacles}", clutter_tasks(obstacles, 12))


if __name__ == "__main__":
    main()
