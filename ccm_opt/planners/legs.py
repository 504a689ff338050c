"""Goals in sequence: a problem with stops is planned leg by leg, each from where the one before came to rest."""

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import NoPlanFound
from ccm_opt.planners.protocols import Planner
from ccm_opt.problem import Goal, JointPose, Problem, Start, Tolerances
from ccm_opt.solution import JointPath

LEAST_TIME = 0.5
"""Time that the planner is given for a leg, even when the legs before have used it up [s]."""


@dataclass(frozen=True)
class Leg:
    """The way to one goal.

    Attributes:
        problem: with this goal alone.
        path: the motion to it.
    """

    problem: Problem
    path: JointPath


def plan_legs(problem: Problem, planner: Planner) -> tuple[Leg, ...]:
    """Plan the way to every goal in turn; without stops that is one leg.

    Args:
        problem: with any number of stops; its time limit is for all legs together.
        planner: plans a leg.

    Raises:
        NoPlanFound: naming the goal that is not reached.
    """
    goals: list[tuple[Goal, Tolerances]] = [(stop.goal, stop.tolerances) for stop in problem.stops]
    goals.append((problem.goal, problem.tolerances))
    start, began, legs = problem.start, time.monotonic(), list[Leg]()
    for number, (goal, tolerances) in enumerate(goals, start=1):
        left = max(problem.planner.time_limit - (time.monotonic() - began), LEAST_TIME)
        options = problem.planner if number == 1 else replace(problem.planner, time_limit=left)
        leg = replace(problem, start=start, goal=goal, tolerances=tolerances, stops=(), planner=options)
        legs.append(Leg(leg, _planned(leg, planner, number, len(goals))))
        start = _pose(legs[-1].path.spline(1.0), problem)
    return tuple(legs)


def _planned(leg: Problem, planner: Planner, number: int, count: int) -> JointPath:
    try:
        return planner.plan(leg)
    except NoPlanFound as error:
        if count == 1:
            raise
        found = error.diagnosis
        reason, evidence = f"goal {number} of {count}: {found.reason}", {**found.evidence, "goal": number}
        raise type(error)(replace(found, reason=reason, evidence=evidence)) from error


def _pose(values: FloatArray, problem: Problem) -> Start:
    links = problem.arm.links
    return JointPose(values[:links], 0.0 if problem.arm.feed is None else float(values[links]))


def whole_path(legs: tuple[Leg, ...]) -> JointPath:
    """The paths of all legs, end to end, each over an equal share of [0, 1]; the spline has a corner at every stop."""
    if len(legs) == 1:
        return legs[0].path
    paths = [leg.path for leg in legs]
    splines = [path.spline for path in paths]
    knots, control = splines[0].t, splines[0].c
    for k, spline in enumerate(splines[1:], start=1):
        knots = np.concatenate((knots[:-1], spline.t[spline.k + 1 :] + k))
        control = np.concatenate((control, spline.c[1:]))
    return JointPath(
        BSpline(knots / len(legs), control, splines[0].k),
        np.concatenate([path.keyframes for path in paths]),
        tuple(curve for path in paths for curve in path.curves),
        "; ".join(path.candidate for path in paths),
        tuple(leader for path in paths for leader in path.leaders),
    )
