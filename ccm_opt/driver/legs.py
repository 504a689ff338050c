"""What a planner is, and the legs of a motion, one to each goal."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, NoPlanFound
from ccm_opt.problem import Goal, JointPose, Problem
from ccm_opt.problem.solution import JointPath, JointTrajectory

_LEAST_TIME = 0.5
"""CPU time that the planner is given for a leg, even when the legs before have used it up [s]: without any, a late leg
would fail on the clock where it might be easy. Taste."""

_SAME = 1e-9
"""Difference of coordinates up to which two configurations are the same [rad, m]: rounding of the file's numbers."""

_OF_DRIVES = frozenset(
    ("masses", "inertia_axial", "inertia_transverse", "payload", "rotor_inertia", "friction", "axes")
)
"""What of an arm no path depends on."""


class Planner(Protocol):
    """Finds a certified joint path for a problem."""

    def plan(self, problem: Problem) -> JointPath:
        """Plan a motion to the problem's only goal.

        Raises:
            NoPlanFound: with a diagnosis, when there is none within the limits.
        """
        ...


class Retimer(Protocol):
    """Lays time along a joint path."""

    def retime(self, problem: Problem, path: JointPath) -> JointTrajectory:
        """Time a path from rest to rest within ``problem.limits``; what it returns is verified.

        Of the limits of the drives a plan may use ``problem.planner.effort_share``, see ``robot.coordinates``.

        Raises:
            RetimingError: with a diagnosis, when there is no timing within the limits.
        """
        ...


@dataclass(frozen=True)
class Leg:
    """The motion to one goal.

    Attributes:
        problem: with this goal alone.
        path: the motion to it.
    """

    problem: Problem
    path: JointPath


def whole_path(legs: Sequence[Leg]) -> JointPath:
    """Return the paths of all legs, end to end, each over an equal share of [0, 1].

    The spline has a corner at every stop.
    """
    return end_to_end([leg.path for leg in legs])


def end_to_end(paths: Sequence[JointPath]) -> JointPath:
    """Return the paths each of which begins where the one before ends, as one path; see ``whole_path``."""
    if len(paths) == 1:
        return paths[0]

    # Every spline is clamped, so its last control point is the next one's first. Of the knots that both have at the
    # stop as many stay as keep the curve continuous there and nothing more.
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
    """Plan the motion to every goal in turn, each from where the one before ends; without stops that is one leg.

    Args:
        problem: with any number of stops; its time limit is for all legs together.
        planner: plans a leg.
        recorded: paths that are known already, with their problems; is added to.
        retrace: whether an arm in space that goes back to a pose from which a leg began may take the same way.

    Raises:
        NoPlanFound: naming the goal that is not reached.
    """
    known = [] if recorded is None else recorded
    goals = [*((stop.goal, stop.tolerances) for stop in problem.stops), (problem.goal, problem.tolerances)]
    start = problem.start
    deadline = Deadline.after(problem.planner.time_limit)
    legs: list[Leg] = []
    for number, (goal, tolerances) in enumerate(goals, start=1):
        options = problem.planner
        if legs:
            options = replace(options, time_limit=max(deadline.left, _LEAST_TIME))
        leg = replace(problem, start=start, goal=goal, tolerances=tolerances, stops=(), planner=options)
        path = (way_back(legs, goal) if retrace else None) or recorded_path(known, leg)
        if path is None:
            try:
                path = planner.plan(leg)
            except NoPlanFound as error:
                if len(goals) == 1:
                    raise
                raise type(error)(_goal_diagnosis(error.diagnosis, number, len(goals))) from error
            known.append((leg, path))
        legs.append(Leg(leg, path))
        start = JointPose.from_configuration(path.spline(1.0), problem.arm.coordinates)
    return tuple(legs)


def _goal_diagnosis(found: Diagnosis, number: int, count: int) -> Diagnosis:
    """Return a diagnosis that says which of several goals it is about."""
    return replace(
        found, reason=f"goal {number} of {count}: {found.reason}", evidence={**found.evidence, "goal": number}
    )


def way_back(legs: Sequence[Leg], goal: Goal) -> JointPath | None:
    """Return the paths of the last legs backwards, to where the latest of them that fits began.

    Args:
        legs: that are planned.
        goal: what comes next.

    Returns:
        None where the goal is not a pose in space in which a leg began.
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
    """Return the path of a problem whose path is known; None where something that decides it has changed.

    Limits of torque and masses of links change no path, so none is planned twice.
    """
    return next((path for known, path in recorded if _same_geometry(known, problem)), None)


def _same_geometry(one: Problem, other: Problem) -> bool:
    """Return whether all that decides a path is the same.

    Parts that ``replace`` has left alone are the very same objects.
    """
    numbers = [each.name for each in fields(one.arm) if each.name not in _OF_DRIVES]
    parts = ("workspace", "start", "goal", "stops")
    return (
        type(one) is type(other)
        and all(np.array_equal(getattr(one.arm, name), getattr(other.arm, name)) for name in numbers)
        and one.tolerances == other.tolerances
        and all(getattr(one, name) is getattr(other, name) for name in parts)
    )
