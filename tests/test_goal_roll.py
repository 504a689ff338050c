"""Roll of the tip at its goal: what it means, its derivatives, plans that meet it, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.diagnosis.moved_goal import omissions
from ccm_opt.ik.tip_roll import TipRoll
from ccm_opt.problem import TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import Tool

ARM = replace(Arm.snake(length=0.8, links=10, radius=0.015), base=np.zeros(3), direction=np.eye(3)[0], up=np.eye(3)[2])
FILE = """
schema = 1
space = 3
name = "rolled"
[workspace]
[[workspace.obstacles]]
name = "ball"
sphere = { center = [0.35, 0.3, 0.25], radius = 0.1 }
[arm]
links = 12
link_length = 0.07
radius = 0.015
joint_limit_deg = 45
base = { position = [0, 0, 0], direction = [1, 0, 0], up = [0, 0, 1] }
[arm.tool]
tip = [0.05, 0.0, 0.03]
direction = [0.0, 0.6, 0.8]
up = [1.0, 0.1, 0.0]
bodies = [{ capsule = { from = [0, 0, 0], to = [0.05, 0, 0.02], radius = 0.01 } }]
[limits]
velocity = 1.5
acceleration = 6.0
[start]
shape = "straight"
[goal]
position = POSITION
direction = DIRECTION
up = UP
"""

TURNTABLE = '{ kind = "revolute", axis = [0, 0, 1], range_deg = [-120, 120], velocity = 1.0, acceleration = 4.0 }'


def _turned(random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return two random unit vectors, at least 0.1 rad from parallel."""
    while True:
        first, second = random.normal(size=(2, 3))
        first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
        if np.linalg.norm(np.cross(first, second)) > 0.1:
            return first, second


@given(seed=st.integers(0, 2**32 - 1), angle=st.floats(-3.0, 3.0))
def test_roll_is_the_angle_about_the_goals_direction_and_its_derivatives_are_right(seed: int, angle: float) -> None:
    """A frame that meets the goal, turned about its direction, rolls by the angle; Newton's rows are its slope."""
    random = np.random.default_rng(seed)
    direction, up = _turned(random)
    pointing, above = _turned(random)
    arm = replace(ARM, tool=Tool(tip=np.zeros(3), direction=pointing, up=above))
    goal = TipGoal(np.ones(3), direction, up=up)
    there = Rotation.align_vectors([direction, up], [pointing, above], weights=[np.inf, 1.0])[0]
    turned = Rotation.from_rotvec(angle * direction) * there
    assert goal.roll_of(turned.apply(above)) == pytest.approx(angle, abs=1e-9)
    roll = TipRoll.of(goal, arm, 0.01)
    assert roll is not None
    axis = random.normal(size=3)
    step = 1e-6
    either = [(Rotation.from_rotvec(sign * step * axis) * turned).as_matrix() for sign in (1.0, -1.0)]
    slope = (roll.of_frames(either[0]) - roll.of_frames(either[1])) / (2.0 * step)
    found = roll.row(turned.as_matrix(), axis[:, None])[0]
    assert found == pytest.approx(slope, rel=1e-4, abs=1e-6)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=1)
@given(seed=st.integers(0, 2**32 - 1), carried=st.booleans())
def test_a_plan_rolls_the_tool_as_asked(seed: int, carried: bool, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The frame of the tool at the end, a chain of rotations, is that of a random pose from which the goal was made.

    The base of the arm is fixed, or on a turntable.
    """
    random = np.random.default_rng(seed)
    n = 12
    shape = np.interp(np.arange(n), [0.0, 6.0, 11.0], [1.0, 0.0, -1.0])
    bends = np.outer(shape, random.uniform(-0.15, 0.0, 2)) + random.uniform(-0.1, 0.0, 2)

    def tool_frame(each: FloatArray, turned: float) -> Rotation:
        chain = Rotation.from_euler("Z", turned)
        for a, b in each.reshape(-1, 2):
            chain = chain * Rotation.from_euler("ZY", [a, b])
        return chain

    turned = random.uniform(-1.0, 1.0) if carried else 0.0
    frame = tool_frame(bends, turned)
    place = np.sum([0.07 * tool_frame(bends[: k + 1], turned).apply([1.0, 0.0, 0.0]) for k in range(n)], axis=0)
    parts = {
        "POSITION": place + frame.apply([0.05, 0.0, 0.03]),
        "DIRECTION": frame.apply([0.0, 0.6, 0.8]),
        "UP": frame.apply([1.0, 0.1, 0.0]),
    }
    text = FILE.replace(
        "up = [0, 0, 1] }", f"up = [0, 0, 1], axes = [{TURNTABLE}] }}" if carried else "up = [0, 0, 1] }"
    )
    for name, vector in parts.items():
        text = text.replace(name, str(vector.tolist()))
    folder = tmp_path_factory.mktemp("rolled")
    (folder / "rolled.toml").write_text(text)
    asked = ["solve", str(folder / "rolled.toml"), "--out", str(folder), "--no-pictures"]
    result = CliRunner().invoke(app, asked)
    assert result.exit_code == 0, result.output
    plan = ccm_opt.load(folder / "rolled")
    assert any(check.name == "goal roll" for check in plan.checks)
    end = plan.trajectory.base_positions[-1, 0] if carried else 0.0
    off = tool_frame(plan.trajectory.bend_angles[-1], end) * frame.inv()
    assert off.magnitude() <= np.deg2rad(2.0)
    assert plan.metrics["roll_error_rad"] <= np.deg2rad(1.0)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("direction = DIRECTION\n", "", "goal.up"),
        ("up = UP", "up = [0.0, 0.0, -2.0]", "parallel to goal.direction"),
        ("up = UP", "up = [0, 1, 0]\ndirection_tolerance_deg = 50", "at most 45"),
        ("up = UP", "roll_tolerance_deg = 3", "goal.roll_tolerance_deg"),
        ("up = [1.0, 0.1, 0.0]\n", "", "arm.tool.up: missing"),
        ("direction = DIRECTION\nup = UP", "look_at = [0, 0, 1]\ndistance = [0.1, 0.2]\nup = UP", "goal.up"),
    ],
)
def test_what_does_not_determine_a_roll_is_named_by_its_key(old: str, new: str, expected: str, tmp_path: Path) -> None:
    """Missing directions, vectors along them, and wide tolerances of direction are refused."""
    text = FILE.replace("direction = [0.0, 0.6, 0.8]", "direction = [0.0, 0.0, 1.0]") if "tool" in expected else FILE
    text = text.replace(old, new).replace("POSITION", "[0.5, 0.1, 0.1]").replace("DIRECTION", "[0.0, 0.0, 1.0]")
    (tmp_path / "rolled.toml").write_text(text.replace("UP", "[0.0, 1.0, 0.0]"))
    with pytest.raises(ProblemFileError) as refused:
        ccm_opt.load_problem(tmp_path / "rolled.toml")
    assert expected in str(refused.value), str(refused.value)


def test_goals_without_their_roll_are_tried_where_there_is_no_plan(tmp_path: Path) -> None:
    """The roll is left out before the direction is."""
    text = FILE.replace("POSITION", "[0.5, 0.1, 0.1]").replace("DIRECTION", "[0.0, 0.0, 1.0]")
    (tmp_path / "rolled.toml").write_text(text.replace("UP", "[0.0, 1.0, 0.0]"))
    problem = ccm_opt.load_problem(tmp_path / "rolled.toml")
    tried = list(omissions(problem, ()))
    assert [change.key for change in tried] == ["goal.up", "goal.direction"]
    goal = tried[0].changed(problem).goal
    assert goal.up is None
    assert goal.direction is problem.goal.direction
