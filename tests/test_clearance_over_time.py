"""The room that a motion keeps: measured like an independent sweep, explained, and bounded from above."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import FloatArray
from ccm_opt.diagnosis.possible_gap import possible_gap
from ccm_opt.driver.clearance_over_time import ClearanceSettings, clearance_over_time
from ccm_opt.driver.solution_assembly import gap_between_walls
from ccm_opt.problem import JointPose, Limits, Problem, Stop, TipGoal, Tolerances
from ccm_opt.problem.solution import ClearanceRecord, JointTrajectory, PossibleGap
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.scene.bodies import SphereBody
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from ccm_opt.verification.selfcollision import segment_distances
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from ccm_opt.viz.clearance_section import clearance_sentences
from ccm_opt.viz.document import PageUnits

from .arms import plain_arm
from .conftest import PROBLEMS
from .space_arms import space_arm
from .surface_scenes import slow_gaps
from .test_verification import ROOM, make_case, quintic, random_motion, random_obstacles

POST = Obstacle("post", PlaneShape(shapely.Point(0.3, 0.12), 0.02))


def swept_gap(problem: Problem, time: FloatArray, bends: FloatArray, poses: int = 1500) -> float:
    """Least gap beyond contact over many poses of a motion, by shapely alone."""
    arm = problem.arm
    moments = np.linspace(time[0], time[-1], poses)
    swept = np.stack([np.interp(moments, time, column) for column in bends.T], axis=1)
    points = arm.joint_positions(arm.headings(swept))
    # The mount is cut off: its links whole, and the beginning of the one on which it ends.
    cut, share = arm.mount_end
    exposed = points[:, cut:].copy()
    exposed[:, 0] += share * (points[:, cut + 1] - points[:, cut])
    arms = shapely.linestrings(exposed)
    walls = [float(np.min(shapely.distance(arms, wall.core))) - wall.rounding for wall in problem.workspace.walls]
    least = min(walls) - arm.radius - problem.workspace.clearance
    links = shapely.linestrings(np.stack((points[:, :-1], points[:, 1:]), axis=2))
    for i, j in zip(*arm.distant_pairs, strict=True):
        least = min(least, float(np.min(shapely.distance(links[:, i], links[:, j]))) - 2.0 * arm.radius)
    return least


def room_of_motion(problem: Problem, time: FloatArray, bends: FloatArray, wanted: float = 0.0) -> ClearanceRecord:
    """The record of a motion of which only the poses matter."""
    still = np.zeros_like(bends)
    return clearance_over_time(problem, JointTrajectory(time, bends, still, still), wanted)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    radius=st.floats(0.0, 0.03),
    clearance=st.floats(0.0, 0.01),
    mount=st.floats(0.0, 0.25),
)
def test_the_least_gap_is_that_of_a_dense_sweep(seed: int, radius: float, clearance: float, mount: float) -> None:
    """The record's least gap is the least of 1500 poses measured by shapely, mount and clearance taken off."""
    rng = np.random.default_rng(seed)
    arm = replace(plain_arm(6, 0.1, radius), mount_length=mount)
    problem, _, _ = make_case(arm, workspace=Workspace(ROOM, random_obstacles(rng), clearance=clearance))
    time, bends = random_motion(rng, arm.links)
    room = room_of_motion(problem, time, bends)
    swept = swept_gap(problem, time, bends)
    assert room.gaps.min() >= room.nearest.gap - 1e-12
    if swept < 1e-5:
        # The search for the least gap ends with the first that refutes the motion.
        assert room.nearest.gap < 2.0 * DEFAULT_VERIFICATION.report_resolution
        return
    step = 2.0 * arm.length * float(np.abs(np.diff(bends, axis=0)).sum(axis=1).max()) * (len(bends) - 1) / 1500
    if swept < room.reach:
        assert room.nearest.gap <= swept + DEFAULT_VERIFICATION.report_resolution + 1e-9
        assert room.nearest.gap >= swept - step
    else:
        assert room.nearest.gap >= room.reach - step


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10**6), clearance=st.floats(0.0, 0.01), thinnest=st.floats(0.2, 1.0))
def test_the_least_gap_in_space_is_that_of_a_dense_sweep(seed: int, clearance: float, thinnest: float) -> None:
    """Of an arm between balls, between samples too; gaps at samples are those of their poses, to the links as well.

    Links become thinner towards the tip, so the link with the nearest centre line need not have the least gap.
    """
    rng = np.random.default_rng(seed)
    taper = Proportions(np.ones(6), np.linspace(1.0, thinnest, 6), np.ones(12))
    arm = space_arm(6, 0.1, 0.02, mount_length=0.05, proportions=taper)
    balls = tuple(Obstacle(f"ball {k}", SphereBody(rng.uniform(-0.6, 0.6, 3), 0.05)) for k in range(4))
    poses = np.cumsum(rng.normal(0.0, 0.15, (5, 12)), axis=0)
    still = np.zeros_like(poses)
    trajectory = JointTrajectory(0.1 * np.arange(5), poses, still, still, arm.coordinates)
    one = np.ones(18)
    start, goal = (JointPose(pose.reshape(6, 2)) for pose in poses[[0, -1]])
    problem = Problem("space", Workspace(obstacles=balls, clearance=clearance), arm, Limits(one, one), start, goal)
    room = clearance_over_time(problem, trajectory, 0.0)

    def gaps(positions: FloatArray) -> FloatArray:
        points = arm.joint_positions_at(positions)
        first, exposed = arm.exposed_links(points)
        walls = slow_gaps(exposed.reshape(-1, 2, 3), problem.workspace.triangle_soup, 9.0)
        i, j = arm.self_pairs
        itself = segment_distances(*(points[:, k].reshape(-1, 3) for k in (i, i + 1, j, j + 1))).reshape(
            len(points), -1
        )
        to_walls = walls.reshape(len(points), -1) - arm.radii[first:]
        to_itself = itself - arm.radii[i] - arm.radii[j]
        return np.asarray(np.minimum(to_walls.min(axis=1) - clearance, to_itself.min(axis=1)))

    at_samples = gaps(poses)
    np.testing.assert_allclose(room.gaps, np.minimum(at_samples, room.reach), atol=1e-9)
    dense = np.concatenate([a + np.linspace(0.0, 1.0, 40)[:, None] * (b - a) for a, b in pairwise(poses)])
    swept = float(gaps(dense).min())
    # Where a pose is too near the search ends with the first that refutes the motion.
    if swept > 1e-3 and swept < room.reach:
        assert room.nearest.gap <= swept + 2.0 * DEFAULT_VERIFICATION.report_resolution
        assert room.nearest.gap >= swept - 0.02


def test_the_nearest_link_is_the_one_with_the_least_gap_of_its_surface() -> None:
    """A thick link comes before a thin one whose centre line is nearer to a ball."""
    arm = space_arm(6, proportions=Proportions(np.ones(6), np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2]), np.ones(12)))
    near_thick = Obstacle("near the thick link", SphereBody(np.array([0.15, 0.055, 0.0]), 0.02))
    near_thin = Obstacle("near the thin link", SphereBody(np.array([0.55, 0.05, 0.0]), 0.02))
    one, still = np.ones(18), JointPose(np.zeros((6, 2)))
    problem = Problem("taper", Workspace(obstacles=(near_thin, near_thick)), arm, Limits(one, one), still, still)
    rest = np.zeros((2, 12))
    room = clearance_over_time(problem, JointTrajectory(np.arange(2.0), rest, rest, rest, arm.coordinates), 0.0)
    np.testing.assert_allclose(room.wall_gaps, 0.015, atol=1e-4)
    assert (room.nearest.link, room.nearest.obstacle) == (2, "near the thick link")


def test_the_ends_and_the_pair_are_named() -> None:
    """The gap of both ends is that of their poses, and the nearest pair is the link and the wall that it is near to."""
    problem, trajectory, _ = make_case(plain_arm(6, 0.1, 0.02), [POST], end=np.array([0.25, 0, 0, 0, 0, 0]))
    room = clearance_over_time(problem, trajectory, 0.01)
    for end, sample in ((room.at_start, 0), (room.at_goal, -1)):
        pose = trajectory.bend_angles[[sample, sample]]
        assert end.gap == pytest.approx(min(swept_gap(problem, np.array([0.0, 1.0]), pose, 2), room.reach), abs=1e-9)
        assert end.time == trajectory.time[sample]
    assert room.nearest.obstacle == "post"
    assert room.nearest.link in {3, 4}
    assert room.nearest.pair == f"link {room.nearest.link} to 'post'"
    assert (room.time[0], room.time[-1]) == (0.0, trajectory.duration)
    assert len(room.time) == len(room.wall_gaps) == len(room.self_gaps) <= ClearanceSettings().samples + 2


@pytest.mark.parametrize("self_collision", [True, False])
def test_an_arm_that_may_cross_itself_has_no_gap_to_itself(*, self_collision: bool) -> None:
    """The record of an arm that curls up asks for the gap between its links where they have to keep apart alone."""
    arm = replace(plain_arm(6, 0.1, 0.02), self_collision=self_collision)
    problem, trajectory, _ = make_case(arm, end=np.full(6, 1.3))
    room = clearance_over_time(problem, trajectory, 0.01)
    assert (room.nearest.second_link > 0) is self_collision
    assert bool(np.all(room.self_gaps == room.reach)) is not self_collision


def turned_about_its_base(turns: tuple[float, ...], pin: Obstacle) -> ClearanceRecord:
    """The room of a straight arm of 0.6 m that turns about its base to some angles in turn, resting at each."""
    arm = plain_arm(6, 0.1, 0.02)
    poses = [turn * np.eye(arm.links)[0] for turn in turns]
    parts = [quintic(a, b) for a, b in pairwise(poses)]
    bends = np.concatenate([parts[0].bend_angles, *(part.bend_angles[1:] for part in parts[1:])])
    still = np.zeros_like(bends)
    steps = len(parts[0].time) - 1
    stops = tuple(k * steps for k in range(1, len(parts)))
    trajectory = JointTrajectory(parts[0].time[1] * np.arange(len(bends)), bends, still, still, stops=stops)
    on_the_way = tuple(Stop(JointPose(pose), Tolerances()) for pose in poses[1:-1])
    problem, _, _ = make_case(arm, [pin], start=poses[0], end=poses[-1], stops=on_the_way)
    return clearance_over_time(problem, trajectory, 0.01)


@pytest.mark.parametrize(
    ("turns", "causes"),
    [((0.0, 0.3), ["start"]), ((0.3, 0.0), ["goal"]), ((0.3, 0.0, 0.3), ["stop"]), ((0.1, 0.4), [])],
)
def test_a_pose_without_room_is_the_cause(turns: tuple[float, ...], causes: list[str]) -> None:
    """Where the arm rests with less than the wanted gap, and has no less nearby, that pose is the cause."""
    # At angle 0 the arm is 5 mm from the pin, and turns away from it at larger angles.
    pin = Obstacle("pin", PlaneShape(shapely.Point(0.3 * np.cos(0.1), -0.3 * np.sin(0.1)), 0.005))
    room = turned_about_its_base(turns, pin)
    assert [part.cause for part in room.short] == causes
    at_rest = 0.3 * np.sin(0.1) - 0.025
    assert [part.nearest.gap for part in room.short] == pytest.approx([at_rest] * len(causes), abs=1e-9)


def test_a_narrow_place_on_the_way_is_a_passage() -> None:
    """The tip passes a pin at 5 mm between two ends that are far from it: the way is short of room there, and then."""
    pin = Obstacle("pin", PlaneShape(shapely.Point(0.63 * np.cos(0.2), 0.63 * np.sin(0.2)), 0.005))
    room = turned_about_its_base((0.0, 0.4), pin)
    (part,) = room.short
    assert part.cause == "passage"
    assert part.nearest.link == 6
    assert part.nearest.gap == pytest.approx(0.005, abs=1e-4)
    assert part.begin < 1.0 < part.end
    sentences = list(clearance_sentences(room, PageUnits.of_arm(1.0)))
    assert sentences[0].startswith("least gap 5.00 mm of the preferred 10 mm, at 1.00 s, link 6 to 'pin'")
    assert "clearance 5" in sentences[1]


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_the_room_is_printed_written_and_printed_again(tmp_path: Path) -> None:
    """The table, the record, the arrays and the check name one and the same least gap, that of the verifier."""
    problem = tmp_path / "room.toml"
    text = (PROBLEMS / "swan-neck.toml").read_text()
    problem.write_text(f"{text}\n[planner]\nwanted_gap = 0.009\n")
    runs = tmp_path / "runs"
    solved = CliRunner().invoke(app, ["solve", str(problem), "--out", str(runs), "--no-pictures"])
    checked = CliRunner().invoke(app, ["check", str(runs / "swan-neck")])
    record = json.loads((runs / "swan-neck" / "solution.json").read_text())
    room = record["room"]
    worst = {check["name"]: check["worst"] for check in record["checks"]}
    assert room["nearest"]["gap"] == pytest.approx(min(worst["wall clearance"], worst["self-collision"]), abs=1e-12)
    assert room["wanted_gap"] == 0.009
    assert room["possible_by"] == "wanted gap"
    assert room["nearest"]["gap"] <= room["possible_gap"]
    line = f"least gap {room['nearest']['gap']:.3g} m of the preferred 0.009 m"
    assert line in solved.output
    assert line in checked.output
    with np.load(runs / "swan-neck" / "solution.npz") as arrays:
        gaps = np.minimum(arrays["wall_gaps"], arrays["self_gaps"])
        assert gaps[0] == room["start"]["gap"]
        assert gaps[-1] == room["goal"]["gap"]
        assert gaps.min() >= room["nearest"]["gap"]
        assert len(arrays["room_time"]) == len(gaps)


# ---------------------------------------------------------------- what would be possible


def bounded(goal: TipGoal, walls: list[Obstacle], wanted: float = 0.05) -> PossibleGap:
    """The bound for an arm of 0.6 m and a radius of 20 mm that starts along x."""
    problem, trajectory, _ = make_case(plain_arm(6, 0.1, 0.02), walls)
    room = clearance_over_time(problem, trajectory, wanted)
    found = possible_gap(replace(problem, goal=goal), room)
    assert found is not None
    return found


def test_the_goal_bounds_the_gap_by_what_it_fixes() -> None:
    """A tip without a heading has the room of its place; with one, that of the last link."""
    post = Obstacle("post", PlaneShape(shapely.Point(0.3, 0.3), 0.01))
    free = bounded(TipGoal(np.array([0.3, 0.35])), [post])
    along = bounded(
        TipGoal(np.array([0.345, 0.3]), heading=0.0), [Obstacle("post", PlaneShape(shapely.Point(0.3, 0.335), 0.01))]
    )
    assert (free.by, along.by) == ("goal", "goal")
    assert free.value == pytest.approx(0.02, abs=1e-9)
    assert along.value == pytest.approx(0.005, abs=1e-9)


@settings(max_examples=20)
@given(half=st.floats(0.025, 0.06))
def test_a_door_bounds_the_gap_of_every_way(half: float) -> None:
    """Through a door in a wall across the room no arm keeps more than half the door less its radius."""
    below = Obstacle("below", PlaneShape(shapely.box(-3.0, 0.2, -half, 0.25)))
    above = Obstacle("above", PlaneShape(shapely.box(half, 0.2, 3.0, 0.25)))
    found = bounded(TipGoal(np.array([0.0, 0.5])), [below, above], wanted=0.03)
    assert found.value == pytest.approx(min(half - 0.02, 0.03), rel=2e-3, abs=1e-4)
    if half - 0.02 < 0.029:
        assert found.by == "passage"
    if half - 0.02 > 0.031:
        assert found.by == "wanted gap"


@settings(max_examples=30)
@given(width=st.floats(0.05, 0.09), turn=st.floats(-0.5, 0.5), shift=st.floats(-0.02, 0.02))
def test_walls_bound_the_gap_of_an_arm_between_them(width: float, turn: float, shift: float) -> None:
    """An arm between two walls has no more than the bound, measured by shapely; beside them there is none."""
    below = Obstacle("below", PlaneShape(shapely.box(0.28, -0.5, 0.32, shift - 0.5 * width)))
    above = Obstacle("above", PlaneShape(shapely.Point(0.3, shift + 0.5 * width + 0.1), 0.1))
    problem, _, _ = make_case(plain_arm(6, 0.1, 0.02), [below, above])
    points = problem.arm.joint_positions(np.full(6, turn * width))
    axis = shapely.LineString(points)
    gaps = [shapely.distance(axis, wall.core) - wall.rounding - 0.02 for wall in (below, above)]
    found = gap_between_walls(problem, points, 0.03)
    if shapely.intersects(axis, shapely.LineString([(0.3, shift - 0.5 * width), (0.3, shift + 0.5 * width)])):
        assert found is not None
        assert set(found.walls) == {"below", "above"}
        assert found.value == pytest.approx(0.5 * width - 0.02, abs=1e-9)
        assert min(gaps) <= found.value + 1e-9
    else:
        assert found is None


def test_where_there_is_room_the_wanted_gap_is_the_bound() -> None:
    """In an empty room nothing stands against the wanted gap."""
    assert bounded(TipGoal(np.array([0.0, 0.5])), [], wanted=0.01) == PossibleGap(0.01, "wanted gap")
