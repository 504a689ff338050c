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
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.workspace import Workspace
from tests.snakes_in_space import snake

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


class AroundOnly(Straight):
    """A planner of straight lines that leads from the straight arm to any bend and back, but not from bend to bend."""

    def plan(self, problem: Problem) -> JointPath:
        """A line, unless both ends are bent."""
        self.asked.append(problem)
        ends = [pose.whole(problem.arm) for pose in (problem.start, problem.goal)]
        assert ends[0] is not None
        assert ends[1] is not None
        if all(np.any(q) for q in ends):
            raise MotionNotFound(Diagnosis("bent at both ends", "motion", ("straighter",)))
        control = ends[0] + np.linspace(0.0, 1.0, 5)[:, None] * (ends[1] - ends[0])
        return JointPath(BSpline(KNOTS, control, 3), control, (), "line")


def in_space(*bends: float) -> Problem:
    """A straight arm in space with goals that bend every joint alike."""
    *stops, last = (JointPose(np.full((4, 2), bend)) for bend in bends)
    workspace = Workspace(bounds=None)
    limits = Limits(np.ones(12), np.ones(12))
    asked = tuple(Stop(stop, Tolerances()) for stop in stops)
    return Problem("goals", workspace, snake(4), limits, JointPose(np.zeros((4, 2))), last, stops=asked)


def test_a_leg_that_is_not_found_begins_anew_from_the_first_start() -> None:
    """In space the arm goes back over the legs so far, which are known, and the record says so."""
    problem = in_space(0.1, 0.2, 0.3)
    planner = AroundOnly()
    legs = plan_legs(problem, planner)
    anew = "line, backwards; line"
    assert [leg.path.candidate for leg in legs] == ["line", anew, anew]
    for leg, bend in zip(legs, (0.1, 0.2, 0.3), strict=True):
        ends = [leg.problem.start.configuration(problem.arm), np.full(8, bend)]
        np.testing.assert_allclose(leg.path.spline([0.0, 1.0]), ends)
    limits = [asked.planner.time_limit for asked in planner.asked]
    assert max(limits) <= problem.planner.time_limit
    # The second of three legs leaves time to go back to the start first, and for the third.
    assert limits[1] < 0.53 * problem.planner.time_limit
    with pytest.raises(MotionNotFound, match="bent at both ends"):
        plan_legs(problem, AroundOnly(), retrace=False)


class Improvable(AroundOnly):
    """A planner of lines that lack clearance, a third less each time that they are optimised further."""

    def plan(self, problem: Problem) -> JointPath:
        """A line that lacks the more clearance, the less its goal is bent."""
        goal = problem.goal.whole(problem.arm)
        assert goal is not None
        return lacking(super().plan(problem), 0.7 - float(goal[0]))


def lacking(path: JointPath, fraction: float) -> JointPath:
    """The path with a middle that says how much it lacks, and a way to lack less until that is a tenth."""
    control = path.spline.c.copy()
    control[2] = fraction
    further = (lambda _: lacking(path, 0.67 * fraction)) if fraction > 0.1 else (lambda _: again)
    again = replace(path, spline=BSpline(path.spline.t, control, 3), lacking=fraction, further=further)
    return again


def test_time_that_is_left_is_used_for_legs_that_lack_clearance() -> None:
    """The worst is optimised first, until one gains nothing, and replaced wherever the arm moves along it."""
    problem = in_space(0.1, 0.2, 0.3)
    recorded: list[tuple[Problem, JointPath]] = []
    legs = plan_legs(problem, Improvable(), recorded)
    first, second, third = (leg.path for leg in legs)
    parts = [first, *second.parts, *third.parts]
    assert max(part.lacking for part in parts) < 0.1
    for there, back in ((first, second.parts[0]), (second.parts[1], third.parts[0])):
        np.testing.assert_array_equal(there.spline.c, back.spline.c[::-1])
    np.testing.assert_array_equal(whole_path(legs).spline([0.0, 1.0]), [np.zeros(8), np.full(8, 0.3)])
    for (_, path), leg in zip(recorded, legs, strict=True):
        np.testing.assert_array_equal(path.spline.c, leg.path.spline.c)
    # One leg is left as it is, and so are several without time.
    assert plan_legs(in_space(0.1), Improvable())[0].path.lacking == 0.6
    hasty = replace(problem, planner=replace(problem.planner, time_limit=0.5))
    assert plan_legs(hasty, Improvable())[0].path.lacking == 0.6
