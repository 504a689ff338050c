"""Dynamics of sections that bend evenly, against MuJoCo, Pinocchio and the verifier's own."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.diagnosis.contact import within_torque_limits
from ccm_opt.dynamics.algorithms.arm_model import arm_model
from ccm_opt.dynamics.runtime.inverse_dynamics import ForwardDynamics, InverseDynamics, MassMatrix
from ccm_opt.dynamics.simulation.controller import CompiledLoop
from ccm_opt.io.folder import write_solution
from ccm_opt.robot.arc_sections import ArcSections, Tendons
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import BaseAxis
from ccm_opt.robot.frames import coupling_of_revolutes, drive_torques, revolute_angles
from ccm_opt.verification.drives import of_drives
from ccm_opt.verification.newton_euler import drive_efforts
from tests.arc_arms import CAMERA, arc_arm, lamp
from tests.command_runs import CommandLine
from tests.oracles.arc_chains import chain_states, mujoco_torques, pinocchio_torques
from tests.oracles.interpreted_loop import InterpretedLoop, with_feed
from tests.test_section_files import TEXT, read

GRAVITY = np.array([1.0, 2.0, -9.81])
SEEDS = st.integers(0, 2**32 - 1)
SHARES = st.sampled_from([1e-9, 1e-3, 1.0])
AXES = (
    BaseAxis(np.array([0.0, 0.0, 1.0]), -1.0, 1.0, revolute=True, point=np.array([0.1, 0.2, 0.0])),
    BaseAxis(np.array([0.6, 0.0, 0.8]), -1.0, 1.0, revolute=False, inertia=0.3),
    BaseAxis(np.array([0.0, 1.0, 0.0]), -1.0, 1.0, revolute=True, point=np.array([0.1, 0.2, 0.3]), inertia=0.1),
)


def heavy_arm(seed: int, **changes: object) -> Arm:
    """An arm of four sections with random masses, camera, lamp and payload, and drives with inertia and friction."""
    carried = {"tool": CAMERA, "straight": (6,), "bodies": (lamp(5),), "payload": 0.3}
    of_drives = {"rotor_inertia": 0.01, "friction": 0.02}
    arm = arc_arm((1, 2, 5, 3), (0.3, 0.1, 0.2, 0.3), **carried, **of_drives, **changes)  # type: ignore[arg-type]
    return replace(arm, masses=np.random.default_rng(seed).uniform(0.05, 0.3, arm.links))


def drive_states(seed: int, share: float, count: int = 3) -> FloatArray:
    """Random bends of four sections, of a given size, and rates and accelerations, shape (3, count, 8)."""
    states = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, count, 8))
    states[0] *= 1.5 * share
    return states


def spread(arm: Arm, drives: FloatArray) -> FloatArray:
    """Angles of the revolutes for values of the drives, or their rates."""
    coupling = coupling_of_revolutes(arm)
    assert coupling is not None
    return drives @ coupling.T


@pytest.mark.parametrize("seed", [0, 1])
def test_torques_of_sections_are_those_of_mujoco_and_pinocchio(seed: int) -> None:
    """Inverse dynamics agree to 1e-8 with chains of slides and hinges that follow the arcs."""
    pytest.importorskip("mujoco")
    pytest.importorskip("pinocchio")
    arm = replace(heavy_arm(seed), rotor_inertia=0.0, friction=0.0)
    state = drive_states(seed, 1.0)[:, 0]
    got = drive_torques(arm, InverseDynamics(arm, GRAVITY)(*spread(arm, state)))
    chain = chain_states(arm, *state)
    for expected in (mujoco_torques(arm, GRAVITY, chain), pinocchio_torques(arm, GRAVITY, chain)):
        np.testing.assert_allclose(got, expected, atol=1e-8 * np.max(np.abs(expected)))


@given(SEEDS, SHARES, st.booleans())
@settings(max_examples=25)
def test_verifier_finds_the_same_efforts(seed: int, share: float, carried: bool) -> None:
    """The verifier's dynamics of arcs, with base axes too, agree with those of timing, joint by joint."""
    arm = heavy_arm(seed, carrier=AXES if carried else ())
    rng = np.random.default_rng(seed + 1)
    bends = rng.uniform(-1.0, 1.0, (3, 4, 2 * arm.links)) * np.where(arm.bend_limits > 0.0, 1.0, 0.0)
    bends[0] *= share
    axes = rng.uniform(-1.0, 1.0, (3, 4, len(arm.carrier)))
    torques, efforts = drive_efforts(arm, GRAVITY, *np.concatenate((bends, axes), axis=2))
    states = tuple(revolute_angles(arm, each) for each in bends)
    dynamics = InverseDynamics(arm, GRAVITY)
    if carried:
        expected, on_axes = dynamics.efforts(states, (axes[0], axes[1], axes[2]))
        np.testing.assert_allclose(efforts, on_axes, atol=1e-11 * np.max(np.abs(on_axes)))
    else:
        expected = dynamics(*states)
    np.testing.assert_allclose(torques, expected, atol=1e-11 * np.max(np.abs(expected)))
    np.testing.assert_allclose(of_drives(arm, torques), drive_torques(arm, torques), atol=1e-12)


@given(SEEDS, SHARES)
@settings(max_examples=25)
def test_forward_dynamics_of_drives_undo_inverse_dynamics(seed: int, share: float) -> None:
    """Accelerations of the sections come back, and their mass matrix is symmetric, positive and C' M C."""
    arm = heavy_arm(seed)
    drives, rates, gains = drive_states(seed, share)
    torques = drive_torques(arm, InverseDynamics(arm, GRAVITY)(*(spread(arm, each) for each in (drives, rates, gains))))
    np.testing.assert_allclose(ForwardDynamics(arm, GRAVITY)(drives, rates, torques), gains, atol=1e-8)
    mass = MassMatrix(arm)(spread(arm, drives[0]))
    assert np.array_equal(mass, mass.T)
    assert np.linalg.eigvalsh(mass)[0] > 0.0


@given(SEEDS, st.integers(3, 4))
@settings(max_examples=25)
def test_tendons_pull_with_the_torques_of_the_sections(seed: int, number: int) -> None:
    """The work of the least tensions on the lengths of the tendons is that of the torques, and no tendon pushes."""
    tendons = (Tendons(0.009, number, 0.2), Tendons(0.007, 7 - number, 1.0), Tendons(0.005, 3, 2.0))
    ones = np.ones(3)
    sections = ArcSections(np.array([4, 4, 4]), 0.1 * ones, 2.0 * ones, np.full((3, 2), 0.01), tendons)
    torques = np.random.default_rng(seed).uniform(-1.0, 1.0, (5, 6))
    tensions = sections.tendon_tensions(torques)
    pulls = sections.tendon_lengths(np.zeros(6)) - np.stack([sections.tendon_lengths(each) for each in np.eye(6)])
    np.testing.assert_allclose(tensions @ pulls.T, torques, atol=1e-12)
    assert np.min(tensions) >= 0.0
    assert np.all(np.min(tensions[:, :number].reshape(5, -1, number // 2 if number == 4 else 1), axis=1) < 1e-12)


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.booleans(), st.floats(0.05, 2.0))
def test_closed_loop_of_drives_is_that_of_the_same_law_in_numpy(seed: int, computed: bool, share: float) -> None:
    """From any state, under noise, brakes and limits that saturate, both loops hold the same efforts over a step."""
    arm = arc_arm((1, 3), (0.3, 0.2), payload=0.1, rotor_inertia=0.01, friction=0.02)
    plant, believed = (arm_model(each, GRAVITY) for each in (arm, replace(arm, payload=0.2)))
    kp, kd = (900.0 * np.ones(4), 60.0 * np.ones(4)) if computed else (np.linspace(0.5, 5.0, 4), np.full(4, 0.02))
    numbers = {"step": 1e-4, "computed": computed, "kp": kp, "kd": kd, "limit": np.full(4, share)}
    numbers = with_feed(numbers, believed, (400.0, 40.0), 20.0)
    random = np.random.default_rng(seed)
    state, reference = random.uniform(-1.0, 1.0, (2, 5)), random.uniform(-1.0, 1.0, (3, 3, 5))
    noise, held = random.normal(0.0, 1e-3, (3, 2, 4)), int(random.integers(0, 2))
    got = CompiledLoop(plant, believed, numbers).run(state, reference, noise, held)
    expected = InterpretedLoop(plant, believed, numbers).run(state, reference, noise, held)
    assert not np.any(got[1][:held])
    assert np.all(np.abs(got[1][:, :4]) <= share)
    for ours, theirs in zip(got, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-8 * np.max(np.abs(theirs)))


HEAD = """[arm.tool]
tip = [10.0, 0.0, 5.0]
bodies = [{ box = [[0.0, -6.0, -6.0], [10.0, 6.0, 8.0]] }]
mass = 0.01

[limits]"""
"""A camera head on the last section."""


@pytest.mark.planning
def test_arm_of_sections_follows_its_plan_within_torque_limits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A plan keeps the torques of its sections, is followed and passes every check; a weak section is named."""
    text = TEXT.replace("velocity = 0.5", "velocity = 5.0\ntorque = [0.5, 0.4]").replace("[1.0, 2.0]", "100.0")
    text = text.replace('drive = "section"', 'drive = "section"\nmass = 0.25').replace("[limits]", HEAD)
    solution = ccm_opt.solve(read(text), explain=False)
    assert solution.simulation.verdict.outcome == "followed"
    assert solution.simulation.tracking_error < 1e-3
    folder = write_solution(solution, tmp_path)
    arrays = np.load(folder / "solution.npz")
    assert arrays["simulated_torques"].shape == arrays["drive_torques"].shape
    assert np.max(np.abs(arrays["drive_torques"][:, :2])) <= 0.5
    np.testing.assert_allclose(arrays["tool_tip"][-1], [0.22, -0.06, 0.12], atol=1e-3)
    assert CommandLine(capsys)("check", folder).code == 0
    weak = next(within_torque_limits(read(text.replace("0.5, 0.4", "0.05, 0.4"))))
    assert "start: section 1 (section1_b) needs" in weak.reason


CARRIAGE = """
[arm.base]
position = [0.0, 0.0, 0.0]
direction = [1.0, 0.0, 0.0]

[[arm.base.axes]]
kind = "prismatic"
axis = [0.0, 1.0, 0.0]
range = [-200.0, 200.0]
velocity = 100.0
acceleration = 500.0
"""
"""A base on an axis across the arm."""


@pytest.mark.drawn(6, of="whole plans")
@pytest.mark.planning
def test_tendons_keep_their_travel_and_speed_on_a_carriage() -> None:
    """An arm on a base axis, which begins at 98 % of the travel, is planned and timed within both limits."""
    text = re.sub(r"\[arm\]\nbase = .*\n", CARRIAGE, TEXT).replace("[220.0, -60.0", "[220.0, -200.0")
    text = text.replace("velocity = 0.5", "velocity = 5.0").replace("[1.0, 2.0]", "100.0").replace("[limits]", HEAD)
    solution = ccm_opt.solve(read(text.replace("number = 3", "number = 3, travel = 1.6, speed = 2.0")), explain=False)
    assert abs(solution.trajectory.base_positions[-1, 0] + 0.14) < 0.1
    shown = {check.name: check for check in solution.checks}
    assert shown["tendon travel"].worst <= 1.6e-3
    assert 0.8 * 2e-3 < shown["tendon speed"].worst <= 2e-3
