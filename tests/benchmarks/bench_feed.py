"""Plans of arms on a feed axis in random families of scenes, timed and verified; prints a Markdown table.

    python -m tests.benchmarks.bench_feed --seeds 0 12
    python -m tests.benchmarks.bench_feed --seeds 0 12 --links 48

CPU of planning alone in this process. Set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import time
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.errors import CcmError
from ccm_opt.driver.pipeline import solve
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution
from tests.benchmarks.bench_planning import head, row
from tests.benchmarks.feed_families import FAMILIES, LINKS


@dataclass(frozen=True)
class Run:
    """One problem: CPU of planning [s], and the solution, or None when there is none or the verifier rejects it."""

    seconds: float
    solution: Solution | None


def main() -> None:
    """Plan every scene and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=list(FAMILIES))
    parser.add_argument("--seeds", nargs=2, type=int, default=[0, 12], metavar=("FIRST", "END"))
    parser.add_argument("--time-limit", type=float, default=30.0, help="of each plan, on the wall clock [s]")
    parser.add_argument("--links", type=int, default=LINKS, help="of the arms, all of which are as long")
    options = parser.parse_args()
    head(
        "family",
        "solved",
        "planning, median [s]",
        "longest [s]",
        "duration, median [s]",
        "deviation, mean [mm]",
        "worst [mm]",
        "straight [mm]",
    )
    for number, family in enumerate(FAMILIES):
        if family in options.families:
            draws = (np.random.default_rng((number, k)) for k in range(*options.seeds))
            problems = (FAMILIES[family](draw, options.links) for draw in draws)
            runs = [planned(patient(problem, options.time_limit)) for problem in problems]
            row(family, *figures(runs))


def patient(problem: Problem, time_limit: float) -> Problem:
    """A problem with a time limit [s]."""
    return replace(problem, planner=replace(problem.planner, time_limit=time_limit))


def planned(problem: Problem) -> Run:
    """Solve one problem; the verifier has its say."""
    begun = time.process_time()
    try:
        solution = solve(problem, explain=False)
    except CcmError as error:
        print(f"- {error}")
        return Run(time.process_time() - begun, None)
    return Run(sum(solution.timings[stage] for stage in ("mapping", "motion")), solution)


def figures(runs: list[Run]) -> list[str]:
    """Cells of the table for the runs of one family."""
    solved = [run.solution.metrics for run in runs if run.solution is not None]
    seconds = [run.seconds for run in runs]
    cells = [f"{len(solved)} of {len(runs)}", f"{np.median(seconds):.2f}", f"{max(seconds):.2f}"]
    durations = [float(run.solution.trajectory.time[-1]) for run in runs if run.solution is not None]
    cells.append(f"{np.median(durations):.2f}" if durations else "-")
    for key, pick in (("mean", np.median), ("worst", np.max), ("straight_mean", np.max)):
        values = [metrics[name] for metrics in solved if (name := f"leader_deviation_{key}_m") in metrics]
        cells.append(f"{1e3 * pick(values):.3f}" if values else "-")
    return cells


if __name__ == "__main__":
    main()
