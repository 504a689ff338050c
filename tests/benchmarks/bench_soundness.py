"""Is what is called solved safe? Plans of many families, their motions as written swept densely by an oracle.

    python -m tests.benchmarks.bench_soundness --count 1000 --first 40000 --limit 6

The problems go through ``ccm_opt.solve`` without a diagnosis. The oracle shares nothing with certificate and verifier.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import ccm_opt
from ccm_opt.core.errors import NoPlanFound, VerificationError
from ccm_opt.problem import Problem
from tests.benchmarks import feed_families, scene_families, withdrawal_scenes
from tests.benchmarks.bench_planning import head, row
from tests.benchmarks.dense_sweep import sweep
from tests.benchmarks.polygon_fields import FieldKind, field_problem
from tests.benchmarks.scene_families import NoSceneError
from tests.few_link_scenes import few_link_problem
from tests.goal_set_scenes import Drawn, box_beside, pocket, slot, wall_behind
from tests.scenes import clutter

Source = Callable[[int, float], Problem]
LINKS = (6, 8, 12, 16, 24, 36, 48, 96)


def passages(family: str) -> Source:
    """Ducts, U-turns, slaloms, gates and unfolding arms."""

    def drawn(seed: int, limit: float) -> Problem:
        return scene_families.problem(family, seed, LINKS[seed % len(LINKS)], limit)

    return drawn


def inside(family: str) -> Source:
    """Into mazes, doors, combs, bottles and spirals."""
    return lambda seed, limit: withdrawal_scenes.way_in(family, seed, limit)


def goal_set(family: Callable[[np.random.Generator], Drawn]) -> Source:
    """Wide goals whose middle no arm can reach."""

    def drawn(seed: int, limit: float) -> Problem:
        problem, goal, tolerances = family(np.random.default_rng(seed))
        return replace(problem, goal=goal, tolerances=tolerances, planner=replace(problem.planner, time_limit=limit))

    return drawn


def field(seed: int, limit: float) -> Problem:
    """Many small polygons."""
    return field_problem(seed, FieldKind(int(np.random.default_rng(seed).choice((30, 60, 100)))), limit)


def strewn(seed: int, limit: float) -> Problem:
    """Clutter of 10 to 60 polygons."""
    rng = np.random.default_rng(seed)
    return clutter(seed, int(rng.choice((10, 20, 40, 60))), int(rng.choice((12, 24, 48)))).problem(time_limit=limit)


def fed(family: str) -> Source:
    """Arms on a feed axis."""

    def drawn(seed: int, limit: float) -> Problem:
        rng = np.random.default_rng((seed, 11))
        problem = feed_families.FAMILIES[family](rng, int(rng.choice((12, 20, 32))))
        return replace(problem, planner=replace(problem.planner, time_limit=limit))

    return drawn


def fed_wide(seed: int, limit: float) -> Problem:
    """Wide goals of fed arms in elbows."""
    rng = np.random.default_rng((seed, 12))
    problem = feed_families.widened(feed_families.elbow(rng), rng)
    return replace(problem, planner=replace(problem.planner, time_limit=limit))


SOURCES: dict[str, Source] = {
    **{family: passages(family) for family in scene_families.FAMILIES},
    **{family: inside(family) for family in withdrawal_scenes.FAMILIES},
    **{f"wide goal, {family.__name__}": goal_set(family) for family in (slot, pocket, wall_behind, box_beside)},
    "few links": few_link_problem,
    "field": field,
    "clutter": strewn,
    **{f"fed, {family}": fed(family) for family in feed_families.FAMILIES},
    "fed, wide goal": fed_wide,
}


def outcome(problem: Problem) -> str:
    """What comes of a problem: "safe", "touches", "no plan", "refused" by the verifier, or "crash"."""
    try:
        solution = ccm_opt.solve(problem, explain=False)
    except NoPlanFound:
        return "no plan"
    except VerificationError as refusal:
        print(f"- {problem.name}: refused. {refusal}", flush=True)
        return "refused"
    except Exception as crash:  # noqa: BLE001 - whatever it is, it is reported as a defect
        place = traceback.extract_tb(crash.__traceback__)[-1]
        print(f"- {problem.name}: {type(crash).__name__}: {crash} ({place.name}, line {place.lineno})", flush=True)
        return "crash"
    seen = sweep(problem, solution.trajectory)
    if seen.violations:
        print(f"- {problem.name}: {'; '.join(seen.violations)}", flush=True)
    return "touches" if seen.violations else "safe"


def main() -> None:
    """Run the families in turn until so many problems are done, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000, help="problems")
    parser.add_argument("--first", type=int, default=40000, help="first seed")
    parser.add_argument("--limit", type=float, default=6.0, help="CPU time of each plan [s]")
    options = parser.parse_args()
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    done = 0
    seed = options.first
    while done < options.count:
        for name, source in SOURCES.items():
            try:
                problem = source(seed, options.limit)
            except NoSceneError:
                continue
            counts[name][outcome(replace(problem, name=f"{name} {seed}"))] += 1
            done += 1
            if done % 50 == 0:
                print(f"{done} problems: {dict(sum(counts.values(), Counter()))}", flush=True)
        seed += 1
    kinds = ("safe", "touches", "no plan", "refused", "crash")
    head("family", "problems", *kinds)
    for name, items in (*counts.items(), ("all", sum(counts.values(), Counter()))):
        row(name, items.total(), *(items[kind] for kind in kinds))


if __name__ == "__main__":
    main()
