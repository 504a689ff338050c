"""Whether a larger tolerance makes a problem harder: narrow goals, and wide ones that contain them; Markdown tables.

    python -m tests.benchmarks.bench_goal_sets --seeds 1000 1200 --limit 30

Every seed draws a scene and a narrow goal that an arm is known to have a pose at, and a wide goal around it: a disc of
places, a range of headings, or both, whose middle is somewhere else, in a wall, behind it, or in a closed box as often
as not. Both are planned, timed and verified in the same run. User CPU of this process, planning alone. Set
OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.polyline import unit_vector
from ccm_opt.problem import Problem, TipGoal, Tolerances
from tests.benchmarks import scene_families
from tests.goal_set_scenes import box_beside, pocket, slot, wall_behind
from tests.planned_runs import Run, quantile, run
from tests.scenes import clutter

TURNS = (10.0, 30.0, 90.0, 180.0)
"""Half widths of ranges of headings [°]."""


@dataclass(frozen=True)
class Pair:
    """A narrow goal and a wide one that contains it.

    Attributes:
        family: of the scene.
        seed: that it was drawn from.
        narrow: the problem with the narrow goal.
        wide: the same with the wide one.
    """

    family: str
    seed: int
    narrow: Problem
    wide: Problem


def widened(rng: np.random.Generator, problem: Problem) -> Problem:
    """A problem whose goal is a set that contains that of another, which is met exactly."""
    goal = problem.goal
    if not isinstance(goal, TipGoal):
        raise TypeError(f"only goals of the tip can be widened, got {type(goal).__name__}")
    kind = rng.choice(("places", "headings", "both")) if goal.heading is not None else "places"
    tolerances = problem.tolerances
    position = goal.position
    heading = goal.heading
    if kind != "headings":
        width = problem.arm.length * rng.uniform(0.02, 0.3)
        # The narrow goal lies somewhere within, not too near to the edge.
        position = position + 0.9 * width * np.sqrt(rng.uniform()) * unit_vector(rng.uniform(-np.pi, np.pi))
        tolerances = replace(tolerances, position=width)
    if kind != "places" and heading is not None:
        turn = float(np.deg2rad(rng.choice(TURNS)))
        heading = heading + 0.9 * turn * rng.uniform(-1.0, 1.0)
        tolerances = replace(tolerances, heading=turn)
    return replace(problem, goal=TipGoal(position, heading=heading), tolerances=tolerances)


def of_clutter(seed: int, rng: np.random.Generator, limit: float) -> tuple[Problem, Problem]:
    """Among polygons."""
    scene = clutter(seed, int(rng.integers(10, 40)))
    narrow = scene.problem(time_limit=limit)
    return narrow, widened(rng, narrow)


def of_passage(seed: int, rng: np.random.Generator, limit: float) -> tuple[Problem, Problem]:
    """At the end of a duct, a U-turn, a slalom or behind gates."""
    family = str(rng.choice(sorted(scene_families.FAMILIES)))
    found = scene_families.scene(family, seed, 24)
    narrow = found.problem(time_limit=limit)
    return narrow, widened(rng, narrow)


def _special(
    make: Callable[[np.random.Generator], tuple[Problem, TipGoal, Tolerances]],
) -> Callable[[int, np.random.Generator, float], tuple[Problem, Problem]]:
    """Scenes that come with their wide goal."""

    def pair(_: int, rng: np.random.Generator, limit: float) -> tuple[Problem, Problem]:
        problem, goal, tolerances = make(rng)
        narrow = replace(problem, planner=replace(problem.planner, time_limit=limit))
        return narrow, replace(narrow, goal=goal, tolerances=tolerances)

    return pair


FAMILIES: dict[str, Callable[[int, np.random.Generator, float], tuple[Problem, Problem]]] = {
    "clutter": of_clutter,
    "passage": of_passage,
    "slot": _special(slot),
    "pocket": _special(pocket),
    "wall": _special(wall_behind),
    "box": _special(box_beside),
}


def pairs(first: int, last: int, limit: float, families: list[str]) -> list[Pair]:
    """Pairs of seeds; the families take turns."""
    found = []
    for seed in range(first, last):
        family = families[seed % len(families)]
        rng = np.random.default_rng((seed, 12))
        try:
            narrow, wide = FAMILIES[family](seed, rng, limit)
        except scene_families.NoSceneError:
            continue
        found.append(Pair(family, seed, narrow, wide))
    return found


def report(rows: list[tuple[Pair, Run, Run]]) -> None:
    """A table of the families, and every pair of which the narrow goal alone was solved."""
    print("\n| family | pairs | narrow solved | wide solved | only narrow | CPU narrow, wide | 90 % |")
    print("|---|---|---|---|---|---|---|")
    for family in sorted({pair.family for pair, _, _ in rows}):
        mine = [(narrow, wide) for pair, narrow, wide in rows if pair.family == family]
        solved = [(one.outcome == "verified", other.outcome == "verified") for one, other in mine]
        seconds = np.array([(one.seconds, other.seconds) for one, other in mine])
        print(
            f"| {family} | {len(mine)} | {sum(one for one, _ in solved)} | {sum(other for _, other in solved)} "
            f"| {sum(one and not other for one, other in solved)} "
            f"| {np.median(seconds[:, 0]):.2f} s, {np.median(seconds[:, 1]):.2f} s "
            f"| {quantile(seconds[:, 0], 0.9):.2f} s, {quantile(seconds[:, 1], 0.9):.2f} s |"
        )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1200))
    parser.add_argument("--limit", type=float, default=30.0)
    parser.add_argument("--families", nargs="*", default=sorted(FAMILIES))
    options = parser.parse_args()
    rows = []
    for pair in pairs(*options.seeds, options.limit, options.families):
        narrow = run(pair.narrow, f"{pair.family} {pair.seed}")
        wide = run(pair.wide, f"{pair.family} {pair.seed}, wide")
        rows.append((pair, narrow, wide))
        worse = narrow.outcome == "verified" and wide.outcome != "verified"
        tolerances = pair.wide.tolerances
        print(
            f"{pair.family} {pair.seed}: {narrow.outcome} {narrow.seconds:.2f} s; disc {tolerances.position:.3f} m, "
            f"range {np.rad2deg(tolerances.heading):.0f}°: {wide.outcome} {wide.seconds:.2f} s"
            + (f" WORSE: {wide.reason}" if worse else ""),
            flush=True,
        )
    report(rows)


if __name__ == "__main__":
    main()
