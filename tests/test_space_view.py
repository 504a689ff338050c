"""The viewer on a plan in space: poses at any time, directions of handles, and a plan that follows its goal."""

import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.cli.view.app import ViewerApp, claim_port
from ccm_opt.cli.view.dragging import GOAL
from ccm_opt.cli.view.frames import MotionFrames, cut_away, rotation_to_axis
from ccm_opt.cli.view.scene import Scene, rotation_matrix
from ccm_opt.core.errors import ProblemError
from ccm_opt.driver.live_plan import LivePlan
from ccm_opt.problem import Problem, Stop, TipGoal, Tolerances
from ccm_opt.scene.bodies import BoxBody, CapsuleBody, CylinderBody, MeshBody, RigidPlacement, SphereBody
from ccm_opt.scene.workspace import Obstacle, Workspace
from ccm_opt.verification.verifier import verify

from .space_folders import solved
from .test_live_plan import cost


@cache
def problem() -> Problem:
    """An arm beside a ball and a box."""
    return ccm_opt.make_problem(
        "beside",
        arm={"links": 10, "link_length": 0.05, "radius": 0.01, "base": {"position": (0, 0, 0)}, "joint_limit_deg": 60},
        obstacles={
            "ball": {"sphere": {"center": (0.35, 0.3, 0.0), "radius": 0.05}},
            "box": {"box": ((0.3, -0.4, -0.2), (0.4, -0.2, 0.2))},
        },
        limits={"velocity": 1.0, "acceleration": 4.0, "torque": 20.0},
        goal={"name": "spot", "position": (0.25, 0.3, 0.1), "direction": (0, 1, 0)},
    )


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1))
def test_handles_turn_as_space_does(vector: tuple[float, float, float]) -> None:
    """A quaternion of a direction turns world x to it, and gives it back; straight back too."""
    direction = np.array(vector) / np.linalg.norm(vector)
    for each in (direction, np.array([-1.0, 0.0, 0.0])):
        wxyz = rotation_to_axis(each)
        matrix = trimesh.transformations.quaternion_matrix(wxyz)[:3, :3]
        np.testing.assert_allclose(rotation_matrix(wxyz), matrix, atol=1e-6)
        np.testing.assert_allclose(matrix[:, 0], each, atol=1e-6)


@given(axis=st.integers(0, 2), place=st.floats(-1.2, 1.2))
def test_a_cut_leaves_what_is_below_the_plane(axis: int, place: float) -> None:
    """All that is left is below, and of a ball it is as much surface as that of a cap."""
    ball = trimesh.creation.icosphere(3)
    vertices, faces = cut_away((np.asarray(ball.vertices), np.asarray(ball.faces)), axis, place)
    assert np.all(vertices[:, axis] <= place + 1e-9)
    cap = 2.0 * np.pi * np.clip(place + 1.0, 0.0, 2.0)  # Archimedes' hat-box
    # Facets lie at most 1.2 % within the ball, and have 1.2 % less surface.
    assert trimesh.Trimesh(vertices, faces, process=False).area == pytest.approx(cap, abs=0.03 * 4.0 * np.pi)


def test_poses_gaps_and_torques_are_those_of_the_plan() -> None:
    """At samples the pose is the plan's; the least gap is about the verifier's; shares of torque are of its limits."""
    plan = solved()
    frames = MotionFrames(plan.problem, plan.trajectory, plan.joints)
    for k in (0, len(plan.trajectory.time) // 2, -1):
        expected = plan.problem.arm.joint_positions_at(plan.trajectory.positions[k])
        np.testing.assert_allclose(frames.pose(plan.trajectory.time[k]), expected, atol=1e-12)
    first = int(np.ceil(plan.problem.arm.mount_length / plan.problem.arm.link_length))
    least = min(frames.gaps(at)[first:].min() for at in np.linspace(0.0, frames.duration, 200))
    beyond = plan.metrics["least_wall_clearance_m"] - plan.problem.workspace.clearance
    assert least == pytest.approx(min(beyond, 0.1 * plan.problem.arm.length), abs=2e-3)
    limit = plan.problem.limits.torque
    assert limit is not None
    peak = max(frames.torque_shares(at).max() for at in plan.trajectory.time)
    assert peak == pytest.approx((np.abs(plan.joints.torques) / limit).max())


def test_a_plan_follows_its_goal_or_says_why_not() -> None:
    """A goal that moves is planned and verified; one in the box is explained, and the last plan stays."""
    live = LivePlan(problem())
    answer = live.move_goal((0.2, 0.32, 0.05), np.array([0.0, 2.0, 1.0]))
    assert answer.current
    assert all(check.passed for check in live.plan.checks)
    tip = problem().arm.joint_positions_at(live.plan.trajectory.positions[-1])[-1]
    assert tip == pytest.approx([0.2, 0.32, 0.05], abs=1e-3)
    kept = live.plan
    refused = live.move_goal((0.35, -0.3, 0.0))
    assert not refused.current
    assert "'box'" in refused.reason
    assert live.plan is kept
    assert live.move_goal((0.2, 0.32, 0.05)).current
    before = cost(live.plan)
    assert live.plan_anew(5.0).current
    assert cost(live.plan) <= before + 1e-9
    with pytest.raises(ProblemError, match="a position"):
        live.move_goal((0.1, 0.2))


def test_a_plan_follows_its_obstacles_or_says_why_not() -> None:
    """An obstacle that stays far off changes no motion; one in the way is gone round; one over the arm is named."""
    live = LivePlan(problem())
    first = live.plan
    assert live.move_obstacle("box", (0.0, -0.05, 0.0)).current
    assert live.plan.trajectory is first.trajectory
    assert live.plan.problem is live.problem
    assert live.problem.workspace.obstacle_centre("box") == pytest.approx([0.35, -0.35, 0.0])
    # Halfway along the path that the middle of the arm takes.
    on_the_way = problem().arm.joint_positions_at(first.trajectory.positions[len(first.trajectory.time) // 2])[-1]
    answer = live.move_obstacle("ball", on_the_way - live.problem.workspace.obstacle_centre("ball"))
    if answer.current:
        assert all(check.passed for check in live.plan.checks)
        again = verify(live.problem, live.plan.trajectory, live.plan.joints)
        assert all(check.passed for check in again)
        assert live.plan.trajectory is not first.trajectory
    else:
        assert answer.reason
    kept = live.plan
    refused = live.move_obstacle("ball", np.array([0.2, 0.0, 0.0]) - live.problem.workspace.obstacle_centre("ball"))
    assert not refused.current
    assert "start" in refused.reason
    assert "'ball'" in refused.reason
    assert live.plan is kept
    assert live.move_obstacle("ball", (0.0, 0.0, 5.0)).current
    with pytest.raises(ProblemError, match="no obstacle 'bull'; there are ball, box"):
        live.move_obstacle("bull", (0.0, 0.0, 0.1))
    stays = live.problem
    for far in (1e39, 1e308, np.inf, np.nan):
        with pytest.raises(ProblemError, match="a displacement"):
            live.move_obstacle("ball", (far, 0.0, 0.0))
    assert live.problem is stays
    with suppress(ProblemError):
        live.move_obstacle("ball", (1e15, 0.0, 0.0))
    with pytest.raises(ProblemError, match="the scene reaches to"):
        live.move_obstacle("ball", (1e15, 0.0, 0.0))
    assert np.all(np.abs(live.problem.workspace.obstacle_centre("ball")) <= 1e15)


def test_any_goal_of_several_can_be_dragged() -> None:
    """The motions to and from it are adapted, not searched for, and the others stay; the plan passes the verifier."""
    beside = problem()
    first, last = beside.goal, TipGoal(np.array([0.3, 0.1, 0.2]))
    live = LivePlan(replace(beside, stops=(Stop(first, Tolerances()),), goal=last))
    before = live.plan
    for number in (2, 1):
        place = live.problem.goals[number - 1].goal.tip(beside.arm) + 0.01
        answer = live.move_goal(place, number=number)
        assert answer.current
        assert answer.same_route
        plan = live.plan
        assert all(check.passed for check in verify(plan.problem, plan.trajectory, plan.joints))
        np.testing.assert_array_equal(plan.problem.goals[number - 1].goal.tip(beside.arm), place)
        assert plan.trajectory.duration < 1.5 * before.trajectory.duration
    with pytest.raises(ProblemError, match="the number of a goal, 1 to 2"):
        live.move_goal((0.3, 0.1, 0.2), number=3)


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3))
def test_moved_bodies_are_the_same_elsewhere(by: list[float]) -> None:
    """Every triangle of every kind of body is moved by as much, and keeps its rounding; so is its middle."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    sides = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    turned = RigidPlacement.turned(np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.0, 1.0]))
    bodies = (
        BoxBody(np.zeros(3), np.ones(3), turned),
        SphereBody(np.ones(3), 0.3),
        CapsuleBody(np.zeros(3), np.ones(3), 0.1),
        # Where two coordinates of its axis are alike, rounding decides how the prism about it is turned.
        CylinderBody(np.zeros(3), np.array([0.2, 0.5, 1.0]), 0.1),
        MeshBody.of_arrays(corners, sides),
    )
    for body in bodies:
        room = Workspace(bounds=None, obstacles=(Obstacle("it", body), Obstacle("other", body)))
        moved = room.with_moved("it", np.array(by))
        assert moved.obstacles[1] is room.obstacles[1]
        np.testing.assert_allclose(moved.obstacles[0].body.triangles, body.triangles + by, atol=1e-9)
        assert moved.obstacles[0].body.rounding == body.rounding
        np.testing.assert_allclose(moved.obstacle_centre("it"), room.obstacle_centre("it") + by, atol=1e-12)


TOWARDS_Y = np.array([1.0, -1.0, 0.0, 0.0]) / np.sqrt(2.0)
"""Rotation of a camera, whose z axis is its direction of view and whose y axis points down, that looks along y."""


@pytest.fixture
def viewer() -> Iterator[ViewerApp]:
    """The page of a plan in space."""
    live = LivePlan(problem())
    plan = live.plan
    app = ViewerApp(MotionFrames(plan.problem, plan.trajectory, plan.joints), live, claim_port(0), plan.checks)
    stop = threading.Event()
    thread = threading.Thread(target=app.run, args=(stop.is_set,))
    thread.start()
    yield app
    stop.set()
    thread.join(20.0)


def all_work_is_seen(scene: Scene, aspect: float) -> None:
    """Check that the free part of a window shows the goal and all that the arm reaches."""
    camera = SimpleNamespace(aspect=aspect, fov=0.8)
    scene.look(SimpleNamespace(camera=camera))  # type: ignore[arg-type]
    ahead = camera.look_at - camera.position
    across = np.cross(ahead, (0.0, 0.0, 1.0))
    axes = np.column_stack([v / np.linalg.norm(v) for v in (across, np.cross(across, ahead), -ahead)])
    seen = (scene.world(scene.frames.points[:, 1:]).reshape(-1, 3) - camera.position) @ axes
    x, y = (seen[:, :2] / -seen[:, 2:] / np.tan(0.4)).T
    assert np.max(np.abs(x)) < aspect
    low, high = (0.2, 1.0) if aspect < 1.0 else (-1.0, 1.0)
    assert low < np.min(y) < np.max(y) < high


def test_the_page_plays_and_follows_its_plan(viewer: ViewerApp) -> None:
    """It is served to this machine alone; it plays; layers and colours switch; a goal that moves is planned."""
    assert viewer.address.startswith("http://127.0.0.1:")
    began = viewer.time
    deadline = time.monotonic() + 20.0
    while viewer.time == began and time.monotonic() < deadline:
        time.sleep(0.05)
    assert viewer.time > began
    scene = viewer.scene
    with viewer._lock:  # it plays on meanwhile
        for layer in scene.layers:
            scene.switch(layer, on=True)
            scene.switch(layer, on=False)
        for meaning in ("gap", "torque"):
            scene.colour_by = meaning
            scene.pose(0.5)
        viewer._cut("y", 0.0)
        assert list(scene._obstacles) == ["/room/box"]  # whose lowest side is in the plane
        viewer._cut("nothing", 0.0)
        scene.shade(0.9)
        assert {mesh.opacity for mesh in scene._obstacles.values()} == {0.9}
        assert len(scene._obstacles) == 2
        # From far away all names are in one place, and only that of the goal is shown.
        camera = SimpleNamespace(position=np.array([0.0, -1e4, 0.0]), wxyz=TOWARDS_Y, fov=0.8, image_height=800)
        scene.switch("names", on=True)
        scene.arrange_names(camera)  # type: ignore[arg-type]
        assert [path for path, label in scene._labels.items() if label.visible] == ["/goals/1"]
        assert scene._labels["/goals/1"].text == "spot"
        camera.position = np.array([0.6, -2.0, 0.5])
        scene.arrange_names(camera)  # type: ignore[arg-type]
        assert all(label.visible for label in scene._labels.values())
        for aspect in (0.5, 1.6):
            all_work_is_seen(scene, aspect)
    live = viewer.live
    assert isinstance(live, LivePlan)
    viewer._planned(live, live.move_goal((0.22, 0.3, 0.12)))
    assert viewer.frames.trajectory is live.plan.trajectory
    assert "planned and verified" in viewer._status.content
    assert isinstance(live.problem.goal, TipGoal)
    viewer._planned(live, live.move_goal((0.35, -0.3, 0.0)))
    assert "No plan; the last one is shown" in viewer._status.content
    assert "box" in viewer._status.content
    viewer._planned(live, live.move_goal((0.22, 0.3, 0.12)))
    assert viewer._handles is not None
    for what in ("ball", "box", f"{GOAL} ('spot')"):
        viewer._handles.attach_handle(what)
    viewer._planned(live, live.move_obstacle("box", (0.0, -0.1, 0.0)))
    assert "planned and verified" in viewer._status.content
    viewer._planned(
        live, live.move_obstacle("box", np.array([0.2, 0.0, 0.0]) - live.problem.workspace.obstacle_centre("box"))
    )
    assert "the start is in contact" in viewer._status.content
