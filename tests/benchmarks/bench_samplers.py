"""Families of scenes: this planner beside sampling planners with swept checks; prints a Markdown table.

    python -m tests.benchmarks.bench_samplers --seeds 900 902 --links 6 12 24 48 --limit 10

CPU seconds in one thread. Ours: a plan optimised, timed and verified, and then swept densely by an oracle. Samplers: a
way without any of that, swept as densely; they are given the pose that the scene is made from. OMPL's need
``libompl-dev``; ``--peers plain`` does without.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from tests.benchmarks.bench_planning import head, row, warm_up
from tests.benchmarks.dense_sweep import sweep
from tests.benchmarks.ompl_planners import PLANNERS, run_peer
from tests.benchmarks.plain_connect import plain_connect
from tests.benchmarks.polygon_fields import FieldKind, field_problem, polygon_field
from tests.benchmarks.scene_families import FAMILIES, NoSceneError, problem, scene
from tests.planned_runs import quantile, run

OURS = "ours"
PLAIN = "plain"
FIELD = "field of 100"
"""Family of polygon fields with a hundred cells."""
ALL = (*FAMILIES, FIELD)
DEFAULT_PEERS = (PLAIN, "RRTConnect", "STRIDE", "XXL")


@dataclass(frozen=True)
class Attempt:
    """What one planner made of one problem.

    Attributes:
        solved: whether its motion reaches the goal and touches nothing.
        seconds: CPU time, whatever came of it.
        touches: whether it called something solved that is not.
    """

    solved: bool
    seconds: float
    touches: bool = False


def drawn(family: str, seed: int, links: int, limit: float) -> tuple[Problem, FloatArray]:
    """A problem, and bends of the pose at its goal that it is made from, shape (links,) [rad].

    Raises:
        NoSceneError: when none comes of the seed.
    """
    if family == FIELD:
        kind = FieldKind(100, links)
        made = polygon_field(seed, kind)
        return field_problem(seed, kind, limit), made.arm.bends(made.goal)
    made = scene(family, seed, links)
    return problem(family, seed, links, limit), made.arm.bends(made.goal)


def attempt(planner: str, task: Problem, goal: FloatArray, limit: float, seed: int) -> Attempt:
    """One planner on one problem."""
    if planner == OURS:
        planned = run(task)
        if planned.trajectory is None or planned.outcome != "verified":
            print(f"- {planned.name}: {planned.outcome} after {planned.seconds:.1f} s. {planned.reason}", flush=True)
            return Attempt(solved=False, seconds=planned.seconds)
        seen = sweep(task, planned.trajectory)
        if seen.violations:
            print(f"- {planned.name}: the sweep says: {'; '.join(seen.violations)}", flush=True)
        return Attempt(solved=not seen.violations, seconds=planned.seconds, touches=bool(seen.violations))
    if planner == PLAIN:
        found = plain_connect(task, goal[None], limit, seed)
        return Attempt(solved=found.way is not None, seconds=found.seconds)
    peer = run_peer(task, goal[None], planner, limit, seed)
    return Attempt(solved=peer.outcome == "solved", seconds=peer.seconds, touches=peer.outcome == "unsound")


def main() -> None:
    """Parse the options, run every planner on every problem, and print a table of families and one of links."""
    options = _options()
    warm_up()
    planners = (OURS, *options.peers)
    by_group: dict[str, dict[str, list[Attempt]]] = defaultdict(lambda: defaultdict(list))
    for family in options.families:
        for links in options.links:
            for seed in range(*options.seeds):
                try:
                    task, goal = drawn(family, seed, links, options.limit)
                except NoSceneError:
                    continue
                for planner in planners:
                    made = attempt(planner, task, goal, options.limit, seed)
                    for group in (family, f"{links} links", "all"):
                        by_group[group][planner].append(made)
    print()
    head("scenes", "number", *(f"{planner}: solved, median, 90 % [s CPU]" for planner in planners))
    counts = [f"{links} links" for links in options.links]
    groups = (*options.families, *counts, "all")
    for group, runs in ((group, by_group[group]) for group in groups if group in by_group):
        row(group, len(runs[OURS]), *(_cell(runs[planner]) for planner in planners))


def _cell(attempts: list[Attempt]) -> str:
    """Solved; median and 90 % of the CPU time of all, where a run in vain counts with what it took."""
    seconds = [made.seconds for made in attempts]
    solved = sum(made.solved for made in attempts)
    wrong = sum(made.touches for made in attempts)
    told = f"{solved}; {np.median(seconds):.2f}, {quantile(seconds, 0.9):.1f}"
    return f"{told} ({wrong} touch)" if wrong else told


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", nargs="+", choices=ALL, default=ALL)
    parser.add_argument("--seeds", nargs=2, type=int, default=[900, 902], metavar=("FIRST", "END"))
    parser.add_argument("--links", nargs="+", type=int, default=[6, 12, 24, 48])
    parser.add_argument("--limit", type=float, default=10.0, help="CPU time of each run [s]")
    parser.add_argument("--peers", nargs="*", choices=(PLAIN, *PLANNERS), default=DEFAULT_PEERS)
    return parser.parse_args()


if __name__ == "__main__":
    main()
