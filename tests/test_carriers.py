"""Arms on axes of any kind: kinematics, their derivatives and bounds, and the verifier's own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemFileError, UnreachableGoal
from ccm_opt.core.native import NativeCall
from ccm_opt.dynamics.algorithms.arm_model import arm_model
from ccm_opt.dynamics.runtime.inverse_dynamics import CompiledFunction, InverseDynamics
from ccm_opt.ik.tip_roll import TipRoll
from ccm_opt.io.mjcf_models import mjcf_text
from ccm_opt.io.urdf_models import urdf_text
from ccm_opt.planning import sampled_poses
from ccm_opt.planning.curve_map import CurveMap, poses_with
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.positioning import CarrierMotions
from ccm_opt.planning.sampled_poses import CurvePoints
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import BaseAxis, nearest_base, short_axes
from ccm_opt.robot.coordinates import DriveLimits, Limits
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.robot.tool import RigidBody, Tool
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.chain_motion import LinkFrames, acceleration_bounds, chain_points
from ccm_opt.verification.newton_euler import drive_efforts

from .command_runs import CommandLine

LINKS = 5
PROBLEMS = Path(__file__).parents[1] / "problems"
seeds = st.integers(0, 2**32)
counts = st.integers(1, 6)


def unit_vector(rng: np.random.Generator) -> FloatArray:
    """Return a random unit vector, shape (3,)."""
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def carried_arm(rng: np.random.Generator, axes: int, links: int = LINKS) -> Arm:
    """Return an arm in space on random axes of both kinds."""
    direction = unit_vector(rng)
    across = np.cross(direction, unit_vector(rng))
    carrier = tuple(
        BaseAxis(
            unit_vector(rng), -2.0, 2.0, revolute=bool(rng.integers(2)), point=rng.normal(size=3),
            inertia=float(rng.uniform()),
        )
        for _ in range(axes)
    )  # fmt: skip
    masses, inertia = rng.uniform(0.1, 1.0, links), rng.uniform(1e-3, 1e-2, links)
    return Arm(
        links, 0.1, 0.01, rng.normal(size=3), 1.0, 1.0, self_collision=True, mount_length=0.0, masses=masses,
        inertia_axial=inertia, inertia_transverse=2.0 * inertia,
        direction=direction, up=across / np.linalg.norm(across), carrier=carrier, payload=0.3,
    )  # fmt: skip


def equipped(arm: Arm, rng: np.random.Generator) -> Arm:
    """Return an arm in space with a body of random mass on a link, and one on the last that is a tool."""
    second = 0.03 * rng.normal(size=(2, 3, 3))
    second = np.einsum("kij,klj->kil", second, second)
    inertia = np.einsum("k,ij->kij", np.trace(second, axis1=1, axis2=2), np.eye(3)) - second
    body, tool = ({"mass": rng.uniform(0.1, 0.5), "centre": 0.05 * rng.normal(size=3), "inertia": i} for i in inertia)
    tip = 0.1 * rng.normal(size=3)
    return replace(
        arm,
        payload=0.0,
        bodies=(RigidBody(**body, link=int(rng.integers(arm.links))),),
        tool=Tool(**tool, tip=tip, direction=unit_vector(rng)),
    )


@given(seed=seeds, axes=counts)
def test_the_base_is_where_rigid_motions_bring_it(seed: int, axes: int) -> None:
    """One after the other, by the package and by the verifier, as if the arm's fixed base were there."""
    rng = np.random.default_rng(seed)
    arm = carried_arm(rng, axes)
    q = rng.uniform(-1.0, 1.0, len(arm.coordinates))
    turn, shift = Rotation.identity(), np.zeros(3)
    for axis, value in zip(arm.carrier, q[arm.coordinates.base], strict=True):
        own = Rotation.from_rotvec(value * axis.direction) if axis.revolute else Rotation.identity()
        moved = axis.point - own.apply(axis.point) if axis.revolute else value * axis.direction
        turn, shift = turn * own, shift + turn.apply(moved)
    up, direction = turn.apply(arm.up), turn.apply(arm.direction)
    still = replace(arm, carrier=(), base=turn.apply(arm.base) + shift, direction=direction, up=up)
    points = still.joint_positions_at(q[: 2 * LINKS])
    np.testing.assert_allclose(arm.joint_positions_at(q), points, atol=1e-12)
    np.testing.assert_allclose(arm.carried(q).place, points[0], atol=1e-12)
    np.testing.assert_allclose(chain_points(arm, q[None])[0], points, atol=1e-12)
    frames = LinkFrames.from_configurations(arm, q[None])
    np.testing.assert_allclose(frames.along[0], arm.link_rotations(q)[..., 0], atol=1e-12)
    np.testing.assert_allclose(frames.across[0], arm.link_rotations(q)[..., 2], atol=1e-12)


@given(seed=seeds, axes=counts)
def test_derivatives_are_those_of_the_places(seed: int, axes: int) -> None:
    """Of all joints by all coordinates, by central differences."""
    rng = np.random.default_rng(seed)
    arm = carried_arm(rng, axes)
    q = rng.uniform(-1.0, 1.0, len(arm.coordinates))
    unit = np.eye(len(q))
    pose = poses_with(arm, q[None], q[None], unit)[0]
    step = 1e-6
    ahead, back = (arm.joint_positions_at(q + sign * step * unit) for sign in (1.0, -1.0))
    np.testing.assert_allclose(pose.moving, np.moveaxis((ahead - back) / (2.0 * step), 0, -1), atol=1e-7)


@given(seed=seeds, axes=counts)
def test_no_point_accelerates_more_than_the_bounds(seed: int, axes: int) -> None:
    """While all coordinates change evenly, by the bounds of planning and by those of the verifier."""
    rng = np.random.default_rng(seed)
    arm = carried_arm(rng, axes)
    q, step = rng.uniform(-1.0, 1.0, len(arm.coordinates)), rng.normal(0.0, 0.4, len(arm.coordinates))
    bow, speed = np.zeros(LINKS + 1), np.zeros(LINKS)
    NativeCall(
        "motion_bounds", links=LINKS, lengths=arm.lengths, carrier=arm.carrier_for_c, speed=speed, bow=bow,
        rotations=arm.link_rotations(q), turns=step, bends=q, arcs=None,
    )()  # fmt: skip
    share = np.linspace(-0.5, 0.5, 201)
    points = arm.joint_positions_at(q + share[:, None] * step)
    second = np.diff(points, 2, axis=0) / (share[1] - share[0]) ** 2
    most = np.max(np.linalg.norm(second, axis=2), axis=0)
    assert np.all(most <= bow * (1.0 + 1e-9) + 1e-6)
    assert np.all(most <= acceleration_bounds(arm, q[None], step[None])[0] * (1.0 + 1e-9) + 1e-6)


@given(seed=seeds, axes=counts)
def test_efforts_are_the_power_that_a_motion_takes(seed: int, axes: int) -> None:
    """Efforts times rates are the change of kinetic and potential energy, which places alone give."""
    rng = np.random.default_rng(seed)
    arm = carried_arm(rng, axes)
    gravity = rng.normal(0.0, 9.0, 3)
    start, rate, gain = rng.uniform(-0.8, 0.8, (3, len(arm.coordinates)))
    h = 1e-4
    time = h * np.arange(-3, 4)[:, None]
    states = (start + rate * time + 0.5 * gain * time**2, rate + gain * time, np.tile(gain, (len(time), 1)))
    torques, on_axes = drive_efforts(arm, gravity, *states)
    bends = torques.reshape(len(time), LINKS, 3)[..., :2].reshape(len(time), -1)
    power = np.sum(np.hstack((bends, on_axes)) * states[1], axis=1)[3]

    def energy(q: FloatArray, v: FloatArray) -> float:
        ahead, back = q + 1e-6 * v, q - 1e-6 * v
        speeds = (arm.joint_positions_at(ahead) - arm.joint_positions_at(back)) / 2e-6
        turns = (arm.link_rotations(ahead) - arm.link_rotations(back)) / 2e-6
        spins = np.einsum("lij,lkj->lik", turns, arm.link_rotations(q))
        omega = 0.5 * np.stack((spins[:, 2, 1] - spins[:, 1, 2], spins[:, 0, 2] - spins[:, 2, 0],
                                spins[:, 1, 0] - spins[:, 0, 1]), axis=1)  # fmt: skip
        along = np.einsum("li,li->l", omega, arm.link_rotations(q)[..., 0]) ** 2
        turning = arm.inertia_transverse * (np.sum(omega**2, axis=1) - along) + arm.inertia_axial * along
        middles, places = 0.5 * (speeds[1:] + speeds[:-1]), arm.joint_positions_at(q)
        moving = arm.masses @ np.sum(middles**2, axis=1) + arm.payload * speeds[-1] @ speeds[-1]
        drives = np.array([axis.inertia for axis in arm.carrier]) @ v[arm.coordinates.base] ** 2
        lifted = arm.masses @ (0.5 * (places[1:] + places[:-1])) + arm.payload * places[-1]
        return float(0.5 * (moving + np.sum(turning) + drives) - gravity @ lifted)

    energies = np.array([energy(q, v) for q, v in zip(states[0], states[1], strict=True)])
    weights = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60.0 * h)
    np.testing.assert_allclose(power, weights @ energies, rtol=1e-4, atol=1e-3)


@given(seed=seeds, axes=counts)
@settings(max_examples=25)
def test_exported_models_have_the_same_kinematics_and_dynamics(seed: int, axes: int) -> None:
    """MuJoCo and Pinocchio read the arm with axes, body and tool, and give its places and the efforts of a motion."""
    mujoco = pytest.importorskip("mujoco")
    pin = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(seed)
    arm = equipped(carried_arm(rng, axes), rng)
    gravity = rng.normal(0.0, 9.0, 3)
    q, v, a = rng.uniform(-0.8, 0.8, (3, len(arm.coordinates)))
    bends, base = arm.coordinates.bends, arm.coordinates.base
    revolutes = tuple(revolute_angles(arm, each[None, bends]) for each in (q, v, a))
    efforts = InverseDynamics(arm, gravity).efforts(revolutes, (q[None, base], v[None, base], a[None, base]))
    ours = np.concatenate([efforts[1][0], efforts[0][0]])
    state = [np.concatenate((each[base], of_arm[0])) for each, of_arm in zip((q, v, a), revolutes, strict=True)]
    tip = points_with_tool(arm, q)[-1]
    needed = drive_efforts(arm, gravity, q[None], v[None], a[None])
    np.testing.assert_allclose(np.concatenate([needed[1][0], needed[0][0]]), ours, atol=1e-8)
    geared = replace(arm, rotor_inertia=1e-3)  # a ball joint whose drives have inertia is nowhere singular
    needs = InverseDynamics(geared, gravity).efforts(revolutes, (q[None, base], v[None, base], a[None, base]))
    forward = CompiledFunction("forward_dynamics", arm_model(geared, gravity)).many
    gains = forward(revolutes[0], revolutes[1], *needs, q[None, base], v[None, base])
    np.testing.assert_allclose(gains[0], revolutes[2], atol=1e-8)
    np.testing.assert_allclose(gains[1], a[None, base], atol=1e-8)

    model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", gravity))
    data = mujoco.MjData(model)
    data.qpos, data.qvel, data.qacc = state
    mujoco.mj_inverse(model, data)
    np.testing.assert_allclose(data.site("tip").xpos, tip, atol=1e-9)
    np.testing.assert_allclose(data.qfrc_inverse, ours, rtol=1e-8, atol=1e-7)

    bounds = DriveLimits(*(np.ones(axes) for _ in range(4)))
    limits = Limits(np.ones(3 * LINKS), np.ones(3 * LINKS), axes=bounds)
    model = pin.buildModelFromXML(urdf_text(arm, "arm", limits))
    order = [model.joints[model.getJointId(name)].idx_q for name in (*arm.coordinates.base_names, *joint_names(arm))]
    data = model.createData()
    placed = np.zeros(model.nq)
    placed[order] = state[0]
    pin.framesForwardKinematics(model, data, placed)
    np.testing.assert_allclose(data.oMf[model.getFrameId("tip")].translation, tip, atol=1e-9)
    model.gravity.linear = gravity
    moving = np.zeros((2, model.nv))
    moving[:, order] = state[1:]
    # The inertia of drives is not part of a URDF.
    drives = np.append([axis.inertia for axis in arm.carrier], np.zeros(3 * LINKS)) * state[2]
    np.testing.assert_allclose(pin.rnea(model, data, placed, *moving)[order] + drives, ours, rtol=1e-8, atol=1e-7)


@given(seed=seeds, axes=counts)
def test_axes_that_move_to_their_limits_do_not_exceed_them(seed: int, axes: int) -> None:
    """A way of the axes passes exactly through its places, in the path as a whole and in its parts."""
    rng = np.random.default_rng(seed)
    arm = carried_arm(rng, axes, 6)
    still = JointPose(np.zeros((6, 2)), rng.uniform(-2.0, 2.0, axes))
    bounds = DriveLimits(*(np.ones(axes) for _ in range(4)))
    limits = Limits(np.ones(18), np.ones(18), axes=bounds)
    problem = Problem("axes", Workspace(), arm, limits, still, still)
    motions = CarrierMotions(problem, SurfaceTree.from_triangles(problem.workspace.triangle_soup))
    way = [rng.uniform(-2.0, 2.0, axes), *(rng.choice([-2.0, 2.0, 0.1], axes) for _ in range(3))]
    rest = np.tile(motions.start, (4, 1))
    rest[:, arm.coordinates.base] = way[-1]
    after = JointPath(BSpline(np.repeat([0.0, 1.0], 4), rest, 3), rest[:2], (), "")
    path = motions.joined(way, after)
    reached = [part.spline(1.0)[arm.coordinates.base] for part in path.parts[:-1]]
    np.testing.assert_array_equal(reached, way[1:])
    assert np.max(np.abs(path.spline.c[:, arm.coordinates.base])) <= 2.0


@given(seed=seeds, axes=counts)
@settings(max_examples=30)
def test_unknowns_hold_bends_and_axes(seed: int, axes: int) -> None:
    """A configuration is the one of its unknowns, a blend leads to another, and slopes are constant differences."""
    rng = np.random.default_rng(seed)
    arm = carried_arm(rng, axes)
    first, last = rng.uniform(-0.9, 0.9, (2, len(arm.coordinates)))
    curve, start = CurveMap.through(arm, first)
    np.testing.assert_allclose(curve.configuration(start), first, atol=1e-9)
    curve, end = curve.blended_to(last)
    begun = np.append(start, 0.0)
    for v, q in ((begun, first), (end, last)):
        np.testing.assert_allclose(curve.configuration(v), q, atol=1e-9)
    np.testing.assert_allclose(curve.slopes(begun) @ (end - begun), last - first, atol=1e-9)


def goal_of(arm: Arm, q: FloatArray, rng: np.random.Generator, room: float | None) -> GoalPose:
    """Return the goal of a pose's tip: its place, direction and, within some room, the roll of a random axis."""
    frame = arm.link_rotations(q)[-1]
    along = frame[:, 0]
    own = unit_vector(rng)
    up = np.cross(along, np.cross(frame @ own, along))
    up /= np.linalg.norm(up)
    roll = None if room is None else TipRoll(up, np.cross(along, up), own, room)
    return GoalPose(arm.joint_positions_at(q)[-1], along, roll=roll)


@given(seed=seeds, axes=counts, room=st.sampled_from((None, 0.0, 0.3)))
@settings(max_examples=30)
def test_shapes_moved_onto_a_goal_have_the_tip_there(seed: int, axes: int, room: float | None) -> None:
    """As far off as is told, in place, direction and roll, whatever the axes."""
    rng = np.random.default_rng(seed)
    arm = carried_arm(rng, axes)
    rest, wanted = rng.uniform(-0.5, 0.5, (2, len(arm.coordinates)))
    curve, v = CurveMap.through(arm, rest)
    goal = goal_of(arm, wanted, rng, room)
    points = CurvePoints(SpaceStepper(curve, (), SpaceMotionSettings()), curve.pose(v))
    moved = np.vstack((v, v + 0.1 * rng.normal(size=(7, len(v))))) @ points.root
    missed = points.moved_onto(goal, moved)
    for left, unknowns in zip(missed, points.unknowns(moved), strict=True):
        pose = curve.pose(unknowns)
        errors = np.concatenate(((pose.tip - goal.position) / arm.length, pose.tip_direction - goal.direction))
        if goal.roll is not None:
            # The angle between two half-planes about the goal's direction.
            sides = [np.cross(goal.direction, each) for each in (goal.roll.up, pose.frames[-1] @ goal.roll.own)]
            turned = np.arctan2(np.linalg.norm(np.cross(*sides)), sides[0] @ sides[1])
            errors = np.append(errors, max(turned - goal.roll.room, 0.0))
        assert np.max(np.abs(errors)) == pytest.approx(left, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("room", [None, 0.0])
def test_shapes_near_a_pose_reach_its_goal_in_few_steps(room: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's method converges as it does with exact derivatives, by bends and by axes."""
    monkeypatch.setattr(sampled_poses, "_NEWTON_STEPS", 4)
    rng = np.random.default_rng(5)
    for axes in range(4):
        arm = carried_arm(rng, axes, 12)
        arm = replace(arm, carrier=tuple(replace(axis, revolute=True) for axis in arm.carrier))
        wanted = rng.uniform(-0.4, 0.4, len(arm.coordinates))
        curve, v = CurveMap.through(arm, wanted)
        points = CurvePoints(SpaceStepper(curve, (), SpaceMotionSettings()), curve.pose(v))
        near = (v + 0.01 * rng.normal(size=(8, len(v)))) @ points.root
        assert np.max(points.moved_onto(goal_of(arm, wanted, rng, room), near)) < 1e-7


@given(seed=seeds, axes=st.integers(1, 3))
def test_the_nearest_base_of_prismatic_axes_is_the_least_squares_one(seed: int, axes: int) -> None:
    """Within the ranges of the axes, by another solver; each axis named as short is so by what is missing."""
    rng = np.random.default_rng(seed)
    place, target = rng.normal(size=(2, 3))
    carrier = tuple(BaseAxis(unit_vector(rng), -0.3, 0.2, revolute=False) for _ in range(axes))
    values, distance = nearest_base(carrier, place, target)
    directions = np.stack([axis.direction for axis in carrier], axis=1)
    oracle = lsq_linear(directions, target - place, bounds=(-0.3, 0.2), tol=1e-14)
    assert distance == pytest.approx(np.sqrt(2.0 * oracle.cost), abs=1e-6)
    assert np.linalg.norm(place + directions @ values - target) == pytest.approx(distance, abs=1e-12)
    for short in short_axes(carrier, place, target, values, 0.9 * distance):
        sign = 1.0 if short.limit > 0.0 else -1.0
        values[short.number] = short.limit + sign * short.missing
        assert np.linalg.norm(place + directions @ values - target) == pytest.approx(0.9 * distance, abs=1e-6)
        values[short.number] = short.limit


@given(seed=seeds, axes=counts)
@settings(max_examples=30)
def test_a_short_axis_reaches_once_its_range_is_wide_enough(seed: int, axes: int) -> None:
    """Axes of both kinds: at what is told beyond the limit, the base is at the distance asked for."""
    rng = np.random.default_rng(seed)
    arm = carried_arm(rng, axes)
    target = arm.base + 9.0 * unit_vector(rng)
    values, distance = nearest_base(arm.carrier, arm.base, target)
    rows = rng.uniform(-2.0, 2.0, (50, len(arm.coordinates)))
    for short in short_axes(arm.carrier, arm.base, target, values, 0.95 * distance):
        q = np.concatenate((np.zeros(2 * LINKS), values))
        q[2 * LINKS + short.number] = short.limit + np.sign(short.limit) * short.missing
        assert np.linalg.norm(arm.carried(q).place - target) == pytest.approx(0.95 * distance, abs=1e-6)
        # No other position of that axis is nearer, with the others where they are.
        rows[:, 2 * LINKS :] = values
        rows[:, 2 * LINKS + short.number] = rng.uniform(-2.0, 2.0, len(rows))
        assert np.min(np.linalg.norm(arm.carried(rows).place - target, axis=1)) >= distance - 1e-9


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_a_gantry_brings_the_arm_before_the_hole() -> None:
    """The plan passes the verifier, and each axis moves."""
    problem = ccm_opt.load_problem(PROBLEMS / "space" / "wing-box-gantry.toml")
    solution = ccm_opt.solve(problem)
    moved = np.ptp(solution.trajectory.base_positions, axis=0)
    assert np.all(moved > 0.01)
    assert all(check.passed for check in solution.checks)
    assert solution.simulation.verdict.outcome == "followed"
    assert np.max(np.abs(solution.simulation.base_positions - solution.trajectory.base_positions)) < 1e-4


SLIDE = """\
schema = 1
space = 3
name = "slide"

[workspace]
bounds = [[-0.3, -0.3, -0.3], [0.9, 0.9, 0.3]]

[[workspace.obstacles]]
name = "post"
box = [[-0.019, 0.2, -0.1], [-0.001, 0.24, 0.1]]

[arm]
links = 8
link_length = 0.05
radius = 0.02
joint_limit_deg = 40

[arm.base]
position = [0.0, 0.0, 0.0]
direction = [1.0, 0.0, 0.0]
up = [0.0, 0.0, 1.0]

[[arm.base.axes]]
kind = "prismatic"
axis = [0.0, 1.0, 0.0]
range = [0.0, 0.5]
velocity = 0.5
acceleration = 2.0

[[arm.base.axes]]
kind = "revolute"
axis = [0.0, 0.0, 1.0]
range_deg = [-30, 30]
velocity = 0.5
acceleration = 2.0

[limits]
velocity = 1.0
acceleration = 5.0

[start]
shape = "straight"
axes = [0.0, 0.0]

[goal]
shape = "straight"
axes = [0.4, 0.0]
"""


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_a_moving_base_is_no_reason_to_pass_through_an_obstacle(tmp_path: Path) -> None:
    """A post behind the base, which the base alone would touch, stops an arm that slides past it."""
    (tmp_path / "slide.toml").write_text(SLIDE)
    problem = ccm_opt.load_problem(tmp_path / "slide.toml")
    problem = replace(problem, planner=replace(problem.planner, time_limit=1.5))
    with pytest.raises(ccm_opt.NoPlanFound):
        ccm_opt.solve(problem)
    free = replace(problem, workspace=replace(problem.workspace, obstacles=()))
    assert all(check.passed for check in ccm_opt.solve(free).checks)


@pytest.mark.planning
def test_torques_are_limited_on_several_axes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Joints with a limit on their torque are timed on two axes, with a camera head that weighs, and are checked.

    That such arms are not simulated is said by the command that would.
    """
    text = SLIDE.replace("acceleration = 5.0", "acceleration = 5.0\ntorque = 20.0").replace("0.24, 0.1", "0.21, -0.08")
    text = text.replace("[arm.base]", f"{HEAD}\n[arm.base]", 1)
    (tmp_path / "slide.toml").write_text(text.replace("[-0.019, 0.2, -0.1]", "[-0.019, 0.2, -0.3]"))
    solution = ccm_opt.solve(ccm_opt.load_problem(tmp_path / "slide.toml"))
    assert "joint torque" in {check.name for check in solution.checks}
    tip = points_with_tool(solution.problem.arm, solution.trajectory.positions[-1])[-1]
    np.testing.assert_allclose(tip, [0.45, 0.4, 0.03], atol=1e-3)
    assert all(check.passed for check in solution.checks)
    done = CommandLine(capsys)("simulate", solution.save(tmp_path / "plan"))
    assert done.code == 0, done.err
    assert "not modelled" in done.out
    assert not (tmp_path / "plan" / "simulation.png").exists()


HEAD = """\
[arm.tool]
tip = [0.05, 0.0, 0.03]
direction = [0.0, 0.0, 1.0]
bodies = [{ box = [[0.0, -0.02, -0.02], [0.04, 0.02, 0.03]] }]
mass = 0.2
"""
TURNTABLE = SLIDE.replace("[0.0, 1.0, 0.0]", "[0.0, 0.0, 1.0]").replace("[-30, 30]", "[-180, 180]")


@pytest.mark.planning
def test_axes_and_bends_move_together(tmp_path: Path) -> None:
    """An arm that bends in one upright plane is lifted and turned to a goal behind it, as an independent model finds.

    The goal is what its axes and bends give, rounded; no place of the base alone brings the tip there.
    """
    arm = "[[arm.sections]]\nlinks = 8\nlink_length = 0.05\nradius = 0.02\njoint_limit_deg = [0, 40]\n"
    head, rest = TURNTABLE.split("[arm]\n")
    tail = rest.split("[arm.base]")[1].split("axes = [0.0, 0.0]")[0]
    arm += "[arm]\nbase_limit_deg = [0, 40]\n[arm.base]"
    goal = "[goal]\nposition = [-0.248, 0.2081, -0.0114]\ndirection = [-0.6428, 0.5393, -0.5440]\n"
    bounds = head.replace("[[-0.3, -0.3, -0.3]", "[[-0.6, -0.6, -0.6]").replace("0.3]]", "0.9]]")
    file = tmp_path / "turned.toml"
    file.write_text(bounds + arm + tail + goal)
    solution = ccm_opt.solve(ccm_opt.load_problem(file))
    assert all(check.passed for check in solution.checks)
    assert np.all(np.ptp(solution.trajectory.base_positions, axis=0) > 0.01)


@pytest.mark.planning
def test_a_pose_of_the_whole_arm_on_an_axis_along_it_may_bend_any_joint(tmp_path: Path) -> None:
    """The axis stands where on a feed axis half of the joints would still be in the guide tube."""
    along = SLIDE.replace("[0.0, 1.0, 0.0]", "[1.0, 0.0, 0.0]")
    kept = along.split("[[arm.base.axes]]")
    one = kept[0] + "[[arm.base.axes]]" + kept[1] + "[limits]" + kept[2].split("[limits]")[1]
    bends = "joints_deg = [[20, 0], [20, 10], [15, 0], [10, -10], [0, 0], [0, 0], [0, 10], [0, 0]]\naxes = [0.1]"
    text = one.replace("axes = [0.0, 0.0]", "axes = [0.0]").replace('shape = "straight"\naxes = [0.4, 0.0]', bends)
    (tmp_path / "whole.toml").write_text(text)
    solution = ccm_opt.solve(ccm_opt.load_problem(tmp_path / "whole.toml"))
    assert all(check.passed for check in solution.checks)


def test_axes_that_end_before_the_goal_is_in_reach_are_named(tmp_path: Path) -> None:
    """By key, with the end of the range and what is missing beyond it: the arm is 0.4 m long."""
    goal = "position = [0.3, 0.95, 0.0]\nposition_tolerance = 1e-3\n"
    text = SLIDE.replace('shape = "straight"\naxes = [0.4, 0.0]', goal).replace("0.9, 0.9", "0.9, 1.2")
    (tmp_path / "far.toml").write_text(text)
    with pytest.raises(UnreachableGoal) as refused:
        ccm_opt.solve(ccm_opt.load_problem(tmp_path / "far.toml"))
    # At y the goal is √(0.3² + (0.95 − y)²) away: 0.401 at y = 0.6839.
    assert "arm.base.axes[0].range beyond 0.5 m by 183.9 mm" in str(refused.value)


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        (("acceleration = 0.5", "acceleration = 0.01"), "arm.base.axes[0].acceleration", "cannot brake"),
        (("axis = [1.0, 0.0, 0.0]", "axis = [0.0, 0.0, 0.0]"), "arm.base.axes[0].axis", ""),
        (("range = [-0.4, 0.3]", "range = [0.3, -0.4]"), "arm.base.axes[0].range", "lower < upper"),
        (('kind = "prismatic"', 'kind = "revolute"'), "arm.base.axes[0].range", "not for a revolute axis"),
        (("[limits]", "[limits]\ntip_velocity = 1.0"), "limits.tip_velocity", "not supported"),
        (("[start]", "[start]\naxes = [0.0]"), "start.axes", "3 axes"),
        (("radius = 0.01", "radius = 0.01\nmount_length = 0.05"), "arm.mount_length", "move the mount"),
        (("radius = 0.01", "radius = 0.01\nfeed = { range = [0.0, 0.1] }"), "arm.feed", "make it the last of them"),
    ],
)
def test_defects_of_axes_are_named(change: tuple[str, str], key: str, words: str, tmp_path: Path) -> None:
    """By key, with what is expected."""
    folder = PROBLEMS / "space"
    text = (folder / "wing-box-gantry.toml").read_text().replace(*change, 1)
    for mesh in folder.glob("wing*.stl"):
        (tmp_path / mesh.name).write_bytes(mesh.read_bytes())
    (tmp_path / "gantry.toml").write_text(text)
    with pytest.raises(ProblemFileError) as refused:
        ccm_opt.load_problem(tmp_path / "gantry.toml")
    assert key in str(refused.value)
    assert words in str(refused.value)
