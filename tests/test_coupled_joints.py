"""Joints that share drives: their dynamics, files and plans."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.dynamics.runtime.inverse_dynamics import ForwardDynamics, InverseDynamics
from ccm_opt.io.folder import model_texts, write_solution
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem, problem_from_mapping
from ccm_opt.io.reading_back import load_any_problem, load_motion
from ccm_opt.planning.section_map import SectionMap
from ccm_opt.robot.frames import angles_from_drives, drive_torques
from ccm_opt.verification.drives import of_drives
from ccm_opt.verification.newton_euler import drive_efforts
from tests.command_runs import CommandLine

TEXT = """
schema = 1
space = 3
name = "finger"

[workspace]
bounds = [[-0.1, -0.4, -0.4], [0.6, 0.4, 0.4]]

[[workspace.obstacles]]
name = "post"
box = [[0.2, -0.3, -0.3], [0.23, 0.3, -0.03]]

[arm]
base_limit_deg = 50
payload = 0.0
base = { position = [0, 0, 0], direction = [1, 0, 0] }
coupling = [
    [1, 0, 0], [0, 1, 0],
    [0, 0, 0], [0, 0.6, 0],
    [0, 0, 0], [0, 0, 1],
    [0, 0, 0], [0, 0, 0.8],
    [-0.5, 0, 0], [0, 0, 0.5],
]

[[arm.sections]]
links = 5
link_length = 0.08
radius = 0.01
joint_limit_deg = 60

[limits]
velocity = [1.0, 2.0, 3.0]
acceleration = 5.0
torque = [1.5, 4.0, 1.0]

[start]
shape = "straight"

[goal]
joints_deg = [[20, -30], [0, -18], [0, 40], [0, 32], [-10, 20]]
"""

TOOL = """
[arm.tool]
tip = [0.04, 0.0, 0.01]
mass = 0.05
bodies = [{ capsule = { from = [0, 0, 0], to = [0.03, 0, 0.01], radius = 0.008 } }]
"""


@cache
def read(text: str = TEXT) -> ccm_opt.Problem:
    """The problem of a file."""
    return parse_problem(text, "finger.toml")


def test_limits_of_drives_are_shared_among_their_joints() -> None:
    """Joints have their ratio of the rates of a drive, and its torque limit; what no drive moves is locked."""
    problem = read()
    drives = problem.arm.coupled
    assert drives is not None
    np.testing.assert_allclose(np.rad2deg(drives.drive_limits), [50.0, 50.0, 60.0])
    np.testing.assert_allclose(np.rad2deg(problem.arm.bend_limits.reshape(-1, 2)[:2]), [[50.0, 50.0], [0.0, 60.0]])
    rates = problem.limits.velocity.reshape(-1, 3)[:, :2]
    np.testing.assert_allclose(rates[[0, 0, 1, 3, 4, 4], [0, 1, 1, 1, 0, 1]], [1.0, 2.0, 1.2, 2.4, 0.5, 1.5])
    assert problem.limits.torque is not None
    np.testing.assert_allclose(drives.of_drives(problem.limits.torque), [1.5, 4.0, 1.0])


def test_problem_is_written_as_it_was_read() -> None:
    """The data of a problem give the same coupling and limits again."""
    problem = read()
    again = problem_from_mapping(problem_data(problem), "written")
    assert again.arm.coupled is not None
    assert problem.arm.coupled is not None
    np.testing.assert_array_equal(again.arm.coupled.ratios, problem.arm.coupled.ratios)
    np.testing.assert_allclose(again.arm.bend_limits, problem.arm.bend_limits, rtol=1e-12)
    for name in ("velocity", "acceleration", "torque"):
        np.testing.assert_allclose(getattr(again.limits, name), getattr(problem.limits, name), rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("    [0, 0, 0], [0, 0.6, 0],\n", "", r"arm.coupling: expected one row for each of the 10 bends"),
        ("[0, 0.6, 0]", "[0, 0.6]", r"arm.coupling\[3\]: expected one number for each of the 3 drives; got 2"),
        ("[0, 0.6, 0]", "[0, 0.6, 0.1]", r"arm.coupling\[3\]: 2 drives move one bend"),
        ("[1, 0, 0], [0, 1, 0]", "[0, 0, 0], [0, 1, 0]", r"start.joints_deg|goal.bends"),
        (
            "payload = 0.0",
            "feed = { range = [0, 1] }",
            r"goal.joints_deg\[0\]: this joint is still inside the guide tube",
        ),
        ("[1.0, 2.0, 3.0]", "[1.0, 2.0]", "limits.velocity: expected one value per drive or revolute"),
        ("[0, 32]", "[0, 33]", r"goal.bends differ by up to [\d.]+° from those of coupled joints"),
        ("acceleration = 5.0", "acceleration = 5.0\ntip_velocity = 1.0", "limits.tip_velocity: not supported"),
    ],
)
def test_what_is_not_supported_is_refused_by_its_key(old: str, new: str, words: str) -> None:
    """Each defect of a file is named with its key."""
    with pytest.raises((ProblemFileError, ccm_opt.ProblemError), match=words):
        read(TEXT.replace(old, new, 1))


@given(drives=st.tuples(*[st.floats(-50.0, 50.0)] * 3), digits=st.integers(2, 6))
def test_rounded_joints_are_those_of_drives(drives: tuple[float, float, float], digits: int) -> None:
    """Of bends that are written with few digits the nearest drives are taken, within their limits."""
    arm = read(TEXT).arm
    assert arm.coupled is not None
    exact = np.rad2deg(arm.coupled.coupling @ np.deg2rad(drives)).reshape(-1, 2)
    rows = np.round(exact, digits).tolist()
    start = read(re.sub(r"(?s)\[start\].*?\n\n", f"[start]\njoints_deg = {rows}\n\n", TEXT)).start
    assert arm.coupled.misfit(np.ravel(start.bends)) <= 1e-9
    assert np.max(np.abs(np.rad2deg(start.bends))) <= 60.0 + 1e-6
    assert np.rad2deg(start.bends) == pytest.approx(exact, abs=10.0**-digits)


def test_a_drive_that_moves_nothing_is_named() -> None:
    """A coupling without rank is refused."""
    with pytest.raises(ProblemFileError, match=r"arm.coupling: drive 3 moves nothing, so that the matrix has no full"):
        read(TEXT.replace("0, 1]", "0, 0]").replace("0.8]", "0]").replace("0, 0.5]", "0, 0]"))


def drawn_ratios(rng: np.random.Generator, links: int, drives: int) -> FloatArray:
    """Random ratios of bends, each moved by one drive or none, and something by each drive, (2 links, drives)."""
    ratios = np.zeros((2 * links, drives))
    moved = rng.integers(-1, drives, 2 * links)
    moved[rng.permutation(2 * links)[:drives]] = np.arange(drives)
    bends = np.flatnonzero(moved >= 0)
    ratios[bends, moved[bends]] = rng.uniform(0.3, 1.5, len(bends)) * rng.choice([-1.0, 1.0], len(bends))
    return ratios


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_dynamics_of_drives_are_those_of_mujoco(seed: int, count: int) -> None:
    """Torques are Cᵀ (M C d̈ + h) of MuJoCo's chain, accelerations undo them, and the verifier finds the same."""
    mujoco = pytest.importorskip("mujoco")
    rng = np.random.default_rng(seed)
    problem = read(TEXT.replace("payload = 0.0", "payload = 0.2"))
    assert problem.arm.coupled is not None
    ratios = drawn_ratios(rng, problem.arm.links, count)
    names = tuple(f"drive{k}" for k in range(count))
    arm = replace(problem.arm, coupled=replace(problem.arm.coupled, ratios=ratios, names=names))
    gravity = rng.normal(size=3) * 5.0
    drives, rates, gains = rng.uniform(-1.0, 1.0, (3, 1, count))
    states = [angles_from_drives(arm, each) for each in (drives, rates, gains)]
    revolutes = InverseDynamics(arm, gravity)(*states)
    torques = drive_torques(arm, revolutes)
    model = mujoco.MjModel.from_xml_string(model_texts(problem, obstacles=False)["arm.mjcf.xml"])
    model.opt.gravity[:] = gravity
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = states[0][0], states[1][0]
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    coupling = angles_from_drives(arm, np.eye(count)).T
    expected = coupling.T @ (mass @ states[2][0] + data.qfrc_bias)
    scale = np.max(np.abs(revolutes))
    np.testing.assert_allclose(torques[0], expected, atol=1e-8 * scale)
    np.testing.assert_allclose(ForwardDynamics(arm, gravity)(drives, rates, torques), gains, rtol=1e-6, atol=1e-7)
    bends = [each @ ratios.T for each in (drives, rates, gains)]
    of_verifier = of_drives(arm, drive_efforts(arm, gravity, *bends)[0])
    np.testing.assert_allclose(of_verifier, torques, atol=1e-10 * scale)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_unknowns_reproduce_configurations_within_limits(seed: int, count: int) -> None:
    """Unknowns of a configuration give it back, random ones respect all limits, and slopes are differences."""
    rng = np.random.default_rng(seed)
    arm = read().arm
    assert arm.coupled is not None
    ratios = drawn_ratios(rng, arm.links, count)
    wide = np.maximum(arm.bend_limits, 0.3)
    drives = replace(arm.coupled, ratios=ratios, names=("drive",) * count, limits=wide)
    arm = replace(arm, coupled=drives)
    space, v = SectionMap.of_drives(arm, drives, ratios @ rng.normal(size=count))
    np.testing.assert_allclose(space.fitted(space.configuration(v)), v, atol=1e-12)
    assert np.all(np.abs(space.configurations(space.drawn(rng, 20))) <= wide + 1e-12)
    np.testing.assert_allclose(space.slopes(v) @ v, space.configuration(v), atol=1e-12)


@pytest.mark.planning
def test_finger_keeps_its_ratios_and_passes_every_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A plan with a tool is followed in simulation and checked from its folder, and joints out of ratio are refused."""
    solution = ccm_opt.solve(read(TEXT + TOOL), explain=False)
    assert solution.simulation.verdict.outcome == "followed"
    folder = write_solution(solution, tmp_path)
    arrays = dict(np.load(folder / "solution.npz"))
    assert arrays["drive_names"].tolist() == ["drive1", "drive2", "drive3"]
    np.testing.assert_allclose(np.rad2deg(arrays["drive_values"][-1]), [20.0, -30.0, 40.0], atol=1e-3)
    assert np.all(np.max(np.abs(arrays["drive_torques"]), axis=0) <= [1.5, 4.0, 1.0])
    assert CommandLine(capsys)("check", folder).code == 0
    arrays["drive_torques"][0, 0] += 1e-3
    np.savez(folder / "solution.npz", **arrays)
    with pytest.raises(ccm_opt.ProblemError, match="drive_torques"):
        load_motion(folder, load_any_problem(folder).arm)


def test_the_hand_moves_the_drives() -> None:
    """Servo control keeps the ratios, and the verifier accepts the motion."""
    servo = ccm_opt.Servo(read())
    for _ in range(8):
        servo.step(ccm_opt.Twist((-0.1, 0.05, -0.1)))
    servo.brake()
    assert np.any(servo.solution().trajectory.positions[-1])
    assert all(check.passed for check in servo.solution().checks)
