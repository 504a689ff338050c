"""Inspection of a room by an arm of five links, against a plain roadmap: ``python -m tests.benchmarks.bench_coverage``.

The task is that of Fu, Kuntz, Salzman and Alterovitz, "Toward asymptotically-optimal inspection planning via efficient
near-optimal graph search", Robotics: Science and Systems 2019: a room of 2 by 2, 400 points on its walls, rectangles of
up to 0.3 at random, links of 0.2, 0.1, 0.2, 0.3 and 0.1, and a field of view of 90°. Scenes are drawn here. The
baseline is not theirs: a roadmap of random poses that keep clear, joined to their nearest ones, and from it a tour that
goes to the pose next in reach that shows something new for its length. Plans are asked to see as much as that, or a
fraction of it. Lengths are sums of the changes of all joints.
"""
# ruff: noqa: T201 - a script of its own that prints its findings

import argparse
import json
import time
from collections.abc import Iterator

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

import ccm_opt
from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import Problem
from ccm_opt.verification.coverage import seen_pieces
from ccm_opt.verification.tool_chain import motion_of

LINKS = (0.2, 0.1, 0.2, 0.3, 0.1)
BASE = np.array([1.0, 0.0])
STEP = 0.05
"""Greatest change of a joint between poses that are compared with walls along an edge of the roadmap [rad]."""


def boxes(seed: int, count: int = 10) -> Iterator[FloatArray]:
    """Yield random boxes (4,) that leave the base and the straight arm free."""
    rng = np.random.default_rng(seed)
    while count:
        size = rng.uniform(0.02, 0.3, 2)
        middle = rng.uniform(0.5 * size, 2.0 - 0.5 * size)
        box = np.append(middle - 0.5 * size, middle + 0.5 * size)
        if shapely.box(*box).distance(shapely.LineString((BASE, BASE + np.array([0.0, 0.9])))) > 0.03:
            count -= 1
            yield box


def room(seed: int, share: float, time_limit: float) -> Problem:
    """Return the problem of seeing a share of the walls of a room."""
    text = ['schema = 1\nname = "room"\n[workspace]\nbounds = [0.0, 0.0, 2.0, 2.0]']
    text += [
        f'[[workspace.obstacles]]\nname = "box {k}"\nbox = {box.round(4).tolist()}'
        for k, box in enumerate(boxes(seed), start=1)
    ]
    text.append("[arm]\nbase = [1.0, 0.0]\nbase_heading_deg = 90.0\nbase_limit_deg = 90.0\nmount_length = 0.01")
    section = "[[arm.sections]]\nlinks = 1\nlink_length = {}\nradius = 0.0\njoint_limit_deg = 170.0\nmass = 0.1"
    text += [section.format(length) for length in LINKS]
    text.append('[limits]\nvelocity = 1.0\nacceleration = 5.0\n[start]\nshape = "straight"')
    text.append(f'[goal]\nsee = ["room"]\nshare = {share}\nspacing = 0.02\ndistance = [0.001, 3.0]\nangle_deg = 89.5')
    text.append(f'field_of_view_deg = 90.0\n[planner]\norder = "free"\ntime_limit = {time_limit}')
    return parse_problem("\n".join(text))


def seen_from(problem: Problem, poses: FloatArray) -> BoolArray:
    """Return which pieces are seen from each of n poses (n, 5), by the verifier's lines of sight, shape (n, m)."""
    assert problem.coverage is not None
    motion = motion_of(problem.arm, np.arange(len(poses), dtype=np.float64), poses)
    return np.array([seen_pieces(problem.workspace, problem.coverage, motion, [k]).seen for k in range(len(poses))])


def free(problem: Problem, poses: FloatArray) -> BoolArray:
    """Return which of n poses touch neither walls nor themselves, shape (n,)."""
    walls = shapely.union_all([obstacle.core for obstacle in problem.workspace.obstacles])
    shapely.prepare(walls)
    points = np.array([problem.arm.joint_positions_at(q) for q in poses])
    lines = shapely.linestrings(points)
    beyond = shapely.linestrings(points[:, 1:])
    inside = shapely.contains(problem.workspace.boundary, beyond)
    return np.asarray(~shapely.intersects(walls, lines) & inside & shapely.is_simple(lines))


def roadmap_tour(problem: Problem, count: int, rng: np.random.Generator) -> list[tuple[int, float]]:
    """Return how many pieces a roadmap tour has seen, and its length [rad], after each of its stops."""
    limits = np.deg2rad([90.0, 170.0, 170.0, 170.0, 170.0])
    start = problem.start.configuration(problem.arm)
    drawn = rng.uniform(-limits, limits, (40 * count, len(limits)))
    poses = np.vstack((start, drawn[free(problem, drawn)][: count - 1]))
    near = cKDTree(poses).query(poses, k=min(12, len(poses)))[1]
    edges = [(a, b) for a in range(len(poses)) for b in near[a] if a < b]
    kept = []
    for a, b in edges:
        steps = int(np.ceil(np.max(np.abs(poses[b] - poses[a])) / STEP)) + 1
        if np.all(free(problem, np.linspace(poses[a], poses[b], steps))):
            kept.append((a, b, float(np.sum(np.abs(poses[b] - poses[a])))))
    rows, columns, lengths = map(np.array, zip(*kept, strict=True))
    graph = csr_array((lengths, (rows, columns)), shape=(len(poses), len(poses)))
    sees = seen_from(problem, poses)
    at, seen, length, stops = 0, sees[0].copy(), 0.0, []
    while True:
        away = dijkstra(graph, directed=False, indices=at)
        gains = np.sum(sees & ~seen, axis=1) / np.maximum(away, 1e-9)
        best = int(np.argmax(np.where(np.isfinite(away), gains, 0.0)))
        if not np.any(sees[best] & ~seen) or not np.isfinite(away[best]):
            return stops
        at, length = best, length + float(away[best])
        seen |= sees[best]
        stops.append((int(np.sum(seen)), length))


def main() -> None:
    """Compare tours in as many rooms as asked, a line of JSON each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5, help="number of rooms")
    parser.add_argument("--poses", type=int, default=400, help="number of poses of the roadmap")
    parser.add_argument(
        "--shares", type=float, nargs="+", default=[1.0, 0.95, 0.9], help="fractions of what the roadmap sees"
    )
    parser.add_argument("--time", type=float, default=60.0, help="time limit of a plan [s]")
    given = parser.parse_args()
    for seed in range(given.count):
        problem = room(seed, 1.0, given.time)
        begun = time.process_time()
        stops = roadmap_tour(problem, given.poses, np.random.default_rng(seed))
        found: dict[str, object] = {"seed": seed, "roadmap_cpu": round(time.process_time() - begun, 1)}
        found |= {"roadmap_seen": stops[-1][0] / 400.0, "roadmap_length": round(stops[-1][1], 2)}
        begun = time.process_time()
        for share in given.shares:
            try:
                plan = ccm_opt.solve(room(seed, share * stops[-1][0] / 400.0, given.time), explain=False)
            except NoPlanFound as failure:
                found[f"{share:g}"] = failure.diagnosis.reason[:90]
                continue
            seen = next(check.worst for check in plan.checks if check.name == "surface seen")
            assert plan.tour is not None
            length = float(np.sum(np.abs(np.diff(plan.trajectory.positions, axis=0))))
            as_much = next((stop[1] for stop in stops if stop[0] >= 4.0 * seen), stops[-1][1])
            found |= {"seen": round(seen / 100.0, 4), "length": round(length, 2), "views": len(plan.tour.order)}
            found["roadmap_length_for_as_much"] = round(as_much, 2)
            break
        found["cpu"] = round(time.process_time() - begun, 1)
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
