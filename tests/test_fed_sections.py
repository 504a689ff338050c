"""Drives of several joints on a feed axis: held at zero until all that they bend has left the guide tube."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import MotionNotFound, ProblemFileError
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem, problem_from_mapping
from ccm_opt.planning.plane_in_space import arm_in_space
from ccm_opt.planning.section_map import SectionMap, unknowns_through
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.couplings import CoupledJoints
from ccm_opt.verification.base_axes import _held
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from tests.arc_arms import arc_arm
from tests.benchmarks.bench_random_arms import toml
from tests.benchmarks.swept_arcs import ArcArm
from tests.benchmarks.swept_file import broken_promises
from tests.space_arms import space_arm

LENGTHS = (0.3, 0.25, 0.2)
FEED = Feed(-0.6, 0.2, 0.05)
DATA: dict[str, Any] = {
    "schema": 1,
    "name": "fed",
    "space": 3,
    "workspace": {
        "bounds": [[-0.6, -0.4, -0.4], [0.6, 0.4, 0.4]],
        "clearance": 0.002,
        "obstacles": [
            {"name": "upper", "sphere": {"center": [0.1, 0.0, 0.07], "radius": 0.04}},
            {"name": "lower", "sphere": {"center": [0.12, 0.0, -0.07], "radius": 0.04}},
        ],
    },
    "arm": {
        "base": {"position": [0.0, 0.0, 0.0], "direction": [1, 0, 0], "up": [0, 0, 1]},
        "feed": {"range": [-0.35, 0.1], "hole": 0.02},
        "sections": [
            {"drive": "section", "length": length, "links": 5, "radius": 0.012, "bend_limit_deg": 110.0}
            for length in (0.15, 0.12, 0.1)
        ],
    },
    "limits": {"velocity": 1.5, "acceleration": 6.0, "feed_velocity": 0.3, "feed_acceleration": 1.0},
    "start": {"shape": "straight"},
    "goal": {"position": [0.2, 0.05, 0.1]},
}


def fed_arms(plane: bool) -> list[tuple[Arm, FloatArray]]:
    """Arms in space on a feed axis, each with what has to be out of the tube for each bend, (2 links,) [m]."""
    evenly = arc_arm((3, 1, 4), LENGTHS, straight=(6,), plane=plane, feed=FEED)
    assert evenly.sections is not None
    begins = np.concatenate(([0.0], np.cumsum(LENGTHS)))[:-1]
    of_joints = np.where(evenly.sections.section_of_joint < 0, 0.0, begins[evenly.sections.section_of_joint])
    ratios = np.zeros((12, 2))
    ratios[[2, 4, 7], 0] = [1.0, 0.5, -0.7]
    ratios[[9, 11], 1] = 1.0
    chain = space_arm(6, 0.1, 0.01, feed=FEED)
    names = CoupledJoints(ratios, ("drive1", "drive2"), np.full(12, 0.8), chain.lengths)
    coupled = replace(chain, coupled=names)
    return [
        (arm_in_space(evenly) if plane else evenly, np.repeat(of_joints, 2)),
        (coupled, 0.1 * np.array([0, 0, 1, 0, 1, 0, 0, 1, 0, 4, 0, 4])),
    ]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0, 1]))
def test_drives_are_held_until_all_that_they_bend_is_out_of_the_tube(seed: int, plane: bool, kind: int) -> None:
    """Unknowns give back the pose that they are taken from, others no bend in the tube, and slopes are differences."""
    rng = np.random.default_rng(seed)
    arm, out_at = fed_arms(plane)[kind]
    assert arm.drives is not None
    drives = arm.drives
    feed = rng.uniform(FEED.low, FEED.high)
    beyond = feed + out_at - FEED.hole
    moves = np.any(drives.coupling[beyond < 0.0], axis=0)
    q = np.append(drives.coupling @ (rng.uniform(-0.5, 0.5, len(moves)) * ~moves), feed)
    assume(np.min(beyond, initial=1.0, where=q[:-1] != 0.0) > 1e-3)
    space, v = unknowns_through(arm, q)
    assert isinstance(space, SectionMap)
    np.testing.assert_allclose(space.configuration(v), q, atol=1e-12)

    drawn = space.drawn(rng, 20)
    found = space.configurations(drawn)
    inside = found[:, -1:] + out_at - FEED.hole < 0.0
    assert not np.any(found[:, :-1][inside])
    assert np.all(np.abs(found[:, :-1]) <= arm.bend_limits + 1e-12)
    assert drives.misfit(found[:, :-1]) < 1e-12
    end = found[0]
    assume(np.min((end[-1] + out_at - FEED.hole)[end[:-1] != 0.0], initial=1.0) > 1e-3)
    other, w = space.blended_to(end)
    np.testing.assert_allclose(other.configuration(w), end, atol=1e-12)
    np.testing.assert_allclose(other.configuration(other.extended(v[None], space)[0]), q, atol=1e-12)

    step = 1e-6 * np.eye(len(v))
    seen = (space.configurations(drawn[1] + step) - space.configurations(drawn[1] - step)) / 2e-6
    scale = 1.0 + np.max(np.abs(seen))
    np.testing.assert_allclose(space.slopes(drawn[1]), seen.T, atol=1e-3 * scale)


def test_bends_at_the_very_end_of_the_tube_are_refused_by_their_drive() -> None:
    """No motion bends a section whose base does not move on; the way out is told."""
    arm, _ = fed_arms(plane=False)[0]
    assert arm.sections is not None
    q = np.append(arm.sections.coupling @ [0.0, 0.3, 0.0, 0.0, 0.1, 0.0], FEED.hole)
    with pytest.raises(MotionNotFound, match=r"section1_b is bent .* beyond the end of the guide tube.*\n.*feed\.hole"):
        unknowns_through(arm, q)


@given(st.floats(1e-4, 0.02), st.sampled_from([1, 2]), st.booleans())
def test_a_section_partly_in_the_tube_has_to_be_straight(depth: float, section: int, plane: bool) -> None:
    """The verifier refuses a bend of a section that is just begun to be out, though all of its joints are out."""
    arm = arc_arm((3, 2, 4), LENGTHS, plane=plane, feed=FEED)
    assert arm.sections is not None
    k = arm.bends_a_joint
    feed = FEED.hole - sum(LENGTHS[:section]) - depth
    bends = np.zeros(3 * k)
    bends[k * section] = 1e-3
    for deeper, passed in ((0.0, False), (depth + 1e-6, True)):
        rows = np.tile(np.append(arm.sections.coupling @ bends, feed + deeper), (3, 1))
        time = np.arange(3.0)
        motion = JointTrajectory(time, rows, np.zeros_like(rows), np.zeros_like(rows), arm.coordinates)
        assert _held(arm, FEED, rows[:, -1], motion, DEFAULT_VERIFICATION).passed == passed


@pytest.mark.parametrize(
    ("table", "value", "words"),
    [
        (
            "goal",
            {"joints_deg": [[9, 0], [0, 0], [0, 0]], "feed": 0.01},
            r"joints_deg\[0\]: this section is still inside",
        ),
        ("goal", {"path": [[0.0, 0, 0], [0.2, 0, 0.1]]}, r"goal\.path: followed by joints that bend one by one"),
    ],
)
def test_what_a_guide_tube_forbids_is_refused_by_its_key(table: str, value: object, words: str) -> None:
    """The file is refused with the key path of the offending value."""
    with pytest.raises(ProblemFileError, match=words):
        parse_problem(toml(DATA | {table: value}))


@pytest.mark.drawn(25, of="dear tests")
@pytest.mark.planning
def test_plan_on_a_feed_axis_keeps_sections_straight_in_the_tube(tmp_path: Path) -> None:
    """By the commands: the plan keeps clear by a model of true arcs of its own, is checked, followed and retargeted."""
    problem = parse_problem(toml(DATA))
    assert problem_data(problem_from_mapping(problem_data(problem))) == problem_data(problem)
    file = tmp_path / "fed.toml"
    file.write_text(toml(DATA))
    solved = CliRunner().invoke(app, ["solve", str(file), "--out", str(tmp_path), "--no-pictures"])
    assert solved.exit_code == 0, solved.output
    with np.load(tmp_path / "fed" / "solution.npz") as arrays:
        assert broken_promises(DATA, dict(arrays), kind=ArcArm) == []
        sample = len(arrays["time"]) // 2
        bends, feed = np.rad2deg(arrays["drive_values"][sample]), arrays["base_feed"][sample]
    assert CliRunner().invoke(app, ["check", str(tmp_path / "fed")]).exit_code == 0
    record = json.loads((tmp_path / "fed" / "solution.json").read_text())
    assert record["simulation"]["outcome"] == "followed"

    asked = ("--position", "0.22,-0.02,0.08", f"--joints-deg={','.join(map(str, bends))}", f"--feed={feed}")
    out = ("--out", str(tmp_path / "moved"), "--no-pictures")
    moved = CliRunner().invoke(app, ["retarget", str(tmp_path / "fed"), *asked, *out])
    assert moved.exit_code == 0, moved.output
    with np.load(tmp_path / "moved" / "fed" / "solution.npz") as arrays:
        np.testing.assert_allclose(arrays["joint_positions"][-1, -1], [0.22, -0.02, 0.08], atol=1e-3)
        assert len(arrays["stops"]) == 1
    assert CliRunner().invoke(app, ["check", str(tmp_path / "moved" / "fed")]).exit_code == 0
