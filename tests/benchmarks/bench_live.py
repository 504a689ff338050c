"""How long a plan takes that follows a dragged goal: ``python -m tests.benchmarks.bench_live [drags] [seed]``.

The goal wanders at random about its place, 2 % of the arm's length at a time, in the swan's neck and in fields of
twenty polygons. CPU seconds of each answer; durations beside a solve from nothing at the last goal.
"""

import sys
from collections import Counter

import numpy as np

import ccm_opt
from ccm_opt.cli.compare.suites import clutter
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.problem import Problem, TipGoal

STEP = 0.02
"""Length of a drag, as a share of the arm's."""
HOME = 0.15
"""Distance from home, as a share of the arm's length, at which the goal is drawn back as strongly as it wanders."""


def wander(problem: Problem, drags: int, seed: int) -> tuple[LivePlan, list[LiveAnswer]]:
    """Drag a goal about; the plan at last, and every answer."""
    live = LivePlan(problem)
    goal = problem.goal
    assert isinstance(goal, TipGoal)
    random = np.random.default_rng(seed)
    position = goal.position.copy()
    pace = random.normal(0.0, 1.0, 2)
    answers = []
    for k in range(drags):
        back = (position - goal.position) / (HOME * problem.arm.length)
        pace = 0.8 * pace + 0.6 * random.normal(0.0, 1.0, 2) - 0.5 * back
        position = position + STEP * problem.arm.length * pace / np.hypot(*pace)
        heading = None if goal.heading is None else goal.heading + 0.3 * np.sin(0.3 * k)
        answers.append(live.move_goal(position, heading))
    return live, answers


def main() -> None:
    """Print a row for every problem."""
    drags = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    problems = [ccm_opt.load_problem("problems/swan-neck.toml")]
    problems += [clutter(seed + k, count=20).problem(name=f"clutter-20-{seed + k}") for k in range(4)]
    sys.stdout.write("problem            planned   median     90 %    worst   duration   anew\n")
    for problem in problems:
        live, answers = wander(problem, drags, seed)
        times = np.array([answer.cpu for answer in answers])
        planned = sum(answer.current for answer in answers)
        anew = ccm_opt.solve(live.plan.problem).trajectory.duration
        sys.stdout.write(
            f"{problem.name:18} {planned:3}/{drags:3} {np.median(times):7.3f}s {np.quantile(times, 0.9):7.3f}s "
            f"{times.max():7.3f}s {live.plan.trajectory.duration:8.3f}s {anew:7.3f}s\n"
        )
        kinds = Counter(" ".join(answer.reason.split()[:4]) for answer in answers if not answer.current)
        for kind, count in kinds.most_common():
            sys.stdout.write(f"    not planned: {count} times {kind} …\n")


if __name__ == "__main__":
    main()
