"""Changes that would help beside other numbers of the arm: a moved goal, a wider room, a dropped term, right units."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, NoPlanFound, UnreachableGoal
from ccm_opt.core.polyline import unit_vector
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.explain import explain_failure, unit_hints
from ccm_opt.diagnosis.moved_goal import moved_goals
from ccm_opt.diagnosis.relaxation import Trials, relaxations
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.problem import JointPose, Limits, Problem, TipGoal
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.bad_pose import clearance_advice
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .conftest import PROBLEMS
from .scenes import ROOM, Scene, clutter, later, make_arm, open_scene

seeds = st.integers(0, 10**6)


def with_post(seed: int) -> Problem:
    """A goal whose tip stands in a round post, with a heading as often as not."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(0.3, 0.8) * unit_vector(rng.uniform(-2.5, 2.5))
    middle = place + rng.uniform(-0.03, 0.03, 2)
    arm = make_arm()
    workspace = Workspace(ROOM, (Obstacle("post", PlaneShape(shapely.Point(middle), 0.05)),))
    heading = float(rng.uniform(-np.pi, np.pi)) if rng.uniform() < 0.5 else None
    return Scene(arm, workspace, np.full(24, np.pi), np.zeros(24)).problem(TipGoal(place, heading=heading))


@pytest.mark.planning
@settings(deadline=None, max_examples=30)
@given(seed=seeds)
def test_a_moved_goal_is_free_and_no_nearer_one_is(seed: int) -> None:
    """The place told is free of contact, and a step short of it, by more than the tolerance, is not."""
    problem = with_post(seed)
    found = [each for each in moved_goals(problem, failed(problem), Deadline.never()) if each.key == "goal.position"]
    assert len(found) == 1
    moved = found[0]
    assert moved.bound is not None
    there = moved.write(problem, moved.bound + 2.0 * problem.tolerances.position)
    assert not any(finding.kind == "contact" for finding in failed(there))
    short = moved.write(problem, 0.9 * moved.bound - 2.0 * problem.arm.link_length * problem.tolerances.heading)
    assert any(finding.kind == "contact" for finding in failed(short))


def test_a_heading_that_cannot_be_taken_is_turned() -> None:
    """Where the last link would lie in a wall, the least turn that frees it is told, and solved with."""
    workspace = Workspace(ROOM, (Obstacle("wall", PlaneShape(shapely.box(0.55, -0.2, 0.6, 0.2))),))
    arm = make_arm()
    problem = Scene(arm, workspace, np.full(24, np.pi), np.zeros(24)).problem(
        TipGoal(np.array([0.53, 0.0]), heading=np.pi)
    )
    found = {each.key: each for each in moved_goals(problem, failed(problem), Deadline.never())}
    turned = found["goal.heading_deg"]
    assert turned.bound is not None
    assert failed(turned.write(problem, turned.bound)) == ()
    assert "goal.heading_deg turned by" in turned.relaxation(problem, turned.bound, turned.bound).words


def test_a_start_outside_is_told_with_the_bounds_that_would_do() -> None:
    """The place and the distance are told, no thinner arm is advised, and the room is widened as far as it must."""
    scene = open_scene(1)
    small = Workspace(shapely.box(-0.3, -0.3, 0.3, 0.3))
    problem = replace(scene.problem(), workspace=small, goal=TipGoal(np.array([0.2, 0.1])))
    findings = failed(problem)
    assert "outside the 'workspace boundary' at (" in findings[0].reason
    assert findings[0].place is not None
    with pytest.raises(UnreachableGoal, match="leaves the workspace") as caught:
        resolve_ends(problem)
    assert not any("radius" in line for line in caught.value.diagnosis.advice)
    asked: list[Problem] = []
    told = relaxations(problem, findings, Trials(asked.append, later(900.0)))
    assert [relaxed.key for relaxed in told] == ["workspace.bounds"]
    assert not any(finding.kind == "contact" for finding in failed(asked[0]))
    assert shapely.contains(asked[0].workspace.boundary, small.boundary)


def test_a_fed_arm_out_of_reach_is_fed_farther() -> None:
    """The least upper end of the feed axis from which the goal is reached is a bound, exactly."""
    arm = replace(make_arm(), feed=Feed(0.0, 0.5, 0.1))
    goal = TipGoal(np.array([1.9, 0.3]))
    count = 3 * arm.links
    limits = Limits(np.ones(count), np.ones(count), feed_velocity=0.1, feed_acceleration=0.1)
    workspace = Workspace(shapely.box(-3.0, -3.0, 3.0, 3.0))
    problem = Problem("fed", workspace, arm, limits, JointPose(np.zeros(arm.links)), goal)
    (finding,) = failed(problem)
    high = finding.bounds["arm.feed.range"]
    assert np.hypot(1.9 - high, 0.3) == pytest.approx(arm.length + problem.tolerances.position)
    fed = replace(problem, arm=replace(arm, feed=Feed(0.0, high + 1e-6, 0.1)))
    assert failed(fed) == ()


def test_a_term_is_dropped_where_nothing_is_proved() -> None:
    """Each of the user's terms is tried in turn where the search failed, and none where the arm or the room decides."""
    problem = clutter(3, 5).problem()
    dropped: list[str] = []

    def solve(_: Problem, name: str = "") -> None:
        dropped.extend([name] * bool(name))
        if name != "tall":
            raise MotionNotFound(Diagnosis("no", "motion"))

    terms = (("constraint", "low"), ("cost", "tall"))
    error = MotionNotFound(Diagnosis("no motion found", "motion"))
    told = explain_failure(problem, error, Trials(solve, later(900.0), terms)).diagnosis
    assert dropped == ["low", "tall"]
    assert [relaxed.words for relaxed in told.relaxations] == ["cost 'tall' dropped"]
    far = replace(problem, goal=TipGoal(np.array([1.25, 0.0])))
    explain_failure(far, error, Trials(solve, later(900.0), terms))
    assert dropped == ["low", "tall"]


def test_units_that_look_wrong_are_hinted_at() -> None:
    """Lengths a thousand times off and joint limits in radians are named; sound problems get no hint."""
    sound = clutter(1, 5).problem()
    assert unit_hints(sound) == ()
    goal = sound.goal
    assert isinstance(goal, TipGoal)
    far = replace(sound, goal=TipGoal(1e3 * goal.position))
    assert any("goal.position" in hint and "mm" in hint for hint in unit_hints(far))
    stiff = replace(sound, arm=replace(sound.arm, joint_limit=float(np.deg2rad(1.0472))))
    assert any("1.047 rad would be 60°" in hint for hint in unit_hints(stiff))
    huge = replace(sound, workspace=Workspace(shapely.box(-1300.0, -1300.0, 1300.0, 1300.0)))
    assert any("workspace.bounds is" in hint for hint in unit_hints(huge))
    told = explain_failure(far, UnreachableGoal(Diagnosis("no way", "free space")), Trials(lambda _: None, later(0.0)))
    assert any(line.startswith("check the units") for line in told.diagnosis.advice)


def test_advice_about_room_is_what_the_problem_has_to_give() -> None:
    """An axis without radius and clearance cannot do with less; crossing axes gain nothing by a thinner arm."""
    assert clearance_advice(0.0, 0.0) == ()
    assert clearance_advice(0.0, 0.01) == ("reduce workspace.clearance (not tried)",)
    assert clearance_advice(0.015, 0.0) == ("reduce arm.radius (not tried)",)
    assert clearance_advice(0.015, 0.01, 0.012) == ("reduce arm.radius by 12.0 mm",)
    assert clearance_advice(0.015, 0.01, 0.02) == ()
    crossing = Obstacle("sheet", PlaneShape(shapely.LineString([(0.5, -0.1), (0.5, 0.1)])))
    problem = Scene(make_arm(), Workspace(ROOM, (crossing,)), np.zeros(24), np.full(24, 1.0)).problem()
    with pytest.raises(UnreachableGoal, match="the start is in contact") as caught:
        resolve_ends(problem)
    assert caught.value.diagnosis.advice == ("change the start",)


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("place", ["[5.0, 5.0]", "[60.0, 0.3]", "[0.65, 0.5]"])
def test_goals_far_out_of_reach_are_moved_to_where_they_can_be_taken(place: str) -> None:
    """However far off a goal is, and whatever stands round the arm, a place is named that was solved."""
    far = ccm_opt.load_problem(PROBLEMS / "swan-neck.toml", changes=[f"goal.position={place}"])
    with pytest.raises(NoPlanFound) as failure:
        ccm_opt.solve(far)
    moved = [change for change in failure.value.diagnosis.relaxations if change.key == "goal.position"]
    assert moved
    assert "e+" not in moved[0].words
