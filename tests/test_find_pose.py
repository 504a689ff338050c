"""The static question: the best pose at the goal, in Python and from the command line."""

import json
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.errors import NoPlanFound, ProblemError
from ccm_opt.io.reading import parse_problem
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal_members import GoalMember
from ccm_opt.planning.pose_beginnings import brought_poses
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.problem.solution import StaticPose
from ccm_opt.scene.bad_pose import refuse_bad_pose

from .conftest import PROBLEMS, SMALL_PROBLEM
from .goal_set_scenes import pocket
from .scenes import clutter

OWN_TERMS = """\
import ccm_opt


@ccm_opt.constraint(name="middle up", lower=0.1)
def middle_up(q):
    return q.point_at(0.2)[1]


@ccm_opt.constraint(name="elbow too far", lower=0.19)
def elbow_too_far(q):
    return q.point_at(0.2)[1]
"""


def assert_sound(found: StaticPose) -> None:
    """The pose ends at the goal, keeps the joint limits and touches nothing, by code that the NLP does not share."""
    problem = found.problem
    arm = problem.arm
    assert isinstance(problem.goal, TipGoal)
    assert found.joint_positions[-1] == pytest.approx(problem.goal.position, abs=1e-6 * arm.length)
    assert np.all(np.abs(found.bends) <= arm.bend_limits)
    refuse_bad_pose(arm, problem.workspace, found.bends, "pose")
    links = shapely.linestrings(np.stack((found.joint_positions[:-1], found.joint_positions[1:]), axis=1))
    for wall in problem.workspace.walls:
        room = shapely.distance(links, wall.core) - wall.rounding - arm.radius - problem.workspace.clearance
        assert room.min() >= found.pose.gap - 1e-6 * arm.length


@pytest.mark.drawn(1, of="poses")
@pytest.mark.parametrize("seed", range(3))
def test_the_best_of_all_tries_is_a_sound_pose_with_the_gap_it_says(seed: int) -> None:
    """In clutter the pose ends at the goal and has the room that it claims; no other try costs less."""
    found = ccm_opt.find_pose(clutter(92_000 + seed, 20).problem())
    assert_sound(found)
    costs = [outcome.cost for outcome in found.outcomes if outcome.cost is not None]
    assert found.pose.cost == min(costs)
    assert found.pose.cost == pytest.approx(sum(found.pose.costs.values()))
    assert sum(segment.length for segment in found.curve.segments) == pytest.approx(found.problem.arm.length)


@pytest.mark.drawn(1, of="poses")
@pytest.mark.parametrize("seed", [0, 1])
def test_a_pocket_that_a_wide_tolerance_reaches_is_found(seed: int) -> None:
    """Where the middle of the goal lies in a wall, a pose in the pocket before it is found, with the tip in the set."""
    narrow, goal, tolerances = pocket(np.random.default_rng([seed, 3]))
    found = ccm_opt.find_pose(replace(narrow, goal=goal, tolerances=tolerances))
    away = np.hypot(*(found.joint_positions[-1] - goal.position))
    assert away <= tolerances.position + 1e-6
    refuse_bad_pose(narrow.arm, narrow.workspace, found.bends, "pose")


def test_random_poses_are_brought_onto_the_goal_and_touch_nothing_much() -> None:
    """What Newton's method brings onto a goal has the tip there and bends no joint too far."""
    problem = clutter(92_000, 20).problem()
    assert isinstance(problem.goal, TipGoal)
    ends = resolve_ends(problem)
    member = GoalMember(problem.goal.position, problem.goal.heading)
    brought = list(islice(brought_poses(problem, problem.arm, ends, (member,)), 3))
    assert brought
    for q in brought:
        assert problem.arm.joint_positions_at(q)[-1] == pytest.approx(problem.goal.position, abs=1e-5)
        assert np.all(np.abs(q) <= problem.arm.bend_limits)


def small(**changes: object) -> Problem:
    """A small arm beside a post, perhaps changed."""
    return replace(parse_problem(SMALL_PROBLEM, "small.toml"), **changes)


def test_own_constraints_are_rows_with_multipliers_and_own_costs_are_parts() -> None:
    """A constraint that decides stands among the multipliers under its name, a cost among the parts of the objective.

    The name is one that rows of the program have, too.
    """
    constraint = ccm_opt.Constraint("gap in y", lambda q: q.point_at(0.2)[1], lower=0.1, upper=0.14)
    cost = ccm_opt.Cost("to the left", lambda q: q.point_at(0.2)[0] ** 2, weight=3.0)
    free = ccm_opt.find_pose(small())
    found = ccm_opt.find_pose(small(), constraints=[constraint], costs=[cost])
    assert_sound(found)
    assert free.joint_positions[2, 1] < 0.1
    assert found.joint_positions[2, 1] == pytest.approx(0.14, abs=1e-6)
    assert found.pose.multipliers["user: gap in y"] > 0.0
    assert found.pose.costs["user: to the left"] == pytest.approx(3.0 * found.joint_positions[2, 0] ** 2, rel=1e-6)
    assert found.residuals["gap in y"] <= 1e-6


@pytest.mark.drawn(20, of="dear tests")
def test_binding_sides_are_at_the_links_that_they_name() -> None:
    """Every side that is reported lies at an end of its link, and its direction is of unit length."""
    found = ccm_opt.find_pose(ccm_opt.load_problem(PROBLEMS / "fork.toml"))
    assert found.binding
    for side in found.binding:
        ends = found.joint_positions[[side.link - 1, side.link]]
        assert np.hypot(*(ends - side.place).T).min() < 1e-9
        assert np.hypot(*side.towards) == pytest.approx(1.0)
        assert side.multiplier > 0.0


@pytest.mark.drawn(2, of="poses in vain")
def test_a_constraint_that_no_pose_was_found_to_keep_is_named_with_its_miss() -> None:
    """The reason names the constraint and by how much the nearest pose misses it, and claims no proof."""
    constraint = ccm_opt.Constraint("elbow too far", lambda q: q.point_at(0.2)[1], lower=0.19)
    with pytest.raises(NoPlanFound) as caught:
        ccm_opt.find_pose(small(), constraints=[constraint])
    diagnosis = caught.value.diagnosis
    assert "constraint 'elbow too far'" in diagnosis.reason
    assert "not proved" in diagnosis.reason
    missed = diagnosis.evidence["missed_constraints"]
    assert isinstance(missed, dict)
    assert 0.0 < missed["elbow too far"] < 0.19


def test_a_goal_out_of_reach_is_proved_to_have_no_pose() -> None:
    """Where a necessary check fails its proof is the diagnosis."""
    with pytest.raises(NoPlanFound) as caught:
        ccm_opt.find_pose(small(goal=TipGoal(np.array([0.6, 0.3]))))
    assert caught.value.diagnosis.findings[0].proved


def test_questions_without_a_pose_to_find_are_refused() -> None:
    """A goal for the whole arm is bad input for the static question."""
    with pytest.raises(ProblemError, match="whole arm"):
        ccm_opt.find_pose(small(goal=JointPose(np.full(4, 0.1))))


def run(*arguments: object) -> tuple[int, str]:
    """Exit code and everything printed."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.output


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with a problem and own terms."""
    (tmp_path / "small.toml").write_text(SMALL_PROBLEM)
    (tmp_path / "own.py").write_text(OWN_TERMS)
    return tmp_path


def test_the_command_writes_the_pose_its_arrays_and_a_picture(files: Path) -> None:
    """``ccm-opt pose`` ends with 0; record, arrays and picture agree and are all there is in the folder."""
    code, output = run(
        "pose", files / "small.toml", "--out", files / "out", "--constraint", f"{files / 'own.py'}:middle_up"
    )
    assert code == 0, output
    folder = files / "out" / "small"
    assert {file.name for file in folder.iterdir()} == {"pose.json", "pose.npz", "pose.png"}
    record = json.loads((folder / "pose.json").read_text())
    with np.load(folder / "pose.npz") as file:
        arrays = dict(file)
    assert record["status"] == "solved"
    assert np.rad2deg(arrays["bend_angles"]) == pytest.approx(record["joints_deg"])
    assert arrays["joint_positions"] == pytest.approx(np.array(record["joint_positions"]))
    assert len(record["curve"]["segments"]) == len(arrays["segment_lengths"])
    assert record["residuals"]["middle up"] <= 1e-6
    assert (folder / "pose.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.drawn(2, of="poses in vain")
def test_the_command_leaves_a_record_where_there_is_no_pose(files: Path) -> None:
    """Without a pose the exit code is 3, and ``pose.json`` alone holds the diagnosis."""
    code, output = run(
        "pose", files / "small.toml", "--out", files / "out", "--constraint", f"{files / 'own.py'}:elbow_too_far"
    )
    assert code == 3
    assert "elbow too far" in output
    folder = files / "out" / "small"
    assert [file.name for file in folder.iterdir()] == ["pose.json"]
    record = json.loads((folder / "pose.json").read_text())
    assert record["status"] == "no plan found"
    assert "elbow too far" in record["diagnosis"]["reason"]


def test_the_command_does_not_replace_the_folder_of_a_plan(files: Path) -> None:
    """A folder that ``solve`` wrote is left alone; the exit code is 2."""
    plan = files / "out" / "small"
    plan.mkdir(parents=True)
    (plan / "solution.json").write_text("{}")
    code, output = run("pose", files / "small.toml", "--out", files / "out")
    assert code == 2
    assert "another --out" in output
    assert [file.name for file in plan.iterdir()] == ["solution.json"]
