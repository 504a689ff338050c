"""What a tick of servo control costs, how much of the hand's velocity is lost, and whether anything is touched.

    python -m tests.benchmarks.bench_servo --ticks 2000 --triangles 1000000 --out servo.jsonl

Random hands of smooth velocity drive the tip from the ends of the plans of the shipped jobs, whose meshes are cut until
there are so many triangles, and of the same arms without obstacles ("free"). The arm is braked at random moments. Every
motion is checked by the verifier and by coal, at poses so dense that no joint moves by a millimetre between two; rates
are differences of its positions. One line of JSON for each drive. Set OMP_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import ccm_opt
from ccm_opt.cli.compare.space_clutter import JOBS
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.scene.workspace import Workspace
from tests.benchmarks.bench_triangles import problem_of, refined
from tests.benchmarks.space_sweep import sweep_in_space

SPEED = 0.05
"""Root mean square of every component of the hand's velocity [m/s]."""
SMOOTH = (0.97, 0.97)
"""Of its velocity and acceleration, what is left after a tick of 10 ms."""
BRAKES = 0.01
"""Probability of braking in a tick, unless told."""


def main() -> None:
    """Parse the options, drive, and print a line of JSON for each drive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=1000)
    parser.add_argument("--triangles", type=int, default=0)
    parser.add_argument("--jobs", nargs="+", choices=list(JOBS), default=list(JOBS))
    parser.add_argument("--hands", nargs="+", type=int, default=[0])
    parser.add_argument("--brakes", type=float, default=BRAKES)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    for job in options.jobs:
        problem = problem_of(job, 0)
        end = ccm_opt.solve(problem).trajectory.positions[-1]
        problem = replace(problem, start=JointPose.from_configuration(end, problem.arm.coordinates))
        meshed = refined(problem, options.triangles)
        empty = replace(problem, workspace=Workspace(bounds=None, obstacles=(), clearance=0.0))
        for hand in options.hands:
            for name, scene in ((job, meshed), (f"{job}, free", empty)):
                line = json.dumps({"job": name, "hand": hand} | driven(scene, hand, options.ticks, options.brakes))
                print(line, flush=True)
                if options.out is not None:
                    with options.out.open("a", encoding="utf-8") as file:
                        file.write(line + "\n")


def driven(problem: Problem, hand: int, ticks: int, brakes: float) -> dict[str, object]:
    """Return the figures of one drive, swept."""
    servo, figures = random_drive(problem, hand, ticks, brakes)
    begin = time.process_time()
    solution = servo.solution()
    seen = sweep_in_space(solution.problem, solution.trajectory)
    return figures | {
        "triangles": len(problem.workspace.triangle_soup),
        "verified": all(check.passed for check in solution.checks),
        "poses": seen.poses,
        "wall_gap_mm": round(1e3 * seen.wall_gap, 4),
        "violations": seen.violations,
        "rates_used": rates_used(problem, solution.trajectory),
        "checking_s": round(time.process_time() - begin, 2),
    }


def rates_used(problem: Problem, trajectory: JointTrajectory) -> list[float]:
    """Return the greatest mean velocity and acceleration between samples, as fractions of their limits."""
    limits = problem.limits.of_coordinates(problem.arm.coordinates)
    steps = np.diff(trajectory.time)[:, None]
    velocities = np.diff(trajectory.positions, axis=0) / steps
    accelerations = 2.0 * np.diff(velocities, axis=0) / (steps[1:] + steps[:-1])
    pairs = ((velocities, limits.velocity), (accelerations, limits.acceleration))
    return [round(float(np.max(np.abs(rates) / limit)), 4) for rates, limit in pairs]


def random_drive(
    problem: Problem, hand: int, ticks: int, brakes: float = BRAKES
) -> tuple[ccm_opt.Servo, dict[str, object]]:
    """Return a servo that a random hand has driven for some ticks, and what that cost."""
    random = np.random.default_rng(hand)
    servo = ccm_opt.Servo(problem)
    velocity, pull = np.zeros((2, problem.dimension))
    cpu, wall, lost, free = [], [], [], []
    braked = 0
    while servo.ticks < ticks:
        pull = SMOOTH[1] * pull + np.sqrt(1.0 - SMOOTH[1] ** 2) * random.normal(size=problem.dimension)
        velocity = SMOOTH[0] * velocity + (1.0 - SMOOTH[0]) * pull
        command = ccm_opt.Twist(SPEED * velocity / np.sqrt(0.5))  # the second filter halves the variance
        begun = time.process_time(), time.perf_counter()
        step = servo.step(command)
        cpu.append(time.process_time() - begun[0])
        wall.append(time.perf_counter() - begun[1])
        lost.append(step.lost)
        free.append(not any("limit" in reason or "range" in reason or "stretched" in reason for reason in step.reasons))
        if random.uniform() < brakes:
            servo.brake()
            braked += 1
    quantiles = (50.0, 99.0, 99.9, 100.0)
    return servo, {
        "links": problem.arm.links,
        "ticks": len(cpu),
        "ticks_braking": servo.ticks - len(cpu),
        "cpu_ms": (1e3 * np.percentile(cpu, quantiles)).round(2).tolist(),
        "wall_ms": (1e3 * np.percentile(wall, quantiles)).round(2).tolist(),
        "lost_mean": round(float(np.mean(lost)), 4),
        "lost_away_from_limits": round(float(np.mean(np.array(lost)[free])), 4) if any(free) else None,
        "braked": braked,
    }


if __name__ == "__main__":
    main()
