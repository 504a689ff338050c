"""How well simulated arms follow plans that use a share of the limits: ``python -m tests.benchmarks.bench_tracking``.

Every problem in ``problems/`` is planned once, timed with a share of its limits, and simulated with links that are
heavier than the controller believes. Ten of the twelve limit no torque; so every problem is timed a second time with
rates that are five times those of the file and torques 1.25 times what holds the arm still along the path, so that
torque decides nearly everywhere. Figures of merit are those of the simulation; nothing here depends on the clock.
"""
# ruff: noqa: T201 - a script of its own that prints its tables

import argparse
import csv
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from ccm_opt import load_problem
from ccm_opt.core.progress import Stages
from ccm_opt.driver.closed_loop import WALLS, simulate_and_check
from ccm_opt.driver.legs import Leg, plan_legs
from ccm_opt.driver.planning_run import default_planner
from ccm_opt.driver.verified_plan import VerifiedPlan, timed_and_verified
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.problem import Disturbances, Problem
from ccm_opt.robot.frames import revolute_angles

FOLDER = Path(__file__).parents[2] / "problems"
FASTER = 5.0
"""Factor on velocity and acceleration where torque is to decide."""
STRONGER = 1.25
"""Torque limits there, over the greatest torque that holds the arm still along the path."""
LEAST_TORQUE = 1e-3
"""Least of these limits [N m]; revolutes that turn out of the plane bear nothing."""


@dataclass(frozen=True)
class Row:
    """What the simulation makes of one plan.

    Attributes:
        problem: its name.
        limits: "file", or "torque" where torque decides.
        share: of the limits that the plan uses.
        mass_error: share by which the links are heavier than the controller believes.
        duration: of the plan [s].
        effort: greatest share of a torque limit that the plan takes; NaN where there is none.
        outcome: of the simulation.
        saturated: share of the time in which some drive is at its limit.
        error: greatest error of a joint [rad].
        gap_planned: least clearance of the plan [m].
        gap: least clearance of the simulated arm [m].
        step: of the run that counts [s].
    """

    problem: str
    limits: str
    share: float
    mass_error: float
    duration: float
    effort: float
    outcome: str
    saturated: float
    error: float
    gap_planned: float
    gap: float
    step: float


def planned_legs(problem: Problem) -> tuple[Leg, ...]:
    """The paths to all goals; limits and shares come later."""
    return plan_legs(problem, default_planner(problem, Stages()))


def torque_decides(problem: Problem, legs: Iterable[Leg]) -> Problem:
    """The problem with faster rates, and torques that hold the arm still along its path with a quarter to spare."""
    arm = problem.arm
    bends = np.concatenate([leg.path.spline(np.linspace(0.0, 1.0, 400))[:, arm.coordinates.bends] for leg in legs])
    angles = revolute_angles(arm, bends)
    rest = np.zeros_like(angles)
    at_rest = [rest, rest, *(np.zeros(len(rest)) for _ in arm.base_axes)]
    holding = np.max(np.abs(InverseDynamics(arm, problem.simulation.gravity)(angles, *at_rest)), axis=0)
    limits = replace(
        problem.limits,
        velocity=FASTER * problem.limits.velocity,
        acceleration=FASTER * problem.limits.acceleration,
        torque=np.maximum(STRONGER * holding, LEAST_TORQUE),
        feed_force=None,
    )
    return replace(problem, limits=limits)


def timed(problem: Problem, legs: Iterable[Leg], share: float) -> tuple[Problem, VerifiedPlan]:
    """The verified motion along paths with a share of the limits."""
    options = replace(problem.planner, effort_share=share)
    whole = replace(problem, planner=options)
    its_legs = tuple(replace(leg, problem=replace(leg.problem, limits=problem.limits, planner=options)) for leg in legs)
    return whole, timed_and_verified(whole, its_legs, Stages())


def followed(problem: Problem, plan: VerifiedPlan, kind: str, mass_error: float) -> Row:
    """Simulate a plan with heavier links."""
    simulation = replace(problem.simulation, disturbances=Disturbances(mass_error=mass_error))
    motion, figures = simulate_and_check(replace(problem, simulation=simulation), plan.trajectory, plan.joints)
    torque = problem.limits.torque
    return Row(
        problem=problem.name,
        limits=kind,
        share=problem.planner.effort_share,
        mass_error=mass_error,
        duration=plan.trajectory.duration,
        effort=np.nan if torque is None else float(np.max(np.abs(plan.joints.torques) / torque)),
        outcome=motion.verdict.outcome,
        saturated=motion.saturated_time / plan.trajectory.duration,
        error=motion.tracking_error,
        gap_planned=next(check.worst for check in plan.checks if check.name == "wall clearance"),
        gap=figures.get(WALLS, np.nan),
        step=motion.verdict.step,
    )


def show(row: Row) -> None:
    """Print a row."""
    print(
        f"{row.problem:18s} {row.limits:7s} {row.share:5.2f} {row.mass_error:6.2f} {row.duration:8.3f} "
        f"{row.effort:7.3f} {row.saturated:8.2%} {1e3 * row.error:9.3f} {1e3 * row.gap_planned:8.2f} "
        f"{1e3 * row.gap:8.2f} {1e3 * row.step:7.4g}  {row.outcome}",
        flush=True,
    )


def main() -> None:
    """Print the table, and write it as CSV where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, action="append", help="share of the limits; may be repeated")
    parser.add_argument("--mass-error", type=float, default=0.05)
    parser.add_argument("--problem", action="append", help="name in problems/; all when left out")
    parser.add_argument("--csv", type=Path)
    given = parser.parse_args()

    print("problem            limits  share  error  dur [s]  effort     sat.  err.[mrad] gap [mm]  simul.   step[ms]")
    rows: list[Row] = []
    for file in sorted(FOLDER.glob("*.toml")):
        if given.problem and file.stem not in given.problem:
            continue
        problem = load_problem(file)
        legs = planned_legs(problem)
        for kind, limited in (("file", problem), ("torque", torque_decides(problem, legs))):
            for share in given.share or (1.0, 0.9):
                whole, plan = timed(limited, legs, share)
                rows.append(followed(whole, plan, kind, given.mass_error))
                show(rows[-1])

    if given.csv is not None:
        with given.csv.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, list(asdict(rows[0])))
            writer.writeheader()
            writer.writerows(asdict(row) for row in rows)
    if any(row.share <= 0.9 and row.saturated > 0.0 for row in rows):
        sys.exit("some plan with a share of 0.9 or less saturates")


if __name__ == "__main__":
    main()
