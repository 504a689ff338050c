"""Goal poses against the best of many random starts of the same NLP, over all routes; prints Markdown tables.

    python -m tests.benchmarks.bench_goal_poses clutter --polygons 20 40 80 --seeds 95000 95034
    python -m tests.benchmarks.bench_goal_poses fresh --polygons 20 40 --seeds 95000 95010
    python -m tests.benchmarks.bench_goal_poses hard --seeds 96000 96020

``clutter`` lets the planner's own motion end at the goal, asks from that pose as the planner does, and solves the same
NLP, with the same weights and the same pose to stay near, from random poses at the goal (``random_goal_poses``), each
with its regions drawn anew until that brings less than a thousandth. ``fresh`` times the first question in a fresh
interpreter. ``hard`` counts failures over arms of 6 to 192 links, thick and of radius 0, with and without goal
headings, torque limits and self-collision.

User CPU of this process. Set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal_pose import poses_at_goal
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.strategies import find_motion
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.arm import Arm
from tests.benchmarks.random_goal_poses import RandomPoses
from tests.planned_runs import quantile, user_seconds
from tests.scenes import clutter

STARTS = 50
ROUNDS = 8
WORTH = 1e-3
"""Share of the cost that a round must bring for the next one, where poses are looked for with patience."""
WITHIN = 1.05
"""A pose that costs at most this much of the best counts as found."""


@dataclass(frozen=True)
class Measured:
    """What came of one scene; costs are infinite where nothing was found.

    Attributes:
        polygons: of the scene.
        first: cost of one solution, from where the motion would end by itself.
        rounds: of the best solution with regions drawn anew until the wanted gap is reached.
        best: of all poses, random starts included.
        starts: random starts drawn.
        seconds: user CPU of the solutions counted as ``rounds`` [s].
    """

    polygons: int
    first: float
    rounds: float
    best: float
    starts: int
    seconds: float


def arrival(problem: Problem) -> FloatArray | None:
    """Link headings in which the motion would end by itself, found and optimised; None where there is none."""
    seen: list[FloatArray] = []

    def look_on(_arm: Arm, headings: FloatArray) -> tuple[FloatArray, ...]:
        seen.append(headings)
        return ()

    ends = resolve_ends(problem)
    task = MotionPlanner().motion_task(problem, ends, Deadline.after(problem.planner.time_limit))
    try:
        find_motion(replace(task, end_poses=look_on))
    except NoPlanFound:
        return None
    return seen[-1] if seen and len(seen[-1]) == problem.arm.links else None


def patient(search: GoalPoses, start: FloatArray) -> ArmPose | None:
    """The solution from a start, its regions drawn anew until that brings nothing; None when it is not feasible."""
    best: ArmPose | None = None
    for _ in range(ROUNDS):
        pose = search.solved(start)
        if not search.feasible(pose) or (best is not None and pose.answer.cost > best.answer.cost):
            break
        gained = np.inf if best is None else 1.0 - pose.answer.cost / best.answer.cost
        best = pose
        start = pose.q
        if gained < WORTH:
            break
    return best


def cost_of(pose: ArmPose | None) -> float:
    """The objective; infinite for no pose."""
    return np.inf if pose is None else pose.answer.cost


def measured(seed: int, polygons: int) -> Measured | None:
    """One scene; None where the planner's search does not arrive."""
    problem = clutter(seed, polygons).problem()
    near = arrival(problem)
    if near is None:
        return None
    ends = resolve_ends(problem)
    search = poses_at_goal(problem, ends, near)
    first = search.solved(near)
    begin = user_seconds()
    rounds = search.best(near)
    seconds = user_seconds() - begin
    starts = RandomPoses(problem, ends, np.random.default_rng([seed, polygons])).draw(STARTS)
    found = [patient(search, start) for start in [near, *map(problem.arm.bends, starts)]]
    best = min(cost_of(pose) for pose in [*found, rounds])
    once = cost_of(first) if search.feasible(first) else np.inf
    return Measured(polygons, once, cost_of(rounds), best, len(starts), seconds)


def compare(polygons: list[int], seeds: range) -> None:
    """Rounds against random starts over clutter; every number of polygons has seeds of its own."""
    every: list[Measured] = []
    for place, count in enumerate(polygons):
        for seed in seeds:
            scene = measured(seed + place * len(seeds), count)
            if scene is None:
                print(f"seed {seed + place * len(seeds)}, {count} polygons: the search does not arrive", flush=True)
                continue
            every.append(scene)
            if scene.rounds > WITHIN * scene.best:
                ratio = scene.rounds / scene.best
                print(f"seed {seed + place * len(seeds)}, {count} polygons: {ratio:.2f} of the best", flush=True)
    print("\n| polygons | scenes | one | rounds | CPU | 90 % | worst |")
    print("|---|---|---|---|---|---|---|")
    for count in [*polygons, 0]:
        report(str(count) if count else "all", [each for each in every if count in (each.polygons, 0)])


def report(name: str, scenes: list[Measured]) -> None:
    """A line of the table: shares of scenes within 5 % of the best, and CPU of the rounds."""
    if not scenes:
        return
    kinds = ("first", "rounds")
    shares = [np.mean([getattr(each, kind) <= WITHIN * each.best for each in scenes]) for kind in kinds]
    seconds = [1e3 * each.seconds for each in scenes]
    print(
        f"| {name} | {len(scenes)} | {shares[0]:.0%} "
        f"| {shares[1]:.0%} | {quantile(seconds, 0.5):.0f} ms | {quantile(seconds, 0.9):.0f} ms "
        f"| {max(each.rounds / each.best for each in scenes):.2f} |"
    )


def fresh(polygons: list[int], seeds: range) -> None:
    """Times the first question of a process, solver and all."""
    print("| polygons | CPU of the first question, median | worst |\n|---|---|---|")
    for count in polygons:
        seconds = []
        for seed in seeds:
            command = [sys.executable, "-m", "tests.benchmarks.bench_goal_poses", "first", str(seed), str(count)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            seconds += [float(line) for line in done.stdout.split()]
        print(f"| {count} | {1e3 * quantile(seconds, 0.5):.0f} ms | {1e3 * quantile(seconds, 1.0):.0f} ms |")


def first_question(seed: int, polygons: int) -> None:
    """Prints the CPU of the first candidates of this process [s]."""
    problem = clutter(seed, polygons).problem()
    near = arrival(problem)
    if near is None:
        return
    ends = resolve_ends(problem)
    begin = user_seconds()
    poses_at_goal(problem, ends, near).best(near)
    print(user_seconds() - begin)


def hard_problems(seeds: range) -> Iterator[tuple[str, Problem, FloatArray]]:
    """Arms of many kinds in clutter, with a pose at the goal that touches nothing."""
    kinds = list(product((6, 12, 24, 48, 96, 192), (0.0, 0.015), (True, False), (True, False), (True, False)))
    rng = np.random.default_rng(seeds.start)
    for seed in seeds:
        for links, radius, headed, loaded, own in (kinds[k] for k in rng.choice(len(kinds), 12, replace=False)):
            scene = clutter(seed, int(rng.choice((20, 40, 80))), links)
            arm = replace(scene.arm, radius=radius, self_collision=own)
            goal = scene.goal_tip if headed else TipGoal(scene.goal_tip.position)
            problem = replace(scene, arm=arm).problem(goal)
            if loaded:
                problem = with_torques(problem, scene.goal)
            words = f"{links} links, radius {1e3 * radius:.0f} mm, heading {headed}, torque {loaded}, self {own}"
            yield f"seed {seed}: {words}", problem, scene.goal


def with_torques(problem: Problem, headings: FloatArray) -> Problem:
    """The problem with torque limits that leave the pose at the goal a third to spare, gravity along -y."""
    arm = problem.arm
    points = arm.joint_positions(headings)
    centres = 0.5 * (points[1:] + points[:-1])
    levers = centres[:, 0] - points[:-1, None, 0]
    carried = np.triu(np.ones((arm.links, arm.links)))
    needed = 9.81 * np.abs((carried * levers * arm.masses).sum(axis=1)).max()
    simulation = replace(problem.simulation, gravity=np.array([0.0, 0.0, -9.81]))
    limits = replace(problem.limits, torque=np.full(3 * arm.links, 1.5 * needed))
    return replace(problem, limits=limits, simulation=simulation)


def hard(seeds: range) -> None:
    """Counts what the NLP says of poses at the goal that touch nothing, and names what failed."""
    statuses: Counter[str] = Counter()
    failures = []
    total = 0
    for name, problem, goal in hard_problems(seeds):
        ends = resolve_ends(problem)
        search = poses_at_goal(problem, ends, ends.start)
        pose = search.solved(problem.arm.bends(goal))
        said = pose.answer
        statuses[said.status] += 1
        total += 1
        if not search.feasible(pose):
            failures.append(f"{name}: {said.status}, {said.worst_row} by {said.violation:.1e}, {said.iterations} it.")
            print(failures[-1], flush=True)
    print(f"\n{total - len(failures)} of {total} feasible; {dict(statuses)}")


def main() -> None:
    """Read the command line and run one of the benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    for name in ("clutter", "fresh"):
        command = commands.add_parser(name)
        command.add_argument("--polygons", type=int, nargs="+", default=[20, 40, 80])
        command.add_argument("--seeds", type=int, nargs=2, default=[95_000, 95_034])
    first = commands.add_parser("first")
    first.add_argument("seed", type=int)
    first.add_argument("polygons", type=int)
    commands.add_parser("hard").add_argument("--seeds", type=int, nargs=2, default=[96_000, 96_010])
    given = parser.parse_args()
    if given.command == "clutter":
        compare(given.polygons, range(*given.seeds))
    elif given.command == "fresh":
        fresh(given.polygons, range(*given.seeds))
    elif given.command == "first":
        first_question(given.seed, given.polygons)
    else:
        hard(range(*given.seeds))


if __name__ == "__main__":
    main()
