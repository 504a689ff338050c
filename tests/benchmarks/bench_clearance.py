"""The room that motions keep, and what it costs; prints Markdown tables.

    python -m tests.benchmarks.bench_clearance problems
    python -m tests.benchmarks.bench_clearance clutter --polygons 20 40 80 --seeds 95000 95034

Every problem is planned, timed and verified twice in the same run, with its wanted gap (or the default share of the
arm's length) and without one. Gaps are those of shapely between poses no farther than a millimetre apart, and owe
nothing to the package's certificate. Where the motion keeps less than nine tenths of the wanted gap, and of what its
start has, the problem is planned again with larger wanted gaps: the largest gap that any of these motions keeps is what
the room allows, as far as this planner can tell. User CPU of this process, planning alone. Set OMP_NUM_THREADS=1 and
OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt import load_problem
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal_pose import poses_at_goal
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.verification.verifier import verify
from tests.benchmarks.dense_sweep import CHUNK
from tests.benchmarks.shared_problems import FOLDER, NAMES
from tests.planned_runs import in_one_line, quantile, timed, user_seconds
from tests.scenes import clutter, sweep_gaps

TRAVEL = 1e-3
"""Farthest that a joint moves between two poses that are looked at [m]."""
ENOUGH = 0.9
"""Share of the wanted gap, or of what the room allows, that counts as kept."""
LARGER = (1.4, 2.0)
"""Wanted gaps that are tried, over the wanted one, where a motion keeps too little."""


@dataclass(frozen=True)
class Plan:
    """One planned, timed and verified motion.

    Attributes:
        seconds: user CPU of planning [s].
        path: of the joints, or None.
        duration: NaN without a motion [s].
        walls: least gap to a wall, not told apart beyond 0.1 m, NaN without a motion [m].
        own: least gap between two links, likewise [m].
        at_start: least gap to a wall of the start pose [m].
        at_goal: of the last pose [m].
        refusal: why there is no verified motion; empty when there is.
    """

    seconds: float
    path: JointPath | None = None
    duration: float = np.nan
    walls: float = np.nan
    own: float = np.nan
    at_start: float = np.nan
    at_goal: float = np.nan
    refusal: str = ""


@dataclass(frozen=True)
class Compared:
    """A problem planned with and without its wanted gap.

    Attributes:
        name: of the problem.
        wanted: gap [m].
        wide: the plan that asks for it.
        close: the plan that does not.
        allowed: the most that any plan kept [m].
    """

    name: str
    wanted: float
    wide: Plan
    close: Plan
    allowed: float

    @cached_property
    def share(self) -> float:
        """Least gap to a wall over the wanted one, or over what the room allows."""
        return self.wide.walls / min(self.wanted, self.allowed)

    @property
    def reached(self) -> str:
        """Whether the motion ends in the pose of the goal-pose NLP."""
        record = None if self.wide.path is None else self.wide.path.goal_pose
        if record is None:
            return "not asked"
        return "yes" if record.reached else "no"

    @property
    def longer(self) -> float:
        """Duration over that of the plan without a wanted gap."""
        return self.wide.duration / self.close.duration

    @property
    def dearer(self) -> float:
        """Planning CPU over that of the plan without a wanted gap."""
        return self.wide.seconds / self.close.seconds


def planned(problem: Problem, gap: float) -> Plan:
    """Plan for a wanted gap [m], time, verify and look at the motion."""
    problem = replace(problem, planner=replace(problem.planner, wanted_gap=gap))
    begin = user_seconds()
    try:
        path = MotionPlanner().plan(problem)
    except NoPlanFound as failure:
        return Plan(user_seconds() - begin, refusal=in_one_line(failure))
    seconds = user_seconds() - begin
    try:
        trajectory, states = timed(problem, path)
    except NoPlanFound as failure:
        return Plan(seconds, path, refusal=in_one_line(failure))
    refused = [check.name for check in verify(problem, trajectory, states) if not check.passed]
    headings = problem.arm.headings(finely(problem, trajectory.bend_angles))
    walls, own = least_gaps(problem, headings)
    ends = [sweep_gaps(problem.arm, problem.workspace, headings[[place]])[0] for place in (0, -1)]
    return Plan(seconds, path, trajectory.duration, walls, own, ends[0], ends[1], "; ".join(refused))


def finely(problem: Problem, bends: FloatArray) -> FloatArray:
    """Bends (T, links) of a motion, linear between its samples, at poses so near that no joint moves a millimetre."""
    points = problem.arm.joint_positions(problem.arm.headings(bends))
    steps = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
    travelled = np.concatenate(([0.0], np.cumsum(steps)))
    places = np.linspace(0.0, travelled[-1], int(np.ceil(travelled[-1] / TRAVEL)) + 1)
    moving = np.concatenate(([True], steps > 0.0))
    return np.stack([np.interp(places, travelled[moving], bend) for bend in bends[moving].T], axis=1)


def least_gaps(problem: Problem, headings: FloatArray) -> tuple[float, float]:
    """Least gap of poses to walls and between links by shapely, not told apart beyond 0.1 m [m]."""
    chunks = [headings[k : k + CHUNK] for k in range(0, len(headings), CHUNK)]
    gaps = np.array([sweep_gaps(problem.arm, problem.workspace, chunk) for chunk in chunks])
    return float(gaps[:, 0].min()), float(gaps[:, 1].min())


def compared(name: str, problem: Problem) -> Compared:
    """Both plans of a problem, and more with larger wanted gaps where the first keeps too little."""
    ends = resolve_ends(problem)
    wanted = poses_at_goal(problem, ends, ends.start).wanted_gap
    wide = planned(problem, wanted)
    close = planned(problem, 0.0)
    allowed = np.nanmax([wide.walls, close.walls, 0.0])
    if wide.walls < ENOUGH * min(wanted, wide.at_start):
        more = [planned(problem, share * wanted) for share in LARGER]
        allowed = np.nanmax([allowed, *(plan.walls for plan in more if not plan.refusal)])
    return Compared(name, wanted, wide, close, max(float(allowed), TRAVEL * TRAVEL))


def print_each(scenes: Iterable[Compared]) -> list[Compared]:
    """Prints a row a problem while they are planned."""
    print("| problem | wanted | gap, walls | links | start | goal | allowed | without | goal pose | s | longer | CPU |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    done = []
    for scene in scenes:
        done.append(scene)
        wide = scene.wide
        gaps = (scene.wanted, wide.walls, wide.own, wide.at_start, wide.at_goal, scene.allowed, scene.close.walls)
        words = " | ".join(f"{1e3 * gap:.1f}" for gap in gaps)
        refusal = f" {wide.refusal}" if wide.refusal else ""
        print(
            f"| {scene.name} | {words} | {scene.reached} | {wide.duration:.2f} | {scene.longer:.2f} "
            f"| {scene.dearer:.2f} |{refusal}",
            flush=True,
        )
    return done


def summary(name: str, scenes: Sequence[Compared]) -> None:
    """Medians and worst of many problems."""
    solved = [scene for scene in scenes if not scene.wide.refusal]
    if not solved:
        print(f"{name}: none of {len(scenes)} solved")
        return
    kept = [scene.share for scene in solved]
    longer = [scene.longer for scene in solved if not scene.close.refusal]
    reached = [scene.reached == "yes" for scene in solved]
    dearer = sum(scene.wide.seconds for scene in scenes) / sum(scene.close.seconds for scene in scenes)
    without = sum(not scene.close.refusal for scene in scenes)
    print(f"\n{name}: {len(solved)} of {len(scenes)} solved, {without} without a wanted gap")
    print(
        f"- least gap over the least of wanted and allowed: median {quantile(kept, 0.5):.2f}, "
        f"10 % {quantile(kept, 0.1):.2f}, worst {min(kept):.2f}; "
        f"at least {ENOUGH} in {np.mean(np.array(kept) >= ENOUGH):.0%}"
    )
    for words, values in (
        ("least gap [mm]", [1e3 * scene.wide.walls for scene in solved]),
        ("least gap without [mm]", [1e3 * scene.close.walls for scene in solved]),
        ("gap of the last pose [mm]", [1e3 * scene.wide.at_goal for scene in solved]),
    ):
        print(
            f"- {words}: median {quantile(values, 0.5):.1f}, 10 % {quantile(values, 0.1):.1f}, worst {min(values):.1f}"
        )
    print(f"- goal pose reached: {np.mean(reached):.0%}")
    print(
        f"- duration over that without a wanted gap: median {quantile(longer, 0.5):.2f}, "
        f"90 % {quantile(longer, 0.9):.2f}, worst {max(longer):.2f}"
    )
    ratios = [scene.dearer for scene in scenes]
    print(f"- planning CPU over that without: sum {dearer:.2f}, median {quantile(ratios, 0.5):.2f}")


def main() -> None:
    """Read the command line and plan."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    files = commands.add_parser("problems")
    files.add_argument("--names", nargs="+", default=list(NAMES))
    random = commands.add_parser("clutter")
    random.add_argument("--polygons", type=int, nargs="+", default=[20, 40, 80])
    random.add_argument("--seeds", type=int, nargs=2, default=[95_000, 95_034])
    given = parser.parse_args()
    planned(clutter(1, 5).problem(), 0.0075)  # the first plan of a process builds what all later ones use
    if given.command == "problems":
        scenes = print_each(compared(name, load_problem(FOLDER / f"{name}.toml")) for name in given.names)
        summary("problems", scenes)
        return
    for place, count in enumerate(given.polygons):
        seeds = [seed + place * (given.seeds[1] - given.seeds[0]) for seed in range(*given.seeds)]
        named = ((f"{count} polygons, seed {seed}", clutter(seed, count).problem()) for seed in seeds)
        summary(f"{count} polygons", print_each(compared(name, problem) for name, problem in named))


if __name__ == "__main__":
    main()
