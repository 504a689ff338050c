"""The chains of OMPL: this planner, and OMPL's own in C++ with swept checks, side by side; run with ``python -m``.

    python -m tests.benchmarks.bench_ompl --links 12 24 36 48 96 --peer-links 12 24 --limit 20
    python -m tests.benchmarks.bench_ompl --links 24 --perturbed 20

CPU times. Ours: a certified C² path, and the same optimised; every plan is timed, passed by the package's verifier and
re-checked densely by ``CrossingCheck``. OMPL needs ``libompl-dev``; without it give ``--peer-links`` no number.
"""

# ruff: noqa: T201 - a script that prints a table

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound, RetimingError
from ccm_opt.dynamics import retiming
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import JointPath, JointStates
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.verification.verifier import verify
from tests.arms import joint_torques
from tests.benchmarks.ompl_planners import PLANNERS, run_peer
from tests.crossings import CrossingCheck
from tests.ompl_scenes import LARGEST_CORRIDOR, SCENES

SAMPLES = 20_001
"""Poses of our path that the crossing check sees."""
PERTURBATION = 0.1
"""Standard deviation of the last link's heading in perturbed starts; every joint has its share [rad]."""


@dataclass(frozen=True)
class OurRun:
    """What came of one plan.

    Attributes:
        outcome: "verified", or why not.
        seconds: CPU time of planning [s].
        travel: length of the joint path [rad].
        candidate: the tactic that found it.
        goal: bends at its end, (links,) [rad], or None.
    """

    outcome: str
    seconds: float
    travel: float
    candidate: str
    goal: FloatArray | None


def run_ours(problem: Problem, *, optimise: bool = False) -> OurRun:
    """Plan, time, verify and re-check one problem; ``seconds`` are those of planning alone."""
    optimiser = "sequential-convex" if optimise else "none"
    problem = replace(problem, planner=replace(problem.planner, optimiser=optimiser))
    begin = time.process_time()
    try:
        path = MotionPlanner().plan(problem)
    except NoPlanFound as failure:
        return OurRun(str(failure).splitlines()[0], time.process_time() - begin, np.nan, "", None)
    seconds = time.process_time() - begin
    travel = float(np.linalg.norm(np.diff(path.keyframes, axis=0), axis=1).sum())
    return OurRun(judge(problem, path), seconds, travel, path.candidate, path.keyframes[-1])


def judge(problem: Problem, path: JointPath) -> str:
    """What the verifier or the dense check says against a path, or that it is verified."""
    if not CrossingCheck(problem).path_is_free(path.spline(np.linspace(0.0, 1.0, SAMPLES))):
        return "crosses"
    arm = problem.arm
    gravity = problem.simulation.gravity

    def torques(angles: FloatArray, velocities: FloatArray, accelerations: FloatArray) -> FloatArray:
        return joint_torques(arm, gravity, *(-values[:, 1::3] for values in (angles, velocities, accelerations)))

    revolutes = partial(revolute_angles, arm)
    try:
        share = problem.planner.effort_share
        trajectory = retiming.retime(path, problem.limits, torques, revolutes=revolutes, share=share)
    except RetimingError as failure:
        return str(failure).splitlines()[0]
    states = [
        revolutes(values)
        for values in (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    ]
    checks = verify(problem, trajectory, JointStates(joint_names(arm), *states, torques(*states)))
    failed = [f"{check.name} {check.worst:.3g} {check.where}" for check in checks if not check.passed]
    return "; ".join(failed) or "verified"


def perturbed(problem: Problem, count: int, seed: int = 0) -> Iterator[Problem]:
    """The problem from starts whose joints are off by small normal random angles, and which touch nothing."""
    if not isinstance(problem.start, JointPose):
        raise TypeError("only joint poses can be perturbed")
    rng = np.random.default_rng(seed)
    check = CrossingCheck(problem)
    found = 0
    spread = PERTURBATION / np.sqrt(problem.arm.links)
    while found < count:
        bends = problem.start.bends + spread * rng.standard_normal(problem.arm.links)
        if check(bends):
            found += 1
            yield replace(problem, name=f"{problem.name}-{found}", start=JointPose(bends))


def cases(scenes: list[str], links: list[int]) -> Iterator[tuple[str, int]]:
    """Scenes and numbers of links that make sense together."""
    for scene in scenes:
        for n in links:
            if scene != "corridor" or n <= LARGEST_CORRIDOR:
                yield scene, n


def compare(options: argparse.Namespace) -> None:
    """Print one row a scene and number of links."""
    print(f"| scene | links | ours [s] | outcome | optimised [s] | outcome | {' | '.join(PLANNERS)} |")
    print("|---" * (6 + len(PLANNERS)) + "|")
    for scene, n in cases(options.scenes, options.links):
        problem = SCENES[scene](n)
        runs = [run_ours(problem) for _ in range(options.repeat)]
        ours = runs[0]
        optimised = run_ours(problem, optimise=True)
        peers = ["" for _ in PLANNERS]
        if n in options.peer_links and ours.goal is not None:
            peers = [_peer(problem, ours.goal, planner, options) for planner in PLANNERS]
        seconds = float(np.median([run.seconds for run in runs]))
        cells = [scene, str(n), f"{seconds:.2f}", _told(ours), f"{optimised.seconds:.2f}", _told(optimised), *peers]
        print(f"| {' | '.join(cells)} |", flush=True)


def _told(run: OurRun) -> str:
    return f"{run.outcome}, {run.travel:.0f} rad, {run.candidate}" if run.goal is not None else run.outcome


def _peer(problem: Problem, goal: FloatArray, planner: str, options: argparse.Namespace) -> str:
    runs = [run_peer(problem, goal[None], planner, options.limit, seed) for seed in range(options.seeds)]
    return ", ".join(
        f"{run.seconds:.2f}" if run.outcome == "solved" else f"{run.outcome} ({run.seconds:.1f})" for run in runs
    )


def shake(options: argparse.Namespace) -> None:
    """Print how many of the perturbed starts are solved."""
    for scene, n in cases(options.scenes, options.links):
        starts = perturbed(SCENES[scene](n), options.perturbed)
        runs = [run_ours(problem, optimise=options.optimise) for problem in starts]
        good = [run for run in runs if run.outcome == "verified"]
        seconds = [run.seconds for run in good]
        print(f"{scene} {n}: {len(good)} of {len(runs)} verified; CPU ", end="")
        print(f"median {np.median(seconds):.2f} s, worst {max(seconds):.2f} s" if seconds else "-", flush=True)
        for k, run in enumerate(runs):
            if run.outcome != "verified":
                print(f"  start {k + 1}: {run.outcome}", flush=True)


def main() -> None:
    """Parse the options and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--links", nargs="+", type=int, default=[12, 24, 36, 48, 96])
    parser.add_argument("--peer-links", nargs="*", type=int, default=[12, 24, 36], help="links at which OMPL runs too")
    parser.add_argument("--limit", type=float, default=20.0, help="CPU seconds of each run of OMPL")
    parser.add_argument("--seeds", type=int, default=1, help="runs of each planner of OMPL")
    parser.add_argument("--repeat", type=int, default=1, help="runs of ours, of which the median counts")
    parser.add_argument("--perturbed", type=int, default=0, help="plan from so many perturbed starts instead")
    parser.add_argument("--optimise", action="store_true", help="optimise the motions from perturbed starts")
    options = parser.parse_args()
    run_ours(SCENES["corridor"](12))  # what is loaded lazily is loaded now
    (shake if options.perturbed else compare)(options)


if __name__ == "__main__":
    main()
