"""The verifier on an arm with a feed axis and on motions with stops: sound, and strict against tampering."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Limits, Problem, Stop, TipGoal, Tolerances
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.verifier import verify
from ccm_opt.verification.wall_clearance import check_walls

from .arms import plain_arm

LINKS = 6
ROOM = shapely.box(-3.0, -3.0, 3.0, 3.0)


def fed_arm(hole: float = 0.0, **changes: object) -> Arm:
    """An arm of six links on an axis of 0.3 m at 30°."""
    on_axis: dict[str, object] = {"base_heading": np.pi / 6, "feed": Feed(0.0, 0.3, hole)}
    return plain_arm(LINKS, **(on_axis | changes))


def quintic(start: FloatArray, end: FloatArray) -> tuple[FloatArray, ...]:
    """Time and the values, rates and accelerations of a rest-to-rest motion of 2 s."""
    t = np.linspace(0.0, 1.0, 501)
    s = 10 * t**3 - 15 * t**4 + 6 * t**5, 30 * t**2 - 60 * t**3 + 30 * t**4, 60 * t - 180 * t**2 + 120 * t**3
    parts = [value[:, None] * (end - start) for value in s]
    return 2.0 * t, start + parts[0], parts[1] / 2.0, parts[2] / 4.0


def make_case(
    end: FloatArray, fed: float = 0.2, arm: Arm | None = None, obstacles: tuple[Obstacle, ...] = ()
) -> tuple[Problem, JointTrajectory]:
    """A problem of a whole-arm goal, and a motion that solves it when nothing is in the way."""
    arm = arm or fed_arm()
    time, *values = quintic(np.zeros(LINKS + 1), np.append(end, fed))
    one = np.ones(3 * LINKS)
    limits = Limits(2.0 * one, 10.0 * one, 20.0 * one, feed_velocity=0.25, feed_acceleration=0.5, feed_force=20.0)
    problem = Problem("fed", Workspace(ROOM, obstacles), arm, limits, JointPose(np.zeros(LINKS)), JointPose(end, fed))
    return problem, JointTrajectory(time, *values, arm.coordinates)


def states(problem: Problem, trajectory: JointTrajectory) -> JointStates:
    """The revolutes' view of a planar motion on a moving base."""
    planar = trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations
    motion = trajectory.positions, trajectory.velocities, trajectory.accelerations
    torques, force = drive_efforts(problem.arm, problem.simulation.gravity, *motion)
    revolutes = (revolute_angles(problem.arm, values) for values in planar)
    return JointStates(joint_names(problem.arm), *revolutes, torques, force)


def failing(problem: Problem, trajectory: JointTrajectory, joints: JointStates | None = None) -> set[str]:
    """Names of the checks that do not hold."""
    checks: tuple[Check, ...] = verify(problem, trajectory, joints or states(problem, trajectory))
    return {check.name for check in checks if not check.passed}


def test_a_good_motion_on_a_feed_axis_passes() -> None:
    """Every check of the axis is made and holds."""
    problem, trajectory = make_case(np.full(LINKS, 0.2))
    checks = verify(problem, trajectory, states(problem, trajectory))
    assert all(check.passed for check in checks)
    names = {check.name for check in checks}
    assert {"feed range", "feed velocity", "feed acceleration", "feed force", "joints inside the guide"} <= names
    assert {"feed force against dynamics", "feed velocity against positions", "start feed", "goal feed"} <= names


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"feed_velocity": 0.18}, "feed velocity"),
        ({"feed_acceleration": 0.25}, "feed acceleration"),
        ({"feed_force": 2.0}, "feed force"),
    ],
)
def test_limits_of_the_axis_are_held(change: dict[str, float], name: str) -> None:
    """A limit a little below what the motion needs is found; so is a share of it that is not kept."""
    problem, trajectory = make_case(np.full(LINKS, 0.2))
    kind = "effort" if "force" in name else name.split()[1]
    shared = replace(problem, limits=replace(problem.limits, **change))
    by_samples = {"feed force of the samples"} if kind == "effort" else set()
    assert failing(shared, trajectory) == {name, f"share of {kind}"} | by_samples
    problem = replace(problem, planner=replace(problem.planner, effort_share=1.0))
    assert failing(replace(problem, limits=replace(problem.limits, **change)), trajectory) == {name} | by_samples


def test_a_false_report_of_the_axis_is_found() -> None:
    """Rates and forces that do not belong to the positions, and positions beyond the range, are refused."""
    problem, trajectory = make_case(np.full(LINKS, 0.2))
    joints = states(problem, trajectory)
    on_base = np.append(np.zeros(LINKS), 1.0)
    slow = replace(trajectory, velocities=trajectory.velocities * (1.0 - 0.1 * on_base))
    assert "feed velocity against positions" in failing(problem, slow, joints)
    light = replace(joints, base_forces=0.9 * joints.base_forces)
    assert failing(problem, trajectory, light) == {"feed force against dynamics"}
    moved = replace(trajectory, positions=trajectory.positions + 0.15 * on_base)
    assert {"feed range", "start feed", "goal feed"} <= failing(problem, moved, joints)
    bends = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    assert failing(problem, JointTrajectory(trajectory.time, *bends), joints) == {"samples"}


def test_joints_inside_the_guide_stay_straight() -> None:
    """A joint that bends before it has passed the hole is refused, and so is one that bends while it passes."""
    arm = fed_arm(hole=0.25)
    bent = np.array([0.0, 0.3, 0.2, 0.2, 0.2, 0.2])
    problem, trajectory = make_case(bent, 0.2, arm)
    assert failing(problem, trajectory) == {"joints inside the guide"}
    free = np.array([0.0, 0.0, 0.0, 0.2, 0.2, 0.2])
    problem, trajectory = make_case(free, 0.2, arm)
    assert failing(problem, trajectory) == set()


def test_walls_are_met_by_a_base_that_moves() -> None:
    """An arm that keeps its shape and is pushed into a wall is refused; pushed less far, it is not."""
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    post = Obstacle("post", PlaneShape(shapely.Point(0.8 * along), 0.05))
    reach = 0.8 - 0.05 - 0.02 - 0.6
    for fed, hits in ((reach - 1e-3, False), (reach + 1e-3, True)):
        problem, trajectory = make_case(np.zeros(LINKS), fed, obstacles=(post,))
        assert ("wall clearance" in failing(problem, trajectory)) is hits


def test_a_wall_passed_between_two_samples_is_met() -> None:
    """The motion of the base between samples counts too."""
    wall = Obstacle("foil", PlaneShape(shapely.LineString([(0.75, -0.5), (0.75, 0.5)])))
    arm = fed_arm(base_heading=0.0)
    arm = replace(arm, feed=Feed(0.0, 2.0, 0.0))
    motion = ChainMotion(arm, np.array([0.0, 0.005]), np.array([[0.0] * LINKS + [0.0], [0.0] * LINKS + [2.0]]))
    assert not check_walls(motion, Workspace(ROOM, (wall,))).passed


def test_stops_are_checked_like_goals() -> None:
    """A stop must be near its goal, at rest, and there at all."""
    problem, trajectory = make_case(np.full(LINKS, 0.2))
    arm, k = problem.arm, 250
    tip = arm.joint_positions(arm.headings(trajectory.bend_angles[k]), trajectory.base_positions[k, 0])[-1]
    near = replace(problem, stops=(Stop(TipGoal(tip + np.array([0.0, 9e-4])), Tolerances()),))
    far = replace(problem, stops=(Stop(TipGoal(tip + np.array([0.0, 1.1e-3])), Tolerances()),))
    told = replace(trajectory, stops=(k,))
    assert failing(near, told) == {"rest", "feed at rest"}
    assert failing(far, told) == {"rest", "feed at rest", "stop 1 position"}
    assert failing(near, trajectory) == {"samples"}
    assert failing(problem, told) == {"samples"}


def test_the_force_on_the_axis_is_newtons() -> None:
    """Whatever the joints do, the force is the change of the arm's momentum along the axis, less gravity's part."""
    problem, trajectory = make_case(np.linspace(-0.4, 0.6, LINKS))
    arm = problem.arm
    points = arm.joint_positions(arm.headings(trajectory.bend_angles), trajectory.base_positions[:, 0])
    centres = 0.5 * (points[:, 1:] + points[:, :-1])
    momentum = np.gradient(np.tensordot(centres, arm.masses, axes=(1, 0)), trajectory.time, axis=0)
    gravity = problem.simulation.gravity[[0, 2]] * arm.masses.sum()
    force = (np.gradient(momentum, trajectory.time, axis=0) - gravity) @ arm.direction
    motion = trajectory.positions, trajectory.velocities, trajectory.accelerations
    _, own = drive_efforts(arm, problem.simulation.gravity, *motion)
    np.testing.assert_allclose(own[3:-3, 0], force[3:-3], atol=2e-3 * np.ptp(force))


@pytest.mark.parametrize(("play", "passes"), [(1e-4, True), (0.0, True), (-1e-5, False)])
@pytest.mark.parametrize("turned", [0.0, 1e-4])
def test_a_guide_as_wide_as_the_arm_touches_and_is_not_hit(play: float, turned: float, *, passes: bool) -> None:
    """A straight arm slides between two walls that are as far apart as it is wide; walls nearer than that are hit.

    So is a wall as near by an arm that is carried a little aslant.
    """
    arm = fed_arm(base_heading=0.0)
    off = arm.radius + play
    walls = (
        Obstacle("left", PlaneShape(shapely.box(-1.0, off, 2.0, 1.0))),
        Obstacle("right", PlaneShape(shapely.box(-1.0, -1.0, 2.0, -off))),
    )
    positions = np.zeros((101, LINKS + 1))
    positions[:, 0] = turned
    positions[:, -1] = np.linspace(0.0, 0.3, 101)
    motion = ChainMotion(arm, np.linspace(0.0, 1.0, 101), positions)
    check = check_walls(motion, Workspace(ROOM, walls))
    # Turned, the arm of 0.6 m comes 0.06 mm nearer at its tip.
    assert check.passed is (passes and (turned == 0.0 or play > 0.0))
