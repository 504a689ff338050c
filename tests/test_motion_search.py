"""The search for a motion: safe, exact at both ends, smoothed and lifted; its failures say why."""

from dataclasses import replace
from functools import cache, partial
from itertools import pairwise

import numpy as np
import pytest
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import MotionNotFound, TimeLimitReached, UnreachableGoal
from ccm_opt.core.polyline import unit_vector
from ccm_opt.diagnosis.explain import refuse_closed
from ccm_opt.planning.curve_routes import find_routes, route_room
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask, coarsened
from ccm_opt.planning.optimisation.optimise import optimise
from ccm_opt.planning.passage_widths import fitting_margins
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.refinement import refine_motion
from ccm_opt.planning.search import Failure, Strategy
from ccm_opt.planning.settings import GoalSettings
from ccm_opt.planning.strategies import find_by_candidates, find_motion, is_divided
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from . import ompl_scenes
from .scenes import (
    ROOM,
    Scene,
    clutter,
    corridor,
    later,
    make_arm,
    motion_task,
    open_scene,
    self_gap,
    swept,
    wall_gaps,
)

EXACT = 100.0 * GoalSettings().polish_tolerance
SCENES = {"clutter 1": clutter(1), "clutter 4": clutter(4), "clutter of 40": clutter(6, 40), "corridor": corridor(1)}


CANDIDATES = (
    Strategy("wide", find_by_candidates),
    Strategy("narrow", partial(find_by_candidates, narrow=True), is_divided),
)
"""Strategies that follow guides, and nothing else."""


def certified(scene: Scene, headings: FloatArray) -> bool:
    """Whether the certificate passes a motion."""
    return len(Certificate(scene.arm, scene.workspace).failures(scene.arm.bends(headings))) == 0


@cache
def planned(name: str) -> tuple[MotionTask, Motion]:
    """A scene's task and the motion found."""
    task = motion_task(SCENES[name].problem())
    return task, find_motion(task)


def least_gap(arm: Arm, workspace: Workspace, headings: FloatArray) -> float:
    """Least gap over a motion swept between its keyframes [m]."""
    fine = np.vstack([swept(a, b, 3) for a, b in pairwise(headings)])
    points = arm.joint_positions(fine)
    return min(float(wall_gaps(arm, workspace, points).min()), self_gap(arm, points))


@pytest.mark.parametrize("name", SCENES)
def test_a_motion_leads_from_start_to_goal(name: str) -> None:
    """It starts at the start, ends on the goal pose to nanometres, keeps all joint limits and touches nothing."""
    task, motion = planned(name)
    arm = task.arm
    headings = arm.headings(motion.configurations)
    np.testing.assert_allclose(motion.configurations[0], task.start, atol=1e-12)
    assert np.hypot(*(arm.joint_positions(headings[-1])[-1] - task.goal.position)) < EXACT
    assert task.goal.heading is not None
    assert abs(np.sin(0.5 * (headings[-1, -1] - task.goal.heading))) < EXACT
    assert (np.abs(arm.bends(headings)) <= arm.bend_limits).all()
    assert least_gap(arm, task.workspace, headings) > 0.0
    assert motion.candidate


@pytest.mark.parametrize("name", SCENES)
def test_the_coordinates_are_those_of_the_headings(name: str) -> None:
    """Every keyframe's coordinates give its headings in the motion's own space."""
    _, motion = planned(name)
    np.testing.assert_allclose(motion.curve.configurations(motion.unknowns), motion.configurations, atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_the_same_task_gives_the_same_motion(name: str) -> None:
    """The search draws no lots."""
    task, motion = planned(name)
    np.testing.assert_array_equal(find_motion(replace(task, deadline=later())).configurations, motion.configurations)


@pytest.mark.parametrize("seed", [1, 6])
def test_whole_arm_goals_are_met_by_every_link(seed: int) -> None:
    """A goal for the whole arm is met by all link headings, not by the tip alone."""
    scene = clutter(seed, 10)
    task = motion_task(scene.problem(JointPose(scene.arm.bends(scene.goal))))
    motion = find_motion(task)
    np.testing.assert_allclose(scene.arm.headings(motion.configurations[0]), scene.start, atol=1e-12)
    np.testing.assert_allclose(scene.arm.headings(motion.configurations[-1]), scene.goal, atol=1e-9)
    assert least_gap(scene.arm, scene.workspace, scene.arm.headings(motion.configurations)) > 0.0


def test_a_goal_without_heading_is_met_by_the_tip() -> None:
    """Any heading will do when none is asked for."""
    scene = clutter(4)
    motion = find_motion(motion_task(scene.problem(TipGoal(scene.goal_tip.position))))
    tip = scene.arm.joint_positions_at(motion.configurations[-1])[-1]
    assert np.hypot(*(tip - scene.goal_tip.position)) < EXACT
    assert certified(scene, scene.arm.headings(motion.configurations))


@pytest.mark.parametrize("name", ["clutter 4", "corridor"])
def test_optimising_shortens_and_stays_safe(name: str) -> None:
    """The optimised motion travels less than the one first found, with the same ends, certified and within limits."""
    scene = SCENES[name]
    (task, optimised) = planned(name)
    found = find_motion(replace(task, deadline=later(), optimiser="none"))
    assert optimised.travel < found.travel
    for motion in (found, optimised):
        np.testing.assert_allclose(scene.arm.headings(motion.configurations[0]), scene.start, atol=1e-12)
        tip = scene.arm.joint_positions_at(motion.configurations[-1])[-1]
        assert np.hypot(*(tip - scene.goal_tip.position)) < EXACT
        assert certified(scene, scene.arm.headings(motion.configurations))
        assert (np.abs(motion.configurations) <= scene.arm.bend_limits).all()


def test_a_detour_is_cut_short() -> None:
    """In the open a motion that goes astray and comes back becomes not much longer than the straight one."""
    scene = open_scene(2)
    task = motion_task(scene.problem())
    space, v = LinkSpace.through(scene.arm, scene.arm.bends(scene.start))
    turn = np.eye(len(v))[0]
    bend = np.eye(len(v))[5]
    way = np.vstack((np.linspace(v, v + 0.8 * turn, 12), np.linspace(v + 0.8 * turn, v + 0.3 * turn + bend, 12)[1:]))
    astray = Motion(space, way, space.configurations(way), "astray")
    points = scene.arm.joint_positions_at(astray.configurations[-1])
    task = replace(
        task,
        goal=GoalPose(points[-1], unit_vector(scene.arm.headings(astray.configurations[-1])[-1])),
        deadline=later(),
    )
    straight = Motion(space, way[[0, -1]], astray.configurations[[0, -1]], "straight")
    assert astray.travel > 2.0 * straight.travel
    assert optimise(astray, task).travel < 1.2 * straight.travel


def test_without_time_the_motion_stays_as_it_is() -> None:
    """Past the deadline optimising returns the motion it was given."""
    task, motion = planned("clutter 4")
    assert optimise(motion, replace(task, deadline=Deadline.after(0.0))) is motion


@pytest.mark.parametrize("name", ["clutter 1", "clutter 4"])
@pytest.mark.parametrize("links", [36, 60])
def test_a_motion_is_lifted_to_more_links(name: str, links: int) -> None:
    """A motion planned at 24 links becomes one of many links that meets their own start and goal and is certified."""
    coarse = SCENES[name]
    _, motion = planned(name)
    arm = make_arm(links)
    start = _refined(coarse.start, links)
    scene = Scene(arm, coarse.workspace, start, start)
    task = motion_task(scene.problem(coarse.goal_tip))
    refined = refine_motion(motion, task)
    assert refined is not None
    assert refined.configurations.shape[1] == links
    np.testing.assert_allclose(arm.headings(refined.configurations[0]), start, atol=1e-12)
    assert np.hypot(*(arm.joint_positions_at(refined.configurations[-1])[-1] - coarse.goal_tip.position)) < EXACT
    assert least_gap(arm, scene.workspace, arm.headings(refined.configurations)) > 0.0
    assert (np.abs(refined.configurations) <= arm.bend_limits).all()


@pytest.mark.parametrize("share", [1.0, 0.3, 1e-15, -1e-15])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_motion_bent_once_more_to_its_own_end_is_lifted(backwards: bool, share: float) -> None:
    """Both ends are met exactly after lifting, though the motion has a further coordinate for its end."""
    many = make_arm(48)
    # No curve shows the zigzag of the start, so that it is blended out.
    start = np.linspace(0.0, 0.6, 48) + 0.01 * (-1.0) ** np.arange(48)
    goal = np.linspace(1.0, 2.2, 48)
    scene = Scene(many, Workspace(ROOM), start, goal)
    task = motion_task(scene.problem(JointPose(many.bends(goal))))
    coarse = coarsened(task, 24)
    assert coarse.goal_pose is not None
    ends = [coarse.goal_pose, coarse.start] if backwards else [coarse.start, coarse.goal_pose]
    space, first = LinkSpace.through(coarse.arm, ends[0])
    once, end = space.blended_to(ends[1])
    # Of the first blend as much as is left, or nothing but for rounding; the second one makes up for the rest.
    end[-1] = share
    twice = replace(once, slopes=np.column_stack((once.slopes, ends[1] - once.configurations(end))))
    last = np.append(end, 1.0)
    coordinates = np.linspace(np.append(first, (0.0, 0.0)), last, 12)
    if backwards:
        coordinates = coordinates[::-1]
    refined = refine_motion(Motion(twice, coordinates, twice.configurations(coordinates), "bent twice"), task)
    assert refined is not None
    np.testing.assert_allclose(many.headings(refined.configurations[[0, -1]]), [start, goal], atol=1e-9)


def _refined(headings: FloatArray, links: int) -> FloatArray:
    """Headings of an arm with more links of the same shape, smoothed over a link."""
    middles = (np.arange(links) + 0.5) / links
    return np.interp(middles, (np.arange(len(headings)) + 0.5) / len(headings), headings)


def test_arms_of_many_links_are_planned_and_certified_on_their_own_links() -> None:
    """At 72 links the motion found has 72 headings, meets start and goal, and touches nothing."""
    scene = clutter(4, 10, 72)
    motion = find_motion(motion_task(scene.problem()))
    assert motion.configurations.shape[1] == 72
    np.testing.assert_allclose(scene.arm.headings(motion.configurations[0]), scene.start, atol=1e-12)
    tip = scene.arm.joint_positions_at(motion.configurations[-1])[-1]
    assert np.hypot(*(tip - scene.goal_tip.position)) < EXACT
    assert least_gap(scene.arm, scene.workspace, scene.arm.headings(motion.configurations)) > 0.0


def test_a_coarser_arm_has_the_same_shape() -> None:
    """A task with fewer links keeps the length, the base, and the arm's shape to a fraction of a link."""
    fine = motion_task(clutter(4, 5, 96).problem())
    coarse = coarsened(fine, 24)
    assert coarse.arm.links == 24
    assert coarse.arm.length == pytest.approx(fine.arm.length)
    here = fine.arm.joint_positions_at(fine.start)[::4]
    there = coarse.arm.joint_positions_at(coarse.start)
    assert np.linalg.norm(here - there, axis=1).max() < 0.25 * coarse.arm.link_length


def boxed_goal(opening: float) -> Scene:
    """A goal inside a box; its left wall has a slot of some width, or none."""
    corners = [(0.5, 0.5 * opening), (0.5, 0.2), (0.9, 0.2), (0.9, -0.2), (0.5, -0.2), (0.5, -0.5 * opening)]
    box = shapely.LineString(corners) if opening else shapely.LineString([*corners, corners[0]])
    goal = np.concatenate((np.full(8, 0.5), np.full(8, -0.5), np.zeros(8)))
    return Scene(
        make_arm(),
        Workspace(open_scene(0).workspace.boundary, (Obstacle("box", PlaneShape(box)),)),
        np.full(24, 2.0),
        goal,
    )


def test_a_closed_box_round_the_goal_is_unreachable() -> None:
    """What is proved is refused before any search; without a proof the planner only says that it found nothing."""
    closed = boxed_goal(0.0).problem(TipGoal(np.array([0.7, 0.0])))
    with pytest.raises(UnreachableGoal, match="'box' closes it off"):
        MotionPlanner(refuse=refuse_closed).plan(closed)
    with pytest.raises(MotionNotFound, match="no route to the goal was found") as caught:
        MotionPlanner().plan(closed)
    assert caught.value.status == "no plan found"
    assert caught.value.diagnosis.advice


def test_a_slot_that_is_too_narrow_is_no_way() -> None:
    """A slot narrower than the arm is as good as none; one four times as wide lets the arm in."""
    goal = TipGoal(np.array([0.7, 0.0]), heading=0.0)
    with pytest.raises(UnreachableGoal, match=r"diameter 30\.0 mm"):
        MotionPlanner(refuse=refuse_closed).plan(boxed_goal(0.028).problem(goal))
    scene = boxed_goal(0.12)
    motion = find_motion(motion_task(scene.problem(goal)))
    assert least_gap(scene.arm, scene.workspace, scene.arm.headings(motion.configurations)) > 0.0


@pytest.mark.parametrize("links", [12, 24])
def test_a_guide_that_finds_no_way_on_stalls_and_the_search_goes_on(links: int) -> None:
    """Drawn back, the tip of 24 links stops in the margin of a wall whose nearest free place lies inside the block."""
    path = MotionPlanner().plan(ompl_scenes.corridor(links))

    assert path.candidate


def test_a_search_without_candidates_says_so() -> None:
    """Without any path of the tip and without a guess there is nothing to try, and that is the reason given."""
    task = motion_task(clutter(4).problem())
    with pytest.raises(MotionNotFound, match="no route to the goal was found") as caught:
        find_motion(replace(task, tip_paths=(), guesses=()))
    assert caught.value.diagnosis.stage == "motion"


def test_a_failed_search_tells_how_far_it_came_and_what_was_tightest() -> None:
    """When interpolation to the only guess runs into a wall, the diagnosis names candidate, wall and rest."""
    wall = Obstacle("the long wall", PlaneShape(shapely.LineString([(0.12, 0.12), (1.2, 1.2)]), 0.01))
    room = Workspace(open_scene(0).workspace.boundary, (wall,))
    scene = Scene(make_arm(), room, np.full(24, 0.3), np.linspace(1.2, 1.8, 24))
    task = replace(motion_task(scene.problem(), 20.0), tip_paths=(), guesses=(scene.goal,))
    with pytest.raises(MotionNotFound) as caught:
        find_motion(task)
    reason = caught.value.diagnosis.reason
    assert "'the long wall'" in reason
    assert "mm from the goal" in reason
    assert any("interpolation 1" in line for line in caught.value.diagnosis.evidence["tried"])
    assert caught.value.diagnosis.advice


def test_the_time_limit_ends_the_search() -> None:
    """A deadline that has passed, or a time limit too short to plan in, ends in TimeLimitReached with that advice."""
    task = motion_task(clutter(5, 40).problem())
    with pytest.raises(TimeLimitReached, match="time limit") as caught:
        find_motion(replace(task, deadline=Deadline.after(0.0)))
    assert any(each.startswith("raise planner.time_limit: ") for each in caught.value.diagnosis.advice)
    with pytest.raises(TimeLimitReached):
        MotionPlanner().plan(clutter(5, 40).problem(time_limit=1e-6))


def gap_scene(gap: float, radius: float = 0.03) -> Problem:
    """A goal behind two walls with a gap between them."""
    arm = make_arm(24, radius)
    walls = (
        Obstacle("upper", PlaneShape(shapely.box(0.4, 0.5 * gap, 0.45, 1.3))),
        Obstacle("lower", PlaneShape(shapely.box(0.4, -1.3, 0.45, -0.5 * gap))),
    )
    start = np.full(24, 2.0)
    return Scene(arm, Workspace(ROOM, walls), start, start).problem(TipGoal(np.array([0.7, 0.0])))


@pytest.mark.parametrize(
    ("gap", "expected"),
    [(0.2, (0.06, 0.024)), (0.0631, (0.024,)), (0.0615, (0.009, 0.024)), (0.0602, (0.0012, 0.024))],
)
def test_margins_leave_the_narrowest_gap_open(gap: float, expected: tuple[float, ...]) -> None:
    """Margins that would close the way are left out; when none fits, one of half the room comes first."""
    margins = fitting_margins(motion_task(gap_scene(gap)))
    np.testing.assert_allclose(margins, expected, rtol=0.02)


def test_a_gap_hardly_wider_than_the_arm_has_a_route() -> None:
    """Where the usual inflation of the walls closes every way, the least one is used."""
    problem = gap_scene(0.0604)
    ends = resolve_ends(problem)
    margin = route_room(problem, ends).inflation
    assert 0.03 < margin < 0.0302
    assert find_routes(problem, ends, FreeSpace(problem.workspace, margin))


@pytest.mark.parametrize("links", [12, 24, 36])
def test_guides_lead_chains_out_of_a_horn(links: int) -> None:
    """A goal that the curve shows exactly leaves the blend of it without effect, and no step stands still for that."""
    task = replace(motion_task(ompl_scenes.horn(links)), optimiser="none")
    motion = find_motion(task, CANDIDATES)
    assert len(task.certificate.failures(motion.configurations)) == 0
    np.testing.assert_allclose(motion.configurations[-1], task.goal_pose, atol=EXACT)


def only_with_few_links(task: MotionTask, failures: list[Failure]) -> Motion | None:
    """What candidates find for fewer than forty links."""
    return find_by_candidates(task, failures) if task.arm.links < 40 else None


def test_what_cannot_be_lifted_is_found_again() -> None:
    """Where a fold is so narrow that the finer arm lies across a wall, the same candidate leads it."""
    task = replace(motion_task(ompl_scenes.horn(48)), optimiser="none")
    motion = find_motion(task, (Strategy("few", only_with_few_links),))
    assert "lifted" not in motion.candidate
    assert len(task.certificate.failures(motion.configurations)) == 0
    np.testing.assert_allclose(motion.configurations[-1], task.goal_pose, atol=EXACT)
