"""Are plans beside a scan safe beside the mesh that the scan was taken of? Sampled points, motions swept by coal.

    python -m tests.benchmarks.bench_scans --count 60 --points 100000 1000000

The shipped jobs with starts and goals moved: their bodies are sampled at random, the arm is planned and verified beside
the points alone, each a ball that reaches what lies between them, and its motion is swept beside the bodies. Every
second plan has the other number of points. CPU is that of planning and verifying beside points and beside triangles.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import time
from collections import Counter
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ccm_opt.cli.compare.suites import SPACE_SUITES, problem_maker
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound, ProblemError, VerificationError
from ccm_opt.core.progress import Stages
from ccm_opt.driver.legs import plan_legs
from ccm_opt.driver.verified_plan import timed_and_verified
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.workspace import Obstacle
from tests.benchmarks.space_sweep import sweep_in_space

PROBES = 200_000
"""Number of further points that say how far the surface is from a point of the scan at most."""


def sampled(triangles: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Points spread evenly over triangles (m, 3, 3), shape (count, 3) [m]."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    areas = np.linalg.norm(np.cross(first, second), axis=1)
    k = rng.choice(len(triangles), count, p=areas / areas.sum())
    a, b = rng.random((2, count, 1))
    a, b = np.where(a + b > 1.0, 1.0 - a, a), np.where(a + b > 1.0, 1.0 - b, b)
    return np.asarray(triangles[k, 0] + a * first[k] + b * second[k])


def scanned(problem: Problem, count: int, rng: np.random.Generator) -> Problem:
    """The problem with points in the place of its bodies."""
    triangles = np.concatenate([each.body.triangles for each in problem.workspace.obstacles])
    points = sampled(triangles, count, rng)
    apart, _ = cKDTree(points).query(sampled(triangles, PROBES, rng))
    scan = Obstacle("scan", MeshBody.of_points(points, radius=float(np.max(apart))))
    return replace(problem, workspace=replace(problem.workspace, obstacles=(scan,)))


def planned(problem: Problem) -> tuple[JointTrajectory, float]:
    """The verified motion, and the CPU that it took [s]."""
    begin = time.process_time()
    trajectory = timed_and_verified(problem, plan_legs(problem, MotionPlanner()), Stages()).trajectory
    return trajectory, time.process_time() - begin


def main() -> None:
    """Print a line a plan, and a summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60, help="number of plans to be swept")
    parser.add_argument("--points", type=int, nargs="+", default=[100_000, 1_000_000], help="of a scan, in turn")
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    parser.add_argument("--limit", type=float, default=60.0, help="time limit of a search [s]")
    parser.add_argument("--mesh", action="store_true", help="plan beside the bodies too, to compare the CPU")
    options = parser.parse_args()
    outcomes: Counter[str] = Counter()
    number = options.first
    while outcomes["clear"] + outcomes["touches"] < options.count:
        number += 1
        points = options.points[number // 3 % len(options.points)]
        name = SPACE_SUITES[-1 - number % 3]
        problem = problem_maker(f"{name}-24-links")(number, f"{name} {number}")
        problem = replace(problem, planner=replace(problem.planner, time_limit=options.limit))
        scan = scanned(problem, points, np.random.default_rng(number))
        body = scan.workspace.obstacles[0].body
        head = f"{problem.name}: {points} points, {len(body.triangles)} balls of {1e3 * body.rounding:.2f} mm"
        try:
            trajectory, seconds = planned(scan)
        except (NoPlanFound, ProblemError, VerificationError) as none:
            outcomes["no plan"] += 1
            print(f"{head}: {type(none).__name__} {str(none).splitlines()[0]}", flush=True)
            continue
        sweep = sweep_in_space(problem, trajectory)
        outcomes["touches" if sweep.violations else "clear"] += 1
        beside = f", {planned(problem)[1]:.1f} s beside the bodies" if options.mesh else ""
        clear = f"touches: {sweep.violations}" if sweep.violations else f"clear by {1e3 * sweep.wall_gap:.2f} mm"
        print(f"{head}: {seconds:.1f} s CPU{beside}, {clear}", flush=True)
    print(dict(outcomes))


if __name__ == "__main__":
    main()
