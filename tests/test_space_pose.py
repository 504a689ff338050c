"""The static question in space, in Python and through the command line."""

import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import assume, given, reject, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import NoPlanFound, ProblemError, UnreachableGoal
from ccm_opt.io.reading import problem_from_mapping
from ccm_opt.problem import JointPose, TipGoal
from ccm_opt.problem.solution import StaticPose
from ccm_opt.robot.configuration import SpaceConfiguration
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.verification.chain_motion import LinkFrames, chain_points
from tests.arms import limits_at

from .benchmarks.bench_random_arms import LAYOUTS, Drawn
from .benchmarks.swept_arcs import ArcArm
from .benchmarks.swept_file import FileArm, broken_promises
from .command_runs import CommandLine, brightness
from .conftest import PROBLEMS
from .section_scenes import section_clutter
from .space_clutter import clutter
from .surface_scenes import slow_gaps

WING_BOX = PROBLEMS / "space" / "wing-box.toml"
OWN_TERMS = """\
import ccm_opt


@ccm_opt.constraint(name="middle aside", lower=0.1)
def middle_aside(q):
    return q.point_at(0.3)[1]


@ccm_opt.constraint(name="middle far away", lower=5.0)
def middle_far_away(q):
    return q.point_at(0.3)[1]
"""


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> CommandLine:
    """The command line."""
    return CommandLine(capsys)


def assert_sound(found: StaticPose) -> None:
    """The pose ends at the goal within the limits, with the gap it says, by code that the NLP does not share."""
    problem = found.problem
    arm = problem.arm
    goal = problem.goal
    assert isinstance(goal, TipGoal)
    q = found.configuration[None]
    points = chain_points(arm, q)[0]
    assert points[-1] == pytest.approx(goal.position, abs=1e-6 * arm.length)
    if goal.direction is not None:
        assert LinkFrames.from_configurations(arm, q).along[0, -1] @ goal.direction == pytest.approx(1.0, abs=1e-10)
    lower, upper = limits_at(arm, found.feed)
    assert np.all(found.configuration >= lower - 1e-9)
    assert np.all(found.configuration <= upper + 1e-9)
    first, share = arm.mount_end
    segments = np.stack((points[:-1], points[1:]), axis=1)[first:]
    segments[0, 0] += share * (segments[0, 1] - segments[0, 0])
    gaps = (
        slow_gaps(segments, problem.workspace.triangle_soup, 0.3 * arm.length)
        - arm.radius
        - problem.workspace.clearance
    )
    assert gaps.min() >= found.pose.gap - 1e-6 * arm.length


@pytest.mark.drawn(1)
@pytest.mark.parametrize("seed", [3, 4])
def test_the_best_of_all_beginnings_is_a_sound_pose_with_the_gap_it_says(seed: int) -> None:
    """Among balls and boxes the pose ends at the goal and has the room that it claims; no other costs less."""
    found = ccm_opt.find_pose(clutter(seed, links=12, bodies=40).problem)
    assert_sound(found)
    costs = [outcome.cost for outcome in found.outcomes if outcome.cost is not None]
    assert found.pose.cost == min(costs)
    assert found.pose.cost == pytest.approx(sum(found.pose.costs.values()))
    assert sum(segment.length for segment in found.curve.segments) == pytest.approx(found.problem.arm.length)


@pytest.mark.drawn(1)
@pytest.mark.parametrize(("seed", "sections"), [(5, 3), (6, 4)])
def test_sections_bend_evenly_in_the_best_pose(seed: int, sections: int) -> None:
    """Its bends are those of the sections, and its curve is that of their true arcs, which ends at the goal."""
    problem = section_clutter(seed, 20, sections)
    found = ccm_opt.find_pose(problem)
    assert isinstance(problem.goal, TipGoal)
    assert problem.arm.sections is not None
    assert problem.arm.sections.misfit(found.configuration) < 1e-12
    assert isinstance(found.curve, SpaceConfiguration)
    tip = found.curve.sample_frames(np.array([found.curve.length]))[1][0]
    for place in (tip, chain_points(problem.arm, found.configuration[None])[0, -1]):
        assert place == pytest.approx(problem.goal.position, abs=1e-6 * problem.arm.length)
    assert found.pose.gap > 0.0


@pytest.mark.drawn(2)
@pytest.mark.parametrize("kinds", LAYOUTS)
@given(seed=st.integers(0, 1 << 31))
@settings(max_examples=2)
def test_poses_of_any_layout_keep_clear_where_the_file_says(kinds: str, seed: int) -> None:
    """Bodies, coupled drives and bases are those of the file: an independent reader sees the goal met, nothing near."""
    kind = ArcArm if "even" in kinds else FileArm
    with TemporaryDirectory() as folder:
        try:
            data = Drawn(seed, 8.0, frozenset(kinds.split()), Path(folder)).data
        except ValueError:
            reject()  # no goal was found for the arm that was drawn
        goals = data["goal"] if isinstance(data["goal"], list) else [data["goal"]]
        data["goal"] = goals[-1]
        assume("position" in data["goal"])
        problem = problem_from_mapping(data, folder=Path(folder))
        try:
            found = ccm_opt.find_pose(problem)
        except NoPlanFound:
            reject()
        arm, q = problem.arm, found.configuration
        arrays = {"bend_angles": found.bends, "joint_positions": found.joint_positions}
        if arm.tool is not None:
            arrays["tool_tip"] = points_with_tool(arm, q)[-1]
        if arm.base_axes:
            arrays["base_axes"] = np.atleast_1d(found.feed)
        if arm.drives is not None:
            arrays["drive_values"] = arm.drives.drives(q[None, : len(arm.bend_limits)])[0]
        still = {name: np.stack((values, values)) for name, values in arrays.items()}
        still |= {"time": np.array([0.0, 1.0]), "stops": np.array([], dtype=int)}
        broken = broken_promises(data, still, Path(folder), kind)
    assert set(broken) <= {"the start is another"}


@pytest.mark.drawn(3, of="whole plans")
def test_a_gantry_stands_where_its_arm_bends_least(tmp_path: Path, run: CommandLine) -> None:
    """Its axes are variables within their ranges, and the record says where they are."""
    run("pose", PROBLEMS / "space" / "wing-box-gantry.toml", "--out", tmp_path, "--no-pictures")
    record = json.loads((tmp_path / "wing-box-gantry" / "pose.json").read_text(encoding="utf-8"))
    problem = ccm_opt.load_problem(PROBLEMS / "space" / "wing-box-gantry.toml")
    arm = problem.arm
    q = np.concatenate((np.deg2rad(record["joints_deg"]).ravel(), record["feed"]))
    assert len(record["feed"]) == len(arm.carrier)
    assert np.all((q >= arm.lower_limits - 1e-9) & (q <= arm.upper_limits + 1e-9))
    assert isinstance(problem.goal, TipGoal)
    assert chain_points(arm, q[None])[0, -1] == pytest.approx(problem.goal.position, abs=1e-6 * arm.length)
    assert record["gap"] > 0.9 * problem.wanted_gap


@pytest.mark.drawn(6, of="whole plans")
def test_a_goal_behind_holes_is_found_on_a_feed_axis_and_written(tmp_path: Path, run: CommandLine) -> None:
    """In the wing box, where a sampled pose is hardly ever free, the pose, its record, arrays and picture are there."""
    done = run("pose", WING_BOX, "--out", tmp_path)
    assert done.code == 0
    assert "best goal pose" in done.out
    assert "feed" in done.out
    folder = tmp_path / "wing-box"
    record = json.loads((folder / "pose.json").read_text())
    assert record["status"] == "solved"
    assert len(record["meshes"]) == len(list((folder / "meshes").iterdir()))
    problem = ccm_opt.load_problem(WING_BOX)
    assert problem.dimension == 3
    with np.load(folder / "pose.npz") as arrays:
        pose = problem.arm.configuration(arrays["bend_angles"], float(arrays["base_feed"]))
        assert arrays["joint_positions"] == pytest.approx(problem.arm.joint_positions_at(pose), abs=1e-12)
        assert arrays["joint_positions"][-1] == pytest.approx(problem.goal.position, abs=1e-6)  # type: ignore[union-attr]
    assert record["gap"] >= 0.9 * record["wanted_gap"]
    assert brightness(folder / "pose.png") > 0.05


@pytest.mark.drawn(2, of="poses in vain")
def test_a_constraint_of_the_user_shapes_the_pose(tmp_path: Path, run: CommandLine) -> None:
    """The arm's middle is where a constraint wants it; one that no pose keeps leaves the record of why, and exit 3."""
    terms = tmp_path / "terms.py"
    terms.write_text(OWN_TERMS)
    file = tmp_path / "bow.toml"
    file.write_text(OPEN)
    done = run("pose", file, "--out", tmp_path / "out", "--constraint", f"{terms}:middle_aside", "--json")
    assert done.code == 0
    points = np.array(done.result["joint_positions"])
    assert points[6, 1] >= 0.1 - 1e-6
    assert np.all(np.array(list(done.result["residuals"].values())) < 1e-6)  # type: ignore[attr-defined]
    failed = run("pose", file, "--out", tmp_path / "none", "--constraint", f"{terms}:middle_far_away")
    assert failed.code == 3
    assert "constraint 'middle far away'" in failed.err
    record = json.loads((tmp_path / "none" / "bow" / "pose.json").read_text())
    assert record["status"] == "no plan found"
    assert record["diagnosis"]["reason"]


OPEN = """
schema = 1
space = 3
name = "bow"

[workspace]

[arm]
links = 12
link_length = 0.05
radius = 0.01
base = { position = [0, 0, 0] }
joint_limit_deg = 60

[limits]
velocity = 1.0
acceleration = 4.0

[start]
shape = "straight"

[goal]
position = [0.4, 0.0, 0.0]
"""


def test_questions_without_an_answer_are_refused() -> None:
    """A goal for the whole arm leaves nothing to find; one out of reach, or inside of a body, is told as such."""
    problem = clutter(3, links=12, bodies=40).problem
    whole = JointPose(np.zeros((12, 2)))
    with pytest.raises(ProblemError, match="of the whole arm"):
        ccm_opt.find_pose(replace(problem, goal=whole))
    with pytest.raises(UnreachableGoal, match="out of reach"):
        ccm_opt.find_pose(replace(problem, goal=TipGoal(np.array([3.0, 0.0, 0.0]))))


@pytest.mark.drawn(1)
@pytest.mark.parametrize(
    ("share", "said"), [(0.999, "cannot turn to the goal"), (0.5, "no goal pose was found")], ids=["far", "near"]
)
def test_a_direction_that_no_pose_takes_is_not_found(share: float, said: str) -> None:
    """A stretched arm cannot look back, which is proved; where it has some length to spare, no pose is found."""
    problem = clutter(3, links=8, bodies=1).problem
    arm = problem.arm
    back = TipGoal(arm.base + share * arm.length * arm.direction, -arm.direction)
    hurried = replace(problem.planner, time_limit=2.0)
    with pytest.raises(NoPlanFound) as caught:
        ccm_opt.find_pose(replace(problem, goal=back, planner=hurried))
    assert said in caught.value.diagnosis.reason
