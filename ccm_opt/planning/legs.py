"""What a planner is, and its legs, one to each goal."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeAlias, TypeVar

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.solution import JointPath, JointTrajectory

Asked = TypeVar("Asked", Problem, SpaceProblem, contravariant=True)  # noqa: PLC0105 - it is told beside it
_Problem = TypeVar("_Problem", Problem, SpaceProblem)


class PlannerOf(Protocol[Asked]):
    """Finds a certified joint path for a problem of one kind."""

    def plan(self, problem: Asked) -> JointPath:
        """Plan a motion to the problem's only goal.

        Raises:
            NoPlanFound: with a diagnosis, when there is none within the limits.
        """
        ...


class RetimerOf(Protocol[Asked]):
    """Lays time along a joint path."""

    def retime(self, problem: Asked, path: JointPath) -> JointTrajectory:
        """Time a path from rest to rest within ``problem.limits``; what it returns is verified.

        Of the limits of the drives a plan may use ``problem.planner.effort_share``, see ``robot.coordinates``.

        Raises:
            RetimingError: with a diagnosis, when there is no timing within the limits.
        """
        ...


Planner: TypeAlias = PlannerOf[Problem]
"""Plans in the plane."""
Retimer: TypeAlias = RetimerOf[Problem]
"""Times what is planned in the plane."""


@dataclass(frozen=True)
class Leg(Generic[_Problem]):
    """The motion to one goal.

    Attributes:
        problem: with this goal alone.
        path: the motion to it.
    """

    problem: _Problem
    path: JointPath


def whole_path(legs: Sequence[Leg[_Problem]]) -> JointPath:
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
