"""Planar arms whose sections bend evenly: true arcs, their drives and tendons, files, and plans."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem, problem_from_mapping
from ccm_opt.planning.plane_in_space import arm_in_space, rows_in_space
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.robot.arc_sections import Tendons
from ccm_opt.robot.frames import drive_torques, joint_positions_3d, revolute_angles
from ccm_opt.verification.chain_motion import acceleration_bounds, chain_points, link_directions
from ccm_opt.verification.drives import of_drives
from ccm_opt.verification.newton_euler import drive_efforts

from .arc_arms import arc_arm
from .benchmarks.bench_random_arms import toml
from .benchmarks.swept_arcs import ArcArm
from .benchmarks.swept_file import broken_promises

GRAVITY = np.array([1.0, 0.0, -9.81])
DATA: dict[str, Any] = {
    "schema": 1,
    "name": "even",
    "workspace": {
        "bounds": [-0.2, -0.5, 0.8, 0.5],
        "clearance": 0.002,
        "obstacles": [
            {"name": "pipe", "circle": {"center": [0.35, 0.12], "radius": 0.04}},
            {"name": "post", "box": [0.5, -0.5, 0.55, -0.3]},
        ],
    },
    "arm": {
        "base": [0.0, 0.0],
        "sections": [
            {
                "drive": "section",
                "length": length,
                "links": 8,
                "radius": [0.015, 0.012],
                "bend_limit_deg": 120.0,
                "mass": 0.2,
                "tendons": {"radius": 0.01, "travel": 0.03, "speed": 0.03},
            }
            for length in (0.25, 0.2, 0.15)
        ],
    },
    "limits": {"velocity": 1.5, "acceleration": 6.0, "torque": 8.0},
    "start": {"joints_deg": [-20.0, 0.0, 30.0]},
    "goal": {"position": [0.38, -0.3]},
}


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-9, 0.1, 1.0]), st.booleans())
def test_arcs_are_circles_as_in_space(seed: int, share: float, headed: bool) -> None:
    """Places, bounds of motion and torques are those of arcs of circles, and of the arm in space, for both models."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(-3.0, 3.0) if headed else 0.0
    arm = arc_arm((3, 1, 5), plane=True, base_heading=heading, rotor_inertia=0.01, friction=0.02, payload=0.3)
    assert arm.sections is not None
    turns = share * rng.uniform(-1.5, 1.5, 3)
    q = arm.sections.coupling @ turns
    before = heading + np.cumsum(turns) - turns
    steps = arm.sections.lengths * np.sinc(0.5 * turns / np.pi) * np.exp(1j * (before + 0.5 * turns))
    points = arm.joint_positions_at(q)
    np.testing.assert_allclose(points[-1], [steps.sum().real, steps.sum().imag], atol=1e-13)
    np.testing.assert_array_equal(joint_positions_3d(arm, revolute_angles(arm, q)), arm.embedded(points))
    whole = arm_in_space(arm)
    assert whole.sections is not None
    in_space = rows_in_space(q[None], arm.links)[0]
    np.testing.assert_allclose(whole.joint_positions_at(in_space)[:, ::2], points, atol=1e-13)
    np.testing.assert_allclose(whole.sections.drives(in_space), turns, atol=1e-13)
    np.testing.assert_allclose(chain_points(arm, q[None])[0], points, atol=1e-13)
    np.testing.assert_allclose(link_directions(arm, q[None])[0], arm.link_rotations(q)[..., 0], atol=1e-13)

    change, u, step = arm.sections.coupling @ rng.uniform(-1.5, 1.5, 3), np.linspace(-0.5, 0.5, 21)[:, None], 2e-4
    near = [arm.joint_positions_at(q + (u + shift) * change) for shift in (-step, 0.0, step)]
    seen = np.max(np.linalg.norm(near[0] - 2.0 * near[1] + near[2], axis=2), axis=0) / step**2
    assert np.all(seen <= acceleration_bounds(arm, q[None], change[None])[0] + 1e-7)

    states = (arm.sections.coupling @ rng.uniform(-1.0, 1.0, (3, 3)))[..., None].reshape(3, 1, -1)
    torques = InverseDynamics(arm, GRAVITY)(*(revolute_angles(arm, each) for each in states))
    spatial = [rows_in_space(each, arm.links) for each in states]
    expected = InverseDynamics(whole, GRAVITY)(*(revolute_angles(whole, each) for each in spatial))
    np.testing.assert_allclose(drive_torques(arm, torques), drive_torques(whole, expected), atol=1e-10)
    needed = drive_efforts(arm, GRAVITY, *states)[0]
    np.testing.assert_allclose(of_drives(arm, needed), drive_torques(arm, torques), atol=1e-10)


@given(st.integers(0, 2**32 - 1))
def test_tendons_run_along_both_sides(seed: int) -> None:
    """They are as long as arcs at their distance from the axis; the one that pulls bears the torque, the other none."""
    rng = np.random.default_rng(seed)
    arm = arc_arm((4, 4, 4), plane=True)
    assert arm.sections is not None
    radii = (0.009, 0.007, 0.005)
    sections = replace(arm.sections, tendons=tuple(Tendons(radius, 2) for radius in radii))
    turns, torques = rng.uniform(-1.5, 1.5, (2, 3))
    arcs = sections.lengths[:, None] - turns[:, None] * np.array([radii])
    expected = np.cumsum(arcs, axis=0).diagonal()
    back = np.cumsum(2.0 * sections.lengths[:, None] - arcs, axis=0).diagonal()
    found = sections.tendon_lengths(turns)
    np.testing.assert_allclose(found, np.stack((expected, back), axis=1).ravel(), atol=1e-14)
    tensions = sections.tendon_tensions(torques)
    np.testing.assert_allclose(-tensions @ sections.tendon_slopes, torques, atol=1e-12)
    assert np.min(tensions) >= 0.0
    np.testing.assert_allclose(np.min(tensions.reshape(3, 2), axis=1), 0.0, atol=1e-12)


def test_problem_is_written_as_it_was_read() -> None:
    """Sections, their tendons and the start keep their values from a file to data and back."""
    problem = parse_problem(toml(DATA))
    again = problem_from_mapping(problem_data(problem))
    assert problem_data(again) == problem_data(problem)
    assert problem.arm.sections is not None
    assert problem.arm.sections.drive_names == ("section1", "section2", "section3")
    np.testing.assert_allclose(problem.arm.sections.drives(problem.start.bends), np.deg2rad([-20.0, 0.0, 30.0]))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("arm", "sections", 0, "tendons", "angle_deg"), 0.0, r"angle_deg: in the plane a section has two tendons"),
        (("arm", "bodies"), [{"link": 1, "bodies": [{"circle": {"center": [0, 0], "radius": 1}}]}], r"give arm\.tool"),
        (("start",), {"shape": "folded"}, r'start\.shape: expected "straight"'),
        (("goal",), {"segments": [{"length": 0.6, "curvature": [0, 0, 0, 0, 0]}]}, r"goal\.segments: not supported"),
        (("start",), {"joints_deg": [[1.0, 2.0]] * 3}, r"start\.joints_deg"),
        (("start",), {"joints_deg": [121.0, 0.0, 0.0]}, r"start\.joints_deg\[0\]: 121° exceeds 120°"),
    ],
)
def test_what_is_not_supported_is_refused_by_its_key(path: tuple[Any, ...], value: object, words: str) -> None:
    """The file is refused with the key path of the offending value."""
    data = json.loads(json.dumps(DATA))
    table = data
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = value
    with pytest.raises(ProblemFileError, match=words):
        parse_problem(toml(data))


@pytest.mark.drawn(25, of="dear tests")
@pytest.mark.planning
def test_plan_of_true_arcs_touches_nothing(tmp_path: Path) -> None:
    """By the commands: the plan keeps clear by a model of true arcs of its own, is checked and simulated."""
    file = tmp_path / "even.toml"
    file.write_text(toml(DATA))
    solved = CliRunner().invoke(app, ["solve", str(file), "--out", str(tmp_path), "--no-pictures"])
    assert solved.exit_code == 0, solved.output
    with np.load(tmp_path / "even" / "solution.npz") as arrays:
        assert broken_promises(DATA, dict(arrays), kind=ArcArm) == []
        assert arrays["tendon_lengths"].shape == (len(arrays["time"]), 6)
    assert CliRunner().invoke(app, ["check", str(tmp_path / "even")]).exit_code == 0
    record = json.loads((tmp_path / "even" / "solution.json").read_text())
    assert record["simulation"]["outcome"] == "followed"


def test_places_are_told_in_the_plane() -> None:
    """A start in contact, which is found in space, is told with two numbers."""
    rows = [{"name": "on the arm", "circle": {"center": [0.3, 0.0], "radius": 0.02}}]
    data = DATA | {"workspace": DATA["workspace"] | {"obstacles": rows}, "start": {"shape": "straight"}}
    with pytest.raises(ProblemError, match=r"'on the arm' at \([-\d.]+, [-\d.]+\) m"):
        MotionPlanner().plan(parse_problem(toml(data)))
