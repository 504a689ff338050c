"""Goals in sequence, leg by leg, and what a planner is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.deadline import Deadline
from ccm_opt.errors import Diagnosis, NoPlanFound
from ccm_opt.problem import Goal, JointPose, Problem, Start, Tolerances
from ccm_opt.solution import JointPath, JointTrajectory


class Planner(Protocol):
    """Finds a certified joint path for a problem."""

    def plan(self, problem: Problem) -> JointPath:
        """Plan a motion.

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


def plan_legs(problem: Problem, planner: Planner, *, least_time: float = 0.5) -> tuple[Leg, ...]:
    """Plan the motion to every goal in turn; without stops that is one leg.

    Args:
        problem: with any number of stops; its time limit is for all legs together.
        planner: plans a leg.
        least_time: that the planner is given for a leg, even when the legs before have used it up [s]; without any, a
            late leg would fail on the clock where it might be easy.

    Raises:
        NoPlanFound: naming the goal that is not reached.
    """
    goals: list[tuple[Goal, Tolerances]] = [(stop.goal, stop.tolerances) for stop in problem.stops]
    goals.append((problem.goal, problem.tolerances))

    start: Start = problem.start
    deadline = Deadline.after(problem.planner.time_limit)
    legs: list[Leg] = []
    for number, (goal, tolerances) in enumerate(goals, start=1):
        options = problem.planner
        if number > 1:
            options = replace(options, time_limit=max(deadline.left, least_time))
        leg = replace(problem, start=start, goal=goal, tolerances=tolerances, stops=(), planner=options)
        try:
            path = planner.plan(leg)
        except NoPlanFound as error:
            if len(goals) == 1:
                raise
            raise type(error)(_of_goal(error.diagnosis, number, len(goals))) from error
        legs.append(Leg(leg, path))
        start = JointPose.from_configuration(path.spline(1.0), problem.arm.coordinates)
    return tuple(legs)


def _of_goal(found: Diagnosis, number: int, count: int) -> Diagnosis:
    """A diagnosis that says which of several goals it is about."""
    return replace(
        found,
        reason=f"goal {number} of {count}: {found.reason}",
        evidence={**found.evidence, "goal": number},
    )


def whole_path(legs: tuple[Leg, ...]) -> JointPath:
    """The paths of all legs, end to end, each over an equal share of [0, 1]; the spline has a corner at every stop."""
    return end_to_end([leg.path for leg in legs])


def end_to_end(paths: Sequence[JointPath]) -> JointPath:
    """Paths each of which begins where the one before ends, as one path; see ``whole_path``."""
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
        tuple(leader for path in paths for leader in path.leaders),
        goal_pose=paths[-1].goal_pose,
        parts=tuple(part for path in paths for part in path.parts or (path,)),
    )
