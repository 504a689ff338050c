"""Protocols of planners and retimers, and planning of a motion to several goals, leg by leg."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, NoPlanFound, UnreachableGoal
from ccm_opt.problem import Goal, JointPose, Problem
from ccm_opt.problem.poses import name_suffix
from ccm_opt.problem.solution import JointPath, JointTrajectory

LEAST_TIME = 0.5
"""CPU time granted to every leg even if earlier legs used up the limit, since a late leg may be easy [s]. Heuristic."""

_DIRECT_SHARE = 0.7
"""Fraction of a leg's time, for an arm in space, spent on planning it from the previous goal. If that fails, the leg is
planned from the first start. Heuristic."""
_RESERVED = 0.35
"""Time kept for each later leg, as a fraction of that of this leg. Heuristic: few legs are hard to find."""
_FURTHER_SHARE = 0.8
"""Fraction of the time limit until which legs are optimised further. Heuristic: the rest is for timing and checks."""

_SAME = 1e-9
"""Maximum difference between coordinates of equal configurations, since numbers in files are rounded [rad, m]."""

_OF_DRIVES = frozenset(
    ("masses", "inertia_axial", "inertia_transverse", "payload", "rotor_inertia", "friction", "axes")
)
"""Attributes of an arm that do not affect paths."""


class Planner(Protocol):
    """Interface of planners, which find a certified joint path for a problem."""

    def plan(self, problem: Problem) -> JointPath:
        """Return a certified path from the start to the only goal of a problem.

        Raises:
            NoPlanFound: no path was found; the error holds a diagnosis.
        """
        ...


class Retimer(Protocol):
    """Interface of retimers, which time a joint path."""

    def retime(self, problem: Problem, path: JointPath) -> JointTrajectory:
        """Return a timed motion along a path, from rest to rest, within ``problem.limits``.

        The motion is verified afterwards. It may use the fraction ``problem.planner.effort_share`` of the drives'
        limits.

        Raises:
            RetimingError: no timing within the limits was found; the error holds a diagnosis.
        """
        ...


@dataclass(frozen=True)
class Leg:
    """The part of a motion that ends at one goal.

    Attributes:
        problem: problem with this goal alone, from the start of the leg.
        path: path from the start of the leg to the goal.
    """

    problem: Problem
    path: JointPath


def whole_path(legs: Sequence[Leg]) -> JointPath:
    """Return the joint paths of all legs joined into one, each over an equal interval of the path parameter in [0, 1].

    The spline has a corner at every intermediate goal.
    """
    return end_to_end([leg.path for leg in legs])


def end_to_end(paths: Sequence[JointPath]) -> JointPath:
    """Return several joint paths joined into one, each beginning where the previous one ends.

    Each part covers an equal part of the path parameter's range [0, 1], with corners between parts.
    """
    if len(paths) == 1:
        return paths[0]

    # Every spline is clamped, so its last control point is the next one's first. Of the knots that both have at the
    # stop, just as many stay as make the curve continuous there, but not smooth.
    first, *others = [path.spline for path in paths]
    knots = first.t
    control = first.c
    for k, spline in enumerate(others, start=1):
        knots = np.concatenate((knots[:-1], spline.t[spline.k + 1 :] + k))
        control = np.concatenate((control, spline.c[1:]))

    return JointPath(
        BSpline(knots / len(paths), control, first.k),
        np.concatenate([path.keyframes for path in paths]),
        tuple(curve for path in paths for curve in path.curves),
        "; ".join(path.candidate for path in paths),
        goal_pose=paths[-1].goal_pose,
        parts=tuple(part for path in paths for part in path.parts or (path,)),
    )


def plan_legs(
    problem: Problem,
    planner: Planner,
    recorded: list[tuple[Problem, JointPath]] | None = None,
    *,
    retrace: bool = True,
) -> tuple[Leg, ...]:
    """Return one planned leg for every goal of a problem, each from the end of the previous one.

    If no path between two goals is found for an arm in space, the arm returns to the first start by traversing the
    certified legs backwards, and the next leg is planned from there. Time that is left after the last leg is used to
    optimise the legs that lack most clearance.

    Args:
        problem: problem with any number of intermediate goals; its time limit applies to all legs together.
        planner: the planner of every leg.
        recorded: known paths with their problems, which are reused; new paths are appended to this list.
        retrace: whether an arm in space may traverse legs backwards.

    Raises:
        NoPlanFound: no path to a goal was found; the error names the goal.
    """
    known = [] if recorded is None else recorded
    goals = [*((stop.goal, stop.tolerances) for stop in problem.stops), (problem.goal, problem.tolerances)]
    start = problem.start
    deadline = Deadline.after(problem.planner.time_limit)
    legs: list[Leg] = []
    for number, (goal, tolerances) in enumerate(goals, start=1):
        leg = replace(problem, start=start, goal=goal, tolerances=tolerances, stops=())
        path = (way_back(legs, goal) if retrace else None) or recorded_path(known, leg)
        if path is None:
            begun = legs if retrace and problem.dimension == 3 else []
            try:
                later = len(goals) - number
                path = planner.plan(leg) if len(goals) == 1 else _planned(planner, leg, begun, deadline, later)
            except NoPlanFound as error:
                if len(goals) == 1:
                    raise
                raise type(error)(_goal_diagnosis(error.diagnosis, number, len(goals), goal)) from error
            known.append((leg, path))
        legs.append(Leg(leg, path))
        start = JointPose.from_configuration(path.spline(1.0), problem.arm.coordinates)
    if len(goals) > 1:
        used = problem.planner.time_limit - deadline.left
        legs = _improved(legs, known, deadline.within(_FURTHER_SHARE * problem.planner.time_limit - used))
    return tuple(legs)


def _planned(planner: Planner, leg: Problem, legs: Sequence[Leg], deadline: Deadline, later: int) -> JointPath:
    """Return the path of a leg or, if none is found, a path back over earlier legs and on to the goal.

    Args:
        planner: the planner.
        leg: problem of the leg.
        legs: earlier legs that may be traversed backwards; may be empty.
        deadline: time limit of all legs together.
        later: number of legs that are still to be planned after this one.

    Raises:
        NoPlanFound: neither path was found; the error is that of the leg itself.
    """

    def within(problem: Problem, share: float) -> Problem:
        limit = max(share * deadline.left, LEAST_TIME)
        return replace(problem, planner=replace(problem.planner, time_limit=limit))

    share = 1.0 / (1.0 + _RESERVED * later)
    if not legs:
        return planner.plan(within(leg, share))
    try:
        return planner.plan(within(leg, _DIRECT_SHARE * share))
    except UnreachableGoal:
        raise
    except NoPlanFound as error:
        try:
            anew = planner.plan(within(replace(leg, start=legs[0].problem.start), share))
        except NoPlanFound:
            raise error from None
    first = legs[0].problem.start.configuration(leg.arm)
    back: list[JointPath] = []
    for part in (part for each in reversed(legs) for part in reversed(each.path.parts or (each.path,))):
        back.append(part.reversed())
        if np.max(np.abs(part.spline(0.0) - first)) < _SAME:
            break
    return end_to_end([*back, anew])


def _improved(legs: list[Leg], known: list[tuple[Problem, JointPath]], deadline: Deadline) -> list[Leg]:
    """Return the legs, with the parts that lack most clearance optimised further until one gains none.

    Args:
        legs: the legs.
        known: known paths with their problems, which are replaced too.
        deadline: time limit.
    """
    while deadline.left > LEAST_TIME:
        parts = [part for leg in legs for part in leg.path.parts or (leg.path,)]
        worst = max(parts, key=lambda part: part.lacking)
        if worst.further is None:
            break
        better = worst.further(deadline.left)
        if better is worst or better.lacking >= worst.lacking:
            break
        legs = [replace(leg, path=_with_part(leg.path, worst, better)) for leg in legs]
        known[:] = [(problem, _with_part(path, worst, better)) for problem, path in known]
    return legs


def _with_part(path: JointPath, part: JointPath, other: JointPath) -> JointPath:
    """Return a path in which one with the same ends replaces a part, wherever the arm moves along it, or back."""
    if not path.parts:
        for old, new in ((part, other), (part.reversed(), other.reversed())):
            if np.array_equal(path.spline.c, old.spline.c):
                return new
        return path
    parts = [_with_part(each, part, other) for each in path.parts]
    changed = any(new is not old for new, old in zip(parts, path.parts, strict=True))
    return end_to_end(parts) if changed else path


def _goal_diagnosis(found: Diagnosis, number: int, count: int, goal: Goal) -> Diagnosis:
    """Return a diagnosis with the words "goal ``number`` of ``count``", the goal to which no path was found, added."""
    title = f"goal {number} of {count}{name_suffix(goal)}"
    return replace(found, reason=f"{title}: {found.reason}", evidence={**found.evidence, "goal": number})


def way_back(legs: Sequence[Leg], goal: Goal) -> JointPath | None:
    """Return a path back over earlier legs to a goal at which one of them began.

    Args:
        legs: legs planned so far.
        goal: the next goal.

    Returns:
        The legs traversed backwards and joined, as far as the latest leg that began in the goal pose; None if no leg
        began there, if the goal does not give the pose of the whole arm, or if the arm is planar.
    """
    back: list[JointPath] = []
    for leg in reversed(legs):
        arm = leg.problem.arm
        wanted = goal.whole(arm)
        if wanted is None or arm.dimension == 2:
            return None
        back.append(leg.path.reversed())
        if np.max(np.abs(leg.problem.start.configuration(arm) - wanted)) < _SAME:
            return end_to_end(back)
    return None


def recorded_path(recorded: Sequence[tuple[Problem, JointPath]], problem: Problem) -> JointPath | None:
    """Return the known path of a problem that agrees with this one in everything that affects paths, else None.

    Limits of the drives and masses do not affect paths, so problems that differ only in these need not be planned
    again.

    Args:
        recorded: known paths with their problems.
        problem: the problem.
    """
    return next((path for known, path in recorded if _same_geometry(known, problem)), None)


def _same_geometry(one: Problem, other: Problem) -> bool:
    """Return whether two problems agree in everything that affects paths.

    Workspace, start and goals are compared by identity, since ``dataclasses.replace`` keeps the same objects for
    attributes that it does not change; equal copies count as different.
    """
    numbers = [each.name for each in fields(one.arm) if each.name not in _OF_DRIVES]
    parts = ("workspace", "start", "goal", "stops")
    return (
        type(one) is type(other)
        and all(np.array_equal(getattr(one.arm, name), getattr(other.arm, name)) for name in numbers)
        and one.tolerances == other.tolerances
        and all(getattr(one, name) is getattr(other, name) for name in parts)
    )
