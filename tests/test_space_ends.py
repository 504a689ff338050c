"""Starts and goals inside of bodies or in contact are told with the obstacle's name, the place and the depth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.errors import ProblemError, UnreachableGoal
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.problem import JointPose, Problem
from ccm_opt.scene.distances.enclosures import deepest_enclosure
from tests.space_files import CUBE, binary_stl, written


def placed(folder: Path, corner: tuple[float, float, float], size: float, goal: str = "[-0.7, 0.1, 0.0]") -> Problem:
    """The small problem with a cube in place of its part."""
    file = written(folder, binary_stl(np.array(corner) + size * CUBE))
    file.write_text(file.read_text().replace("[-0.7, 0.1, 0.0]", goal))
    problem = ccm_opt.load_problem(file)
    assert problem.dimension == 3
    return problem


@pytest.mark.parametrize(
    ("corner", "size", "goal", "words"),
    [
        (
            (-0.75, -0.05, -0.05),
            0.1,
            "[-0.8, 0.2, 0.0]",
            (
                r"contact: link 3 is .* too near to 'part' at .*; joint 4 is 50.0 mm inside 'part', "
                r"at \(-0.700, 0.000, 0.000\) m"
            ),
        ),
        ((-1.5, -0.5, -0.5), 1.0, "[-0.8, 0.2, 0.0]", r"base at \(-1, 0, 0\) m is 0.5 m inside 'part'"),
        (
            (-0.9, 0.1, -0.1),
            0.2,
            "[-0.8, 0.17, 0.0]",
            r"the goal is 70.0 mm inside 'part', at \(-0.800, 0.170, 0.000\) m",
        ),
        ((-0.9, 0.1, -0.1), 0.2, "[-0.8, 0.095, 0]", r"5.0 mm too near to 'part' at \(-0.800, 0.100, 0.000\) m"),
        ((-0.9, 0.1, -0.1), 0.2, "[-2.1, 0.0, 0]", r"the goal is 100.0 mm outside workspace.bounds"),
    ],
)
def test_ends_without_room(
    tmp_path: Path, corner: tuple[float, float, float], size: float, goal: str, words: str
) -> None:
    """What an end touches, where, and by how much it is too near or too deep is told before anything is planned."""
    with pytest.raises((ProblemError, UnreachableGoal), match=words):
        MotionPlanner().plan(placed(tmp_path, corner, size, goal))


def test_one_place_inside_tells_of_all(tmp_path: Path) -> None:
    """The deepest of several places is found, and none where all are free."""
    workspace = placed(tmp_path, (0.0, 0.0, 0.0), 1.0).workspace
    places = np.array([[0.9, 0.5, 0.5], [0.5, 0.5, 0.7], [1.5, 0.5, 0.5]])
    found = deepest_enclosure(workspace, places)
    assert found is not None
    assert (found.name, found.number, found.depth) == ("part", 1, pytest.approx(0.3))
    assert deepest_enclosure(workspace, places[2:]) is None


ON_A_TABLE = """\
schema = 1
space = 3
name = "on-a-table"

[workspace]
bounds = [[-0.5, -1, -0.5], [1.5, 1, 1.5]]

[[workspace.obstacles]]
name = "table"
box = [[0.3, -0.5, -0.1], [1.2, 0.5, {top!r}]]

[arm]
links = 16
link_length = 0.0625
radius = 0.02
base = {{ position = [0, 0, 0], direction = [1, 0, 0], up = [0, 0, 1] }}
joint_limit_deg = 60

[limits]
velocity = 1.0
acceleration = 5.0

[start]
shape = "straight"

[goal]
{goal}
"""
LIFTED = "position = [0.65, 0.4, 0.35]"


def on_a_table(folder: Path, gap: float, goal: str = LIFTED) -> Problem:
    """A straight arm so far above a table [m]."""
    file = folder / "on-a-table.toml"
    file.write_text(ON_A_TABLE.format(top=-0.02 - gap, goal=goal))
    problem = ccm_opt.load_problem(file)
    assert problem.dimension == 3
    return problem


@pytest.mark.drawn(1)
@pytest.mark.parametrize("gap", [1e-3, 5e-5, 5e-6])
def test_an_arm_is_lifted_off_what_it_nearly_lies_on(tmp_path: Path, gap: float) -> None:
    """What is proved to be spared gives way to the little room of a start, and the plan is verified."""
    solution = ccm_opt.solve(on_a_table(tmp_path, gap))
    assert solution.room is not None
    assert solution.room.nearest.gap == pytest.approx(gap, abs=1e-8)


@pytest.mark.parametrize("gap", [2e-7, 0.0])
def test_an_end_without_room_to_leave_it_is_refused(tmp_path: Path, gap: float) -> None:
    """A start, or a goal of the whole arm, that leaves nothing to prove is told with link and obstacle."""
    with pytest.raises(
        ProblemError, match=r"the start has too little clearance .*: link 5 is .* too near to 'table' at"
    ):
        MotionPlanner().plan(on_a_table(tmp_path, gap))
    laid = "joints_deg = [" + ", ".join(["[0, 0]"] * 16) + "]"
    lifted = on_a_table(tmp_path, gap, laid)
    bent = np.zeros((16, 2))
    bent[0, 1] = -0.3
    lifted = replace(lifted, start=JointPose(bent))
    with pytest.raises(
        UnreachableGoal, match=r"the goal pose has too little clearance .*: link 5 is .* too near to 'table' at"
    ):
        MotionPlanner().plan(lifted)
