"""How long a plan takes that follows a dragged goal: ``python -m tests.benchmarks.bench_live [drags] [seed] [name]``.

The goal wanders at random about its place, 2 % of the arm's length at a time, in the swan's neck, in fields of twenty
polygons, in three jobs in space and among forty bodies. CPU seconds of each answer, the drags after which the route may
have changed, and durations beside those of solves from nothing at every fiftieth goal.
"""

import sys
from collections import Counter
from collections.abc import Iterator

import numpy as np

import ccm_opt
from ccm_opt.cli.compare.suites import clutter
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.problem import Problem, TipGoal
from tests.space_clutter import clutter as clutter_in_space

STEP = 0.02
"""Length of a drag, as a share of the arm's."""
HOME = {2: 0.15, 3: 0.05}
"""Distance from home, as a share of the arm's length, at which the goal is drawn back as strongly as it wanders, in the
plane and in space."""
EVERY = 50
"""Drags between two solves from nothing."""


def wander(problem: Problem, drags: int, seed: int) -> Iterator[tuple[LivePlan, LiveAnswer]]:
    """Drag a goal about; the plan and the answer after each drag."""
    live = LivePlan(problem)
    goal = problem.goal
    assert isinstance(goal, TipGoal)
    random = np.random.default_rng(seed)
    position = goal.position.copy()
    pace = random.normal(0.0, 1.0, len(position))
    for k in range(drags):
        back = (position - goal.position) / (HOME[problem.dimension] * problem.arm.length)
        pace = 0.8 * pace + 0.6 * random.normal(0.0, 1.0, len(position)) - 0.5 * back
        position = position + STEP * problem.arm.length * pace / np.linalg.norm(pace)
        heading = goal.heading if problem.dimension == 2 else None
        yield live, live.move_goal(position, None if heading is None else heading + 0.3 * np.sin(0.3 * k))


def problems(seed: int) -> Iterator[Problem]:
    """Yield the problems whose goals are dragged."""
    yield ccm_opt.load_problem("problems/swan-neck.toml")
    for k in range(4):
        yield clutter(seed + k, count=20).problem(name=f"clutter-20-{seed + k}")
    for name in ("elbow", "wing-box", "blade-row"):
        yield ccm_opt.load_problem(f"problems/space/{name}.toml")
    yield clutter_in_space(seed, bodies=40, most_gap=0.02).problem


def main() -> None:
    """Print a row for every problem."""
    drags = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    wanted = sys.argv[3] if len(sys.argv) > 3 else ""
    sys.stdout.write("problem            planned   median     90 %    worst  routes  duration over that of a solve\n")
    for problem in problems(seed):
        if wanted not in problem.name:
            continue
        answers = []
        ratios = []
        for live, answer in wander(problem, drags, seed):
            answers.append(answer)
            if answer.current and len(answers) % EVERY == 0:
                try:
                    anew = ccm_opt.solve(live.plan.problem)
                except NoPlanFound:
                    ratios.append(0.0)
                else:
                    ratios.append(live.plan.trajectory.duration / anew.trajectory.duration)
        times = np.array([answer.cpu for answer in answers])
        planned = sum(answer.current for answer in answers)
        changed = sum(not answer.same_route for answer in answers)
        sys.stdout.write(
            f"{problem.name:18} {planned:3}/{drags:3} {np.median(times):7.3f}s {np.quantile(times, 0.9):7.3f}s "
            f"{times.max():7.3f}s {changed:5}   {' '.join(f'{ratio:.2f}' for ratio in ratios)}\n"
        )
        kinds = Counter(" ".join(answer.reason.split()[:4]) for answer in answers if not answer.current)
        for kind, count in kinds.most_common():
            sys.stdout.write(f"    not planned: {count} times {kind} …\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
