"""Is what is called solved in space safe? Random plans, their motions as timed swept densely with coal's distances.

    python -m tests.benchmarks.bench_space_soundness --count 1000 --first 50000 --limit 8

Clutter of 20 to 320 bodies and the shipped jobs with starts and goals moved, with arms of 8 to 96 links. Plans are
made, timed and verified as by ``ccm-opt solve``, but not simulated; with ``--found`` they are not optimised. The
oracle, ``space_sweep.py``, shares nothing with certificate and verifier.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import traceback
from collections import Counter, defaultdict
from dataclasses import dataclass, replace

from ccm_opt.cli.compare.suites import SPACE_SUITES, problem_maker
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound, ProblemError, VerificationError
from ccm_opt.core.progress import Stages
from ccm_opt.driver.legs import Planner, plan_legs
from ccm_opt.driver.verified_plan import timed_and_verified
from ccm_opt.planning.ends import refuse_ends
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.smooth_path import joint_path
from ccm_opt.planning.space_task import space_task
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from tests.benchmarks.bench_planning import head, row
from tests.benchmarks.space_sweep import sweep_in_space

LINKS = (8, 12, 16, 24, 36, 48, 96)
LINKS_IN_JOBS = (24, 36, 48, 96)
"""Arms of fewer links are too stiff for most ducts and holes."""
ROUND = (*4 * SPACE_SUITES[:-3], *SPACE_SUITES[-3:])
"""The jobs, which come last, take several times as long as clutter."""


def suite(number: int) -> str:
    """Name of the suite that is drawn from in some turn: all scenes one after the other, with any number of links."""
    scene = ROUND[number % len(ROUND)]
    counts = LINKS if "clutter" in scene else LINKS_IN_JOBS
    return f"{scene}-{counts[number % len(counts)]}-links"


@dataclass(frozen=True)
class FoundAlone:
    """A planner that leaves motions as they were found, which come nearer to everything."""

    def plan(self, problem: Problem) -> JointPath:
        """The path along the motion that the search finds."""
        deadline = Deadline.after(problem.planner.time_limit)
        tree = SurfaceTree.from_triangles(problem.workspace.triangle_soup)
        task = space_task(problem, tree, deadline, SpaceMotionSettings())
        refuse_ends(problem, task)
        return joint_path(task, find_by_ways(task))


def outcome(problem: Problem, planner: Planner) -> str:
    """What comes of a problem: "safe", "touches", "no plan", "refused" by the verifier, or "crash"."""
    try:
        trajectory = timed_and_verified(problem, plan_legs(problem, planner), Stages()).trajectory
    except VerificationError as refused:
        print(f"- {problem.name}: refused: {'; '.join(refused.failures)}", flush=True)
        return "refused"
    except (NoPlanFound, ProblemError) as none:
        print(f"- {problem.name}: {none}".splitlines()[0], flush=True)
        return "no plan"
    except Exception as crash:  # noqa: BLE001 - whatever it is, it is reported as a defect
        place = traceback.extract_tb(crash.__traceback__)[-1]
        print(f"- {problem.name}: {type(crash).__name__}: {crash} ({place.name}, line {place.lineno})", flush=True)
        return "crash"
    seen = sweep_in_space(problem, trajectory)
    if seen.violations:
        print(f"- {problem.name}: {'; '.join(seen.violations)}", flush=True)
    return "touches" if seen.violations else "safe"


def main() -> None:
    """Run the scenes in turn, each with the next number of links, until there are so many plans, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000, help="plans")
    parser.add_argument("--first", type=int, default=50000, help="first seed")
    parser.add_argument("--limit", type=float, default=8.0, help="CPU time of each plan [s]")
    parser.add_argument("--found", action="store_true", help="leave motions as they were found, not optimised")
    options = parser.parse_args()
    planner = FoundAlone() if options.found else MotionPlanner()
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    number = 0
    planned = 0
    while planned < options.count:
        name = suite(number)
        seed = options.first + number
        number += 1
        try:
            problem = problem_maker(name)(seed, f"{name} {seed}")
        except ProblemError:  # no ends with room were drawn
            continue
        limited = replace(problem.planner, time_limit=options.limit)
        what = outcome(replace(problem, planner=limited), planner)
        counts[name.rsplit("-", 2)[0]][what] += 1
        planned += what != "no plan"
        if number % 25 == 0:
            print(f"{number} problems: {dict(sum(counts.values(), Counter()))}", flush=True)
    kinds = ("safe", "touches", "no plan", "refused", "crash")
    head("scene", "problems", *kinds)
    for name, items in (*counts.items(), ("all", sum(counts.values(), Counter()))):
        row(name, items.total(), *(items[kind] for kind in kinds))


if __name__ == "__main__":
    main()
