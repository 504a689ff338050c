"""Guides, the continuation that follows them, settling and polish, and the smooth path through the keyframes."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import unit_vector
from ccm_opt.planning.continuation import GuideCandidate, Stalled, follow, settle
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.guides import PoseLed, TipLed, TipTrack
from ccm_opt.planning.hairpin import FoldTrack, fold_track
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion_task import CachedItems
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.search_run import first_candidates
from ccm_opt.planning.settings import GoalSettings, StepSettings
from ccm_opt.planning.spline_path import certified_spline, clamped_spline
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.tip_paths import TipPath, find_tip_paths, round_base
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .scenes import (
    ROOM,
    Scene,
    clutter,
    later,
    make_arm,
    make_stepper,
    motion_task,
    open_scene,
    random_headings,
    self_gap,
    sweep_gaps,
    swept,
    wall_gaps,
)

seeds = st.integers(0, 2**32 - 1)


def goal_coordinates(stepper: Stepper, headings: FloatArray) -> FloatArray:
    """Coordinates of a pose near given headings."""
    return stepper.space.fitted(stepper.space.arm.bends(headings))


def stack_configurations(poses: list[Pose]) -> FloatArray:
    """The configurations of poses."""
    return np.array([pose.q for pose in poses])


def walled_off() -> Scene:
    """A scene whose only obstacle is a long wall between start and goal."""
    wall = Obstacle("wall", PlaneShape(shapely.LineString([(0.12, 0.12), (1.2, 1.2)]), 0.01))
    room = open_scene(0).workspace.boundary
    return Scene(make_arm(), Workspace(room, (wall,)), np.full(24, 0.3), np.full(24, 1.3))


def followed(stepper: Stepper, start: Pose, candidate: GuideCandidate) -> tuple[list[Pose], bool]:
    """The poses to which a candidate leads, and whether it came to its end."""
    guide = candidate.make_guide()
    try:
        poses = follow(stepper, guide, start, later())
        arrived = True
    except Stalled as stalled:
        poses = stalled.poses
        arrived = False
    for resume in candidate.resume:
        try:
            return poses + follow(stepper, resume(guide, poses[-1]), poses[-1], later())[1:], True
        except Stalled as stalled:
            poses = poses + stalled.poses[1:]
            arrived = False
    return poses, arrived


@pytest.mark.drawn(2)
@pytest.mark.planning
@pytest.mark.parametrize("turn", [1.5, 2.3, -2.0])
@pytest.mark.parametrize("heading", [0.0, 1.0])
def test_every_candidate_reaches_its_end_in_the_open(turn: float, heading: float) -> None:
    """From a straight arm to a bow on its other side, interpolation, tip and fold all lead to the goal, safely."""
    room = Workspace(ROOM)
    bow = heading + turn + np.linspace(0.0, 1.0, 24)
    scene = Scene(make_arm(), room, np.full(24, heading), bow)
    stepper, start = make_stepper(scene)
    paths = motion_task(scene.problem()).tip_paths[:1]
    tried = list(first_candidates(stepper, start, (goal_coordinates(stepper, scene.goal),), paths))
    assert len(tried) >= 3
    for candidate in tried:
        poses, arrived = followed(stepper, start, candidate)
        assert poses[0] is start
        assert arrived, candidate.name
        assert np.hypot(*(poses[-1].points[-1] - scene.goal_tip.position)) < 0.1
        assert len(Certificate(scene.arm, room).failures(stack_configurations(poses))) == 0


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("seed", range(3))
def test_wherever_a_candidate_leads_it_leads_safely(seed: int) -> None:
    """In clutter the way to where a candidate arrives or stalls touches nothing in a sweep between its poses."""
    scene = clutter(seed, 30)
    stepper, start = make_stepper(scene)
    paths = motion_task(scene.problem()).tip_paths[:1]
    for candidate in first_candidates(stepper, start, (goal_coordinates(stepper, scene.goal),), paths):
        headings = scene.arm.headings(stack_configurations(followed(stepper, start, candidate)[0]))
        fine = np.vstack([swept(a, b, 4)[:-1] for a, b in pairwise(headings)])
        assert min(sweep_gaps(scene.arm, scene.workspace, fine)) > 0.0, candidate.name


def test_among_many_walls_every_tip_path_comes_before_the_first_pose_at_the_goal() -> None:
    """The tip is led along each path, shortest first and once, and nothing is asked of the poses before that."""
    scene = clutter(3, 30)
    stepper, start = make_stepper(scene)
    paths = motion_task(scene.problem()).tip_paths
    crowded = replace(stepper, settings=replace(stepper.settings, many_walls=20))

    def poses() -> Iterator[FloatArray]:
        asked.append(True)
        yield goal_coordinates(stepper, scene.goal)

    asked: list[bool] = []
    tried = first_candidates(crowded, start, CachedItems(poses()), paths)
    led = [next(tried).name for _ in paths]
    assert not asked
    shortest_first = sorted(paths, key=lambda path: path.length)
    assert led == [f"tip-led, {path.name}" for path in shortest_first]
    rest = [candidate.name for candidate in tried]
    assert asked
    assert not any(name.startswith("tip-led") for name in rest)


def test_a_route_leaves_the_base_straight() -> None:
    """The base, which the tip has to pass on one side, is no obstacle to the route that begins there."""
    points = make_arm().joint_positions(np.zeros(24))
    for turn in np.linspace(0.5, 5.5, 6):
        goal = 0.9 * np.array([np.cos(turn), np.sin(turn)])
        route = np.stack((points[0], goal))
        for path in find_tip_paths(FreeSpace(Workspace(ROOM), 0.016), points, (route,), 0.016):
            np.testing.assert_allclose(path.from_joint(points, 0), route, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_interpolation_arrives_near_its_end(seed: int) -> None:
    """In the open the interpolation ends with every link near its target, having moved the target only forwards."""
    scene = open_scene(seed)
    stepper, start = make_stepper(scene)
    goal = goal_coordinates(stepper, scene.goal)
    poses = follow(stepper, PoseLed(stepper.space, start.v, goal), start, later())
    assert np.abs(np.cumsum(poses[-1].q - stepper.space.configurations(goal))).max() < 0.15


def test_the_tip_is_led_along_the_track() -> None:
    """In the open the tip stays near the track it is led along and ends near the track's end."""
    scene = Scene(make_arm(), open_scene(0).workspace, np.linspace(0.0, 1.5, 24), np.zeros(24))
    stepper, start = make_stepper(scene)
    way = np.vstack((start.points[-1], [[0.5, 0.3], [0.6, -0.3]]))
    track = TipTrack.along(way)
    poses = follow(stepper, TipLed(stepper.space, track), start, later())
    tips = np.array([pose.points[-1] for pose in poses])
    line = shapely.LineString(way)
    assert shapely.distance(shapely.points(tips), line).max() < 0.06
    assert np.hypot(*(tips[-1] - way[-1])) < 0.08
    along = shapely.line_locate_point(line, shapely.points(tips))
    assert np.diff(along).min() > -0.02


def test_a_stalled_guide_tells_the_way_there() -> None:
    """Before a wall without a way round, the guide gives up; its poses lead clear from the start to where it stuck."""
    scene = walled_off()
    stepper, start = make_stepper(scene)
    guide = PoseLed(stepper.space, start.v, goal_coordinates(stepper, scene.goal))
    with pytest.raises(Stalled, match="interpolation stopped") as caught:
        follow(stepper, guide, start, later(), patience=10)
    poses = caught.value.poses
    assert poses[0] is start
    assert np.abs(np.cumsum(poses[-1].q - start.q)).max() > 0.2
    assert min(sweep_gaps(scene.arm, scene.workspace, scene.arm.headings(stack_configurations(poses)))) > 0.0


def test_a_passed_deadline_stops_the_continuation() -> None:
    """A guide in full swing is stopped at the deadline, after one step at the latest."""
    scene = open_scene(1)
    stepper, start = make_stepper(scene)
    guide = PoseLed(stepper.space, start.v, goal_coordinates(stepper, scene.goal))
    with pytest.raises(Stalled) as caught:
        follow(stepper, guide, start, Deadline.after(0.0))
    assert len(caught.value.poses) <= 2


@settings(max_examples=25)
@given(seed=seeds, links=st.sampled_from((12, 24, 60)), free=st.booleans())
def test_polish_meets_the_goal_to_a_nanometre(seed: int, links: int, *, free: bool) -> None:
    """From a few millimetres and hundredths of a radian off, the tip ends within 1e-9 m and, if asked, 1e-9 rad."""
    rng = np.random.default_rng(seed)
    arm = make_arm(links)
    space, v = LinkSpace.through(arm, arm.bends(random_headings(rng, arm, 5.0)))
    points = space.pose(v).points
    last = arm.headings(space.configurations(v))[-1]
    heading = None if free else float(last + rng.uniform(-0.05, 0.05)) + 2.0 * np.pi * int(rng.integers(-1, 2))
    inwards = 0.004 * (points[0] - points[-1]) / np.hypot(*(points[0] - points[-1]))
    direction = None if heading is None else unit_vector(heading)
    goal = GoalPose(points[-1] + inwards + rng.uniform(-0.001, 0.001, 2), direction)
    final = moved_onto(space, goal, space.pose(v)).v
    assert np.hypot(*(space.pose(final).points[-1] - goal.position)) < 2.0 * GoalSettings().polish_tolerance
    turn = arm.headings(space.configurations(final))[-1] - (last if heading is None else heading)
    assert (
        heading is None or abs(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi) < 2.0 * GoalSettings().polish_tolerance
    )
    assert np.abs(np.cumsum(space.configurations(final) - space.configurations(v))).max() < 0.5


@pytest.mark.parametrize("heading", [True, False])
def test_settling_ends_on_the_goal(heading: bool) -> None:
    """From some way off, the tip is drawn onto the goal pose exactly; every pose keeps clear and within limits."""
    scene = clutter(5, 20)
    stepper, pose = make_stepper(scene)
    turn = unit_vector(float(scene.arm.headings(pose.q)[-1]) + 0.2) if heading else None
    inwards = 0.03 * (pose.points[0] - pose.points[-1]) / np.hypot(*pose.points[-1])
    goal = GoalPose(pose.points[-1] + inwards, turn)
    poses = settle(stepper, goal, pose, later())
    assert goal.errors(poses[-1]) == pytest.approx((0.0, 0.0), abs=10.0 * GoalSettings().polish_tolerance)
    assert min(sweep_gaps(scene.arm, scene.workspace, scene.arm.headings(stack_configurations(poses)))) > 0.0
    within = 0.5 * (1.0 + StepSettings().limit_share) * scene.arm.bend_limits + 1e-9
    assert (np.abs(stack_configurations(poses)) <= within).all()


def test_settling_behind_an_obstacle_stalls() -> None:
    """A goal inside an obstacle is not reached, and the message says how far off the tip ended."""
    scene = open_scene(3)
    tip = make_arm().joint_positions(np.zeros(24))[-1]
    goal = tip + np.array([-0.05, 0.08])
    post = Workspace(scene.workspace.boundary, (Obstacle("post", PlaneShape(shapely.Point(goal), 0.03)),))
    stepper, pose = make_stepper(Scene(scene.arm, post, np.zeros(24), np.zeros(24)))
    with pytest.raises(Stalled, match=r"corrections at the goal ended \d+\.\d mm and \d+\.\d° away") as caught:
        settle(stepper, GoalPose(goal, None), pose, later())
    gaps = wall_gaps(scene.arm, post, np.array([p.points for p in caught.value.poses]))
    assert gaps.min() > 0.0


@settings(max_examples=40)
@given(seed=seeds)
def test_the_goal_heading_is_approached_the_short_way(seed: int) -> None:
    """The turn still to go leads onto the goal heading, up to whole turns, and is never more than half a turn."""
    rng = np.random.default_rng(seed)
    stepper, pose = make_stepper(open_scene(0))
    heading = float(rng.uniform(-12.0, 12.0))
    goal = GoalPose(rng.normal(size=2), unit_vector(heading))
    (turn,) = goal.turn(pose)
    assert abs(turn) <= np.pi
    assert np.cos(stepper.space.arm.headings(pose.q)[-1] + turn - heading) == pytest.approx(1.0)
    assert goal.errors(pose)[0] == pytest.approx(np.linalg.norm(goal.position - pose.points[-1]))
    assert GoalPose(goal.position, None).turn(pose) == 0.0
    assert stepper.space.arm.links == len(pose.q)


@settings(max_examples=40)
@given(seed=seeds)
def test_a_track_is_measured_by_arc_length(seed: int) -> None:
    """Places on a track are shapely's at the same length, repeated points or not; beyond its ends it stands still."""
    rng = np.random.default_rng(seed)
    points = np.repeat(rng.uniform(-1.0, 1.0, (6, 2)), rng.integers(1, 3, 6), axis=0)
    track = TipTrack.along(points)
    line = shapely.LineString(points)
    assert track.length == pytest.approx(line.length)
    for arc in rng.uniform(0.0, line.length, 5):
        place = shapely.get_coordinates(line.interpolate(arc))[0]
        np.testing.assert_allclose(track.at(arc), place, atol=1e-12)
    np.testing.assert_allclose(track.at(-1.0), points[0])
    np.testing.assert_allclose(track.at(1e3), points[-1])


@settings(max_examples=40)
@given(seed=seeds, first=st.floats(-20.0, 20.0))
def test_a_tracks_heading_is_its_tangent_unwrapped(seed: int, first: float) -> None:
    """Away from corners the heading is the leg's; it starts in the winding nearest to the one asked for."""
    rng = np.random.default_rng(seed)
    turns = np.cumsum(np.append(rng.uniform(-3.0, 3.0), rng.uniform(-2.5, 2.5, 4)))
    points = np.vstack((np.zeros(2), np.cumsum(np.stack((np.cos(turns), np.sin(turns)), axis=1), axis=0)))
    track = FoldTrack.smoothed(points, 0.2, first)
    headings = track.heading(np.arange(5) + 0.5)
    np.testing.assert_allclose(np.diff(headings), np.diff(turns), atol=1e-9)
    assert np.cos(headings[0] - turns[0]) == pytest.approx(1.0)
    assert abs(headings[0] - first) <= np.pi + 1e-9


def swept_angle(path: FloatArray, centre: FloatArray) -> float:
    """Angle by which a polyline (k, 2) turns about a point."""
    rays = path - centre
    a = rays[:-1]
    b = rays[1:]
    return float(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum())


@settings(max_examples=40)
@given(seed=seeds)
def test_the_base_is_passed_on_either_side(seed: int) -> None:
    """Back along the arm, round the base, out along the route: on the two sides a whole turn about the base apart."""
    scene = open_scene(seed % 30)
    points = scene.arm.joint_positions(scene.start)
    route = scene.arm.joint_positions(scene.goal)
    ways = {side: round_base(points, route, side) for side in (1, -1)}
    for way in ways.values():
        np.testing.assert_allclose(way[[0, -1]], [points[-1], route[-1]])
        assert np.linalg.norm(way - points[0], axis=1).min() > 1e-4
    turns = {side: swept_angle(way, points[0]) for side, way in ways.items()}
    assert turns[1] - turns[-1] == pytest.approx(2.0 * np.pi)


@pytest.mark.parametrize("seed", [1, 4, 9])
def test_tip_paths_are_free_and_lead_from_tip_to_goal(seed: int) -> None:
    """Both sides of a route give a path clear of all obstacles, taut or shorter than the way round, shortest first."""
    scene = clutter(seed, 20)
    points = scene.arm.joint_positions(scene.start)
    route = scene.arm.joint_positions(scene.goal)
    paths = find_tip_paths(FreeSpace(scene.workspace, scene.arm.radius + 1e-3), points, (route,), 0.0)
    assert {path.side for path in paths} == {1, -1}
    assert [path.length for path in paths] == sorted(path.length for path in paths)
    for path in paths:
        np.testing.assert_allclose(path.taut[[0, -1]], [points[-1], route[-1]], atol=1e-9)
        assert path.length <= _length(round_base(points, route, path.side)) + 0.05  # the base is passed at a distance
        line = shapely.LineString(path.taut)
        assert min(line.distance(wall.core) for wall in scene.workspace.walls) >= 0.5 * scene.arm.radius
        _starts_at_every_joint(path, points)


def _length(path: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _starts_at_every_joint(path: TipPath, points: FloatArray) -> None:
    for joint in (0, 7, 24):
        way = path.from_joint(points, joint)
        np.testing.assert_allclose(way[[0, -1]], [points[joint], path.taut[-1]], atol=1e-3)


def led_motion(seed: int) -> tuple[Scene, FloatArray]:
    """A certified motion in clutter: an interpolation as far as it comes."""
    scene = clutter(seed, 15)
    stepper, start = make_stepper(scene)
    guide = PoseLed(stepper.space, start.v, goal_coordinates(stepper, scene.goal))
    try:
        poses = follow(stepper, guide, start, later(), patience=5)
    except Stalled as stalled:
        poses = stalled.poses
    return scene, stack_configurations(poses)


@pytest.mark.parametrize("seed", range(6))
def test_the_smooth_path_is_certified_finer_than_it_was_made(seed: int) -> None:
    """The spline runs from the first to the last keyframe; between samples eight times as dense it is certified."""
    scene, keyframes = led_motion(seed)
    certificate = Certificate(scene.arm, scene.workspace)
    assert len(certificate.failures(keyframes)) == 0
    spline = certified_spline(keyframes, certificate)
    assert isinstance(spline, BSpline)
    np.testing.assert_allclose(spline([0.0, 1.0]), keyframes[[0, -1]], atol=1e-12)
    fine = spline(np.linspace(0.0, 1.0, 32 * (len(spline.c) - 3) + 1))
    assert len(certificate.failures(fine)) == 0
    samples = scene.arm.joint_positions_at(fine[::8])
    assert min(wall_gaps(scene.arm, scene.workspace, samples).min(), self_gap(scene.arm, samples)) > 0.0


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9])
def test_few_keyframes_make_a_path_too(count: int) -> None:
    """Any number of keyframes makes a C² spline that starts and ends on them and stays in their hull."""
    scene = open_scene(2)
    start = scene.arm.bends(scene.start)
    keyframes = swept(start, start + 0.01, max(count - 1, 1))[:count]
    spline = certified_spline(keyframes, Certificate(scene.arm, scene.workspace))
    assert spline is not None
    u = np.linspace(0.0, 1.0, 101)
    np.testing.assert_allclose(spline(u[[0, -1]]), keyframes[[0, -1]], atol=1e-12)
    assert (spline(u) >= keyframes.min(axis=0) - 1e-12).all()
    assert (spline(u) <= keyframes.max(axis=0) + 1e-12).all()


@settings(max_examples=20)
@given(seed=seeds, count=st.integers(4, 30))
def test_the_clamped_spline_is_twice_differentiable(seed: int, count: int) -> None:
    """At every knot the second derivative from the left and from the right agree."""
    spline = clamped_spline(np.random.default_rng(seed).normal(size=(count, 3)))
    knots = np.unique(spline.t)[1:-1]
    bend = spline.derivative(2)
    np.testing.assert_allclose(bend(knots - 1e-9), bend(knots + 1e-9), atol=1e-4 * count**3)


def test_a_motion_without_room_has_no_smooth_path() -> None:
    """Keyframes that touch an obstacle cannot be smoothed: there is no path rather than an unsafe one."""
    scene = walled_off()
    keyframes = scene.arm.bends(swept(scene.start, scene.goal, 8))
    assert certified_spline(keyframes, Certificate(scene.arm, scene.workspace)) is None


@given(st.integers(0, 10_000), st.integers(1, 6), st.sampled_from((-1.0, 1.0)))
@settings(max_examples=20, deadline=None)
def test_a_fold_joins_its_route_wherever_that_has_vertices(seed: int, extra: int, side: float) -> None:
    """Vertices added to a route on its straight legs do not move the track of a fold."""
    rng = np.random.default_rng(seed)
    points = np.stack((np.linspace(0.0, 1.0, 25), 0.1 * np.sin(np.linspace(0.0, 3.0, 25))), axis=1)
    route = np.array([points[6], [0.3, 0.3], [0.1, 0.6], [0.5, 0.9]])
    at = np.sort(rng.uniform(0.0, 3.0, extra))
    more = np.stack([np.interp(np.union1d(at, np.arange(4.0)), np.arange(4.0), route[:, k]) for k in (0, 1)], axis=1)
    plain, divided = (fold_track(points, 6, way, side, 0.03, 0.08, 0.0) for way in (route, more))
    arcs = np.linspace(0.0, plain[0].length, 50)
    np.testing.assert_allclose(plain[0].at(arcs), divided[0].at(arcs), atol=1e-9)
    np.testing.assert_allclose(plain[1], divided[1])


def test_what_is_remembered_is_made_once() -> None:
    """Items are made when first asked for, and given again from the first to every later asker."""
    made: list[int] = []

    def items() -> Iterator[FloatArray]:
        for k in range(3):
            made.append(k)
            yield np.array([float(k)])

    remembered = CachedItems(items())
    assert next(iter(remembered))[0] == 0.0
    assert made == [0]
    assert [item[0] for item in remembered] == [item[0] for item in remembered] == [0.0, 1.0, 2.0]
    assert made == [0, 1, 2]
