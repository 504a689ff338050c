"""Goals in sequence: planned in order, each from where the last leg ended, and told apart when one fails."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

from ccm_opt.core.errors import Diagnosis, MotionNotFound
from ccm_opt.driver.legs import plan_legs, whole_path
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import JointPose, Problem, Stop, Tolerances
from ccm_opt.problem.solution import JointPath

from .conftest import SMALL_PROBLEM

KNOTS = np.concatenate((np.zeros(4), [0.3], np.ones(4)))


class Straight:
    """A planner of straight lines in joint space, which remembers what it was asked."""

    def __init__(self) -> None:
        self.asked: list[Problem] = []

    def plan(self, problem: Problem) -> JointPath:
        """A line, unless the goal bends a joint by more than 1 rad."""
        self.asked.append(problem)
        assert isinstance(problem.start, JointPose)
        assert isinstance(problem.goal, JointPose)
        if np.max(np.abs(problem.goal.bends)) > 1.0:
            raise MotionNotFound(Diagnosis("too far", "motion", ("nearer",)))
        control = problem.start.bends + np.linspace(0.0, 1.0, 5)[:, None] * (problem.goal.bends - problem.start.bends)
        return JointPath(BSpline(KNOTS, control, 3), control, (), "line")


def sequence(*goals: float) -> Problem:
    """A problem whose goals bend every joint alike."""
    *stops, last = (JointPose(np.full(4, bend)) for bend in goals)
    problem = parse_problem(SMALL_PROBLEM)
    return replace(problem, goal=last, stops=tuple(Stop(stop, Tolerances()) for stop in stops))


def test_legs_follow_each_other() -> None:
    """Every leg starts where the one before ended, has one goal, and the whole path passes all of them."""
    planner = Straight()
    legs = plan_legs(sequence(0.1, -0.2, 0.3), planner)
    assert [leg.problem.stops for leg in legs] == [(), (), ()]
    starts = [problem.start.bends[0] for problem in planner.asked if isinstance(problem.start, JointPose)]
    np.testing.assert_allclose(starts, [0.0, 0.1, -0.2])
    path = whole_path(legs)
    np.testing.assert_allclose(path.spline([0.0, 1 / 3, 2 / 3, 1.0])[:, 0], [0.0, 0.1, -0.2, 0.3], atol=1e-12)
    for k, leg in enumerate(legs):
        u = np.linspace(0.0, 1.0, 7)
        np.testing.assert_allclose(path.spline((k + u) / 3.0), leg.path.spline(u), atol=1e-12)
    assert len(path.keyframes) == 15


def test_one_goal_is_one_leg_and_its_own_path() -> None:
    """Without stops the planner's path is passed on as it is."""
    legs = plan_legs(sequence(0.4), Straight())
    assert whole_path(legs) is legs[0].path


def test_a_goal_that_is_not_reached_is_numbered() -> None:
    """The reason says which of the goals; the kind of failure and the advice stay."""
    with pytest.raises(MotionNotFound, match=r"goal 2 of 3: too far") as caught:
        plan_legs(sequence(0.1, 1.1, 0.3), Straight())
    assert caught.value.diagnosis.advice == ("nearer",)
    assert caught.value.diagnosis.evidence["goal"] == 2
    with pytest.raises(MotionNotFound, match=r"^too far"):
        plan_legs(sequence(1.1), Straight())
