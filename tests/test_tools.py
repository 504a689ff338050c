"""Tools: rigid bodies on the last link, as links of an arm, in plans, problem files and folders."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import mujoco
import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.cli.view.frames import MotionFrames
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound, ProblemError, ProblemFileError, UnreachableGoal
from ccm_opt.diagnosis.sizes import Proofs, size_of
from ccm_opt.driver.clearance_over_time import clearance_over_time
from ccm_opt.dynamics.algorithms.arm_model import arm_model, in_plane_alone
from ccm_opt.dynamics.runtime.inverse_dynamics import DynamicsFunction, InverseDynamics
from ccm_opt.io.mjcf_models import mjcf_text
from ccm_opt.io.problem_data import arm_table
from ccm_opt.io.tool_tables import box_capsules
from ccm_opt.io.urdf_models import urdf_text
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.tool_problem import problem_with_tool_links
from ccm_opt.problem import Limits, Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.robot.tool import RigidBody, Tool, ToolBody
from ccm_opt.scene.bad_pose import joints_at_limits
from ccm_opt.scene.tool_links import colliding_at_rest, drawn_radii, own_joints, points_with_tool, with_tool_links
from ccm_opt.verification.chain_motion import chain_points, pointing
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.tool_chain import arm_with_bodies, motion_of

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


def _capsules(rng: np.random.Generator, dimension: int) -> tuple[ToolBody, ...]:
    found = []
    for _ in range(rng.integers(0, 4)):
        start, step = 0.1 * rng.normal(size=(2, dimension))
        found.append(ToolBody(start, start + step * rng.integers(0, 2), float(rng.uniform(0.005, 0.03))))
    return tuple(found)


def _equipped(seed: int, dimension: int) -> Arm:
    """An arm of unequal links with bodies on some of them, and mostly with a tool."""
    rng = np.random.default_rng(seed)
    arm = PLANE if dimension == 2 else SPACE
    links = rng.choice(arm.links, rng.integers(0, 4))
    bodies = tuple(RigidBody(_capsules(rng, dimension), link=int(link)) for link in links)
    direction: FloatArray = rng.normal(size=dimension)
    direction /= np.linalg.norm(direction)
    tool = Tool(_capsules(rng, dimension), tip=0.1 * rng.normal(size=dimension), direction=direction)
    lengths = rng.uniform(0.5, 1.5, arm.links)
    shares = Proportions(lengths / lengths.mean(), np.ones(arm.links), np.ones(arm.links * arm.bends_a_joint))
    return replace(arm, proportions=shares, bodies=bodies, tool=tool if rng.random() < 0.8 else None)


def _distance_from_axis(place: FloatArray, start: FloatArray, end: FloatArray) -> float:
    line = end - start
    share = np.clip((place - start) @ line / (line @ line + 1e-300), 0.0, 1.0)
    return float(np.linalg.norm(place - start - share * line))


@settings(max_examples=50)
@given(seed=st.integers(0, 10_000), dimension=st.sampled_from([2, 3]))
def test_tool_links_run_along_every_body_and_lead_to_the_tip_in_its_direction(seed: int, dimension: int) -> None:
    """Own links stay where they are, links of the bodies' radii contain their axes, and the last ends at the tip."""
    arm = _equipped(seed, dimension)
    whole = with_tool_links(arm)
    rng = np.random.default_rng(seed)
    bends = 0.5 * rng.normal(size=(arm.links, arm.bends_a_joint))
    q = np.ravel(bends)
    own = np.ones(arm.links, dtype=bool) if whole.tool_links is None else whole.tool_links.own
    longer = np.zeros((whole.links, arm.bends_a_joint))
    longer[own] = bends
    points, frames = whole.joint_positions_at(longer.ravel()), whole.link_rotations(longer.ravel())
    assert points == pytest.approx(points_with_tool(arm, q), abs=1e-12)
    assert points[own_joints(arm)] == pytest.approx(arm.joint_positions_at(q), abs=1e-12)
    assert frames[own] == pytest.approx(arm.link_rotations(q), abs=1e-12)
    ends, turns = arm.joint_positions_at(q)[1:], arm.link_rotations(q)
    tip, along = (0.0 * ends[0], np.eye(dimension)[0]) if arm.tool is None else (arm.tool.tip, arm.tool.direction)
    assert points[-1] == pytest.approx(ends[-1] + turns[-1] @ tip, abs=1e-12)
    assert frames[-1][:, 0] == pytest.approx(turns[-1] @ along, abs=1e-9)
    parts = list(zip(points[:-1], points[1:], drawn_radii(arm), strict=True))
    for body in arm.rigid_bodies:
        for capsule in body.bodies:
            for place in (capsule.start, capsule.end):
                at = ends[body.link] + turns[body.link] @ place
                near = (_distance_from_axis(at, a, b) for a, b, radius in parts if radius == capsule.radius)
                assert min(near) < 1e-6


@settings(max_examples=50)
@given(seed=st.integers(0, 10_000), dimension=st.sampled_from([2, 3]))
def test_the_verifiers_chain_places_bodies_as_the_planners_links_do(seed: int, dimension: int) -> None:
    """Both models end at the same tip, and compare the same capsules with the same links and capsules."""
    arm = _equipped(seed, dimension)
    q = 0.5 * np.random.default_rng(seed).normal(size=(2, len(arm.coordinates)))
    motion = motion_of(arm, np.array([0.0, 1.0]), q)
    assert chain_points(motion.arm, motion.positions)[:, -1] == pytest.approx(points_with_tool(arm, q)[:, -1])
    pairs = []
    for whole in (with_tool_links(arm), arm_with_bodies(arm)):
        links = whole.tool_links
        solid = slice(None) if links is None else ~links.bare
        pairs.append((whole.distant_links if links is None else links.distant)[solid][:, solid])
    assert np.array_equal(*pairs)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_tool_without_length_may_point_aside(dimension: int) -> None:
    """The verifier's chain points as a tool does that is nothing but a direction."""
    aside = np.eye(dimension)[1]
    arm = replace(Arm.snake(length=1.0, links=4, radius=0.01), base=np.zeros(dimension))
    if dimension == 3:
        arm = replace(arm, direction=np.eye(3)[0], up=np.eye(3)[2])
    arm = replace(arm, tool=Tool(tip=np.zeros(dimension), direction=aside))
    motion = motion_of(arm, np.array([0.0, 1.0]), np.zeros((2, len(arm.coordinates))))
    np.testing.assert_allclose(pointing(motion, 1), aside, atol=1e-12)


def _weighed(rng: np.random.Generator, dimension: int, link: int) -> dict[str, Any]:
    """Mass, centre and inertia of random point masses, alike on both sides of the plane for an arm in the plane."""
    places, masses = 0.05 * rng.normal(size=(5, 3)), rng.uniform(0.01, 0.2, 5)
    if dimension == 2:
        places[:, 1] = 0.0
    mass = float(masses.sum())
    centre = masses @ places / mass
    out = places - centre
    second = np.einsum("k,ki,kj->ij", masses, out, out)
    inertia = np.trace(second) * np.eye(3) - second
    return {"mass": mass, "centre": centre if dimension == 3 else centre[[0, 2]], "inertia": inertia, "link": link}


def _heavy(seed: int, dimension: int) -> Arm:
    arm, rng = _equipped(seed, dimension), np.random.default_rng(seed)
    bodies = tuple(RigidBody(**_weighed(rng, dimension, int(link))) for link in rng.choice(arm.links, 2))
    tool = Tool(**_weighed(rng, dimension, -1), tip=np.zeros(dimension), direction=np.eye(dimension)[0])
    return replace(arm, bodies=bodies, tool=tool, payload=0.1, masses=rng.uniform(0.05, 0.2, arm.links))


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), dimension=st.sampled_from([2, 3]))
def test_bodies_weigh_as_pinocchio_and_mujoco_say_and_accelerate_as_they_are_driven(seed: int, dimension: int) -> None:
    """Torques agree with two other libraries and the verifier's point masses, and forward dynamics inverts them."""
    arm, rng = _heavy(seed, dimension), np.random.default_rng(seed)
    gravity = np.array([0.3, 0.0, -9.0]) if dimension == 2 else rng.normal(size=3)
    q, qd, qdd = (revolute_angles(arm, 0.5 * rng.normal(size=(1, len(arm.coordinates)))) for _ in range(3))
    torques = InverseDynamics(arm, gravity)(q, qd, qdd)[0]
    limits = Limits(velocity=np.ones(3 * arm.links), acceleration=np.ones(3 * arm.links))
    model = pinocchio.buildModelFromXML(urdf_text(arm, "arm", limits))
    model.gravity.linear = gravity
    assert pinocchio.rnea(model, model.createData(), q[0], qd[0], qdd[0]) == pytest.approx(torques, abs=1e-8)
    other = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", gravity))
    other.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # limits and contacts
    data = mujoco.MjData(other)
    data.qpos, data.qvel, data.qacc = q[0], qd[0], qdd[0]
    mujoco.mj_inverse(other, data)
    assert data.qfrc_inverse - data.qfrc_passive == pytest.approx(torques, abs=1e-8)
    back = [-bends for bends in (q, qd, qdd)] if dimension == 2 else [q, qd, qdd]
    own = [each[:, arm.coordinates.drive_numbers] for each in back]
    needed, _ = drive_efforts(arm, gravity, *own)
    assert needed[0] == pytest.approx(torques, abs=1e-10)
    kinds = (arm_model(arm, gravity), in_plane_alone(arm_model(arm, gravity)))
    for each in kinds[: 4 - dimension]:
        driven = DynamicsFunction("forward_dynamics", each).of_joints(q[0], qd[0], torques)
        assert driven == pytest.approx(qdd[0], abs=1e-8)


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
    tool = Tool(tip=np.zeros(2), direction=np.array([1.0, 0.0]), bodies=(ahead, back))
    assert colliding_at_rest(replace(PLANE, tool=tool)) == (0, 1, "link 6")
    assert colliding_at_rest(replace(PLANE, tool=replace(tool, bodies=(ahead,)))) is None


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
        (
            "{ box = [0.05, 0.0, 0.07, 0.04] }]",
            "{ bax = [0.05, 0.0, 0.07, 0.04] }]\nmass = 0.1",
            r"line \d+: arm.tool.bodies\[1\].bax: unknown key",
        ),
        (
            "tip = ",
            "mass = 0.0\ncentre = [0, 0]\ntip = ",
            r"line \d+: arm.tool.centre: no effect without a mass above 0",
        ),
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


@pytest.mark.parametrize(
    ("post", "expected"),
    [
        ("[0.52, 0.0]", "link 7 is .* too near to 'post'"),
        ("[0.2, -0.09]", "the body on link 3 is .* too near to 'post'"),
        ("[1.02, 0.02]", "the tool is .* too near to 'post'"),
    ],
)
def test_messages_number_links_and_joints_of_the_arm(post: str, expected: str, tmp_path: Path) -> None:
    """What touches or is bent is named by its number in the file, or as the body on a link, wherever bodies are."""
    body = (
        "[[arm.bodies]]\nlink = 3\nbodies = [{ capsule = { from = [-0.04, -0.04], to = [0, -0.05], radius = 0.01 } }]"
    )
    text = FILE.replace("[limits]", f"{body}\n[limits]", 1)
    whole = problem_with_tool_links(_problem(text.replace("[0.9, 0.35]", post, 1), tmp_path))
    with pytest.raises(UnreachableGoal, match=expected):
        resolve_ends(whole)
    assert whole.arm.tool_links is not None
    bends = np.zeros(whole.arm.links)
    bends[np.flatnonzero(whole.arm.tool_links.own)[8]] = np.deg2rad(60.0)
    words, advice = joints_at_limits(whole.arm, bends)
    assert words == "joint 9 at the limit of 60°"
    assert advice[0].startswith("raise arm.joint_limit_deg ")


def test_the_record_of_clearance_tells_what_gap_a_body_should_keep(tmp_path: Path) -> None:
    """The preferred gap between a body and a neighbour of its link is that of the body, not that of the two links."""
    body = (
        "[[arm.bodies]]\nlink = 3\nbodies = [{ capsule = { from = [0.01, 0.04], to = [0.03, 0.04], radius = 0.01 } }]"
    )
    problem = _problem(FILE.replace("[limits]", f"{body}\n[limits]", 1), tmp_path)
    # The least gap is between two of the 240 recorded samples, so that it comes from the checks.
    time = np.linspace(0.0, 1.0, 1001)
    still = np.zeros((len(time), problem.arm.links))
    positions = still.copy()
    positions[:, 3] = 0.1 - 0.2 * np.abs(time - 0.5)
    trajectory = JointTrajectory(time, positions, still, still, problem.arm.coordinates)
    room = clearance_over_time(problem, trajectory, 0.01)
    assert (room.nearest.link, room.nearest.second_link) == (3, 4)
    assert room.nearest.wanted > 0.0


def test_sizes_are_sought_where_bodies_allow_arms(tmp_path: Path) -> None:
    """No arm is tried whose links are so short that a body touches others, and none without the link of a body."""
    body = "[[arm.bodies]]\nlink = 3\nbodies = [{ capsule = { from = [-0.08, 0], to = [0, 0], radius = 0.025 } }]"
    problem = _problem(FILE.replace("[limits]", f"{body}\n[limits]", 1), tmp_path)
    size = size_of(problem, "length")
    with pytest.raises(ProblemError, match="its link belongs to the mount"):
        size.at(problem, size.hardest * 0.08)
    shortest = size.farthest(problem, size.hardest)
    assert size.hardest * 0.08 < shortest <= 0.08
    proofs = Proofs(problem, size, shortest, 0.0, 1.0)
    assert proofs.holds(shortest) == (False, ())
    with pytest.raises(ProblemError, match=r"arm\.bodies\[0\]\.link: the body is on link 3 of 12"):
        size_of(problem, "links")


def test_a_tool_survives_being_written_and_read(tmp_path: Path) -> None:
    """The table of an arm with a tool gives the same tool again, its bodies as capsules."""
    problem = _problem(FILE, tmp_path)
    table: Any = arm_table(problem.arm, "m")["tool"]
    assert table["tip"] == [0.07, 0.05]
    assert [list(body) for body in table["bodies"]] == [["capsule"], ["capsule"]]


def test_what_is_not_found_in_the_plane_is_found_in_space(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A planar arm with a tool, for which the plane's own search ends in vain, gets a verified plan all the same."""
    in_vain = MotionNotFound(Diagnosis("nothing was found", "motion"))
    monkeypatch.setattr(MotionPlanner, "planned", Mock(side_effect=in_vain))
    problem = _problem(FILE, tmp_path)
    solution = ccm_opt.solve(problem)
    assert all(check.passed for check in solution.checks)
    tip = points_with_tool(problem.arm, solution.trajectory.positions[-1])[-1]
    assert tip == pytest.approx([0.4, 0.5], abs=1e-3)


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
    # The viewer draws the tool, and measures its gap, which is the verifier's.
    frames = MotionFrames(problem, solution.trajectory, solution.joints)
    np.testing.assert_allclose(frames.pose(0.0), points_with_tool(problem.arm, solution.trajectory.positions[0]))
    least = min(frames.nearest(q) for q in solution.trajectory.positions[::5])
    assert least[0] == pytest.approx(solution.metrics["least_wall_clearance_m"], abs=1e-3)
    assert float(np.min(frames.least_gaps)) == pytest.approx(least[0], abs=1e-3)
