"""Retiming: limits hold on a dense grid, the path is kept, and the time is near the closed-form optimum."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import ProblemError, RetimingError
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.frames import joint_names
from ccm_opt.problem import JointPose, Limits, Problem
from ccm_opt.retiming import joined, retime, reversed_trajectory
from ccm_opt.retiming.grid import path_grid
from ccm_opt.retiming.profile import SpeedProfile
from ccm_opt.retiming.reachability import reachable_profile
from ccm_opt.retiming.rows import path_rows
from ccm_opt.retiming.sampling import MOST_PIECES
from ccm_opt.retiming.speed_optimizer import fastest_profile
from ccm_opt.solution import JointPath, JointStates, JointTrajectory
from ccm_opt.verification import verify
from ccm_opt.verification.newton_euler import joint_torques

GRAVITY, MASS, LENGTH, FRICTION = 9.81, 2.0, 0.5, 3.0


def retimed_states(trajectory: JointTrajectory, arm: Arm, gravity: FloatArray) -> JointStates:
    """The motion of all revolutes with the verifier's own torques."""
    planar = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    revolutes = [to_revolutes(values) for values in planar]
    return JointStates(joint_names(arm), *revolutes, joint_torques(arm, gravity, *planar))


def on_feed(limits: Limits, force: float | None = None) -> Limits:
    """The limits with those of a feed axis."""
    return replace(limits, feed_velocity=0.1, feed_acceleration=0.5, feed_force=force)


def make_path(control: FloatArray) -> JointPath:
    """A clamped uniform cubic spline over [0, 1] with given control points, shape (m ≥ 4, links)."""
    control = np.asarray(control, dtype=np.float64)
    knots = np.concatenate((np.zeros(3), np.linspace(0.0, 1.0, len(control) - 2), np.ones(3)))
    return JointPath(BSpline(knots, control, 3), control, ())


def straight_path(end: FloatArray) -> JointPath:
    """A straight line in joint space at even pace."""
    return make_path(np.linspace(0.0, 1.0, 4)[:, None] * np.atleast_1d(end))


def to_revolutes(bends: FloatArray) -> FloatArray:
    """Bends to three revolutes a ball, the second turning the other way."""
    angles = np.zeros((len(bends), 3 * bends.shape[1]))
    angles[:, 1::3] = -bends
    return angles


def weightless(angles: FloatArray, _rates: FloatArray, _growth: FloatArray) -> FloatArray:
    """Inverse dynamics of an arm without mass."""
    return np.zeros_like(angles)


def pendulums(angles: FloatArray, _rates: FloatArray, growth: FloatArray) -> FloatArray:
    """Inverse dynamics of independent point-mass pendulums: τ = m l² q̈ + m g l cos q on every bend axis."""
    torques = np.zeros_like(angles)
    torques[:, 1::3] = MASS * LENGTH**2 * growth[:, 1::3] + MASS * GRAVITY * LENGTH * np.cos(angles[:, 1::3])
    return torques


def sticky_pendulums(angles: FloatArray, rates: FloatArray, growth: FloatArray) -> FloatArray:
    """The same with viscous friction in every bend axis."""
    torques = pendulums(angles, rates, growth)
    torques[:, 1::3] += FRICTION * rates[:, 1::3]
    return torques


def even_limits(links: int, velocity: float, acceleration: float, torque: float | None = None) -> Limits:
    """The same limits for all revolutes."""
    one = np.ones(3 * links)
    return Limits(velocity * one, acceleration * one, None if torque is None else torque * one)


def run(path: JointPath, limits: Limits, dynamics=weightless, **options: float) -> JointTrajectory:  # noqa: ANN001
    """Retime with the toy revolutes."""
    return retime(path, limits, dynamics, revolutes=to_revolutes, **options)


def slim_arm(links: int, length: float) -> Arm:
    """An arm that bends as far as it likes."""
    one = np.ones(links)
    return Arm(links, length, 0.01, np.zeros(2), 0.3, 99.0, 99.0, False, 0.0, 0.1 * one, 1e-5 * one, 1e-4 * one)  # noqa: FBT003


def distance_to_way(arm: Arm, path: JointPath, bends: FloatArray) -> float:
    """Least distance of a pose to the poses of a path, that of the joint farthest away, by search on finer grids."""
    pose, low, high = arm.joint_positions(arm.headings(bends)), 0.0, 1.0
    for _ in range(4):
        places = np.linspace(low, high, 4001)
        apart = np.linalg.norm(arm.joint_positions(arm.headings(path.spline(places))) - pose, axis=2).max(axis=1)
        k = int(np.argmin(apart))
        low, high = places[max(k - 2, 0)], places[min(k + 2, 4000)]
    return float(apart[k])


def used(trajectory: JointTrajectory, limits: Limits) -> tuple[float, float]:
    """Greatest share of the velocity and acceleration limits at the samples."""
    speed = np.abs(trajectory.bend_velocities) / limits.velocity[1::3]
    growth = np.abs(trajectory.bend_accelerations) / limits.acceleration[1::3]
    return float(speed.max()), float(growth.max())


def random_control(seed: int, links: int) -> FloatArray:
    """Control points of a winding path, some legs halved as the planner does, some points repeated."""
    rng = np.random.default_rng(seed)
    control = np.cumsum(rng.normal(0.0, 0.3, (int(rng.integers(4, 30)), links)), axis=0)
    halved = rng.integers(1, len(control), 3)
    control = np.insert(control, halved, 0.5 * (control[halved] + control[halved - 1]), axis=0)
    return np.repeat(control, rng.choice([1, 2], len(control), p=[0.9, 0.1]), axis=0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
@settings(max_examples=40, deadline=None)
def test_limits_hold_on_a_dense_grid_and_the_path_is_kept(seed: int, links: int) -> None:
    """At 1 kHz the limits hold, no part of the path is travelled twice, and the motion rests on the path's ends."""
    rng = np.random.default_rng(seed + 1)
    path = make_path(random_control(seed, links))
    limits = Limits(rng.uniform(0.5, 3.0, 3 * links), rng.uniform(2.0, 20.0, 3 * links))
    trajectory = run(path, limits, step=1e-3)
    assert max(used(trajectory, limits)) <= 1.0 + 1e-9
    assert np.max(np.diff(trajectory.time)) <= 1e-3 + 1e-12
    np.testing.assert_allclose(trajectory.bend_angles[[0, -1]], path.keyframes[[0, -1]], atol=1e-12)
    assert not np.any(trajectory.bend_velocities[[0, -1]])
    travelled = np.linalg.norm(np.diff(trajectory.bend_angles, axis=0), axis=1).sum()
    length = np.linalg.norm(np.diff(path.spline(np.linspace(0.0, 1.0, 20001)), axis=0), axis=1).sum()
    assert travelled == pytest.approx(length, rel=1e-3)


@pytest.mark.parametrize(("seed", "links"), [(266996, 1)])
def test_paths_that_turn_back_where_linear_programs_fail_are_timed(seed: int, links: int) -> None:
    """A path at whose turning point TOPP-RA's linear programs fail is timed within its limits nevertheless."""
    rng = np.random.default_rng(seed + 1)
    limits = Limits(rng.uniform(0.5, 3.0, 3 * links), rng.uniform(2.0, 20.0, 3 * links))
    trajectory = run(make_path(random_control(seed, links)), limits)
    assert max(used(trajectory, limits)) <= 1.0 + 1e-9
    assert trajectory.duration < 30.0


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
@settings(max_examples=20, deadline=None)
def test_two_ways_of_the_same_sweeps_agree(seed: int, links: int) -> None:
    """The sweeps that cannot fail find the squared speeds that the linear programs find."""
    path, limits = make_path(random_control(seed, links)), even_limits(links, 2.0, 10.0, 40.0)
    rows = path_rows(path.spline, path_grid(path.spline, 100), limits, pendulums, to_revolutes)
    slack, cap = np.full_like(rows.c, 0.99), (0.99 / np.maximum(rows.speed, 1e-3)) ** 2
    ours = SpeedProfile(rows.s, reachable_profile(rows, slack, cap))
    assert np.all(ours.squared[1:-1] > 0.0)
    moving = rows.a[:-1] * ours.acceleration[:, None] + rows.b[:-1] * ours.squared[:-1, None] + rows.c[:-1]
    assert np.all(np.abs(moving) <= slack[:-1] + 1e-6)
    theirs = SpeedProfile(rows.s, fastest_profile(rows, slack, cap))
    assert ours.duration == pytest.approx(theirs.duration, rel=5e-3)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_angles_velocities_and_accelerations_are_one_motion(seed: int) -> None:
    """Reported rates are the derivatives of the reported angles, to the order of the sample step."""
    path, limits = make_path(random_control(seed, 3)), even_limits(3, 2.0, 10.0)
    trajectory = run(path, limits, step=1e-3)
    h = np.diff(trajectory.time)[:, None]
    mean = 0.5 * (trajectory.bend_velocities[1:] + trajectory.bend_velocities[:-1])
    assert np.max(np.abs(np.diff(trajectory.bend_angles, axis=0) / h - mean) / h) <= 0.25 * 10.0
    gained = h * 0.5 * (trajectory.bend_accelerations[1:] + trajectory.bend_accelerations[:-1])
    missing = np.abs(np.diff(trajectory.bend_velocities, axis=0) - gained)
    assert np.all(missing <= h * 10.0)
    assert np.sum(missing) <= 0.05 * np.sum(np.abs(gained))


@pytest.mark.parametrize(
    ("end", "velocity", "acceleration"), [(1.0, 10.0, 4.0), (3.0, 1.0, 4.0), (-0.01, 2.0, 10.0), (6.0, 0.02, 0.5)]
)
def test_duration_meets_the_bang_bang_optimum(end: float, velocity: float, acceleration: float) -> None:
    """A straight path takes 2 √(d/a), or d/v + v/a when the velocity limit is met, within two per cent."""
    trajectory = run(straight_path(np.array([end, 0.5 * end])), even_limits(2, velocity, acceleration))
    distance = abs(end)
    meets = distance > velocity**2 / acceleration
    best = distance / velocity + velocity / acceleration if meets else 2.0 * np.sqrt(distance / acceleration)
    assert best <= trajectory.duration <= 1.02 * best


def test_each_joint_keeps_its_own_limits() -> None:
    """The limits of ball i are those of revolute 3 i + 1; the others do not matter to a planar motion."""
    limits = even_limits(2, 1e-3, 1e-3)
    limits.velocity[1::3], limits.acceleration[1::3] = (1.0, 0.25), (4.0, 4.0)
    trajectory = run(straight_path(np.array([2.0, 2.0])), limits)
    assert np.abs(trajectory.bend_velocities).max() == pytest.approx(0.25, rel=0.02)


@given(st.integers(0, 2**32 - 1), st.floats(1.02, 3.0))
@settings(max_examples=25, deadline=None)
def test_torque_limits_hold_on_a_dense_grid(seed: int, room: float) -> None:
    """Pendulums keep their torque limit at 1 kHz, even when gravity leaves a fiftieth of it."""
    path = make_path(random_control(seed, 2))
    limits = even_limits(2, 4.0, 60.0, room * MASS * GRAVITY * LENGTH)
    trajectory = run(path, limits, pendulums, step=1e-3)
    motion = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    torques = pendulums(*(to_revolutes(values) for values in motion))
    assert np.abs(torques).max() <= limits.torque[0] * (1.0 + 1e-9)
    assert max(used(trajectory, limits)) <= 1.0 + 1e-9


def test_a_pendulum_swings_at_its_torque_limit() -> None:
    """A pendulum lifted through the horizontal uses the torque it is given, and takes longer than without gravity."""
    limits = even_limits(1, 100.0, 1000.0, 1.3 * MASS * GRAVITY * LENGTH)
    trajectory = run(make_path(np.linspace(-1.2, 1.2, 4)[:, None]), limits, pendulums)
    motion = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    torques = np.abs(pendulums(*(to_revolutes(values) for values in motion)))
    assert torques.max() >= 0.98 * limits.torque[0]
    assert trajectory.duration > 2.0 * np.sqrt(2.4 * MASS * LENGTH**2 / limits.torque[0])


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_torque_limits_hold_with_friction(seed: int) -> None:
    """Viscous friction, which is linear in speed, counts towards the torque and costs time."""
    path = make_path(random_control(seed, 2))
    limits = even_limits(2, 4.0, 60.0, 1.3 * MASS * GRAVITY * LENGTH)
    trajectory = run(path, limits, sticky_pendulums)
    motion = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    torques = sticky_pendulums(*(to_revolutes(values) for values in motion))
    assert np.abs(torques).max() <= limits.torque[0] * (1.0 + 1e-9)
    assert np.abs(torques).max() >= 0.8 * limits.torque[0]
    assert trajectory.duration > run(path, limits, pendulums).duration


class Cart:
    """A point mass on a feed axis that leans by 30°, with pendulums that feel its acceleration."""

    def __call__(
        self, angles: FloatArray, rates: FloatArray, growth: FloatArray, feed_growth: FloatArray
    ) -> FloatArray:
        """Torques: those of the pendulums, and m l a sin q from the base's acceleration."""
        torques = pendulums(angles, rates, growth)
        torques[:, 1::3] += MASS * LENGTH * feed_growth[:, None] * np.sin(angles[:, 1::3])
        return torques

    def feed_forces(
        self, angles: FloatArray, _rates: FloatArray, _growth: FloatArray, feed_growth: FloatArray
    ) -> FloatArray:
        """Force on the axis: that of the masses."""
        return MASS * (angles.shape[1] // 3) * (feed_growth + 0.5 * GRAVITY)


def test_the_feed_axis_keeps_its_own_limits() -> None:
    """A path of feed alone takes d/v + v/a, and its motion is reported as that of the feed."""
    trajectory = run(make_path(np.linspace(0.0, 1.0, 4)[:, None] * [0.0, 0.0, 0.3]), on_feed(even_limits(2, 2.0, 10.0)))
    best = 0.3 / 0.1 + 0.1 / 0.5
    assert best <= trajectory.duration <= 1.02 * best
    assert trajectory.bend_angles.shape[1] == 2
    np.testing.assert_allclose(trajectory.feed.positions[[0, -1]], [0.0, 0.3], atol=1e-12)
    assert np.abs(trajectory.feed.velocities).max() == pytest.approx(0.1, rel=0.02)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_force_and_torque_limits_hold_with_a_feed_axis(seed: int) -> None:
    """Force on the axis and torques that its acceleration costs stay within their limits, and one of them binds."""
    control = random_control(seed, 3) * [1.0, 1.0, 0.1]
    limits = on_feed(even_limits(2, 4.0, 60.0, 1.2 * MASS * GRAVITY * LENGTH), 2.02 * MASS * 0.5 * GRAVITY)
    limits = replace(limits, feed_velocity=1.0, feed_acceleration=20.0)
    trajectory = run(make_path(control), limits, Cart())
    motion = [
        to_revolutes(values)
        for values in (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    ]
    torques = np.abs(Cart()(*motion, trajectory.feed.accelerations)).max() / limits.torque[0]
    force = np.abs(Cart().feed_forces(*motion, trajectory.feed.accelerations)).max() / limits.feed_force
    assert max(torques, force) <= 1.0 + 1e-9
    assert force >= 0.95


def test_a_feed_drive_too_weak_to_hold_the_arm_is_named() -> None:
    """A static force above the limit names the axis; dynamics that cannot tell the force are refused."""
    path = make_path(np.linspace(0.0, 1.0, 4)[:, None] * [0.0, 0.3])
    with pytest.raises(RetimingError, match=r"the feed axis needs 9.81 N to hold the arm still .* limit is 9 N"):
        run(path, on_feed(even_limits(1, 2.0, 10.0), 9.0), Cart())
    with pytest.raises(ProblemError, match="feed_forces"):
        run(path, on_feed(even_limits(1, 2.0, 10.0), 9.0))
    with pytest.raises(RetimingError, match="2 columns"):
        run(path, even_limits(1, 2.0, 10.0))


def test_a_joint_too_weak_to_hold_the_arm_is_named() -> None:
    """A static torque above the limit raises an error with joint, torque, limit, place on the path, and advice."""
    limits = even_limits(2, 2.0, 10.0, 9.0)
    with pytest.raises(RetimingError) as caught:
        run(make_path(np.array([[1.4, 1.5], [1.4, 0.8], [1.4, 0.0], [1.4, -0.9]])), limits, pendulums)
    diagnosis = caught.value.diagnosis
    assert "joint 2, second (bend) axis" in diagnosis.reason
    assert "9.81 N m" in diagnosis.reason
    assert "limit is 9 N m" in diagnosis.reason
    assert diagnosis.stage == "retiming"
    assert diagnosis.evidence["revolute"] == 4
    assert 0.5 < float(str(diagnosis.evidence["path_position"])) < 1.0
    assert diagnosis.advice


def test_standing_still_is_a_valid_short_motion() -> None:
    """A path from a pose to itself gives a short trajectory at rest, unless the joints cannot hold the pose."""
    path = make_path(np.full((5, 2), 0.3))
    trajectory = run(path, even_limits(2, 2.0, 10.0, 20.0), pendulums)
    assert trajectory.time[0] == 0.0
    assert 0.0 < trajectory.duration <= 5e-3
    assert not np.any(trajectory.bend_velocities)
    np.testing.assert_array_equal(trajectory.bend_angles, np.full((2, 2), 0.3))
    with pytest.raises(RetimingError, match="to hold the arm still"):
        run(path, even_limits(2, 2.0, 10.0, 5.0), pendulums)


@pytest.mark.parametrize("size", [1e-8, 1e-6, 1e-3])
def test_tiny_motions_are_timed_like_large_ones(size: float) -> None:
    """Down to a hundred-millionth of a radian the time is near the closed form and there are many samples."""
    trajectory = run(straight_path(np.array([size])), even_limits(1, 2.0, 10.0))
    assert trajectory.duration == pytest.approx(2.0 * np.sqrt(size / 10.0), rel=0.02)
    assert len(trajectory.time) > 50


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_unit_of_time_does_not_matter(scale: float) -> None:
    """Limits scaled as by another unit of time give the same motion in that unit."""
    path = make_path(random_control(3, 3))
    trajectory = run(path, even_limits(3, 2.0 / scale, 10.0 / scale**2), step=1e-3 * scale)
    reference = run(path, even_limits(3, 2.0, 10.0), step=1e-3)
    assert trajectory.duration / scale == pytest.approx(reference.duration, rel=5e-3)


def test_a_path_that_turns_back_on_itself_keeps_its_limits() -> None:
    """A cusp in joint space, where the path stops, neither breaks the limits nor the solver."""
    there_and_back = np.concatenate((np.linspace(0.0, 1.0, 6), np.linspace(1.0, 0.0, 6)))
    limits = even_limits(1, 2.0, 10.0)
    trajectory = run(make_path(there_and_back[:, None]), limits)
    assert max(used(trajectory, limits)) <= 1.0 + 1e-9
    assert trajectory.bend_angles.max() > 0.9


@pytest.mark.parametrize("jerk", [None, 200.0])
@pytest.mark.parametrize("step", [1e-3, 4e-3])
@pytest.mark.parametrize("seed", range(6))
def test_a_retimed_motion_satisfies_the_independent_verifier(seed: int, step: float, jerk: float | None) -> None:
    """Angles, rates, torques and jerks of a retimed path pass every check of the verifier that concerns time."""
    links = 4
    arm = slim_arm(links, 0.1)
    path = make_path(random_control(seed, links))
    ends = (JointPose(path.keyframes[0]), JointPose(path.keyframes[-1]))
    limits = replace(even_limits(links, 2.0, 10.0, 1.0), jerk=None if jerk is None else np.full(3 * links, jerk))
    problem = Problem("retimed", Workspace(shapely.box(-1.0, -1.0, 1.0, 1.0)), arm, limits, *ends)
    gravity = problem.simulation.gravity

    def dynamics(*motion: FloatArray) -> FloatArray:
        return joint_torques(arm, gravity, *(-values[:, 1::3] for values in motion))

    trajectory = run(path, limits, dynamics, step=step)
    checks = verify(problem, trajectory, retimed_states(trajectory, arm, gravity))
    assert [check for check in checks if not check.passed] == []
    assert any(check.name == "joint jerk" for check in checks) == (jerk is not None)


def test_without_smoothing_the_verifier_sees_the_jerk() -> None:
    """The fastest motion passes a jerk limit that the smoothed one keeps, and takes less time."""
    links = 2
    arm, path = slim_arm(links, 0.1), straight_path(np.array([1.0, -0.5]))
    limits = replace(even_limits(links, 2.0, 10.0), jerk=np.full(3 * links, 100.0))
    ends = (JointPose(np.zeros(2)), JointPose(path.keyframes[-1]))
    problem = Problem("jerky", Workspace(shapely.box(-1.0, -1.0, 1.0, 1.0)), arm, limits, *ends)
    smooth, jerky = run(path, limits), run(path, replace(limits, jerk=None))
    jerks = {}
    for name, motion in (("smooth", smooth), ("jerky", jerky)):
        checks = verify(problem, motion, retimed_states(motion, arm, problem.simulation.gravity))
        jerks[name] = next(check for check in checks if check.name == "joint jerk")
    assert jerks["smooth"].passed
    assert jerks["smooth"].worst > 60.0
    assert not jerks["jerky"].passed
    assert jerky.duration < smooth.duration < 1.5 * jerky.duration


@given(st.integers(0, 2**32 - 1), st.floats(20.0, 2000.0))
@settings(max_examples=10, deadline=None)
def test_all_limits_hold_when_jerk_is_limited(seed: int, jerk: float) -> None:
    """Torques, velocities, accelerations and differences of accelerations keep their limits, the ends at rest."""
    path = make_path(random_control(seed, 2))
    limits = even_limits(2, 4.0, 60.0, 1.2 * MASS * GRAVITY * LENGTH)
    trajectory = run(path, replace(limits, jerk=np.full(6, jerk)), pendulums, step=1e-3)
    motion = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    assert np.abs(pendulums(*(to_revolutes(values) for values in motion))).max() <= limits.torque[0] * (1.0 + 1e-9)
    assert max(used(trajectory, limits)) <= 1.0 + 1e-9
    jerks = np.diff(trajectory.bend_accelerations, axis=0) / np.diff(trajectory.time)[:, None]
    assert np.abs(jerks).max() <= jerk * (1.0 + 1e-6)
    assert np.abs(trajectory.bend_accelerations[[0, -1]]).max() <= 1e-3 * jerk
    np.testing.assert_allclose(trajectory.bend_angles[[0, -1]], path.keyframes[[0, -1]], atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e-3))
@settings(max_examples=8, deadline=None)
def test_chords_between_samples_stay_near_the_path(seed: int, spare: float) -> None:
    """No point of the arm, on the chord between two samples, is farther than half the spare gap from its way."""
    links, length = 5, 0.1
    arm = slim_arm(links, length)
    path = replace(make_path(random_control(seed, links)), spare=spare)
    trajectory = run(path, even_limits(links, 5.0, 20.0), link_length=length)
    plain = run(path, even_limits(links, 5.0, 20.0))
    assert len(trajectory.time) >= len(plain.time)
    assert trajectory.duration == pytest.approx(plain.duration, rel=1e-2)
    worst = np.argmax(np.abs(np.diff(trajectory.bend_angles, n=2, axis=0)).sum(axis=1))
    for k in (worst, worst + 1, len(trajectory.time) // 2):
        middle = trajectory.bend_angles[k : k + 2].mean(axis=0)
        assert distance_to_way(arm, path, middle) <= 0.5 * spare * 1.01 + 1e-8


def test_where_a_path_spares_no_gap_steps_are_cut_so_far_and_no_further(caplog: pytest.LogCaptureFixture) -> None:
    """Steps are cut into a bounded number of pieces, and a warning tells when that is not enough."""
    path = make_path(random_control(5, 3))
    plain = run(path, even_limits(3, 50.0, 900.0))
    trajectory = run(path, even_limits(3, 50.0, 900.0), link_length=10.0)
    assert len(plain.time) < len(trajectory.time) <= MOST_PIECES * len(plain.time) + 1
    assert "not cut further" in caplog.text


def legs(seed: int, count: int) -> list[JointTrajectory]:
    """Retimed legs, each from where the one before ends, with a feed axis."""
    rng = np.random.default_rng(seed)
    poses = np.cumsum(rng.normal(0.0, 0.2, (count + 1, 4)), axis=0)
    shares = np.linspace(0.0, 1.0, 5)[:, None]
    paths = [make_path(a + shares * (b - a)) for a, b in pairwise(poses)]
    return [run(path, on_feed(even_limits(3, 2.0, 10.0))) for path in paths]


@given(st.integers(0, 2**32 - 1), st.lists(st.floats(0.0, 0.1), min_size=2, max_size=2))
@settings(max_examples=10, deadline=None)
def test_joined_legs_are_one_motion_that_rests_at_its_stops(seed: int, pauses: list[float]) -> None:
    """Legs and pauses follow each other in time, rest at the stops, and keep limits that differences can show."""
    parts = legs(seed, 3)
    whole = joined(parts, pauses)
    assert whole.duration == pytest.approx(sum(leg.duration for leg in parts) + sum(pauses))
    steps = np.diff(whole.time)
    assert steps.min() > 0.0
    assert steps.max() <= 5e-3
    for stop, leg in zip(whole.stops, parts[:-1], strict=True):
        np.testing.assert_array_equal(whole.bend_angles[stop], leg.bend_angles[-1])
        assert not np.any(whole.bend_velocities[stop])
        assert whole.feed.velocities[stop] == 0.0
    mean = np.diff(whole.bend_angles, axis=0) / steps[:, None]
    second = np.diff(mean, axis=0) / (0.5 * (steps[1:] + steps[:-1]))[:, None]
    assert np.abs(second).max() <= 10.0 * (1.0 + 1e-6)
    assert np.abs(np.diff(whole.bend_velocities, axis=0) / steps[:, None]).max() <= 10.0 * (1.0 + 1e-6)


def test_reversing_twice_is_the_identity_and_once_swaps_the_ends() -> None:
    """A retraction ends where the motion began, with opposite velocities, and reversing it again gives the motion."""
    whole = joined(legs(1, 2), [0.05])
    back = reversed_trajectory(whole)
    np.testing.assert_array_equal(back.bend_angles[[0, -1]], whole.bend_angles[[-1, 0]])
    np.testing.assert_array_equal(back.bend_velocities, -whole.bend_velocities[::-1])
    assert back.time[0] == 0.0
    assert not np.any(back.bend_velocities[back.stops[0]])
    again = reversed_trajectory(back)
    assert again.stops == whole.stops
    np.testing.assert_allclose(again.time, whole.time, atol=1e-12)
    np.testing.assert_array_equal(again.bend_accelerations, whole.bend_accelerations)
    np.testing.assert_array_equal(again.feed.positions, whole.feed.positions)


def test_legs_that_do_not_meet_are_refused() -> None:
    """A leg that begins elsewhere, and pauses that do not fit, are errors that say so."""
    first, second, third = legs(2, 3)
    with pytest.raises(RetimingError, match="leg 2 begins"):
        joined([first, third])
    with pytest.raises(ValueError, match="pauses"):
        joined([first, second], [0.1, 0.1])


def test_grid_points_follow_the_path_and_hold_every_knot() -> None:
    """All knots are grid points, and long spans get more of them than short ones."""
    path = make_path(np.array([[0.0], [0.01], [0.02], [0.03], [1.0], [2.0], [3.0], [3.01]]))
    grid = path_grid(path.spline, 100)
    assert set(np.unique(path.spline.t)) <= set(grid)
    assert np.all(np.diff(grid) > 0.0)
    assert np.max(np.diff(grid)) > 3.0 * np.diff(grid)[len(grid) // 2]


def test_speed_profile_times_are_exact() -> None:
    """Under constant s̈ the profile's times, positions and speeds are those of s = t²/2."""
    s = np.linspace(0.0, 1.0, 11) ** 2
    profile = SpeedProfile(s, 2.0 * s)
    np.testing.assert_allclose(profile.times, np.sqrt(2.0 * s), atol=1e-12)
    time = np.linspace(0.0, profile.duration, 37)
    position, speed, growth = profile.at(time)
    np.testing.assert_allclose(position, 0.5 * time**2, atol=1e-12)
    np.testing.assert_allclose(speed, time, atol=1e-12)
    np.testing.assert_allclose(growth, 1.0, atol=1e-9)
    assert profile.slowed(2.0).duration == pytest.approx(2.0 * profile.duration)
