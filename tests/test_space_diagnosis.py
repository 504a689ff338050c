"""Why there is no plan in space: checks prove nothing false, the reason is the true one, what helps was solved."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.core import deadline
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import UnreachableGoal, sentences
from ccm_opt.core.polyline import path_length
from ccm_opt.diagnosis.axis_paths import tight_passages
from ccm_opt.diagnosis.cell_tree import CellTree
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.contact import within_torque_limits
from ccm_opt.diagnosis.explain import refuse_impossible, refuse_infeasible
from ccm_opt.diagnosis.moved_goal import moved_goals
from ccm_opt.diagnosis.named_goals import NamedGoal, NamedPose
from ccm_opt.diagnosis.reach import TurnCaps, least_limit, most_turn
from ccm_opt.diagnosis.relaxation import Trials, relaxations
from ccm_opt.diagnosis.space_axis_paths import SpaceAxisPaths, space_axis_paths
from ccm_opt.problem import JointPose, Problem, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.bodies import BoxBody, SphereBody
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Obstacle, Workspace

from .diagnosis_judgement import named_rightly, relaxation_error
from .scenes import later
from .space_arms import space_arm
from .space_clutter import clutter
from .space_diagnosis_families import make_space_case

if TYPE_CHECKING:
    from ccm_opt.core.arrays import FloatArray

seeds = st.integers(0, 10**6)
ROOM = np.array([[-1.5, -1.5, -1.5], [1.5, 1.5, 1.5]])


def problem_of(arm: Arm, goal: TipGoal | JointPose, *obstacles: Obstacle) -> Problem:
    """A problem in a large room with a straight start."""
    ones = np.ones(3 * arm.links)
    start = JointPose(np.zeros((arm.links, 2)))
    return Problem("made", Workspace(bounds=ROOM, obstacles=obstacles), arm, Limits(ones, ones), start, goal)


def box(name: str, low: list[float], high: list[float]) -> Obstacle:
    """A box between two corners."""
    return Obstacle(name, BoxBody(np.array(low), np.array(high)))


def window(half: float, ahead: float = 0.4, depth: float = 0.05) -> tuple[Obstacle, ...]:
    """A wall across the room with a square window in its middle."""
    far, near = 1.5, ahead + depth
    return (
        box("upper", [ahead, -far, half], [near, far, far]),
        box("lower", [ahead, -far, -far], [near, far, -half]),
        box("left", [ahead, half, -half], [near, far, half]),
        box("right", [ahead, -far, -half], [near, -half, half]),
    )


def backwards(problem: Problem) -> Problem:
    """The problem with a straight start that points away from what is ahead."""
    bends = np.zeros((problem.arm.links, 2))
    bends[0, 0] = 2.8
    return replace(problem, start=JointPose(bends))


def ways_of(problem: Problem) -> SpaceAxisPaths:
    """The ways to the only goal of a problem, which is for the tip."""
    (ways,) = space_axis_paths(problem, Deadline.never())
    return ways


BEYOND = TipGoal(np.array([0.7, 0.05, 0.0]))
"""Behind the window."""


# ------------------------------------------------------------ through the command line
@pytest.mark.drawn(2)
@pytest.mark.parametrize(
    ("family", "seed", "closest"),
    [
        ("too short", 0, 0.05),
        ("too stiff", 0, 0.05),
        ("contact", 1, 0.1),
        ("torque", 1, 0.05),
        ("too thick", 1, 0.3),
        ("blocked", 0, 0.0),
    ],
)
def test_the_reason_in_space_is_true_and_what_helps_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, family: str, seed: int, closest: float
) -> None:
    """A problem of each family: exit code 3, the true reason by name, a verified change close to the threshold."""
    # How close it comes is a matter of time: of the processor's, not of others that run beside.
    monkeypatch.setattr(deadline, "WALL_GUARD", 1e3)
    case = make_space_case(family, seed)
    file = tmp_path / "problem.toml"
    file.write_text(tomlkit.dumps(case.data))
    result = CliRunner().invoke(app, ["solve", str(file), "--out", str(tmp_path)])
    record: dict[str, Any] = json.loads((tmp_path / case.data["name"] / "solution.json").read_text())
    assert (result.exit_code, record["status"]) == (3, "infeasible")
    diagnosis = record["diagnosis"]
    assert named_rightly(case, diagnosis), diagnosis
    assert relaxation_error(case, diagnosis) <= closest, diagnosis
    assert all(sentence in result.output for sentence in sentences(diagnosis["reason"]))
    assert all(f"solved with {relaxed['words']}" in result.output for relaxed in diagnosis["relaxations"])
    assert (tmp_path / case.data["name"] / "report.html").exists()


# ------------------------------------------------------------ proofs prove nothing false
@settings(max_examples=60, deadline=None)
@given(seed=seeds, limit=st.floats(0.03, 1.2), base=st.floats(0.05, 3.1), asked=st.booleans())
def test_no_pose_in_space_is_out_of_reach(seed: int, limit: float, base: float, asked: bool) -> None:
    """The tip of any pose within the joint limits, with its direction or without, passes all checks at once."""
    rng = np.random.default_rng(seed)
    arm = space_arm(8, joint_limit=limit, base_limit=base, self_collision=False)
    bends = np.where(rng.random((8, 2)) < 0.4, 1.0, rng.uniform(-1.0, 1.0, (8, 2)))
    bends *= rng.choice([-1.0, 1.0], 2) * np.append([base], np.full(7, limit))[:, None]
    q = arm.configuration(bends, 0.0)
    tip = arm.joint_positions_at(q)[-1]
    direction = arm.link_rotations(q)[-1, :, 0] if asked else None
    problem = problem_of(arm, TipGoal(tip, direction))
    refuse_impossible(replace(problem, workspace=Workspace(bounds=None)))


@pytest.mark.drawn(3, of="closed ways")
@settings(max_examples=6, deadline=None)
@given(seed=seeds)
def test_no_pose_among_bodies_is_closed_off(seed: int) -> None:
    """Whatever is about an arm that touches nothing, there is a way to its tip: the arm itself."""
    assert ways_of(clutter(seed, links=12, bodies=40).problem).answer != "closed"


@settings(max_examples=100, deadline=None)
@given(limit=st.floats(0.0, 3.1), seed=seeds)
def test_the_most_turn_of_a_joint_is_that_of_its_bends(limit: float, seed: int) -> None:
    """No two bends within a limit turn a link by more, and some do; the limit of a turn is its inverse."""
    arm = space_arm(8)
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-limit, limit, (2, 200))
    turns = np.arccos(np.clip(np.cos(a) * np.cos(b), -1.0, 1.0))
    assert np.max(turns) <= most_turn(arm, limit) + 1e-7
    at_limit = [np.arccos(np.clip(np.cos(limit) ** 2, -1.0, 1.0)), limit]
    assert any(turn == pytest.approx(most_turn(arm, limit), abs=1e-7) for turn in at_limit)
    assert least_limit(arm, most_turn(arm, limit)) == pytest.approx(limit, abs=1e-6)


def test_caps_are_as_far_as_the_arm_when_nothing_bends_it_back() -> None:
    """Straight ahead an arm reaches its length, against the direction asked for at its goal it falls short."""
    arm = space_arm(8, joint_limit=0.1, base_limit=0.1)
    ahead = NamedGoal("goal", "goal", TipGoal(np.array([0.8, 0.0, 0.0])), Tolerances())
    assert TurnCaps(arm, ahead).farthest(np.eye(3)[:1])[0] == pytest.approx(0.8)
    back = replace(ahead, goal=TipGoal(np.array([0.7, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])))
    found = failed(problem_of(arm, back.goal))
    assert {finding.kind for finding in found} == {"too stiff"}


# ------------------------------------------------------------ ways
@settings(max_examples=15, deadline=None)
@given(seed=seeds)
def test_split_cubes_touch_as_before(seed: int) -> None:
    """However cubes are split, they fill the same box, and the pairs that are kept are those that touch."""
    rng = np.random.default_rng(seed)
    tree = SurfaceTree.from_triangles(Workspace(bounds=ROOM).triangle_soup)
    cells = CellTree.over(tree, ROOM, 30, 1.0)
    volume = float(np.sum(cells.sides**3))
    for _ in range(3):
        cells, _ = cells.split(rng.random(len(cells)) < 0.15)
    assert float(np.sum(cells.sides**3)) == pytest.approx(volume)
    low, high = cells.low, cells.low + cells.size[:, None]
    touch = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), axis=2)
    kept = np.zeros_like(touch)
    kept[cells.pairs[:, 0], cells.pairs[:, 1]] = True
    assert np.array_equal(kept | kept.T, touch & ~np.eye(len(cells), dtype=bool))
    assert len(cells.pairs) == np.count_nonzero(np.triu(touch, 1))


@pytest.mark.drawn(3, of="closed ways")
@pytest.mark.planning
def test_the_widest_way_in_space_is_the_window() -> None:
    """The bottleneck is found: its place, how wide it is, and the walls beside it; a thinner arm passes."""
    arm = space_arm(12, radius=0.05)
    problem = backwards(problem_of(arm, BEYOND, *window(0.035)))
    (finding,) = failed(problem)
    assert (finding.kind, finding.proved) == ("too thick", True)
    assert 0.07 - 1e-9 <= (finding.measured or 0.0) <= 0.07 * 1.06
    place = np.array(finding.place)
    assert 0.38 <= place[0] <= 0.47
    assert np.all(np.abs(place[1:]) < 0.02)
    assert set(finding.obstacles) <= {"upper", "lower", "left", "right"}
    assert finding.bounds["arm.radius"] >= 0.035 - 1e-9
    assert ways_of(replace(problem, arm=replace(arm, radius=0.03))).answer == "open"
    with pytest.raises(UnreachableGoal):
        refuse_infeasible(problem)


@pytest.mark.drawn(3, of="closed ways")
@pytest.mark.planning
def test_a_way_round_that_is_too_long_is_one_of_length() -> None:
    """Behind a screen that ends above, the arm is too short, by as much as a string over its edge is long."""
    arm = space_arm(12, 0.8 / 12, radius=0.015)
    screen = box("screen", [0.35, -1.5, -1.5], [0.4, 1.5, 0.35])
    problem = backwards(problem_of(arm, TipGoal(np.array([0.7, 0.0, 0.0])), screen))
    (finding,) = failed(problem)
    string = np.hypot(0.35, 0.35) + 0.05 + np.hypot(0.3, 0.35)
    assert (finding.kind, finding.obstacles[0]) == ("too short", "screen")
    assert string <= (finding.measured or 0.0) <= 1.1 * string
    assert 0.8 <= 12 * finding.bounds["arm.link_length"] <= string + 2.0 * 0.015 * np.pi
    longer = replace(problem, arm=replace(arm, link_length=1.15 * string / 12))
    shortest = ways_of(longer).shortest
    assert shortest is not None
    assert path_length(shortest) <= 1.1 * string
    assert failed(longer) == ()


@pytest.mark.drawn(3, of="closed ways")
@pytest.mark.planning
def test_a_closed_window_is_opened_by_taking_its_shutter_away() -> None:
    """Every way is closed however thin the arm is; the smallest body that opens one is named first, and where."""
    shutter = box("shutter", [0.41, -0.11, -0.11], [0.44, 0.11, 0.11])
    problem = backwards(problem_of(space_arm(12, radius=0.03), BEYOND, *window(0.1), shutter))
    (finding,) = failed(problem)
    assert (finding.kind, finding.obstacles[0]) == ("blocked", "shutter")
    assert finding.place == pytest.approx((0.425, 0.0, 0.0), abs=0.1)
    assert failed(replace(problem, workspace=problem.workspace.without_obstacle("shutter"))) == ()


@pytest.mark.drawn(3, of="closed ways")
@pytest.mark.planning
def test_what_is_tight_in_space_is_told() -> None:
    """A window hardly wider than the arm is likely to stand in the way, and is no proof; a wide one is not told."""
    arm = space_arm(12, radius=0.05)
    tight = tight_passages(problem_of(arm, BEYOND, *window(0.058)), Deadline.never())
    assert tight[0].kind == "too thick"
    assert not any(finding.proved for finding in tight)
    assert 0.116 <= (tight[0].measured or 0.0) <= 0.125
    assert not any(
        finding.kind == "too thick"
        for finding in tight_passages(problem_of(arm, BEYOND, *window(0.2)), Deadline.never())
    )


def test_a_turn_that_the_arm_cannot_make_is_told() -> None:
    """Round a low screen's edge, with a ceiling above it, a stiff arm has no room to turn: where, and by how much."""
    arm = space_arm(12, radius=0.02, joint_limit=0.06)
    walls = box("screen", [0.4, -1.5, -1.5], [0.45, 1.5, 0.2]), box("ceiling", [-1.5, -1.5, 0.3], [1.5, 1.5, 0.4])
    found = {finding.kind: finding for finding in tight_passages(problem_of(arm, BEYOND, *walls), Deadline.never())}
    stiff = found["too stiff"]
    assert not stiff.proved
    assert stiff.obstacles == ("screen",)
    assert (stiff.measured or 0.0) < (stiff.allowed or 0.0)


# ------------------------------------------------------------ contact, torque, what helps
def test_contacts_in_space_are_told_with_link_depth_and_place() -> None:
    """A ball 5 mm into the third link of a straight start, a box about the tip, and the room's wall behind the tip."""
    arm = space_arm(6)
    ball = Obstacle("ball", SphereBody(np.array([0.25, 0.025, 0.0]), 0.01))
    problem = problem_of(arm, TipGoal(np.array([0.0, 0.4, 0.2])), ball)
    (finding,) = failed(problem)
    assert "start: the start is in contact: link 3 overlaps 'ball' by 5.0 mm" in finding.reason
    assert finding.bounds["arm.radius"] == pytest.approx(0.015)
    cover = box("cover", [-0.1, 0.3, 0.1], [0.1, 0.5, 0.3])
    (finding,) = failed(problem_of(arm, problem.goal, cover))
    assert "the tip is 100.0 mm inside 'cover'" in finding.reason
    touched = problem_of(arm, problem.goal, box("cover", [-0.1, 0.4 + arm.radius, 0.1], [0.1, 0.5, 0.3]))
    kept = replace(touched, workspace=replace(touched.workspace, clearance=0.005))
    (finding,) = failed(kept)
    assert "the tip has a clearance of 0.0 mm to 'cover'" in finding.reason
    small = replace(problem, workspace=Workspace(bounds=np.array([[-0.2, -0.5, -0.5], [0.5, 0.5, 0.5]])))
    findings = failed(small)
    assert "link 6 is 100.0 mm outside the 'room'" in findings[0].reason
    asked: list[Problem] = []
    told = relaxations(small, findings, Trials(asked.append, later(900.0)))
    assert [relaxed.key for relaxed in told] == ["workspace.bounds"]
    assert failed(asked[0]) == ()


@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_the_load_of_a_straight_arm_in_space_is_weight_times_lever(tilt: float) -> None:
    """A straight arm at an angle needs m g L / 2 cos of it; a limit just above passes, just below fails."""
    arm = space_arm(6)
    need = float(arm.masses.sum()) * 9.81 * 0.5 * arm.length * np.cos(tilt)
    start = JointPose(np.array([[0.0, -tilt], *[[0.0, 0.0]] * 5]))
    problem = replace(problem_of(arm, TipGoal(np.array([0.2, 0.3, 0.2]))), start=start)
    ones = np.ones(18)
    for share, count in ((1.001, 0), (0.999, 1)):
        held = replace(problem, limits=Limits(ones, ones, torque=share * need * ones))
        found = list(within_torque_limits(held))
        assert len(found) == count
    assert found[0].bounds["limits.torque"] == pytest.approx(1.0 / 0.999)


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_tolerances_move_no_link_farther_than_is_granted(seed: int) -> None:
    """Poses within the play of a whole-arm goal lie within what it says of every link."""
    rng = np.random.default_rng(seed)
    arm = space_arm(8)
    bends = rng.uniform(-0.5, 0.5, (8, 2))
    pose = NamedPose("goal", "goal", arm.configuration(bends, 0.0), 0.05)
    moved: FloatArray = arm.configuration(bends + rng.uniform(-0.05, 0.05, (8, 2)), 0.0)
    away = np.linalg.norm(arm.joint_positions_at(moved) - arm.joint_positions_at(pose.q), axis=1)
    assert np.all(away[1:] <= pose.displacement_bounds(arm) + 1e-12)


def test_a_goal_deep_in_a_body_is_moved_out_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The nearest place outside of a body is told, however deep the goal lies; without time none is looked for."""
    monkeypatch.setattr("ccm_opt.diagnosis.moved_goal._LONGEST_LOOK", 600.0)
    block = box("block", [0.05, 0.15, 0.0], [0.35, 0.45, 0.3])
    problem = problem_of(space_arm(8), TipGoal(np.array([0.2, 0.3, 0.1])), block)
    findings = failed(problem)
    (moved,) = moved_goals(problem, findings, Deadline.never())
    assert moved.bound is not None
    assert 0.1 <= moved.bound <= 0.25
    assert failed(moved.write(problem, moved.bound + 2e-3)) == ()
    assert tuple(moved_goals(problem, findings, later(0.0))) == ()


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_a_goal_moved_in_space_is_free(seed: int) -> None:
    """The place that is told for a goal inside of a ball passes every check, and is not far outside of the ball."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=3)
    goal = rng.uniform(0.3, 0.6) * way / np.linalg.norm(way)
    if goal[0] > 0.8 * float(np.linalg.norm(goal)):
        goal[0] *= -1.0  # away from the straight start
    ball = Obstacle("ball", SphereBody(goal + rng.uniform(-0.02, 0.02, 3), 0.06))
    problem = problem_of(space_arm(8), TipGoal(goal), ball)
    (moved,) = moved_goals(problem, failed(problem), Deadline.never())
    assert moved.bound is not None
    there = moved.write(problem, moved.bound)
    assert failed(there) == ()
    assert moved.bound <= 0.06 + 0.035 + 0.02 + 0.04
    assert f"goal.position moved by {moved.bound:.4g}" in moved.relaxation(problem, moved.bound, None).words
