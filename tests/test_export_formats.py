"""Formats for other programs: ROS messages take every number, bends alone are enough, a film is what it should be."""

import csv
import io
import json
import re
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.cli.written_plans import exported_files
from ccm_opt.io.controller_points import number_rows
from ccm_opt.io.folder import write_solution
from ccm_opt.io.glb import motion_glb
from ccm_opt.io.records import arrays_npz, bend_arrays, solution_arrays
from ccm_opt.io.urdf_models import urdf_text
from ccm_opt.problem.solution import Solution
from ccm_opt.robot.frames import revolute_angles

from .dynamics_arms import loose_limits, swan_neck
from .test_cli_output import run

YAML_FLOAT = re.compile(r"[-+]?[0-9][0-9_]*\.[0-9_]*(?:[eE][-+][0-9]+)?")
"""What YAML 1.1, and with it PyYAML, takes for a float; without a point it takes an integer or a text."""


@pytest.fixture
def folder(small_solution: Solution, tmp_path: Path) -> Path:
    """The folder of a made-up plan."""
    return write_solution(small_solution, tmp_path / "runs")


@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False, width=64) | st.integers(-9, 9), min_size=1))
def test_every_number_reads_as_a_float(values: list[float]) -> None:
    """Whole ones, tiny ones, huge ones: YAML takes each for a float, of the same value to twelve digits."""
    (row,) = number_rows(np.array([values], dtype=np.float64))
    words = row.split(",")
    assert all(YAML_FLOAT.fullmatch(word) for word in words)
    np.testing.assert_allclose([float(word) for word in words], values, rtol=1e-11)


@dataclass
class Duration:
    """``builtin_interfaces/Duration``: int32 sec, uint32 nanosec, with the checks that rclpy's setters make."""

    sec: int = 0
    nanosec: int = 0

    def __setattr__(self, name: str, value: object) -> None:
        assert type(value) is int, f"The '{name}' field must be of type 'int'"
        bounds = (-(2**31), 2**31) if name == "sec" else (0, 2**32)
        assert bounds[0] <= value < bounds[1]
        object.__setattr__(self, name, value)


@dataclass
class JointTrajectoryPoint:
    """``trajectory_msgs/JointTrajectoryPoint``: four lists of float64 and a Duration, checked as rclpy checks them."""

    positions: list[float] = field(default_factory=list)
    velocities: list[float] = field(default_factory=list)
    accelerations: list[float] = field(default_factory=list)
    effort: list[float] = field(default_factory=list)
    time_from_start: Duration = field(default_factory=Duration)

    def __setattr__(self, name: str, value: object) -> None:
        if name == "time_from_start":
            assert isinstance(value, Duration)
        else:
            assert isinstance(value, list)
            assert all(isinstance(item, float) for item in value), f"The '{name}' field must be a set of 'float'"
        object.__setattr__(self, name, value)


def yaml_scalars(text: str) -> dict[str, object]:
    """A message as PyYAML reads it; without PyYAML, by the rule that it follows for plain numbers."""
    yaml = pytest.importorskip("yaml")
    loaded: dict[str, object] = yaml.safe_load(text)
    return loaded


def points_by_rule(text: str) -> list[dict[str, object]]:
    """The points of a message, numbers typed by the rule of YAML 1.1."""

    def typed(word: str) -> object:
        word = word.strip()
        if YAML_FLOAT.fullmatch(word):
            return float(word)
        return int(word) if re.fullmatch(r"[-+]?\d+", word) else word

    points: list[dict[str, object]] = []
    for line in text.splitlines()[2:]:
        key, _, value = line.strip(" -").partition(": ")
        if key == "time_from_start":
            sec, nanosec = re.findall(r": (\d+)", value)
            points.append({key: Duration(int(sec), int(nanosec))})
        else:
            points[-1][key] = [typed(word) for word in value.strip("[]").split(",")]
    return points


@pytest.mark.parametrize("bends_only", [False, True])
def test_ros_messages_take_every_point(folder: Path, bends_only: bool) -> None:
    """The setters of the message, which refuse integers, take all fields of all points, of one length each."""
    text = exported_files(folder, "yaml", bends_only=bends_only, effort=True)[""].decode()
    names = json.loads(text.splitlines()[0].removeprefix("joint_names: "))
    points = [JointTrajectoryPoint(**point) for point in points_by_rule(text)]  # type: ignore[arg-type]
    assert len(points) > 2
    for point in points:
        assert len(point.positions) == len(point.velocities) == len(point.effort) == len(names)
        assert point.accelerations == []
    assert points[-1].time_from_start == Duration(1, 0)


def test_a_message_survives_ros_serialisation(folder: Path) -> None:
    """Built from the file as the how-to builds it, the message is serialised by ROS 2's rules and read back alike."""
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    message = yaml_scalars(exported_files(folder, "yaml")[""].decode())
    types = store.types
    points = [
        types["trajectory_msgs/msg/JointTrajectoryPoint"](
            **{key: np.array(point.get(key, [])) for key in ("positions", "velocities", "accelerations", "effort")},
            time_from_start=types["builtin_interfaces/msg/Duration"](**point["time_from_start"]),
        )
        for point in message["points"]  # type: ignore[attr-defined]
    ]
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="world")
    kind = "trajectory_msgs/msg/JointTrajectory"
    built = types[kind](header=header, joint_names=message["joint_names"], points=points)
    again = store.deserialize_cdr(store.serialize_cdr(built, kind), kind)
    assert again.joint_names == message["joint_names"]
    np.testing.assert_array_equal(again.points[-1].positions, points[-1].positions)


def test_tables_of_bends_are_the_second_of_three_columns(folder: Path) -> None:
    """A third of the columns, by their names, with the numbers of the whole table."""
    whole, bends = (
        list(csv.reader(io.StringIO(exported_files(folder, "csv", bends_only=only)[""].decode())))
        for only in (False, True)
    )
    places = [0, *(k for k, name in enumerate(whole[0]) if "_bend_" in name)]
    assert bends == [[row[k] for k in places] for row in whole]
    assert len(places) == 1 + 4 * 4


def test_arrays_of_bends_lack_the_zeros(folder: Path, small_solution: Solution) -> None:
    """The arrays of revolutes have a third of the columns; nothing that moves is lost, and the rest is as it was."""
    content = exported_files(folder, "npz", bends_only=True, out=folder / "x.npz")[""]
    with np.load(io.BytesIO(content), allow_pickle=False) as bends:
        whole = solution_arrays(small_solution)
        assert set(bends.files) == set(whole)
        np.testing.assert_array_equal(bends["joint_angles"], whole["joint_angles"][:, 1::3])
        np.testing.assert_array_equal(bends["joint_angles"], -whole["bend_angles"])
        np.testing.assert_array_equal(bends["joint_positions"], whole["joint_positions"])
        assert all(name.endswith("_bend") for name in bends["joint_names"].tolist())
        assert np.abs(np.delete(whole["joint_angles"], np.s_[1::3], axis=1)).max() == 0.0


def test_zeros_take_no_room(small_solution: Solution) -> None:
    """The whole arrays take little more than those of the bends alone, and the same ones give the same bytes."""
    whole = solution_arrays(small_solution)
    plain = io.BytesIO()
    np.savez(plain, **bend_arrays(whole))  # type: ignore[arg-type]
    assert len(arrays_npz(whole)) < 1.1 * len(plain.getvalue())
    assert arrays_npz(whole) == arrays_npz(whole)


def test_models_of_bends_move_as_the_whole_arm() -> None:
    """With one joint a link, Pinocchio puts the tip of the URDF where all three joints put it."""
    pin = pytest.importorskip("pinocchio")
    arm = swan_neck(6)
    bends = np.array([0.5, 0.2, -0.1, 0.3, 0.2, 0.1])
    tips = []
    for only, angles in ((False, revolute_angles(arm, bends)), (True, revolute_angles(arm, bends)[1::3])):
        model = pin.buildModelFromXML(urdf_text(arm, "arm", loose_limits(arm), bends_only=only))
        data = model.createData()
        pin.framesForwardKinematics(model, data, angles)
        tips.append(data.oMf[model.getFrameId("tip")].translation)
    assert tuple(model.names)[1:] == tuple(f"ball{k:02d}_bend" for k in range(1, 7))
    np.testing.assert_allclose(tips[1], tips[0], atol=1e-14)


def glb_document(content: bytes) -> tuple[dict[str, list[dict[str, object]]], bytes]:
    """The two chunks of a binary glTF file, its header checked."""
    magic, version, length = struct.unpack("<4sII", content[:12])
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack("<I4s", content[12:20])
    assert kind == b"JSON"
    rest = content[20 + size :]
    assert struct.unpack("<I4s", rest[:8]) == (len(rest) - 8, b"BIN\0")
    return json.loads(content[20 : 20 + size]), rest[8:]


def test_a_film_moves_the_links_as_the_plan_does(small_solution: Solution) -> None:
    """Every link's node is, at every keyframe, where the plan has that link, turned along it."""
    content = motion_glb(small_solution.problem, small_solution.trajectory)
    document, binary = glb_document(content)

    def values(number: int) -> np.ndarray:
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]  # type: ignore[index]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[str(accessor["type"])]
        kind = "<f4" if accessor["componentType"] == 5126 else "<u4"
        flat = np.frombuffer(binary, kind, int(accessor["count"]) * width, int(view["byteOffset"]))  # type: ignore[call-overload]
        return np.asarray(flat).reshape(-1, width)

    animation = document["animations"][0]
    arm = small_solution.problem.arm
    time = small_solution.trajectory.time
    for channel in animation["channels"]:  # type: ignore[attr-defined]
        sampler = animation["samplers"][channel["sampler"]]  # type: ignore[index]
        clock = values(sampler["input"])[:, 0]
        found = values(sampler["output"])
        name = str(document["nodes"][channel["target"]["node"]]["name"])
        k = int(name.removeprefix("link")) - 1
        bends = np.column_stack([np.interp(clock, time, column) for column in small_solution.trajectory.positions.T])
        ends = arm.joint_positions_at(bends)[:, k : k + 2]
        if channel["target"]["path"] == "translation":
            np.testing.assert_allclose(found[:, [0, 2]], ends[:, 0], atol=1e-6)
        else:
            heading = -2.0 * np.arctan2(found[:, 1], found[:, 3])
            along = (ends[:, 1] - ends[:, 0]) / arm.link_length
            np.testing.assert_allclose(np.column_stack((np.cos(heading), np.sin(heading))), along, atol=1e-5)
    assert clock[0] == 0.0
    assert clock[-1] == pytest.approx(time[-1])
    names = {str(node["name"]) for node in document["nodes"]}
    assert {"post", "link01", "link04"} <= names
    assert all(int(view["byteOffset"]) % 4 == 0 for view in document["bufferViews"])  # type: ignore[call-overload]


def test_another_program_loads_the_film(small_solution: Solution, tmp_path: Path) -> None:
    """Trimesh finds every node, closed meshes, and the disc of the post with its size."""
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "motion.glb"
    path.write_bytes(motion_glb(small_solution.problem, small_solution.trajectory))
    scene = trimesh.load(path)
    assert {"post", "link01"} <= set(scene.graph.nodes)
    for mesh in scene.geometry.values():
        mesh.merge_vertices()
        assert mesh.is_watertight
        assert mesh.volume > 0.0


def test_files_that_are_no_text_need_a_name(folder: Path, tmp_path: Path) -> None:
    """A film or arrays go into a file; on standard output they are refused with what to do."""
    for kind in ("glb", "npz"):
        refused = run("export", folder, "--format", kind)
        assert refused.exit_code == 2
        assert "--out" in refused.stderr
        assert run("export", folder, "--format", kind, "--out", tmp_path / f"a.{kind}").exit_code == 0
        assert (tmp_path / f"a.{kind}").stat().st_size > 1000


def test_the_scene_may_be_left_out(folder: Path) -> None:
    """Both models have the obstacle of the problem unless asked not to."""
    for kind, word in (("urdf", "obstacle_post"), ("mjcf", '"post"')):
        assert word in run("export", folder, "--format", kind).stdout
        assert word not in run("export", folder, "--format", kind, "--no-scene").stdout
