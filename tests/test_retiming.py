"""Retiming: limits hold on a dense grid, the path is kept, and the time is near the closed-form optimum."""

import sys
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import RetimingError
from ccm_opt.dynamics.retiming.motion_limits import limits_along
from ccm_opt.dynamics.retiming.profile import SpeedProfile, path_grid, path_rows
from ccm_opt.dynamics.retiming.speed_optimizer import fastest_profile, reachable_speeds
from ccm_opt.dynamics.retiming.timed_path import InverseDynamics, TimedPath
from ccm_opt.dynamics.retiming.timing import with_jumps
from ccm_opt.dynamics.retiming.timing_settings import GridSettings
from ccm_opt.dynamics.simulation.controller import step_reference
from ccm_opt.problem import Limits
from ccm_opt.robot.coordinates import joint_coordinates
from tests.phase_plane import fastest_duration
from tests.retiming_paths import (
    FRICTION,
    GRAVITY,
    LENGTH,
    MASS,
    even_limits,
    make_path,
    pendulums,
    random_control,
    run,
    sticky_pendulums,
    straight_path,
    to_revolutes,
    used,
)


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


CORNERS = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0], [1.0, 0.0]])


def legs_with_stops(corners: FloatArray) -> FloatArray:
    """Control points of straight legs between corners, in each of which, the ends among them, the path stops."""
    legs = [np.concatenate((a + np.linspace(0.0, 1.0, 5)[1:-1, None] * (b - a), [b] * 3)) for a, b in pairwise(corners)]
    return np.concatenate(([corners[0]] * 3, *legs))


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize(
    "control",
    [legs_with_stops(CORNERS), legs_with_stops(CORNERS)[2:-2], random_control(84, 1), random_control(79, 2)],
    ids=["stops at the ends", "stops on the way", "one joint turns back", "both joints turn back at once, nearly"],
)
def test_where_toppra_fails_the_sweeps_time_the_path(control: FloatArray) -> None:
    """Each kind of path on which toppra's programs fail is timed within its limits, near the optimum, and says so."""
    path, limits = make_path(control), even_limits(control.shape[1], 2.0, 10.0, 40.0)
    trajectory = run(path, limits, pendulums)
    assert max(used(trajectory, limits)) <= 1.0 + 1e-9
    assert "sweeps: toppra fails at" in trajectory.timed_by[0]
    assert trajectory.duration <= 1.25 * fastest_duration(path, limits, 0.0)


@pytest.mark.parametrize("absent", ["toppra", "matplotlib"])
def test_without_toppra_motions_last_as_long(absent: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where toppra, or what it needs, is not installed the sweeps time the path, as fast, and say why."""
    path, limits = make_path(random_control(5, 3)), even_limits(3, 2.0, 10.0)
    by_toppra = run(path, limits)
    for name in [name for name in sys.modules if name.split(".")[0] in {"toppra", absent}]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, absent, None)
    by_sweeps = run(path, limits)
    assert by_toppra.timed_by == ("toppra",)
    assert by_sweeps.timed_by[0].startswith("sweeps: toppra cannot be loaded")
    assert by_sweeps.duration == pytest.approx(by_toppra.duration, rel=1e-3)


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
@settings(max_examples=20, deadline=None)
@example(1022, 4)
@example(372, 1)
def test_two_ways_of_the_same_sweeps_agree(seed: int, links: int) -> None:
    """The sweeps that cannot fail find the squared speeds that toppra's linear programs find."""
    path, limits = make_path(random_control(seed, links)), even_limits(links, 2.0, 10.0, 40.0)
    columns = joint_coordinates(links)
    limited = limits_along(TimedPath(path.spline, limits, pendulums, to_revolutes, columns))
    rows = path_rows(limited, path.spline, path_grid(path.spline, GridSettings(intervals=100)))
    slack, cap = np.full_like(rows.c, 0.99), (0.99 / np.maximum(rows.slowness, 1e-3)) ** 2
    ours = SpeedProfile(rows.s, reachable_speeds(rows, slack, cap))
    assert np.all(ours.squared[1:-1] > 0.0)
    moving = rows.a[:-1] * ours.acceleration[:, None] + rows.b[:-1] * ours.squared[:-1, None] + rows.c[:-1]
    assert np.all(np.abs(moving) <= slack[:-1] + 1e-6)
    theirs = fastest_profile(rows, slack, cap)
    assert theirs.timed_by == "toppra" or theirs.timed_by.endswith("where it all but stops")
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
@example(262143)
def test_torque_limits_hold_with_friction(seed: int) -> None:
    """Viscous friction, which is linear in speed, counts towards the torque."""
    path = make_path(random_control(seed, 2))
    limits = even_limits(2, 4.0, 60.0, 1.3 * MASS * GRAVITY * LENGTH)
    trajectory = run(path, limits, sticky_pendulums)
    motion = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    torques = sticky_pendulums(*(to_revolutes(values) for values in motion))
    assert np.abs(torques).max() <= limits.torque[0] * (1.0 + 1e-9)
    assert np.abs(torques).max() >= 0.8 * limits.torque[0]


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(st.integers(0, 2**32 - 1), st.sampled_from([(pendulums, 0.0), (sticky_pendulums, FRICTION)]))
@settings(max_examples=2, deadline=None)  # the oracle is dear, and 500 paths were tried
@example(262143, (pendulums, 0.0))
@example(81, (sticky_pendulums, FRICTION))
@example(3206374, (sticky_pendulums, FRICTION))
@example(18401, (sticky_pendulums, FRICTION))
def test_timing_is_near_the_optimum_of_the_phase_plane(seed: int, drive: tuple[InverseDynamics, float]) -> None:
    """With and without friction no motion is much faster.

    262143 stops on its way, friction makes 81 faster, and the tangents of friction swing in 3206374 and in 18401, where
    one at a high speed brings the path almost to a stop. Of 500 random paths with friction one takes 1.18 times as
    long, the others at most 1.13 times.
    """
    path = make_path(random_control(seed, 2))
    limits = even_limits(2, 4.0, 60.0, 1.3 * MASS * GRAVITY * LENGTH)
    dynamics, friction = drive
    best = fastest_duration(path, limits, friction)
    assert 0.99 * best <= run(path, limits, dynamics).duration <= 1.25 * best


@given(st.floats(-1.4, 0.0), st.floats(0.2, 1.4))
@settings(max_examples=15, deadline=None)
def test_friction_costs_time_where_the_drive_lifts(low: float, rise: float) -> None:
    """A pendulum on its way up has less torque left to speed up than to brake, and friction takes of the lesser.

    On its way down it is the other way round: friction helps to brake, and may shorten the motion.
    """
    lifting = -np.linspace(low, low + rise, 4)[:, None]  # the drive turns the other way than the bend
    path = make_path(lifting)
    limits = even_limits(1, 4.0, 60.0, 1.3 * MASS * GRAVITY * LENGTH)
    assert run(path, limits, sticky_pendulums).duration > run(path, limits, pendulums).duration


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


def test_a_motion_that_takes_for_ever_is_refused() -> None:
    """Limits that hardly let the arm move are told with the duration, not by a lack of memory for the samples."""
    with pytest.raises(RetimingError, match=r"the motion takes .* s within the limits") as caught:
        run(make_path(random_control(3, 3)), even_limits(3, 1e-9, 10.0))
    assert caught.value.diagnosis.evidence["duration"] > 1e8
    assert caught.value.diagnosis.advice


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


def test_a_path_that_stops_on_the_way_takes_little_longer_than_its_legs() -> None:
    """Where three control points coincide the path stops; its time is near that of its legs from rest to rest."""
    corners = np.array([[0.0], [0.7], [0.2], [0.9]])
    limits = even_limits(1, 2.0, 10.0)
    trajectory = run(make_path(legs_with_stops(corners)), limits)
    assert max(used(trajectory, limits)) <= 1.0 + 1e-9
    assert trajectory.duration <= 1.08 * sum(run(straight_path(b - a), limits).duration for a, b in pairwise(corners))


def test_grid_points_follow_the_path_and_hold_every_knot() -> None:
    """All knots are grid points, and long spans get more of them than short ones."""
    path = make_path(np.array([[0.0], [0.01], [0.02], [0.03], [1.0], [2.0], [3.0], [3.01]]))
    grid = path_grid(path.spline, GridSettings(intervals=100))
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


@given(st.integers(0, 2**32 - 1), st.floats(0.3, 3.0), st.floats(2.0, 30.0))
@settings(max_examples=25, deadline=None)
def test_a_reference_between_the_samples_keeps_the_accelerations(seed: int, velocity: float, growth: float) -> None:
    """A cubic through angles and velocities, which a drive interpolates, hardly passes the limit beside a jump."""
    limits = even_limits(3, velocity, growth)
    trajectory = run(make_path(random_control(seed, 3)), limits)
    reference = step_reference(trajectory.time, trajectory.positions, trajectory.velocities, 1e-3)
    window, _ = reference.window(0, reference.steps)
    assert np.max(np.abs(window[:, 2])) <= 1.1 * growth


def test_samples_stand_at_jumps_unless_one_is_there_anyhow() -> None:
    """Every jump has a sample at it or beside it, and no step becomes shorter than its share."""
    time = np.linspace(0.0, 1.0, 11)
    jumps = np.array([0.05, 0.2, 0.3005, 0.333, 0.3335, 0.999])
    sampled = with_jumps(time, jumps, 0.02)
    np.testing.assert_allclose(np.setdiff1d(sampled, time), [0.05, 0.333])
    assert np.min(np.diff(sampled)) > 0.002
