"""Arms read from URDF files: which chains are arms, their bodies and masses, and what is refused by name."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.io.urdf_bodies import Rounded, containing_radius, standing_out
from ccm_opt.io.urdf_models import roll_pitch_yaw, urdf_text
from ccm_opt.problem import Limits, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.robot.link_layout import Proportions

from .space_arms import space_arm
from .test_export_models import AXES, load_pinocchio

SEEDS = st.integers(0, 2**32 - 1)
BODY = '<collision><origin xyz="{0} 0 0" rpy="0 1.5707963267948966 0"/><geometry>{1}</geometry></collision>'


@dataclass
class Row:
    """A joint of a URDF and what it carries."""

    name: str
    xyz: Sequence[float] | FloatArray = (0.1, 0.0, 0.0)
    rpy: Sequence[float] = (0.0, 0.0, 0.0)
    axis: Sequence[float] | FloatArray = (0.0, 0.0, 1.0)
    kind: str = "revolute"
    span: tuple[float, float] = (-1.0, 1.0)
    body: str = ""
    parent: str = ""
    more: str = ""
    rates: tuple[float, float] = (2.0, 5.0)
    frames: list[tuple[str, FloatArray]] = field(default_factory=list)


def numbers(values: Sequence[float] | FloatArray) -> str:
    """Text of numbers, exact."""
    return " ".join(repr(float(value)) for value in values)


def written(*rows: Row) -> str:
    """A URDF of joints one after the other, from ``base_link`` to the last."""
    parts = ['<robot name="arm"><link name="base_link"/>']
    before = "base_link"
    for row in rows:
        low, high = row.span
        velocity, effort = row.rates
        parts.append(
            f'<link name="of_{row.name}">{row.body}</link><joint name="{row.name}" type="{row.kind}">'
            f'<origin xyz="{numbers(row.xyz)}" rpy="{numbers(row.rpy)}"/><axis xyz="{numbers(row.axis)}"/>'
            f'<parent link="{row.parent or before}"/><child link="of_{row.name}"/>'
            f'<limit lower="{low!r}" upper="{high!r}" velocity="{velocity}" effort="{effort}"/>{row.more}</joint>'
        )
        before = f"of_{row.name}"
        for name, place in row.frames:
            parts.append(
                f'<link name="{name}"/><joint name="to_{name}" type="fixed"><origin xyz="{numbers(place)}"/>'
                f'<parent link="{before}"/><child link="{name}"/></joint>'
            )
    return "".join((*parts, "</robot>"))


def snake(count: int = 6, **changes: Any) -> list[Row]:
    """Joints that turn in turn about z and y, each with the same frame turned by a right angle, and a tip."""
    rows = [Row(f"j{k}", rpy=((-1.0) ** k * np.pi / 2.0, 0.0, 0.0) if k else (0.0, 0.0, 0.0)) for k in range(count)]
    rows = [replace(row, body=BODY.format(0.05, '<cylinder radius="0.02" length="0.1"/>'), **changes) for row in rows]
    return [*rows, Row("tip", kind="fixed")]


def read(folder: Path, text: str, *, space: int = 3, **keys: Any) -> Problem:
    """The problem of an arm from the text of a URDF."""
    (folder / "arm.urdf").write_text(text)
    limits = {"acceleration": 4.0, **keys.pop("limits", {})}
    data = {
        "schema": 1,
        "space": space,
        "name": "read",
        "workspace": {} if space == 3 else {"bounds": [-9, -9, 9, 9]},
        "arm": {"urdf": "arm.urdf", **keys},
        "limits": limits,
        "start": {"shape": "straight"},
        "goal": {"position": [0.5, 0.2, 0.1][:space]},
    }
    (folder / "read.toml").write_text(tomlkit.dumps(data))
    return ccm_opt.load_problem(folder / "read.toml")


def refused(folder: Path, text: str, **keys: Any) -> str:
    """What the problem of an arm from the text of a URDF is refused with."""
    with pytest.raises(ProblemFileError) as error:
        read(folder, text, **keys)
    return str(error.value)


def drawn_arm(seed: int, *, in_space: bool) -> tuple[Arm, Limits]:
    """A random arm of unequal links, some of whose bends are locked, and its limits."""
    rng = np.random.default_rng(seed)
    links = int(rng.integers(2, 9))
    if in_space:
        turn = Rotation.random(random_state=int(seed)).as_matrix()
        arm = replace(space_arm(links), direction=turn[:, 0], up=turn[:, 2], base=rng.normal(size=3))
    else:
        arm = Arm.snake(length=1.0, links=2 * links, radius=0.02, heading_deg=float(rng.uniform(-179.0, 179.0)))
        arm = replace(arm, base=rng.normal(size=2), axes=AXES[int(rng.integers(2))])
    lengths, radii = rng.uniform(0.5, 1.5, (2, arm.links))
    limits = rng.uniform(0.2, 1.0, len(arm.bend_limits)) * (rng.random(len(arm.bend_limits)) < 0.8)
    k = arm.bends_a_joint
    limits[:k] /= np.max(limits[:k]) or 1.0
    limits[k:] /= np.max(limits[k:]) or 1.0
    limits[-1] = 1.0
    arm = replace(
        arm,
        radius=0.03,
        joint_limit=1.2,
        base_limit=2.0,
        proportions=Proportions(lengths / lengths.mean(), np.sort(radii)[::-1] / radii.max(), limits),
        masses=rng.uniform(0.05, 0.5, arm.links),
        inertia_axial=rng.uniform(1e-5, 1e-4, arm.links),
        inertia_transverse=rng.uniform(1e-4, 1e-3, arm.links),
        feed=Feed(-0.3, 0.4, 0.4) if in_space and rng.random() < 0.5 else None,
        payload=float(rng.choice([0.0, 0.2])),
        friction=rng.uniform(0.0, 0.1, 3 * arm.links),
        mount_length=0.0,
    )
    rates = rng.uniform(0.5, 3.0, (2, 3 * arm.links))
    limited = Limits(rates[0], np.full(3 * arm.links, 4.0), rates[1])
    if arm.feed is not None:
        limited = replace(limited, feed_velocity=0.2, feed_acceleration=1.0, feed_force=30.0)
    return arm, limited


@pytest.mark.drawn(20, of="dear tests")
@given(SEEDS, st.booleans())
@settings(max_examples=40, deadline=None)
def test_an_arm_written_as_urdf_is_read_as_the_same_arm(
    tmp_path_factory: pytest.TempPathFactory, seed: int, in_space: bool
) -> None:
    """In the plane and in space, with its place, masses, limits, feed axis and payload."""
    arm, limits = drawn_arm(seed, in_space=in_space)
    rates = {"feed_acceleration": 1.0} if arm.feed is not None else {}
    text = urdf_text(arm, "arm", limits)
    problem = read(tmp_path_factory.mktemp("urdf"), text, space=arm.dimension, mount_length=0.0, limits=rates)
    again = problem.arm
    for key in ("base", "direction", "lengths", "radii", "bend_limits", "masses", "payload", "friction"):
        np.testing.assert_allclose(getattr(again, key), getattr(arm, key), rtol=1e-11, atol=1e-12, err_msg=key)
    for key in ("inertia_axial", "inertia_transverse"):
        np.testing.assert_allclose(getattr(again, key), getattr(arm, key), rtol=1e-9)
    np.testing.assert_allclose(again.base_rotation, arm.base_rotation, atol=1e-12)
    assert again.axes == arm.axes
    assert again.feed == arm.feed
    np.testing.assert_allclose(problem.limits.velocity, limits.velocity)
    torque, written_torque = problem.limits.torque, limits.torque
    assert torque is not None
    assert written_torque is not None
    np.testing.assert_allclose(torque, written_torque)
    assert problem.limits.feed_force == limits.feed_force
    assert problem.imported_arm is not None
    assert not any("stand out" in note or "centres" in note for note in problem.imported_arm.notes)


def drawn_chain(rng: np.random.Generator) -> list[Row]:
    """Joints of one to three revolutes of an arm that is straight at zero, in frames of no particular kind."""
    here = np.eye(4)
    here[:3, :3], here[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
    rows = []
    for k in range(int(rng.integers(2, 7))):
        kinds = [[0], [1], [0, 1], [0, 1, 2]][int(rng.integers(4))] if k else [0, 1]
        length = float(rng.uniform(0.05, 0.3))
        for slot in kinds:
            axis = frame[:3, 2 - slot] * rng.choice([-1.0, 1.0])
            there = np.eye(4)
            there[:3, :3] = Rotation.random(random_state=rng).as_matrix()
            there[:3, 3] = frame[:3, 3] + rng.normal() * axis
            step = np.linalg.inv(here) @ there
            limit = float(rng.uniform(0.3, 1.5))
            rows.append(
                Row(
                    f"j{k}_{slot}",
                    step[:3, 3],
                    roll_pitch_yaw(step[:3, :3]),
                    there[:3, :3].T @ axis,
                    span=(-limit, limit),
                )
            )
            here = there
        frame[:3, 3] = frame[:3, 3] + length * frame[:3, 0]
        rows[-1].frames.append((f"end{k + 1}", (np.linalg.inv(here) @ frame)[:3, 3]))
    return rows


@given(SEEDS)
@settings(max_examples=40, deadline=None)
def test_places_agree_with_pinocchio(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    """Ends of links, for any bends, whatever the frames of links and the signs of axes."""
    rng = np.random.default_rng(seed)
    text = written(*drawn_chain(rng))
    problem = read(tmp_path_factory.mktemp("urdf"), text, radius=0.01, self_collision=False)
    arm, imported = problem.arm, problem.imported_arm
    assert imported is not None
    pin, model, data = load_pinocchio(text, "urdf")
    q = rng.uniform(-1.0, 1.0, len(arm.coordinates)) * arm.bend_limits
    angles = revolute_angles(arm, q)
    position = np.zeros(model.nq)
    for joint in imported.joints:
        position[model.joints[model.getJointId(joint.name)].idx_q] = joint.sense * angles[joint.drive]
    pin.framesForwardKinematics(model, data, position)
    ends = [data.oMf[model.getFrameId(f"end{k + 1}")].translation for k in range(arm.links)]
    np.testing.assert_allclose(arm.joint_positions_at(q)[1:], ends, atol=1e-9)


def test_a_snake_of_joints_in_turn_is_planned(tmp_path: Path) -> None:
    """Its joints have one bend each, with the limits of the file; those of the problem file count where stricter."""
    problem = read(tmp_path, written(*snake(10)), limits={"velocity": 1.5, "torque": 9.0})
    arm = problem.arm
    np.testing.assert_allclose(arm.bend_limits.reshape(-1, 2), [[1.0, 0.0], [0.0, 1.0]] * 5)
    np.testing.assert_allclose(arm.radii, 0.02, rtol=1e-2)
    drives = arm.coordinates.drive_numbers[np.flatnonzero(arm.bend_limits)]
    assert np.all(problem.limits.velocity[drives] == 1.5)
    assert problem.limits.torque is not None
    assert np.all(problem.limits.torque[drives] == 5.0)
    assert ccm_opt.solve(problem).trajectory.duration > 0.0


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_capsules_contain_bodies(seed: int) -> None:
    """No point of a body is outside, and no capsule stands out less than it does from the points of a body."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    ends = np.cumsum(rng.normal(size=(2, 3)), axis=0)
    ends[1] = ends[0] + rng.uniform(0.0, 1.0) * axis
    bodies = [Rounded(rng.normal(size=(8, 3))), Rounded(ends, 0.3, axis), Rounded(ends[:1], 0.2)]
    length = float(rng.uniform(0.1, 2.0))
    radius = containing_radius(bodies, length)
    across = np.linalg.svd(axis[None])[2][1:]
    turn = rng.uniform(0.0, 2.0 * np.pi, 500)
    disc = ends[rng.integers(0, 2, 500)] + 0.3 * np.column_stack((np.cos(turn), np.sin(turn))) @ across
    outward = rng.normal(size=(2000, 3))
    ball = ends[0] + 0.2 * outward / np.linalg.norm(outward, axis=1)[:, None]
    points = np.concatenate((bodies[0].points, disc, ball))
    beyond = points - np.clip(points[:, :1], 0.0, length) * [1.0, 0.0, 0.0]
    assert np.linalg.norm(beyond, axis=1).max() <= radius + 1e-12
    assert radius <= np.linalg.norm(beyond, axis=1).max() * 1.02 + 0.06
    assert standing_out(bodies, length, radius) >= -1e-3


BAD = {
    "branch": ([*snake(3), Row("claw", parent="of_j0")], "joint 'claw' branches off beside joint 'j1'"),
    "mimic": ([*snake(3, more='<mimic joint="j0"/>')], "joint 'j0' follows 'j0' (mimic)"),
    "floating": ([Row("free", kind="floating"), *snake(3)], "joint 'free' is floating"),
    "prismatic": ([*snake(3)[:2], Row("slide", kind="prismatic"), *snake(6)[3:]], "joint 'slide' is prismatic"),
    "bent": ([*snake(4)[:3], Row("j3", rpy=(0.0, 0.3, 0.0)), Row("j4"), Row("tip", kind="fixed")], "joint 'j3'"),
    "aside": ([*snake(6)[:3], Row("j3", (0.1, 0.02, 0.0)), Row("tip", kind="fixed")], "passes the line of the arm"),
    "askew": (
        [*snake(4)[:3], Row("j3", rpy=(0.5, 0.0, 0.0)), Row("tip", kind="fixed")],
        "joint 'j3': its axis is turned",
    ),
    "back": (
        [*snake(4)[:3], Row("j3", (-0.15, 0.0, 0.0)), Row("tip", (0.9, 0.0, 0.0), kind="fixed")],
        "'j3' lies 0.15",
    ),
    "one side": ([*snake(3)[:2], Row("j2", span=(0.0, 1.0)), Row("tip", kind="fixed")], "joint 'j2': its range, 0° to"),
    "no tip": ([Row("j0"), Row("j1")], "link 'of_j1' has no length"),
    "roll first": ([Row("roll", axis=(1.0, 0.0, 0.0)), *snake(3)], "joint 'roll' turns about the line of the arm"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_arm_is_refused_by_the_name_of_the_joint(tmp_path: Path, name: str) -> None:
    """With the line of the key ``arm.urdf``."""
    rows, told = BAD[name]
    words = refused(tmp_path, written(*rows))
    assert "arm.urdf: arm.urdf: " in words
    assert told in words


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"sections": []}, "arm.sections: not together with arm.urdf"),
        ({"radius": 0.01}, "arm.radius: not together with arm.urdf, whose links all have collision bodies"),
        ({"links": 4}, "arm.links: not together with arm.urdf"),
    ],
)
def test_keys_that_the_urdf_says_are_refused(tmp_path: Path, keys: dict[str, Any], told: str) -> None:
    """By key."""
    assert told in refused(tmp_path, written(*snake()), **keys)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<robot", "not readable as XML"),
        ("<svg/>", "expected the outermost element robot, got svg"),
        ('<robot><link name="a"/><link name="b"/></robot>', "expected exactly one link that no joint carries"),
        (written(*snake()).replace("base_link", "of_tip", 1), "two links have the name 'of_tip'"),
        (written(*snake()).replace('axis xyz="0.0 0.0 1.0"', 'axis xyz="0 0 0"', 1), "joint 'j0': its axis is zero"),
        (written(*snake()).replace('upper="1.0"', 'upper="one"', 1), "joint 'j0': upper is 'one'; expected a number"),
        (written(*snake()).replace("<cylinder", "<cone", 1), "link 'of_j0': a collision body is of the kind 'cone'"),
        ('<robot xmlns:xacro="x"><xacro:include filename="a"/></robot>', "it has xacro macros"),
    ],
)
def test_defects_of_the_file_are_named(tmp_path: Path, text: str, told: str) -> None:
    """By link or joint, where there is one."""
    assert told in refused(tmp_path, text)


def test_a_link_without_body_takes_the_radius_of_the_file(tmp_path: Path) -> None:
    """Which is missing otherwise."""
    rows = snake(3)
    rows[1].body = ""
    assert "arm.radius: expected the radius of links of the URDF without collision body: 'of_j1'" in refused(
        tmp_path, written(*rows)
    )
    np.testing.assert_allclose(read(tmp_path, written(*rows), radius=0.015).arm.radii[1], 0.015)


def test_what_is_simplified_is_told(tmp_path: Path) -> None:
    """Ranges of two sizes, centres of mass off the middle, bodies that are no capsules, and joints held at zero."""
    box = '<collision><origin xyz="0.05 0 0"/><geometry><box size="0.1 0.06 0.02"/></geometry></collision>'
    mass = '<inertial><origin xyz="0.02 0 0"/><mass value="0.4"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial>'
    rows = [*snake(3, span=(-0.5, 1.0))[:3], Row("roll", (0.0, 0.0, 0.0), axis=(1.0, 0.0, 0.0), body=box + mass)]
    rows[2].body = ""
    problem = read(tmp_path, written(*rows, Row("tip", kind="fixed")))
    assert problem.imported_arm is not None
    notes = "\n".join(problem.imported_arm.notes)
    assert "'roll' stays at 0" in notes
    assert "j0 [-28.65, 57.3]° to ±28.65°" in notes
    assert "capsules stand out from the bodies of links by up to" in notes
    assert "centres of mass are set to the middles of links, from up to 0.03 m away (link 'of_roll')" in notes
    assert "without mass: taken as 1e-06 kg" in notes
    np.testing.assert_allclose(problem.arm.bend_limits[0], 0.5)
    np.testing.assert_allclose(problem.arm.radii[2], np.hypot(0.03, 0.01), rtol=1e-9)
