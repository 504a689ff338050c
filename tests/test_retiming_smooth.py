"""Timed motions as the verifier sees them: chords between samples, and jerk limits."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING
from ccm_opt.problem import JointPose, PlannerOptions, Problem
from ccm_opt.problem.solution import JointPath, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import joint_names
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.consistency import check_keyframes
from ccm_opt.verification.verifier import verify
from tests.retiming_paths import (
    GRAVITY,
    LENGTH,
    MASS,
    even_limits,
    make_path,
    pendulums,
    random_control,
    run,
    slim_arm,
    straight_path,
    to_revolutes,
    used,
)

from .arms import joint_torques


def retimed_states(trajectory: JointTrajectory, arm: Arm, gravity: FloatArray) -> JointStates:
    """The motion of all revolutes with the verifier's own torques."""
    planar = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    revolutes = [to_revolutes(values) for values in planar]
    return JointStates(joint_names(arm), *revolutes, joint_torques(arm, gravity, *planar))


def distance_to_way(arm: Arm, path: JointPath, bends: FloatArray) -> float:
    """Least distance of a pose to the poses of a path, that of the joint farthest away, by search on finer grids."""
    pose, low, high = arm.joint_positions(arm.headings(bends)), 0.0, 1.0
    for _ in range(4):
        places = np.linspace(low, high, 4001)
        apart = np.linalg.norm(arm.joint_positions(arm.headings(path.spline(places))) - pose, axis=2).max(axis=1)
        k = int(np.argmin(apart))
        low, high = places[max(k - 2, 0)], places[min(k + 2, 4000)]
    return float(apart[k])


@pytest.mark.drawn(8)
@pytest.mark.planning
@pytest.mark.parametrize("share", [1.0, 0.6])
@pytest.mark.parametrize("jerk", [None, 200.0])
@pytest.mark.parametrize("step", [1e-3, 4e-3])
@pytest.mark.parametrize("seed", range(4))
def test_a_retimed_motion_satisfies_the_independent_verifier(
    seed: int, step: float, jerk: float | None, share: float
) -> None:
    """Angles, rates, torques and jerks of a retimed path pass every check of the verifier that concerns time."""
    links = 4
    arm = slim_arm(links, 0.1)
    path = make_path(random_control(seed, links))
    ends = (JointPose(path.keyframes[0]), JointPose(path.keyframes[-1]))
    limits = replace(even_limits(links, 2.0, 10.0, 1.0), jerk=None if jerk is None else np.full(3 * links, jerk))
    room = Workspace(shapely.box(-1.0, -1.0, 1.0, 1.0))
    problem = Problem("retimed", room, arm, limits, *ends, planner=PlannerOptions(effort_share=share))
    gravity = problem.simulation.gravity

    def dynamics(*motion: FloatArray) -> FloatArray:
        return joint_torques(arm, gravity, *(-values[:, 1::3] for values in motion))

    trajectory = run(path, limits, dynamics, step=step, share=share)
    checks = verify(problem, trajectory, retimed_states(trajectory, arm, gravity))
    assert [check for check in checks if not check.passed] == []
    assert any(check.name == "joint jerk" for check in checks) == (jerk is not None)
    assert any(check.name == "share of effort" for check in checks) == (share < 1.0)


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
    trajectory = run(path, even_limits(links, 5.0, 20.0), link_lengths=np.full(links, length))
    plain = run(path, even_limits(links, 5.0, 20.0))
    assert trajectory.duration == pytest.approx(plain.duration, rel=1e-2)
    worst = np.argmax(np.abs(np.diff(trajectory.bend_angles, n=2, axis=0)).sum(axis=1))
    for k in (worst, worst + 1, len(trajectory.time) // 2):
        middle = trajectory.bend_angles[k : k + 2].mean(axis=0)
        assert distance_to_way(arm, path, middle) <= 0.5 * spare * 1.01 + 1e-8


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=4, deadline=None)
def test_samples_are_near_keyframes_that_are_denser_than_steps(seed: int) -> None:
    """The chords of a motion through ever denser keyframes are as near to each as the verifier asks."""
    rng = np.random.default_rng(seed)
    steps = 0.3 * rng.uniform(0.6, 0.95) ** np.arange(rng.integers(20, 60)) + 3e-4
    turn = np.cumsum(rng.uniform(5.0, 40.0) * steps)
    ahead = np.column_stack((np.cos(turn), np.sin(turn), 0.3 * np.cos(2.0 * turn)))
    path = replace(make_path(np.cumsum(steps[:, None] * ahead, axis=0)), spare=1e-2)
    trajectory = run(path, even_limits(3, 5.0, 60.0), link_lengths=np.full(3, 0.1))
    assert check_keyframes(slim_arm(3, 0.1), trajectory, path.keyframes).passed


def test_where_a_path_spares_no_gap_steps_are_cut_so_far_and_no_further(caplog: pytest.LogCaptureFixture) -> None:
    """Steps are cut into a bounded number of pieces, and a warning tells when that is not enough."""
    path = make_path(random_control(5, 3))
    plain = run(path, even_limits(3, 50.0, 900.0))
    trajectory = run(path, even_limits(3, 50.0, 900.0), link_lengths=np.full(3, 10.0))
    assert len(plain.time) < len(trajectory.time) <= DEFAULT_TIMING.sampling.most_pieces * len(plain.time) + 1
    assert "chord deviation" in caplog.text
