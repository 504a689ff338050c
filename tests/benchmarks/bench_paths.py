"""Random paths followed by three sections that bend evenly on six base axes; prints a line for each kind of path.

    python -m tests.benchmarks.bench_paths --paths 40
    python -m tests.benchmarks.bench_paths --paths 4 --solve

Distances of arm and tip from the path, in % of the arm's length, and CPU of planning. With ``--solve`` plans are timed
and verified too, and the tube is the one that the verifier proves.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.tip_path import TipPath
from ccm_opt.problem import JointPose, Problem, TipGoal, Workspace

FILE = Path(__file__).parents[2] / "problems" / "space" / "scanned-path.toml"
KINDS = ("planar", "spatial", "S-shaped")
POINTS = 401


def random_path(kind: str, rng: np.random.Generator) -> FloatArray:
    """Return points of a path of unit length from the origin, shape (POINTS, 3).

    Planar and spatial paths turn by 30 to 120 degrees in all, S-shaped ones by 30 to 75 degrees each way. Curvatures
    are cubic splines through five random values, or change their sign between 35 and 65 % of the length, and grow
    within the first twentieth of it.
    """
    s = np.linspace(0.0, 1.0, POINTS)

    def spline(low: float) -> FloatArray:
        return np.asarray(CubicSpline(np.linspace(0.0, 1.0, 5), rng.uniform(low, 1.0, 5))(s))

    if kind == "S-shaped":
        middle, width = rng.uniform(0.35, 0.65), rng.uniform(0.05, 0.15)
        turns = np.where(s < middle, rng.uniform(30.0, 75.0) / middle, rng.uniform(30.0, 75.0) / (1.0 - middle))
        curvature = np.stack((np.tanh((middle - s) / width) * np.deg2rad(turns), np.zeros(POINTS)))
    else:
        flat = kind == "planar"
        curvature = np.stack((np.maximum(spline(0.0), 0.0), np.zeros(POINTS)) if flat else (spline(-1.0), spline(-1.0)))
        curvature *= np.deg2rad(rng.uniform(30.0, 120.0)) / np.mean(np.linalg.norm(curvature, axis=0))
    curvature *= np.minimum(s / 0.05, 1.0)
    half = 0.5 * (curvature[:, 1:] + curvature[:, :-1]) / (POINTS - 1) / 2.0
    halves = Rotation.from_rotvec(np.stack((np.zeros(POINTS - 1), -half[1], half[0]), axis=1))
    frame, points = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)), [np.zeros(3)]
    for turn in halves:
        frame = frame * turn
        points.append(points[-1] + frame.apply([1.0 / (POINTS - 1), 0.0, 0.0]))
        frame = frame * turn
    return np.stack(points)


def path_problem(kind: str, seed: int) -> Problem:
    """Return the problem of following a random path in free space, from a straight start behind it."""
    problem = ccm_opt.load_problem(FILE)
    arm = problem.arm
    axes = tuple(replace(axis, low=-3.0, high=3.0) for axis in arm.carrier)
    arm = replace(arm, carrier=axes)
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    points = arm.length * random_path(kind, rng)[::10]
    along = TipPath(points, arm.length / 400.0).tangents(np.zeros(1))[0]
    place = -arm.length * along - arm.base
    turns = [np.arctan2(along[1], along[0]), -np.arcsin(along[2]), 0.0]
    return replace(
        problem,
        arm=arm,
        workspace=Workspace(bounds=None, obstacles=()),
        start=JointPose(np.zeros((arm.links, 2)), np.array([*place, *turns])),
        goal=TipGoal(points[-1], path=points),
        planner=replace(problem.planner, follow_within=0.05 * arm.length),
    )


def distances(problem: Problem, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return distances of the arm, (k, m), and of the tip, (k,), from start and path at configurations (k, c) [m]."""
    assert problem.goal.path is not None
    path = TipPath(problem.goal.path, problem.arm.length / 400.0)
    samples = path.at(np.linspace(0.0, path.length, 20001))
    joints = problem.arm.joint_positions_at(q)
    behind = np.linspace(joints[0, 0], joints[0, -1], 20001)
    share = np.linspace(0.0, 1.0, 5)[:, None]
    places = joints[:, :-1, None] + share * (joints[:, 1:, None] - joints[:, :-1, None])
    off = cKDTree(np.vstack((behind, samples))).query(places)[0]
    tips = joints[:, -1]
    nearest = cKDTree(samples).query(tips)[1]
    tangents = path.tangents(np.asarray(nearest) * path.length / 20000)
    aside = tips - samples[nearest]
    aside -= np.sum(aside * tangents, axis=1)[:, None] * tangents
    return off.reshape(len(q), -1), np.linalg.norm(aside, axis=1)


def main() -> None:
    """Follow all paths and print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--paths", type=int, default=40, help="of each kind")
    parser.add_argument("--solve", action="store_true", help="time and verify the plans too")
    options = parser.parse_args()
    for kind in KINDS:
        means, worst, tips, seconds, tubes = [], [], [], [], []
        for seed in range(options.paths):
            problem = path_problem(kind, seed)
            begin = time.process_time()
            path = ccm_opt.BuiltInPlanner().plan(problem)
            seconds.append(time.process_time() - begin)
            off, tip = distances(problem, np.asarray(path.spline(np.linspace(0.0, 1.0, 801))))
            share = 100.0 / problem.arm.length
            means.append(share * float(np.mean(off)))
            worst.append(share * float(np.max(off)))
            tips.append(share * float(np.max(tip)))
            if options.solve:
                checks = {check.name: check for check in ccm_opt.solve(problem, explain=False).checks}
                tubes.append(share * checks["following the tip"].worst)
        tube = f", proved tube at most {max(tubes):.2f} %" if tubes else ""
        print(
            f"{kind}: {options.paths} of {options.paths}, mean {np.mean(means):.2f} % (of a path {max(means):.2f} %), "
            f"worst {max(worst):.2f} %, tip {max(tips):.1e} %, CPU {np.median(seconds):.2f} s in the median, "
            f"{max(seconds):.2f} s at most{tube}",
            flush=True,
        )


if __name__ == "__main__":
    main()
