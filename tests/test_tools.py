"""Tools: rigid bodies on the last link, as links of an arm, in plans, problem files and folders."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.io.problem_data import arm_table
from ccm_opt.io.tool_tables import box_capsules
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import Tool, ToolBody
from ccm_opt.scene.tool_links import colliding_at_rest, drawn_radii, points_with_tool, with_tool_links
from ccm_opt.verification.chain_motion import chain_points
from ccm_opt.verification.tool_chain import arm_with_tool, motion_of

PLANE = Arm.snake(length=1.0, links=10, radius=0.02)
SPACE = replace(PLANE, base=np.zeros(3), direction=np.eye(3)[0], up=np.eye(3)[2])
FILE = """
schema = 1
name = "camera"
[workspace]
bounds = [-1.2, -1.2, 1.2, 1.2]
[[workspace.obstacles]]
name = "post"
circle = { center = [0.9, 0.35], radius = 0.05 }
[arm]
links = 12
link_length = 0.08
radius = 0.02
base = [0, 0]
joint_limit_deg = 60.0
[arm.tool]
tip = [0.07, 0.05]
direction = [0, 1]
bodies = [{ capsule = { from = [0, 0], to = [0.06, 0], radius = 0.012 } }, { box = [0.05, 0.0, 0.07, 0.04] }]
[limits]
velocity = 1.0
acceleration = 2.0
[start]
shape = "straight"
[goal]
position = [0.4, 0.5]
heading_deg = 120.0
"""


def _tool(rng: np.random.Generator, dimension: int) -> Tool:
    direction: FloatArray = rng.normal(size=dimension)
    bodies = []
    for _ in range(rng.integers(0, 4)):
        start, step = 0.1 * rng.normal(size=(2, dimension))
        bodies.append(ToolBody(start, start + step * rng.integers(0, 2), float(rng.uniform(0.005, 0.03))))
    return Tool(0.1 * rng.normal(size=dimension), direction / np.linalg.norm(direction), tuple(bodies))


def _distance_from_axis(place: FloatArray, start: FloatArray, end: FloatArray) -> float:
    line = end - start
    share = np.clip((place - start) @ line / (line @ line + 1e-300), 0.0, 1.0)
    return float(np.linalg.norm(place - start - share * line))


@given(seed=st.integers(0, 10_000), dimension=st.sampled_from([2, 3]))
def test_tool_links_end_at_the_tip_in_its_direction_and_run_along_every_body(seed: int, dimension: int) -> None:
    """The last link ends at the tool's tip and points its way, and links of the bodies' radii contain their axes."""
    rng = np.random.default_rng(seed)
    tool = _tool(rng, dimension)
    arm = replace(PLANE if dimension == 2 else SPACE, tool=tool)
    whole = with_tool_links(arm)
    q = np.zeros(len(whole.coordinates))
    q[: len(arm.coordinates)] = 0.5 * rng.normal(size=len(arm.coordinates))
    points, frames = whole.joint_positions_at(q), whole.link_rotations(q)
    end, frame = points[arm.links], frames[arm.links - 1]
    assert points[-1] == pytest.approx(end + frame @ tool.tip, abs=1e-12)
    assert frames[-1][:, 0] == pytest.approx(frame @ tool.direction, abs=1e-9)
    assert points == pytest.approx(points_with_tool(arm, q[: len(arm.coordinates)]), abs=1e-12)
    parts = list(zip(points[:-1], points[1:], drawn_radii(arm), strict=True))[arm.links :]
    for body in tool.bodies:
        for place in (body.start, body.end):
            at = end + frame @ place
            assert min(_distance_from_axis(at, a, b) for a, b, radius in parts if radius == body.radius) < 1e-6


@given(seed=st.integers(0, 10_000), dimension=st.sampled_from([2, 3]))
def test_the_verifiers_chain_places_bodies_as_the_planners_links_do(seed: int, dimension: int) -> None:
    """Both models end at the same tip, and compare the same number of pairs of a link of the arm and a body."""
    rng = np.random.default_rng(seed)
    arm = replace(PLANE if dimension == 2 else SPACE, tool=_tool(rng, dimension))
    q = 0.5 * rng.normal(size=(2, len(arm.coordinates)))
    motion = motion_of(arm, np.array([0.0, 1.0]), q)
    assert chain_points(motion.arm, motion.positions)[:, -1] == pytest.approx(points_with_tool(arm, q)[:, -1])
    pairs = []
    for whole in (with_tool_links(arm), arm_with_tool(arm)):
        assert whole.tool_links is not None
        pairs.append(int(np.sum(whole.tool_links.distant)))
    assert pairs[0] == pairs[1]


@given(seed=st.integers(0, 10_000), dimension=st.sampled_from([2, 3]))
def test_capsules_of_a_box_contain_it(seed: int, dimension: int) -> None:
    """Every point of a box, its corners above all, lies in one of its capsules."""
    rng = np.random.default_rng(seed)
    half = rng.uniform(0.01, 1.0, dimension)
    capsules = list(box_capsules(-half, half))
    corners = np.array(np.meshgrid(*zip(-half, half, strict=True))).reshape(dimension, -1).T
    for place in np.concatenate((corners, rng.uniform(-half, half, (50, dimension)))):
        assert any(_distance_from_axis(place, c.start, c.end) <= c.radius * (1.0 + 1e-12) for c in capsules)


def test_a_tool_that_reaches_back_to_the_arm_collides_at_rest() -> None:
    """A body beside a link far from the tip is found with the link; one in front of the arm is not."""
    back = ToolBody(np.array([-0.45, 0.0]), np.array([-0.42, 0.0]), 0.01)
    ahead = ToolBody(np.zeros(2), np.array([0.1, 0.0]), 0.02)
    tool = Tool(np.zeros(2), np.array([1.0, 0.0]), (ahead, back))
    assert colliding_at_rest(PLANE, tool) == (5, 1)
    assert colliding_at_rest(PLANE, replace(tool, bodies=(ahead,))) is None


def _problem(text: str, folder: Path) -> Problem:
    file = folder / "camera.toml"
    file.write_text(text)
    return ccm_opt.load_problem(file)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("radius = 0.02\n", "radius = 0.02\npayload = 0.1\n", r"line \d+: arm.payload: not supported"),
        (
            "acceleration = 2.0",
            "acceleration = 2.0\ntip_velocity = 1.0",
            r"line \d+: limits.tip_velocity: not supported",
        ),
        ("direction = [0, 1]", "direction = [0, 0]", r"line \d+: arm.tool.direction: expected numbers"),
        ("to = [0.06, 0]", "to = [-0.5, 0]", r"line \d+: arm.tool.bodies\[0\]: it touches or nearly touches link \d+"),
        ("{ box = [0.05, 0.0, 0.07, 0.04] }", "{}", r"line \d+: arm.tool.bodies\[1\]: expected exactly one"),
    ],
)
def test_what_a_tool_does_not_allow_is_named_by_key_and_line(old: str, new: str, expected: str, tmp_path: Path) -> None:
    """Bad tools, and keys that do not go with tools, are refused with their place in the file."""
    with pytest.raises(ProblemFileError, match=expected):
        _problem(FILE.replace(old, new, 1), tmp_path)


@pytest.mark.parametrize("beside", [0.0205, 0.0215, 0.05])
def test_a_body_that_runs_back_along_the_arm_is_compared_or_refused(beside: float, tmp_path: Path) -> None:
    """No body comes so near to links of the straight arm that it is not compared with them, unless it is refused."""
    text = FILE.replace(
        "bodies = [",
        f"bodies = [{{ capsule = {{ from = [0, {beside}], to = [-0.3, {beside}], radius = 0.005 }} }}, ",
        1,
    )
    try:
        arm = _problem(text, tmp_path).arm
    except ProblemFileError as refused:
        assert "nearly touches link" in str(refused)  # noqa: PT017 - it may be accepted
        return
    whole = with_tool_links(arm)
    body = arm.links + int(np.flatnonzero(whole.radii[arm.links :] > 0.0)[0])
    assert all(whole.distant_links[link, body] for link in range(arm.links - 2))


def test_a_tool_survives_being_written_and_read(tmp_path: Path) -> None:
    """The table of an arm with a tool gives the same tool again, its bodies as capsules."""
    problem = _problem(FILE, tmp_path)
    table: Any = arm_table(problem.arm, "m")["tool"]
    assert table["tip"] == [0.07, 0.05]
    assert [list(body) for body in table["bodies"]] == [["capsule"], ["capsule"]]


@pytest.mark.parametrize("call", [ccm_opt.find_pose, ccm_opt.reach_map, ccm_opt.LivePlan])
def test_functions_that_do_not_carry_tools_refuse_them(call: Any, tmp_path: Path) -> None:
    """No function plans for the arm without its tool."""
    with pytest.raises(ProblemError, match=r"does not support a tool; leave arm\.tool out"):
        call(_problem(FILE, tmp_path))


def test_a_plan_brings_the_tools_tip_to_the_goal_and_its_folder_holds(tmp_path: Path) -> None:
    """The tip of the tool is at the goal, in its direction, and the written plan passes every check."""
    problem = _problem(FILE, tmp_path)
    solution = ccm_opt.solve(problem)
    q = solution.trajectory.positions[-1]
    assert points_with_tool(problem.arm, q)[-1] == pytest.approx([0.4, 0.5], abs=1e-3)
    heading = problem.arm.headings(q)[-1] + np.pi / 2.0
    assert np.cos(heading - np.deg2rad(120.0)) == pytest.approx(1.0, abs=1e-3)
    folder = solution.save(tmp_path / "camera")
    assert CliRunner().invoke(app, ["check", str(folder)]).exit_code == 0
    with np.load(folder / "solution.npz") as arrays:
        assert arrays["tool_tip"][-1] == pytest.approx([0.4, 0.5], abs=1e-3)
    assert 'link name="tool"' in (folder / "arm.urdf").read_text()
