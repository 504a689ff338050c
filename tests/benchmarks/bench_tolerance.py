"""Certified errors of the joints, held against random motions within them; run this file as a module.

For every problem: the certified error δ and what finding it costs, how many of 1000 random motions within δ touch
something at poses spread over the motion and close together where δ is limited, looked at by shapely alone, and whether
the motion that is off by 1.5 δ along the worst direction does. Problems: those of the package, and random scenes in
which a plan is found.

    python -m tests.benchmarks.bench_tolerance [random scenes a family, 3] [motions, 1000] [files, those of problems/]
"""

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely

import ccm_opt
from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.errors import CcmError
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution, ToleratedError
from ccm_opt.verification.tolerance.error_model import joint_errors
from ccm_opt.verification.tolerance.tolerated_errors import tolerated_error
from tests.benchmarks.scene_families import FAMILIES, problems
from tests.scenes import free_axis, self_gap

ROUNDING = 1e-9
SPREAD = 80
"""Poses of every random motion over its whole length."""
NEAR = 40
"""Further poses about the time that limits the error."""
WINDOW = 0.02
"""Share of the duration to either side of that time."""
OWN = 20
"""Of so many poses one is held against the arm itself, where that matters."""
SMALL = 0.2
"""Errors that turn the tip by less than this, all together, count as small [rad]."""


@dataclass(frozen=True)
class Oracle:
    """Whether poses touch anything, by shapely alone.

    Attributes:
        problem: arm and room.
    """

    problem: Problem

    @cached_property
    def _cores(self) -> list[tuple[float, shapely.Geometry]]:
        """The walls' cores, prepared, one geometry for each rounding."""
        walls = self.problem.workspace.walls
        found = []
        for rounding in {wall.rounding for wall in walls}:
            cores = shapely.union_all([wall.core for wall in walls if wall.rounding == rounding])
            shapely.prepare(cores)
            found.append((rounding, cores))
        return found

    def touching(self, q: FloatArray) -> BoolArray:
        """Which coordinates, shape (N, c), bring the arm nearer to a wall than the clearance."""
        arm = self.problem.arm
        axes = shapely.linestrings([free_axis(arm, pose) for pose in arm.joint_positions_at(q)])
        touching = np.zeros(len(q), dtype=bool)
        for rounding, cores in self._cores:
            need = arm.radius + self.problem.workspace.clearance + rounding - ROUNDING
            # An axis without width touches a wall only where it meets it.
            near = shapely.dwithin(cores, axes, need) if need > 0.0 else shapely.intersects(cores, axes)
            touching |= near
        return touching

    def touches_itself(self, q: FloatArray) -> bool:
        """Whether distant links of any of some poses are nearer to each other than two radii."""
        arm = self.problem.arm
        return arm.self_collision and self_gap(arm, arm.joint_positions_at(q)) < -ROUNDING


def random_motions_that_touch(solution: Solution, found: ToleratedError, motions: int) -> int:
    """Of some random motions within the certified error of their joints, how many touch something."""
    rng = np.random.default_rng(0)
    oracle = Oracle(solution.problem)
    drawn = (poses_of_random_motion(rng, solution, found, k) for k in range(motions))
    return sum(bool(oracle.touching(q).any()) or oracle.touches_itself(q[::OWN]) for q in drawn)


def poses_of_random_motion(
    rng: np.random.Generator, solution: Solution, found: ToleratedError, kind: int
) -> FloatArray:
    """Poses of one random motion: its errors constant, uniform or extreme, or waves, or changing at random."""
    trajectory = solution.trajectory
    duration = trajectory.duration
    times = rng.uniform(0.0, duration, SPREAD)
    if found.time is not None:
        low = max(0.0, found.time - WINDOW * duration)
        times = np.append(times, rng.uniform(low, min(duration, found.time + WINDOW * duration), NEAR))
    q = np.stack([np.interp(times, trajectory.time, column) for column in trajectory.positions.T], axis=1)
    links = solution.problem.arm.links
    shape = (len(times), links)
    waves = np.sin(np.outer(times, rng.uniform(1.0, 30.0, links)) + rng.uniform(0.0, 6.3, links))
    shares = (
        np.tile(rng.uniform(-1.0, 1.0, links), (len(times), 1)),
        np.tile(rng.choice((-1.0, 1.0), links), (len(times), 1)),
        waves,
        rng.choice((-1.0, 1.0), shape),
    )[kind % 4]
    return with_errors(solution, q, found.size * shares)


def with_errors(solution: Solution, q: FloatArray, errors: FloatArray) -> FloatArray:
    """Coordinates with errors of their bends, but of those that a guide tube holds straight."""
    arm = solution.problem.arm
    held = arm.held(arm.coordinates.advance(q)) if arm.base_axes else np.zeros(arm.links, dtype=bool)
    moved = q.copy()
    moved[:, : arm.links] += np.where(held, 0.0, errors)
    return moved


def worst_touches(solution: Solution, found: ToleratedError, factor: float) -> bool:
    """Whether the motion that is off along the worst direction touches something."""
    q = solution.trajectory.positions
    off = with_errors(solution, q, np.tile(factor * found.size * np.array(found.worst), (len(q), 1)))
    return bool(Oracle(solution.problem).touching(off).any()) or Oracle(solution.problem).touches_itself(off)


def cases(scenes: int, files: Sequence[Path]) -> Iterator[tuple[str, Problem]]:
    """Problems from files, and random scenes."""
    for file in files:
        problem = ccm_opt.load_problem(file)
        yield problem.name, problem
    for _, problem in problems(FAMILIES, range(scenes), (8, 24)):
        yield problem.name, replace(problem, planner=replace(problem.planner, time_limit=20.0))


def main() -> None:
    """Print a line a problem, and sums."""
    scenes = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    motions = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    files = [Path(name) for name in sys.argv[3:]] or sorted(Path("problems").glob("*.toml"))
    touched = 0
    small: list[bool] = []
    large: list[bool] = []
    print(f"{'problem':22} {'δ [deg]':>9} {'CPU [s]':>8} {'touch':>6} {'1.1 δ':>6} {'1.5 δ':>6}  limited by")  # noqa: T201
    for name, problem in cases(scenes, files):
        try:
            solution = ccm_opt.solve(problem, explain=False)
        except CcmError:
            continue
        begin = time.process_time()
        found = tolerated_error(problem, solution.trajectory, joint_errors(problem.arm))
        spent = time.process_time() - begin
        count = random_motions_that_touch(solution, found, motions)
        touched += count
        marks = ["-", "-"]
        if found.limited and found.size > 0.0:
            touches = [worst_touches(solution, found, factor) for factor in (1.1, 1.5)]
            marks = ["yes" if touch else "no" for touch in touches]
            (small if found.size * problem.arm.links < SMALL else large).append(touches[1])
        figures = f"{np.rad2deg(found.size):9.4f} {spent:8.2f} {count:6d} {marks[0]:>6} {marks[1]:>6}"
        print(f"{name:22} {figures}  {found.where}", flush=True)  # noqa: T201
    print(f"random motions that touch: {touched}")  # noqa: T201
    print(f"at 1.5 δ along the worst direction: {sum(small)} of {len(small)} touch where errors are small")  # noqa: T201
    print(f"and {sum(large)} of {len(large)} where they turn the tip by more than {SMALL} rad")  # noqa: T201


if __name__ == "__main__":
    main()
