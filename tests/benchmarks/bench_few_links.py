"""Arms of two to eight links in random scenes: what the planner finds beside a plain RRT-Connect with swept checks.

``python -m tests.benchmarks.bench_few_links 2000 200`` runs 200 scenes from seed 2000 on; the sampler has 3 s of CPU,
the planner what the problem's time limit allows, and is counted as late after 3 s. Only scenes that the sampler solves
are planned unless ``--all`` is given.
"""

import argparse
import resource
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.planning.draws import Connecting
from ccm_opt.planning.passage_widths import MARGINS
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.sampled_check import SampledCheck
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.problem import JointPose, Problem
from tests.benchmarks.plain_connect import plain_connect
from tests.few_link_scenes import few_link_problem, few_link_scene
from tests.scenes import motion_task

SECONDS = 3.0
"""CPU time of the sampler, and what the planner should not need more than [s]."""
TIME_LIMIT = 20.0
"""Of the planner [s]."""
DRAWS = 4
"""How often poses at a goal for the tip are drawn for the sampler."""


@dataclass(frozen=True)
class FewLinksRun:
    """What came of one scene; seconds are None where nothing was found.

    Attributes:
        seed: of the scene.
        plain: CPU time of the sampler [s].
        planner: CPU time of the planner, the optimisation included [s]; NaN where it was not asked.
        candidate: what found the planner's motion, or why there is none.
    """

    seed: int
    plain: float | None
    planner: float | None
    candidate: str


def goal_poses(problem: Problem, seed: int) -> FloatArray:
    """Bends of poses at the goal, shape (m, links) [rad]: the one the scene is made from, and others for the tip."""
    arm = problem.arm
    known = arm.bends(few_link_scene(seed).goal)[None]
    if isinstance(problem.goal, JointPose):
        return known
    task = motion_task(problem)
    run = PlanarRun.from_task(task, MARGINS[-1])
    connecting = Connecting(task, run.stepper.space, run.start, run.goal, lambda: iter(()))
    check = SampledCheck.for_workspace(arm, problem.workspace)
    goals = connecting._search(check, np.random.default_rng(seed)).goals
    drawn = [pose for _ in range(DRAWS) for pose in next(goals)]
    proved = [pose for pose in drawn if len(task.certificate.failures(np.stack((pose, pose)))) == 0]
    return np.vstack((known, *(arm.bends(pose)[None] for pose in proved)))


def compared(seed: int, *, always: bool) -> FewLinksRun:
    """Both on one scene; the planner only where the sampler finds something, unless it is always asked."""
    problem = few_link_problem(seed, TIME_LIMIT)
    run = plain_connect(problem, goal_poses(problem, seed), SECONDS, seed)
    plain = None if run.way is None else run.seconds
    if plain is None and not always:
        return FewLinksRun(seed, None, float("nan"), "not asked")
    before = _cpu()
    try:
        path = MotionPlanner().plan(problem)
    except NoPlanFound as error:
        return FewLinksRun(seed, plain, None, str(error).splitlines()[0])
    return FewLinksRun(seed, plain, _cpu() - before, path.candidate)


def _cpu() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    """Run the scenes and print what differs, then the sums."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("count", type=int)
    parser.add_argument("--all", action="store_true")
    arguments = parser.parse_args()
    runs = []
    for seed in range(arguments.first, arguments.first + arguments.count):
        run = compared(seed, always=arguments.all)
        runs.append(run)
        late = run.planner is None or run.planner > SECONDS
        if late or (run.plain is None and arguments.all):
            print(run, flush=True)  # noqa: T201 - a benchmark prints
    plain = [run.plain for run in runs if run.plain is not None]
    both = [run for run in runs if run.plain is not None and run.planner is not None]
    seconds = np.array([run.planner for run in both], dtype=np.float64)
    print(f"the sampler solves {len(plain)} of {len(runs)}, the planner {len(both)} of these")  # noqa: T201 - likewise
    if both:
        print(  # noqa: T201 - likewise
            f"{int(np.sum(seconds <= SECONDS))} in {SECONDS:.0f} s of CPU; median {np.median(seconds):.2f} s, "
            f"90 % {np.quantile(seconds, 0.9):.2f} s; the sampler's median {1e3 * np.median(plain):.1f} ms"
        )


if __name__ == "__main__":
    main()
