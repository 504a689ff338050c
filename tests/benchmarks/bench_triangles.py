"""What it costs to mesh the same surfaces ever more finely: planning, verifying and all of it.

    python -m tests.benchmarks.bench_triangles --triangles 0 100000 1000000 --seeds 0 1 2

The meshes of the shipped problems are cut across their longest edges until there are so many triangles, which changes
nothing of the surfaces; 0 leaves them as they are. Seed 0 is the shipped problem itself, others have their start and
goal moved. User CPU. Set OMP_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import resource
from dataclasses import replace

import numpy as np

import ccm_opt
from ccm_opt.cli.compare.space_clutter import JOBS, disturbed_job
from ccm_opt.cli.compare.suites import shared_folder
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.progress import Stages
from ccm_opt.driver.legs import plan_legs
from ccm_opt.driver.verified_plan import failed_checks, timed_and_verified
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.problem import Problem
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.verification.verifier import verify
from tests.benchmarks.bench_planning import head, row

NEARLY_LONGEST = 0.75
"""Triangles with an edge of this share of the longest are cut together, so that all become about as large."""


def main() -> None:
    """Parse the options, measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--triangles", nargs="+", type=int, default=[0, 100_000, 1_000_000])
    parser.add_argument("--jobs", nargs="+", choices=list(JOBS), default=list(JOBS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    options = parser.parse_args()
    head("job", "seed", "triangles", "tree", "motion", "NLP", "optimisation", "path", "planned", "verified", "gap [mm]")
    for job in options.jobs:
        for seed in options.seeds:
            for count in options.triangles:
                measure(job, seed, refined(problem_of(job, seed), count))


def measure(job: str, seed: int, problem: Problem) -> None:
    """Plan and verify a problem, and print what that took [s]."""
    triangles = len(problem.workspace.triangle_soup)
    stages = Stages()
    begun = user_time()
    try:
        (leg,) = plan_legs(problem, MotionPlanner(stages))
    except NoPlanFound as none:
        print(f"{job} {seed}, {triangles}: {none}")
        return
    planned = user_time() - begun
    motion = timed_and_verified(problem, (leg,), Stages())
    trajectory, joints = motion.trajectory, motion.joints
    begun = user_time()
    checks = verify(problem, trajectory, joints)
    verified = user_time() - begun
    gap = next(check.worst for check in checks if check.name == "wall clearance")
    names = ("free space", "motion", "configuration", "optimisation", "smooth path")
    figures = (f"{stages.timings[name]:.2f}" for name in names)
    said = "refused" if failed_checks(checks) else f"{verified:.2f}"
    row(job, seed, triangles, *figures, f"{planned:.2f}", said, f"{1e3 * gap:.2f}")


def problem_of(job: str, seed: int) -> Problem:
    """A shipped problem, or one with its ends moved."""
    folder = shared_folder() / "space"
    if seed:
        return disturbed_job(seed, job, 24, folder, f"{job} {seed}")
    problem = ccm_opt.load_problem(folder / f"{job}.toml")
    assert problem.dimension == 3
    return problem


def refined(problem: Problem, count: int) -> Problem:
    """The problem with its meshes cut into about so many triangles."""
    meshes = [each.body for each in problem.workspace.obstacles if isinstance(each.body, MeshBody)]
    cut = iter(np.split(*finer([mesh.triangles for mesh in meshes], count)))
    obstacles = tuple(
        replace(each, shape=remeshed(each.body, next(cut))) if isinstance(each.body, MeshBody) else each
        for each in problem.workspace.obstacles
    )
    return replace(problem, workspace=replace(problem.workspace, obstacles=obstacles), source="")


def finer(parts: list[FloatArray], count: int) -> tuple[FloatArray, FloatArray]:
    """All triangles of some meshes, cut into so many at least, in the order of the meshes, and where each begins."""
    triangles = np.concatenate(parts)
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    while len(triangles) < count:
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        longest = np.argmax(edges, axis=1)
        lengths = edges.max(axis=1)
        order = np.argsort(-lengths)[: count - len(triangles)]
        chosen = order[lengths[order] >= NEARLY_LONGEST * lengths.max()]
        turn = (longest[chosen, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(triangles[chosen], turn[:, :, None], axis=1).transpose(1, 0, 2)
        middle = 0.5 * (a + b)
        triangles[chosen] = np.stack((a, middle, c), axis=1)
        triangles = np.concatenate((triangles, np.stack((middle, b, c), axis=1)))
        owner = np.concatenate((owner, owner[chosen]))
    order = np.argsort(owner, kind="stable")
    return triangles[order], np.searchsorted(owner[order], np.arange(1, len(parts)))


def remeshed(body: MeshBody, triangles: FloatArray) -> MeshBody:
    """A mesh of other triangles."""
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return replace(body, vertices=triangles.reshape(-1, 3), faces=faces, triangles_read=len(triangles))


def user_time() -> float:
    """User CPU of this process [s]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


if __name__ == "__main__":
    main()
