"""Scenes in space drawn around a motion that is known to be possible, its witness.

    python -m tests.witness_scenes OUT --family ribs --links 24 --seed 0 --start inside

The witness comes first (``witness_motions.py``); holes, pipes and bodies are then placed about all that it sweeps so
that it has 4 to 11 mm of room as a rule. A sweep with coal, which shares nothing with the package's proofs, measures
the least gap that it really has. Scenes of odd seeds are turned at random. Where the base is fixed, a start has no tube
to be in.
"""

import argparse
import json
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ccm_opt.cli.compare.comparison_files import write_problems
from ccm_opt.cli.compare.suites import Case
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import JointPose, Problem, Stop, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.bodies import RigidPlacement
from ccm_opt.scene.workspace import Obstacle, Workspace

from .benchmarks.space_sweep import sweep_rows
from .space_shapes import UselessDraw
from .witness_clutter import cables, engine, keyhole, rack, shapes, truss, weave
from .witness_drawing import Drawing
from .witness_passages import baffles, guided, helix, pipes, pocket, reversed_task, ribs, tours

LEAST_GAP = 0.003
"""Minimum clearance of a witness [m]."""
MOST_DRAWS = 60
"""Maximum number of invalid scenes before a seed is given up."""
VELOCITY, ACCELERATION = 1.0, 4.0
"""Limits of every revolute joint [rad/s, rad/s²]."""
FEED_VELOCITY, FEED_ACCELERATION = 0.15, 0.6
"""Limits of the feed axis [m/s, m/s²]."""


@dataclass(frozen=True, eq=False)
class Witness:
    """Random problem in space with a known motion that solves the problem.

    Attributes:
        problem: the problem.
        rows: vertices of the motion, which is piecewise linear in joint space, shape (T, c) [rad, m].
        stops: indices of the vertices at goals, in order.
        gap: minimum distance of the motion from bodies, computed by the library coal [m].
        bound: lower bound of the duration within the limits [s].
    """

    problem: Problem
    rows: FloatArray
    stops: tuple[int, ...]
    gap: float
    bound: float


FAMILIES: Mapping[str, Callable[[Drawing], None]] = {
    "ribs": ribs,
    "pipes": pipes,
    "cables": cables,
    "engine": engine,
    "weave": weave,
    "shapes": shapes,
    "rack": rack,
    "keyhole": keyhole,
    "truss": truss,
    "guided": guided,
    "pocket": pocket,
    "baffles": baffles,
    "helix": helix,
    "tours": tours,
    "reversed": reversed_task,
}
"""Functions that build a random scene, by name of the family; their docstrings describe the problems."""


def witness_scene(family: str, seed: int, links: int, start: str = "") -> Witness:
    """Return a random problem of a family with a motion that solves the problem.

    Args:
        family: name of the family.
        seed: seed of the random numbers.
        links: number of links of the arm.
        start: "inside" for a start in the guide tube, "out" for one fed out of it; random if empty.

    Raises:
        ProblemError: no valid scene was found.
    """
    rng = np.random.default_rng([seed, links, zlib.crc32(family.encode())])
    begin = start or ("inside" if rng.uniform() < 0.6 else "out")
    for _ in range(MOST_DRAWS):
        scene = Drawing(rng, links, begin)
        try:
            FAMILIES[family](scene)
            return _witness(scene, f"{family}-{links}-{seed}", FAMILIES[family].__doc__ or "", turned=bool(seed % 2))
        except UselessDraw:
            continue
    raise ProblemError(
        f"{MOST_DRAWS} draws of the family {family} with {links} links and the seed {seed} are of no use"
    )


def _witness(scene: Drawing, name: str, description: str, *, turned: bool) -> Witness:
    """Return the problem and the motion of a finished scene, at a random position and orientation if ``turned``."""
    rng, arm = scene.rng, scene.arm
    ends = np.cumsum([len(leg) for leg in scene.legs])
    rows = np.concatenate(scene.legs)
    stops = tuple(int(ends[leg - 1]) - 1 for leg in scene.stops)
    bodies = scene.bodies
    # What is found in use: joints that are bent to some three quarters of what they can do.
    bent = float(np.max(np.abs(rows[:, 2 : 2 * scene.links])))
    arm = replace(arm, joint_limit=min(max(bent / float(rng.uniform(0.7, 0.9)), np.deg2rad(8.0)), 0.5 * np.pi))
    if turned:
        by = RigidPlacement.of_quaternion(rng.uniform(-1.0, 1.0, 3), rng.normal(size=4))
        bodies = {name: body.placed(by) for name, body in bodies.items()}
        direction, up = by.rotation @ arm.direction, by.rotation @ arm.up
        arm = replace(arm, base=by.points(arm.base[None])[0], direction=direction, up=up)
    goals = [_goal(arm, rows[stop], directed=rng.uniform() < 0.85) for stop in stops]
    rates = np.ones(3 * scene.links)
    limits = Limits(VELOCITY * rates, ACCELERATION * rates)
    if scene.fed:
        limits = replace(limits, feed_velocity=FEED_VELOCITY, feed_acceleration=FEED_ACCELERATION)
    problem = Problem(
        name,
        Workspace(bounds=None, obstacles=tuple(Obstacle(*item) for item in bodies.items())),
        arm,
        limits,
        JointPose.from_configuration(rows[0], arm.coordinates),
        goals[-1],
        description,
        stops=tuple(Stop(goal, Tolerances()) for goal in goals[:-1]),
    )
    seen = sweep_rows(problem, rows)
    if seen.violations or min(seen.wall_gap, 0.5 * seen.self_gap) < LEAST_GAP:
        raise UselessDraw
    return Witness(problem, rows, stops, seen.wall_gap, _bound(rows, ends, fed=scene.fed))


def _goal(arm: Arm, q: FloatArray, *, directed: bool) -> TipGoal:
    return TipGoal(arm.joint_positions_at(q)[-1], arm.link_rotations(q)[-1, :, 0] if directed else None)


def _bound(rows: FloatArray, ends: FloatArray, *, fed: bool) -> float:
    """Return a lower bound of the duration of motions from rest to rest, by the slowest coordinate of each [s].

    Args:
        rows: vertices of all motions, shape (T, c) [rad, m].
        ends: index after the last vertex of each motion.
        fed: whether the last coordinate is a feed.
    """
    begins = np.concatenate(([0], ends[:-1]))
    travel = np.abs(rows[ends - 1] - rows[begins])
    fastest = np.full(travel.shape[1], VELOCITY)
    quickest = np.full(travel.shape[1], ACCELERATION)
    if fed:
        fastest[-1], quickest[-1] = FEED_VELOCITY, FEED_ACCELERATION
    cruising = travel > fastest**2 / quickest
    times = np.where(cruising, travel / fastest + fastest / quickest, 2.0 * np.sqrt(travel / quickest))
    return float(np.sum(np.max(times, axis=1)))


def write_scene(witness: Witness, folder: Path) -> Path:
    """Write a problem file with its meshes and a JSON file with the known motion; return the problem file's path."""
    problem = witness.problem
    (file,) = write_problems([Case(problem.name, "files", given=problem)], folder)
    known = {"gap_mm": 1e3 * witness.gap, "bound_s": witness.bound, "stops": witness.stops}
    record = known | {"wanted_mm": 1e3 * problem.wanted_gap, "rows": witness.rows.tolist()}
    file.with_suffix(".json").write_text(json.dumps(record), encoding="utf-8")
    return file


def main() -> None:
    """Write random problems of families given on the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.witness_scenes", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--family", choices=FAMILIES, nargs="+", default=list(FAMILIES))
    parser.add_argument("--links", type=int, nargs="+", default=[24])
    parser.add_argument("--seed", type=int, nargs="+", default=[0])
    parser.add_argument("--start", choices=["inside", "out"], default="")
    asked = parser.parse_args()
    for family in asked.family:
        for links in asked.links:
            for seed in asked.seed:
                try:
                    write_scene(witness_scene(family, seed, links, asked.start), asked.out)
                except ProblemError as error:
                    parser.exit(1, f"{error}\n")


if __name__ == "__main__":
    main()
