"""The simulated closed loop: physics, tracking, stability limits and failures."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigvals

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import SimulationError
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, MassMatrix, joint_states
from ccm_opt.dynamics.simulation import closed_loop_run as simulation
from ccm_opt.dynamics.simulation.closed_loop_run import simulate
from ccm_opt.dynamics.simulation.controller import gains, hermite, inertia_at_most, step_reference
from ccm_opt.dynamics.simulation.stability import check_stability, fastest_mode
from ccm_opt.io.mjcf_models import mjcf_text
from ccm_opt.problem import ControllerName, Disturbances, SimulationOptions
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import BaseAxis, Feed
from ccm_opt.robot.coordinates import DriveLimits
from ccm_opt.robot.frames import frame_transforms, joint_positions_3d
from tests.dynamics_arms import carried, loose_limits, smooth_trajectory, swan_neck
from tests.oracles.interpreted_loop import InterpretedLoop
from tests.space_arms import space_arm

CHUNK = 200
"""Steps between two states that are compared."""
WEIGHT = np.array([0.0, 0.0, -9.81])
BENDS = 0.4 * np.sin(np.arange(12.0))


def states_of(arm: Arm, trajectory: JointTrajectory, gravity: FloatArray = WEIGHT) -> JointStates:
    """Joint states of a planar trajectory."""
    return joint_states(arm, trajectory, InverseDynamics(arm, gravity))


def run(
    arm: Arm, trajectory: JointTrajectory, options: SimulationOptions, torque: float | None = None
) -> SimulatedMotion:
    """Simulate a planar trajectory."""
    return simulate(arm, trajectory, states_of(arm, trajectory, options.gravity), options, loose_limits(arm, torque))


def spatial_states(arm: Arm, trajectory: JointTrajectory) -> JointStates:
    """A motion of all three revolutes of every ball, made from a trajectory's own time law."""
    planar = states_of(arm, trajectory)
    mix = np.kron(np.eye(arm.links), np.array([[0, 0, 0], [0.5, 1.0, -0.7], [0, 0, 0]]))
    angles, velocities, accelerations = (x @ mix for x in (planar.angles, planar.velocities, planar.accelerations))
    torques = InverseDynamics(arm, WEIGHT)(angles, velocities, accelerations)
    return JointStates(planar.names, angles, velocities, accelerations, torques)


def test_computed_torque_tracks_a_smooth_motion() -> None:
    """Computed torque follows a smooth motion within 1e-3 rad, at the samples too, without saturation."""
    arm, trajectory = swan_neck(12), smooth_trajectory(BENDS)
    motion = run(arm, trajectory, SimulationOptions())
    planned = states_of(arm, trajectory)
    assert motion.tracking_error < 2e-5
    assert np.max(np.abs(motion.angles - planned.angles)) <= motion.tracking_error + 1e-9
    assert np.max(np.abs(motion.torques - planned.torques)) < 0.02 * np.max(np.abs(planned.torques))
    assert not motion.saturated


def test_tracking_in_space_improves_with_the_step() -> None:
    """For a motion of all revolutes the error of the held torque is of second order in the step."""
    arm, trajectory = swan_neck(12), smooth_trajectory(BENDS)
    joints, limits = spatial_states(arm, trajectory), loose_limits(arm)
    coarse, fine = (
        simulate(arm, trajectory, joints, SimulationOptions(step=step), limits).tracking_error
        for step in (5e-4, 2.5e-4)
    )
    assert np.max(np.abs(joints.angles[:, 3])) > 0.1
    assert fine < 2e-5
    assert coarse / fine == pytest.approx(4.0, rel=0.1)


def test_an_arm_of_many_links_is_tracked_at_the_default_step() -> None:
    """The torque held over a step is right at its middle, so that even 120 links are tracked at 1 ms."""
    arm = swan_neck(120)
    motion = run(arm, smooth_trajectory(0.1 * np.sin(0.2 * np.arange(120.0))), SimulationOptions())
    assert motion.tracking_error < 1e-3


def test_a_planar_motion_stays_exactly_planar_past_the_singular_bend() -> None:
    """The base may turn past 90°, where Z-Y-X is singular: out of the plane everything stays exactly zero."""
    bends = BENDS.copy()
    bends[0] = 2.5
    motion = run(swan_neck(12), smooth_trajectory(bends, duration=2.0), SimulationOptions())
    assert motion.tracking_error < 1e-3
    assert not np.any(motion.angles[:, 0::3])
    assert not np.any(motion.angles[:, 2::3])


def test_large_arms_track() -> None:
    """An arm above 72 joints tracks as well."""
    bends = 0.2 * np.sin(np.arange(26.0))
    assert run(swan_neck(26), smooth_trajectory(bends), SimulationOptions()).tracking_error < 1e-3


def test_pd_follows_and_ends_near_the_goal() -> None:
    """PD with gravity torques lags behind the motion but stays near it, and holds still at rest."""
    arm = swan_neck(12)
    options = SimulationOptions(controller="pd", proportional_gain=10.0, derivative_gain=0.015)
    assert run(arm, smooth_trajectory(BENDS, duration=2.0), options).tracking_error < 0.2
    resting = run(arm, smooth_trajectory(np.zeros(12), duration=0.3), options)
    assert resting.tracking_error < 1e-6


def test_the_virtual_machine_simulates_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """In CasADi's virtual machine the simulated motion is the same to rounding."""
    arm, trajectory = swan_neck(4), smooth_trajectory(BENDS[:4], duration=0.5)
    expected = run(arm, trajectory, SimulationOptions())
    monkeypatch.setattr(simulation, "CompiledLoop", InterpretedLoop)
    got = run(arm, trajectory, SimulationOptions())
    assert np.allclose(got.angles, expected.angles, atol=1e-10)
    assert np.allclose(got.torques, expected.torques, atol=1e-8)


def free_fall(arm: Arm, seconds: float, step: float) -> list[FloatArray]:
    """States of an arm falling freely, straight and at rest at first: the loop with its torques limited to zero."""
    loop = simulation.closed_loop(arm, arm, SimulationOptions(step=step), loose_limits(arm, torque=0.0))
    width, state = 3 * arm.links + 1, np.zeros((2, 3 * arm.links + 1))
    states = [state[:, :-1].ravel()]
    for _ in range(round(seconds / step / CHUNK)):
        rest = np.zeros((CHUNK, 3, width))
        state = loop.run(state, rest, rest[:, :2, :-1], 0)[0][-1]
        states.append(state[:, :-1].ravel())
    return states


def free_fall_energy(arm: Arm, seconds: float, step: float) -> FloatArray:
    """Total energy along a free fall [J]."""
    return np.array([energy(arm, state) for state in free_fall(arm, seconds, step)])


def energy(arm: Arm, state: FloatArray) -> float:
    """Kinetic energy by the mass matrix and potential energy of the links' centres."""
    q, qd = np.split(state, 2)
    points = joint_positions_3d(arm, q)
    height = 0.5 * (points[:-1, 2] + points[1:, 2])
    return float(0.5 * qd @ MassMatrix(arm)(q) @ qd + 9.81 * np.sum(arm.masses * height))


def test_free_fall_from_level_keeps_its_energy() -> None:
    """In 0.6 s of free fall from level the energy drifts by under 1e-6 J at steps of 1 ms, 1e-7 J at 0.5 ms."""
    arm = replace(swan_neck(12), base_heading=0.0)
    for step, bound in ((1e-3, 1e-6), (5e-4, 1e-7)):
        total = free_fall_energy(arm, seconds=0.6, step=step)
        assert np.max(np.abs(total - total[0])) < bound


def test_free_fall_equals_mujocos() -> None:
    """A raised arm, whose end whips round as it falls, keeps MuJoCo's company: same steps, same states, same drift."""
    mujoco = pytest.importorskip("mujoco")
    arm = swan_neck(12)
    model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", WEIGHT))  # Runge–Kutta, 1 ms
    model.jnt_limited[:] = 0
    data = mujoco.MjData(model)
    for ours in free_fall(arm, seconds=0.6, step=1e-3)[1:]:
        mujoco.mj_step(model, data, CHUNK)
        assert np.allclose(ours, np.concatenate((data.qpos, data.qvel)), atol=1e-7)


def test_the_integrator_is_of_fourth_order() -> None:
    """Halving the step cuts the energy error about thirty-two-fold (fifth order for RK4's dissipation)."""
    coarse, fine = (free_fall_energy(swan_neck(4), 0.4, step) for step in (2e-3, 1e-3))
    ratio = np.abs(coarse[-1] - coarse[0]) / np.abs(fine[-1] - fine[0])
    assert 12.0 < ratio < 80.0


def test_saturation_is_reported_and_kept() -> None:
    """Torques never pass their limit, and meeting it is reported."""
    arm, trajectory = swan_neck(12), smooth_trajectory(BENDS, duration=0.4)
    limit = 0.9 * float(np.max(np.abs(states_of(arm, trajectory).torques)))
    motion = run(arm, trajectory, SimulationOptions(), torque=limit)
    assert motion.saturated
    assert motion.verdict.outcome in {"saturated", "strayed"}
    assert "torque limit" in motion.verdict.reason
    assert 0.0 < motion.saturated_time <= trajectory.duration
    assert motion.verdict.joint in motion.verdict.reason
    assert np.max(np.abs(motion.torques)) <= limit


def test_unstable_pd_gains_are_refused_with_numbers() -> None:
    """Kp far above Kd / dt shakes at the step: the error gives the figures and gains that would hold."""
    options = SimulationOptions(controller="pd", proportional_gain=100.0, derivative_gain=0.02)
    with pytest.raises(SimulationError, match=r"pd with Kp / Kd = 5000 1/s, dt = 0\.001 s, is unstable") as caught:
        run(swan_neck(12), smooth_trajectory(BENDS), options)
    diagnosis = caught.value.diagnosis
    assert diagnosis.stage == "simulation"
    assert "simulation.gains.derivative above" in diagnosis.advice[0]
    a = diagnosis.evidence["fastest_rate"] * 1e-3
    assert diagnosis.evidence["value"] == pytest.approx(6.0 * a / (1.0 + a))


@pytest.mark.parametrize(
    "options",
    [
        SimulationOptions(controller="pd", proportional_gain=100.0, derivative_gain=0.02),
        SimulationOptions(controller="pd", bandwidth=3000.0),
        SimulationOptions(controller="pd", disturbances=Disturbances(mass_error=-0.49)),
    ],
)
def test_the_gains_that_are_advised_are_stable(options: SimulationOptions) -> None:
    """The first figure that the error names passes the check, and the simulated arm stays at its plan."""
    arm, trajectory = swan_neck(12), smooth_trajectory(BENDS, duration=0.5)
    with pytest.raises(SimulationError) as caught:
        run(arm, trajectory, options)
    name, _, value = caught.value.diagnosis.advice[0].split()[:3]
    field = {"simulation.gains.derivative": "derivative_gain", "simulation.bandwidth": "bandwidth"}[name]
    assert run(arm, trajectory, replace(options, **{field: float(value)})).verdict.outcome == "followed"


def test_an_arm_half_as_heavy_as_believed_is_refused() -> None:
    """PD looks ahead on the believed arm: where what moves has less than half its inertia no gains are stable."""
    options = SimulationOptions(controller="pd", disturbances=Disturbances(mass_error=-0.6))
    with pytest.raises(SimulationError, match=r"(?s)unstable for this arm.*try: simulation.disturbances.mass_error"):
        run(swan_neck(12), smooth_trajectory(BENDS), options)


def test_too_much_bandwidth_is_refused() -> None:
    """Computed torque needs ωn dt < 1, and says so before running."""
    with pytest.raises(SimulationError, match=r"computed-torque .* is unstable") as caught:
        run(swan_neck(12), smooth_trajectory(BENDS), SimulationOptions(bandwidth=1200.0))
    assert "simulation.bandwidth below" in caught.value.diagnosis.advice[0]


@settings(max_examples=60, deadline=None)
@given(bandwidth=st.floats(1.0, 1e4), step=st.floats(1e-4, 0.5))
def test_the_condition_of_computed_torque_is_that_of_the_sampled_mode(bandwidth: float, step: float) -> None:
    """ωn dt < 1 holds exactly when the sampled double integrator has its roots inside the circle."""
    alpha, beta = (bandwidth * step) ** 2, 2.0 * bandwidth * step
    radius = np.max(np.abs(eigvals([[1 - alpha / 2, 1 - beta / 2], [-alpha, 1 - beta]])))
    if abs(radius - 1.0) > 1e-6:
        assert (radius < 1.0) == (bandwidth * step < 1.0)


@settings(max_examples=100, deadline=None)
@given(kp=st.floats(0.1, 1e4), kd=st.floats(1e-3, 1e2), step=st.floats(1e-4, 0.1), inertia=st.floats(1e-6, 10.0))
def test_the_condition_of_pd_is_that_of_the_sampled_mode(kp: float, kd: float, step: float, inertia: float) -> None:
    """A mode under PD whose errors are those of the end of the step is stable exactly under the one condition."""
    # The law itself, as it stands in control_law.py, for one joint without gravity: unit errors of place and speed.
    motion = []
    for x, v in ((1.0, 0.0), (0.0, 1.0)):
        ahead = -kp * (x + step * v) - kd * v
        effort = ahead - step * kd * ahead / (inertia + step * kd)
        motion.append([x + step * v + 0.5 * step**2 * effort / inertia, v + step * effort / inertia])
    radius = np.max(np.abs(eigvals(np.transpose(motion))))
    rate = kd / inertia
    if abs(radius - 1.0) > 1e-6:
        assert (radius < 1.0) == (rate * step * (1.0 + kp / kd * step) / (1.0 + rate * step) < 2.0)


def test_computed_torque_is_critically_damped() -> None:
    """Kp = ωn², Kd = 2 ωn."""
    proportional, derivative = gains(swan_neck(4), SimulationOptions(bandwidth=30.0))
    np.testing.assert_allclose(proportional, 900.0)
    np.testing.assert_allclose(derivative, 60.0)


def test_of_one_gain_the_other_follows() -> None:
    """A gain that is given alone is met by the one that damps critically at the bandwidth; two stand as they are."""
    for one in ({"proportional_gain": 8.0}, {"derivative_gain": 0.4}):
        proportional, derivative = gains(swan_neck(4), SimulationOptions(controller="pd", bandwidth=40.0, **one))
        np.testing.assert_allclose(proportional, 8.0)
        np.testing.assert_allclose(derivative, 0.4)
    options = SimulationOptions(controller="pd", proportional_gain=3.0, derivative_gain=0.1)
    proportional, derivative = gains(swan_neck(4), options)
    assert proportional[0] == 3.0
    assert derivative[-1] == 0.1


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), links=st.integers(2, 16), payload=st.floats(0.0, 2.0))
def test_gains_of_pd_outweigh_the_mass_matrix_of_every_pose(seed: int, links: int, payload: float) -> None:
    """D − M(q) has no negative eigenvalue for the bends of any pose in the plane: every mode is critically damped."""
    rng = np.random.default_rng(seed)
    arm = replace(swan_neck(links, varied=True), payload=payload, rotor_inertia=rng.uniform(0.0, 1e-3))
    angles = np.zeros(3 * links)
    angles[1::3] = rng.uniform(-1.5, 1.5, links)
    M = MassMatrix(arm)(angles)[1::3, 1::3]
    D = inertia_at_most(arm)[1::3]
    assert np.min(np.linalg.eigvalsh(np.diag(D) - M)) > -1e-9 * np.max(D)


@pytest.mark.parametrize("mass", [0.005, 0.5, 200.0])
@pytest.mark.parametrize("links", [2, 5, 24, 96])
def test_pd_follows_whatever_the_arm(links: int, mass: float) -> None:
    """Gains that come from the arm keep a metre of arm at its plan, from two links to 96, from grams to a crane."""
    share = mass / links
    length = 1.0 / links
    arm = replace(
        swan_neck(links),
        link_length=length,
        masses=np.full(links, share),
        inertia_axial=np.full(links, share * 0.015**2 / 2),
        inertia_transverse=np.full(links, share * (3 * 0.015**2 + length**2) / 12),
    )
    bends = np.minimum(1.0, 6.0 / links) * np.sin(0.7 + 6.0 / links * np.arange(links))
    trajectory = smooth_trajectory(bends, duration=1.5)
    motion = run(arm, trajectory, SimulationOptions(controller="pd"))
    assert motion.verdict.outcome == "followed"
    # Slow against ωn a joint is off by its acceleration over ωn², and Coriolis forces add their part.
    assert motion.tracking_error < 1.5 * np.max(np.abs(trajectory.bend_accelerations)) / 50.0**2
    heavier = run(arm, trajectory, SimulationOptions(controller="pd", disturbances=Disturbances(mass_error=0.2)))
    assert heavier.verdict.outcome == "followed"


def test_a_run_that_fails_says_what_the_drives_could_hold() -> None:
    """Joint, time, cause and need are in the reason: too weak drives are told from drives that are badly used."""
    arm, trajectory = swan_neck(12), smooth_trajectory(BENDS, duration=0.8)
    joints = states_of(arm, trajectory)
    peak = float(np.max(np.abs(joints.torques)))
    weak = run(arm, trajectory, SimulationOptions(), torque=0.8 * peak).verdict
    assert f"the drives cannot follow this plan with the simulated arm: it takes {peak:.4g} N m of ball01_bend at" in (
        weak.reason
    )
    assert f"and the limit is {0.8 * peak:.4g} N m" in weak.reason
    assert weak.advice[0] == f"a torque limit above {peak:.4g} N m for ball01_bend"
    # Held back for a tenth of a second the arm has to catch up, which the drives cannot; the plan itself they could do.
    late = SimulationOptions(bandwidth=200.0, disturbances=Disturbances(start_delay=0.3))
    hurried = run(arm, trajectory, late, torque=1.05 * peak).verdict
    assert not hurried.followed
    assert "the drives could follow this plan with the simulated arm, at 95.2 % of a limit at most" in hurried.reason


def test_the_fastest_mode_is_the_largest_eigenvalue() -> None:
    """λmax is that of M⁻¹, over all joints in space and over the bends in the plane."""
    arm, angles = swan_neck(6), np.zeros((2, 18))
    M = MassMatrix(arm)(angles[0])
    assert fastest_mode(arm, angles, planar=False) == pytest.approx(np.max(np.linalg.eigvalsh(np.linalg.inv(M))))
    bends = np.linalg.inv(M[1::3, 1::3])
    assert fastest_mode(arm, angles, planar=True) == pytest.approx(np.max(np.linalg.eigvalsh(bends)))


def test_an_arm_out_of_control_is_stopped_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """When the loop blows up in spite of the check, the run ends there: joint and time are named, all is finite."""
    monkeypatch.setattr(simulation, "check_stability", lambda *_, **__: None)
    options = SimulationOptions(controller="pd", proportional_gain=100.0, derivative_gain=0.002)
    trajectory = smooth_trajectory(BENDS)
    motion = run(swan_neck(12), trajectory, options)
    assert motion.verdict.outcome == "diverged"
    assert motion.verdict.joint.startswith("ball")
    assert motion.verdict.joint in motion.verdict.reason
    assert motion.verdict.time is not None
    assert 0.0 < motion.verdict.time < trajectory.duration
    assert np.isfinite(motion.angles).all()
    # From there on the arm stands still in its last pose.
    after = motion.angles[trajectory.time >= motion.verdict.time]
    assert np.all(after == after[0])


def test_zyz_is_refused_out_of_the_plane() -> None:
    """Forward dynamics of zyz are singular when straight; where the arm leaves its plane the error says to use zyx."""
    sideways = SimulationOptions(gravity=np.array([0.0, 1.0, -9.81]))
    with pytest.raises(SimulationError, match=r"(?s)'zyz' is singular.*try: arm\.axes = \"zyx\""):
        run(swan_neck(12, "zyz"), smooth_trajectory(BENDS), sideways)


def test_zyz_in_the_plane_is_simulated_as_zyx() -> None:
    """In the plane both orders of axes give the same motion and the same torques of the bends."""
    options = SimulationOptions()
    one, other = (run(swan_neck(12, axes), smooth_trajectory(BENDS), options) for axes in ("zyz", "zyx"))
    np.testing.assert_array_equal(one.angles[:, 1::3], other.angles[:, 1::3])
    np.testing.assert_allclose(one.torques[:, 1::3], other.torques[:, 1::3], atol=1e-9)


def test_large_bends_out_of_the_plane_are_refused() -> None:
    """With gravity across the plane a bend near 90° is refused before running."""
    bends = BENDS.copy()
    bends[0] = 1.5
    options = SimulationOptions(gravity=np.array([0.0, 1.0, -9.81]))
    with pytest.raises(SimulationError, match=r"a bend reaches 1\.5 rad"):
        run(swan_neck(12), smooth_trajectory(bends), options)


def test_a_motion_without_duration_stands_still() -> None:
    """A trajectory of one sample comes back as it is."""
    arm = swan_neck(4)
    trajectory = JointTrajectory(np.zeros(1), *np.zeros((3, 1, 4)))
    motion = run(arm, trajectory, SimulationOptions())
    assert motion.angles.shape == (1, 12)
    assert motion.tracking_error == 0.0


@pytest.mark.parametrize("interval", [4e-3, 1 / 300, 2.7e-3])
def test_any_sample_grid_is_served(interval: float) -> None:
    """Samples that do not fall on steps are interpolated well below the tracking error's size."""
    arm, trajectory = swan_neck(4), smooth_trajectory(BENDS[:4], duration=0.5, interval=interval)
    motion = run(arm, trajectory, SimulationOptions(bandwidth=200.0))
    assert motion.angles.shape == (len(trajectory.time), 12)
    assert np.max(np.abs(motion.angles - states_of(arm, trajectory).angles)) < 1e-4


def test_the_reference_reproduces_constant_accelerations() -> None:
    """Between samples of a constant acceleration the reference is exact, at any step."""
    time = np.linspace(0.0, 1.0, 11)[:, None]
    reference = step_reference(time[:, 0], 0.5 * 3.0 * time**2, 3.0 * time, 3e-3)
    window, ends = reference.window(100, 20)
    t = (100 + np.arange(20)) * 3e-3
    assert np.allclose(window[:, 0, 0], 1.5 * t**2, atol=1e-14)
    assert np.allclose(window[:, 1, 0], 3.0 * t, atol=1e-13)
    assert np.allclose(window[:, 2, 0], 3.0, atol=1e-10)
    assert np.allclose(ends[:, 0], 1.5 * (t + 3e-3) ** 2, atol=1e-14)


@settings(max_examples=30, deadline=None)
@given(coefficients=st.lists(st.floats(-2, 2), min_size=4, max_size=4), u=st.floats(0, 1))
def test_hermite_is_exact_for_cubics(coefficients: list[float], u: float) -> None:
    """Interpolation inside a step reproduces any cubic."""
    cubic = np.polynomial.Polynomial(coefficients)
    rate, step = cubic.deriv(), 0.3
    start, end = (np.array([[[cubic(t)], [rate(t)]]]) for t in (0.0, step))
    assert np.allclose(hermite(np.array([u]), step, start, end), cubic(u * step), atol=1e-12)


def test_link_frames_and_dynamics_agree_on_the_roll_axis() -> None:
    """The energy oracle's points are the balls of the DH frames."""
    arm = swan_neck(4)
    q = np.random.default_rng(3).uniform(-1, 1, 12)
    assert np.array_equal(joint_positions_3d(arm, q), frame_transforms(arm, q)[::3, :3, 3])


def test_stable_options_pass_the_check() -> None:
    """The default options of both controllers pass on the swan's neck."""
    arm, states = swan_neck(12), states_of(swan_neck(12), smooth_trajectory(BENDS))
    for controller in ("computed-torque", "pd"):
        check_stability(arm, states.angles, np.zeros((1, 0)), SimulationOptions(controller=controller), planar=True)


def on_axis(arm: Arm, duration: float = 1.0) -> tuple[Arm, JointTrajectory]:
    """The arm on a feed axis, and a motion of bends and feed together."""
    arm = replace(arm, feed=Feed(0.0, 0.4, 0.4))
    base = smooth_trajectory(np.array([0.3]), duration)
    return arm, carried(arm, smooth_trajectory(BENDS[: arm.links], duration), base)


def test_the_feed_axis_is_tracked() -> None:
    """Computed torque follows bends and feed of a motion together; without disturbances both errors are small."""
    arm, trajectory = on_axis(swan_neck(12))
    motion = run(arm, trajectory, SimulationOptions())
    assert motion.tracking_error < 2e-5
    assert np.max(np.abs(motion.base_positions - trajectory.base_positions)) < 1e-6


@pytest.mark.parametrize("share", [10.0, 0.6])
@pytest.mark.parametrize("controller", ["computed-torque", "pd"])
def test_an_axis_along_the_arm_moves_as_a_feed_axis_does(controller: ControllerName, share: float) -> None:
    """The closed loop on one prismatic base axis is that on a feed axis, with a force that saturates too."""
    fed = space_arm(4, feed=Feed(0.0, 0.4, 0.0))
    trajectory = carried(fed, smooth_trajectory(np.full(8, 0.3), 1.0), smooth_trajectory(np.array([0.3]), 1.0))
    axis = BaseAxis(fed.base_rotation[:, 0], 0.0, 0.4, revolute=False)
    on_axis = replace(fed, feed=None, carrier=(axis,))
    options = SimulationOptions(controller=controller, gravity=np.array([3.0, 1.0, -9.0]))
    joints = states_of(fed, trajectory)
    most = share * float(np.max(np.abs(joints.base_forces)))
    loose = loose_limits(fed)
    of_axis = DriveLimits(*np.full((3, 1), np.inf), np.array([most]))
    expected = simulate(fed, trajectory, joints, options, replace(loose, feed_force=most))
    carried_too = replace(trajectory, coordinates=on_axis.coordinates)
    got = simulate(on_axis, carried_too, joints, options, replace(loose, axes=of_axis))
    assert got.saturated == expected.saturated == (share < 1.0)
    np.testing.assert_allclose(got.base_positions, expected.base_positions, atol=1e-9)
    np.testing.assert_allclose(got.angles, expected.angles, atol=1e-8)


def test_pd_holds_the_feed_axis_against_gravity() -> None:
    """PD follows the feed of a slow motion, and rests exactly where gravity pulls along the axis."""
    arm, trajectory = on_axis(replace(swan_neck(12), base_heading=1.0), duration=2.0)
    options = SimulationOptions(controller="pd", proportional_gain=10.0, derivative_gain=0.015, bandwidth=20.0)
    motion = run(arm, trajectory, options)
    assert np.max(np.abs(motion.base_positions - trajectory.base_positions)) < 0.01
    still = carried(arm, smooth_trajectory(np.zeros(12), 0.3), smooth_trajectory(np.zeros(1), 0.3))
    resting = run(arm, still, options)
    assert np.max(np.abs(resting.base_positions)) < 1e-9


def test_thrust_never_passes_its_limit() -> None:
    """A feed force too small for the motion is kept and reported as saturation, and the base lags."""
    arm, trajectory = on_axis(swan_neck(12), duration=0.4)
    joints = states_of(arm, trajectory)
    loose = simulate(arm, trajectory, joints, SimulationOptions(), loose_limits(arm))
    tight = replace(loose_limits(arm), feed_force=0.6 * float(np.max(np.abs(joints.base_forces))))
    motion = simulate(arm, trajectory, joints, SimulationOptions(), tight)
    assert motion.saturated
    assert not loose.saturated
    assert np.max(np.abs(motion.base_positions - trajectory.base_positions)) > 1e-3


def test_too_stiff_a_feed_axis_is_refused() -> None:
    """Under PD a bent arm gives way to the base at once: damping for its whole mass is refused with a better figure."""
    arm, trajectory = on_axis(swan_neck(12))
    options = SimulationOptions(controller="pd", proportional_gain=10.0, derivative_gain=0.015, bandwidth=2000.0)
    with pytest.raises(SimulationError, match="PD of the feed axis is unstable") as caught:
        run(arm, trajectory, options)
    advised = float(caught.value.diagnosis.advice[0].split()[2])
    assert np.isfinite(run(arm, trajectory, replace(options, bandwidth=min(advised, 100.0))).tracking_error)


def test_free_fall_on_a_feed_axis_equals_mujocos() -> None:
    """Without thrust and torques, base and arm fall as MuJoCo's do, payload, rotors and friction included."""
    mujoco = pytest.importorskip("mujoco")
    arm, _ = on_axis(replace(swan_neck(6), payload=0.1, rotor_inertia=1e-4, friction=1e-3))
    model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", WEIGHT))
    model.jnt_limited[:] = 0
    data = mujoco.MjData(model)
    limits = replace(loose_limits(arm, torque=0.0), feed_force=0.0)
    loop = simulation.closed_loop(arm, arm, SimulationOptions(), limits)
    rest = np.zeros((CHUNK, 3, 19))
    state = np.zeros((2, 19))
    for _ in range(3):
        state = loop.run(state, rest, rest[:, :2, :-1], 0)[0][-1]
        mujoco.mj_step(model, data, CHUNK)
        ours = np.concatenate((state[0, -1:], state[0, :-1], state[1, -1:], state[1, :-1]))
        assert np.allclose(ours, np.concatenate((data.qpos, data.qvel)), atol=1e-7)
    assert abs(state[0, -1]) > 0.01


def test_thrust_at_its_limit_is_the_same_in_the_virtual_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled and interpreted loops agree where the thrust is at its limit."""
    arm, trajectory = on_axis(swan_neck(4), duration=0.3)
    joints = states_of(arm, trajectory)
    limits = replace(loose_limits(arm), feed_force=0.7 * float(np.max(np.abs(joints.base_forces))))
    expected = simulate(arm, trajectory, joints, SimulationOptions(), limits)
    monkeypatch.setattr(simulation, "CompiledLoop", InterpretedLoop)
    got = simulate(arm, trajectory, joints, SimulationOptions(), limits)
    assert expected.saturated
    assert np.allclose(got.angles, expected.angles, rtol=0.0, atol=1e-10)


DISTURBANCES = (
    Disturbances(),
    Disturbances(mass_error=0.1, payload=0.02, friction=1e-3, start_delay=0.05),
    Disturbances(angle_noise=1e-4, velocity_noise=1e-3, seed=3),
)


@pytest.mark.parametrize("disturbances", DISTURBANCES)
@pytest.mark.parametrize("controller", ["computed-torque", "pd"])
def test_the_virtual_machine_runs_the_same_loop(
    monkeypatch: pytest.MonkeyPatch, disturbances: Disturbances, controller: ControllerName
) -> None:
    """Compiled and interpreted loops agree to rounding, with a feed axis and whatever disturbs them."""
    arm, trajectory = on_axis(replace(swan_neck(4), payload=0.05, friction=1e-3), duration=0.3)
    options = SimulationOptions(
        controller=controller, proportional_gain=10.0, derivative_gain=0.015, bandwidth=20.0, disturbances=disturbances
    )
    expected = run(arm, trajectory, options)
    monkeypatch.setattr(simulation, "CompiledLoop", InterpretedLoop)
    got = run(arm, trajectory, options)
    assert np.allclose(got.angles, expected.angles, rtol=0.0, atol=1e-10)
    assert np.allclose(got.base_positions, expected.base_positions, rtol=0.0, atol=1e-10)
    assert np.allclose(got.torques, expected.torques, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize(
    "disturbances",
    [
        Disturbances(mass_error=0.05),
        Disturbances(payload=0.01),
        Disturbances(friction=1e-3),
        Disturbances(angle_noise=1e-3),
        Disturbances(velocity_noise=0.05),
        Disturbances(start_delay=0.05),
    ],
)
def test_every_disturbance_disturbs(disturbances: Disturbances) -> None:
    """What the controller does not know of makes the error at least ten times what it is without."""
    arm, trajectory = swan_neck(12), smooth_trajectory(BENDS)
    calm = run(arm, trajectory, SimulationOptions()).tracking_error
    assert run(arm, trajectory, SimulationOptions(disturbances=disturbances)).tracking_error > 10.0 * calm


def test_noise_is_the_same_for_the_same_seed() -> None:
    """Noise is repeated by its seed, changed by another, and leaves a planar motion in its plane."""
    arm, trajectory = swan_neck(4), smooth_trajectory(BENDS[:4], duration=0.3)
    first, again, other = (
        run(arm, trajectory, SimulationOptions(disturbances=Disturbances(angle_noise=1e-3, seed=seed))).angles
        for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert not np.any(first[:, 0::3])


def test_brakes_hold_the_arm_until_it_starts() -> None:
    """During the delay nothing moves and nothing is driven."""
    arm, trajectory = swan_neck(4), smooth_trajectory(BENDS[:4])
    motion = run(arm, trajectory, SimulationOptions(disturbances=Disturbances(start_delay=0.2)))
    held = trajectory.time < 0.2 - 1e-9
    assert not np.any(motion.angles[held])
    assert not np.any(motion.torques[held])
    assert np.any(motion.angles[-1])


def test_friction_too_stiff_for_the_step_is_refused() -> None:
    """Friction that the integrator cannot follow is refused before running, with a step that would do."""
    options = SimulationOptions(disturbances=Disturbances(friction=0.5))
    with pytest.raises(SimulationError, match="cannot be integrated"):
        run(swan_neck(12), smooth_trajectory(BENDS), options)
