"""The how-to for ROS 2: its blocks run on stand-ins that are as strict as the generated message classes of rclpy."""

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import ccm_opt
from ccm_opt.cli.written_plans import exported_files
from ccm_opt.io.folder import write_solution
from ccm_opt.problem.solution import Solution

from .conftest import PROBLEMS
from .solved_problems import solved
from .test_export_formats import Duration, JointTrajectoryPoint

EXAMPLES = Path(__file__).parent.parent / "examples"
PAGE = Path(__file__).parent.parent / "docs" / "other-programs.md"


class Strict:
    """A message whose fields are given by name alone, each checked as rclpy's setters check it."""

    def __init__(self, **fields: object) -> None:
        for name, value in fields.items():
            setattr(self, name, value)


class JointTrajectory(Strict):
    """``trajectory_msgs/JointTrajectory``: header, string[] joint_names, JointTrajectoryPoint[] points."""

    def __init__(self, **fields: object) -> None:
        self.joint_names: list[str] = []
        self.points: list[JointTrajectoryPoint] = []
        super().__init__(**fields)

    def __setattr__(self, name: str, value: object) -> None:
        assert name in {"header", "joint_names", "points"}
        assert isinstance(value, list)
        assert all(isinstance(item, str if name == "joint_names" else JointTrajectoryPoint) for item in value)
        object.__setattr__(self, name, value)


class Vector3(Strict):
    """``geometry_msgs/Vector3``: float64 x, y, z."""

    def __init__(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> None:
        super().__init__(x=x, y=y, z=z)

    def __setattr__(self, name: str, value: object) -> None:
        assert name in {"x", "y", "z"}
        assert isinstance(value, float)
        object.__setattr__(self, name, value)


class JointState(Strict):
    """``sensor_msgs/JointState``: header, string[] name, float64[] position, velocity, effort."""

    def __init__(self, **fields: object) -> None:
        object.__setattr__(self, "header", SimpleNamespace(stamp=None))
        super().__init__(**fields)

    def __setattr__(self, name: str, value: object) -> None:
        assert name in {"name", "position", "velocity", "effort"}
        assert isinstance(value, list)
        assert all(isinstance(item, str if name == "name" else float) for item in value)
        object.__setattr__(self, name, value)


class Node:
    """``rclpy.node.Node``: keeps what is published, and its timer's callback."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.published: list[object] = []

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        """A publisher that keeps messages of its kind."""
        topics = {JointState: "joint_states", JointTrajectory: "/joint_trajectory_controller/joint_trajectory"}
        assert (topic, depth) == (topics[kind], 10)
        return SimpleNamespace(publish=self.published.append)

    def create_subscription(self, kind: type, topic: str, callback: Any, depth: int) -> None:
        """Keep nothing: the test calls the callback."""
        assert (kind, topic) == (Strict, "/ccm_opt/twist")
        assert callable(callback)
        assert depth > 0

    def get_logger(self) -> SimpleNamespace:
        """A logger that says nothing."""
        return SimpleNamespace(info=lambda _, **options: options["throttle_duration_sec"])

    def create_timer(self, period: float, callback: Any) -> None:
        """Keep the callback."""
        assert period > 0.0
        self.tick = callback

    def get_clock(self) -> SimpleNamespace:
        """A clock that stands still."""
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: "now", nanoseconds=self.nanoseconds))

    nanoseconds = 0


class Launched:
    """An action of a launch file; keeps what it was given."""

    def __init__(self, *given: object, **named: object) -> None:
        self.given = given
        self.named = named


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules of ROS 2 with the stand-ins."""
    parts = {
        "builtin_interfaces.msg": {"Duration": Duration},
        "trajectory_msgs.msg": {"JointTrajectory": JointTrajectory, "JointTrajectoryPoint": JointTrajectoryPoint},
        "sensor_msgs.msg": {"JointState": JointState},
        "geometry_msgs.msg": {"TwistStamped": Strict},
        "rclpy.node": {"Node": Node},
        "launch": {"LaunchDescription": list},
        "launch.actions": {"ExecuteProcess": Launched},
        "launch_ros.actions": {"Node": Launched},
    }
    for path, names in parts.items():
        for name in (path.partition(".")[0], path):
            if name not in sys.modules:
                monkeypatch.setitem(sys.modules, name, ModuleType(name))
        for key, value in names.items():
            setattr(sys.modules[path], key, value)


@pytest.fixture
def exported(small_solution: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that the page's commands write, of a made-up plan."""
    folder = write_solution(small_solution, tmp_path / "runs")
    for kind, name in (("urdf", "arm.urdf"), ("yaml", "trajectory.yaml")):
        out = tmp_path / "ros" / name
        out.parent.mkdir(exist_ok=True)
        for beside, content in exported_files(folder, kind, out, bends_only=True).items():
            (out.parent / (beside or name)).write_bytes(content)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "ros"


def blocks() -> list[str]:
    """The blocks of the page for ROS 2, which come first."""
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[:3]


@pytest.mark.usefixtures("ros")
def test_the_page_makes_a_message_and_plays_it(exported: Path) -> None:
    """The message has every joint, and no efforts; the player publishes one state a tick and begins anew at the end."""
    pytest.importorskip("yaml")
    make_message, player, _ = blocks()
    names: dict[str, Any] = {}
    exec(compile(make_message, "page", "exec"), names)  # noqa: S102 - our own page
    trajectory = names["message"](exported / "trajectory.yaml")
    assert trajectory.joint_names == [f"ball{k:02d}_bend" for k in range(1, 5)]
    assert trajectory.points[-1].time_from_start == Duration(1, 0)
    exec(compile(player, "page", "exec"), names)  # noqa: S102 - likewise
    node = names["Player"](trajectory)
    while len(node.published) < 2 or node.now > 0.0:
        node.tick()
    node.tick()
    np.testing.assert_allclose(node.published[-2].position, trajectory.points[-1].positions, atol=0.05)
    assert node.published[-1].position == node.published[0].position == trajectory.points[0].positions
    assert all(point.effort == [] for point in trajectory.points)


@pytest.mark.usefixtures("ros")
def test_the_launch_file_describes_the_arm_with_whole_addresses(exported: Path) -> None:
    """The description has the arm and the post, and names no mesh by a relative address."""
    names: dict[str, Any] = {}
    exec(compile(blocks()[2], "page", "exec"), names)  # noqa: S102 - our own page
    publisher, player, rviz = names["generate_launch_description"]()
    urdf = publisher.named["parameters"][0]["robot_description"]
    assert "obstacle_post" in urdf
    assert 'link name="tip"' in urdf
    for mesh in re.findall(r'filename="([^"]*)"', urdf):
        assert mesh.startswith(f"file://{exported.resolve()}/arm.urdf.meshes/")
    assert player.named["cmd"] == ["python3", "play.py"]
    assert rviz.named["package"] == "rviz2"


@pytest.mark.usefixtures("ros")
def test_the_node_sends_a_plan_and_then_every_tick_with_its_braking(monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages keep the definitions; those of ticks begin at the plan's end and end at rest; stale twists send none."""
    pytest.importorskip("yaml")
    solution = solved("open-space")
    monkeypatch.setattr(ccm_opt, "solve", lambda _: solution)
    node: Any = runpy.run_path(str(EXAMPLES / "14_ros2_plan_and_servo.py"))["PlanAndServo"](
        PROBLEMS / "open-space.toml"
    )
    (planned,) = node.published
    assert planned.points[0].time_from_start == Duration(0, 0)
    twist = SimpleNamespace(linear=Vector3(0.02, -0.01), angular=Vector3())
    node.heard(SimpleNamespace(twist=twist))
    node.tick()
    assert len(node.published) == 1, "the plan is still executed"
    node.nanoseconds = round(1e9 * (solution.trajectory.duration + 1.0))
    node.heard(SimpleNamespace(twist=twist))
    for _ in range(3):
        node.tick()
    first, *_, last = node.published[1:]
    assert first.joint_names == planned.joint_names
    assert first.points[0].time_from_start == Duration(0, 20_000_000)
    np.testing.assert_allclose(first.points[0].positions, planned.points[-1].positions, atol=1e-3)
    assert all(abs(value) < 1e-9 for value in last.points[-1].velocities)
    assert any(value != 0.0 for value in last.points[0].velocities)
    node.nanoseconds += 10**9
    ticks = node.servo.ticks
    node.tick()
    assert (len(node.published), node.servo.ticks) == (4, ticks + 1)
