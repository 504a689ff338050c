"""Durations before and after the optimisation of motions: ``python -m tests.benchmarks.bench_optimisation``.

All problems of the repository, and random clutter of 20 polygons. Every motion is found once, without optimisation;
its spline is timed as it is and again after the optimisation, whose user CPU time is measured alone.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np
from rich.console import Console
from rich.table import Table

from ccm_opt.core.errors import NoPlanFound
from ccm_opt.dynamics.retiming import retime
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.io.reading import load_problem
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.optimise import optimise
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.smooth_path import joint_path
from ccm_opt.planning.strategies import find_motion
from ccm_opt.problem import OptimiserName, Problem
from ccm_opt.robot.frames import revolute_angles
from tests.scenes import clutter, later

PROBLEMS = Path(__file__).parents[2] / "problems"
TIME_LIMIT = 20.0


def problems(seeds: int) -> Iterator[Problem]:
    """The problems of the repository, then clutter."""
    for path in sorted(PROBLEMS.glob("*.toml")):
        yield load_problem(path)
    for seed in range(seeds):
        yield replace(clutter(seed).problem(time_limit=TIME_LIMIT), name=f"clutter {seed}")


def found(problem: Problem) -> tuple[MotionTask, Motion]:
    """The task and the motion that is found, not optimised."""
    wanted = problem.planner.optimiser
    plain = replace(problem, planner=replace(problem.planner, optimiser="none"))
    task = MotionPlanner().motion_task(plain, resolve_ends(plain), later(problem.planner.time_limit))
    return replace(task, optimiser=wanted), find_motion(task)


def duration(problem: Problem, task: MotionTask, motion: Motion) -> float:
    """Duration of the motion's spline within the problem's limits [s]."""
    path = joint_path(task, motion)
    inverse_dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    revolutes = partial(revolute_angles, problem.arm)
    return retime(path, problem.limits, inverse_dynamics, revolutes=revolutes).duration


def measure(problem: Problem, optimiser: OptimiserName) -> tuple[float, float, float]:
    """Duration before and after [s], and CPU time of the optimisation [s]."""
    task, motion = found(problem)
    task = replace(task, deadline=later(), optimiser=optimiser)
    begun = time.process_time()
    optimised = optimise(motion, task)
    spent = time.process_time() - begun
    return duration(problem, task, motion), duration(problem, task, optimised), spent


def main() -> None:
    """Print one line for each problem, then medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=24, help="number of clutter problems")
    parser.add_argument("--optimiser", choices=get_args(OptimiserName), default="sequential-convex")
    options = parser.parse_args()
    console = Console()
    table = Table("problem", "before [s]", "after [s]", "cut", "CPU [s]")
    figures = []
    for problem in problems(options.seeds):
        try:
            before, after, spent = measure(problem, options.optimiser)
        except NoPlanFound as error:
            table.add_row(problem.name, str(error).splitlines()[0][:40])
            continue
        figures.append((1.0 - after / before, spent))
        table.add_row(problem.name, f"{before:.2f}", f"{after:.2f}", f"{figures[-1][0]:.0%}", f"{spent:.2f}")
    cut, spent = np.median(figures, axis=0)
    table.add_row("median", "", "", f"{cut:.0%}", f"{spent:.2f}")
    console.print(table)


if __name__ == "__main__":
    main()
