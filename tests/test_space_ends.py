"""Starts and goals inside of bodies or in contact are told with the obstacle's name, the place and the depth."""

from pathlib import Path

import numpy as np
import pytest

import ccm_opt
from ccm_opt.errors import ProblemError, UnreachableGoal
from ccm_opt.space.planner import SpacePlanner
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.enclosures import deepest_enclosure
from tests.space_files import CUBE, binary_stl, written


def placed(
    folder: Path, corner: tuple[float, float, float], size: float, goal: str = "[-0.7, 0.1, 0.0]"
) -> SpaceProblem:
    """The small problem with a cube in place of its part."""
    file = written(folder, binary_stl(np.array(corner) + size * CUBE))
    file.write_text(file.read_text().replace("[-0.7, 0.1, 0.0]", goal))
    problem = ccm_opt.load_problem(file)
    assert isinstance(problem, SpaceProblem)
    return problem


@pytest.mark.parametrize(
    ("corner", "size", "goal", "words"),
    [
        (
            (-0.75, -0.05, -0.05),
            0.1,
            "[-0.8, 0.2, 0.0]",
            (
                r"contact: link 3 and 'part' at .* too near; joint 4 is 50.0 mm deep inside of 'part', "
                r"at \(-0.700, 0.000, 0.000\) m"
            ),
        ),
        ((-1.5, -0.5, -0.5), 1.0, "[-0.8, 0.2, 0.0]", r"base at \(-1, 0, 0\) m is 0.5 m inside 'part'"),
        (
            (-0.9, 0.1, -0.1),
            0.2,
            "[-0.8, 0.17, 0.0]",
            r"the goal is 70.0 mm deep inside of 'part', at \(-0.800, 0.170, 0.000\) m",
        ),
        ((-0.9, 0.1, -0.1), 0.2, "[-0.8, 0.095, 0]", r"5.0 mm too near to 'part' at \(-0.800, 0.100, 0.000\) m"),
        ((-0.9, 0.1, -0.1), 0.2, "[-2.1, 0.0, 0]", r"the goal is 100.0 mm outside of the room"),
    ],
)
def test_ends_without_room(
    tmp_path: Path, corner: tuple[float, float, float], size: float, goal: str, words: str
) -> None:
    """What an end touches, where, and by how much it is too near or too deep is told before anything is planned."""
    with pytest.raises((ProblemError, UnreachableGoal), match=words):
        SpacePlanner().plan(placed(tmp_path, corner, size, goal))


def test_one_place_inside_tells_of_all(tmp_path: Path) -> None:
    """The deepest of several places is found, and none where all are free."""
    workspace = placed(tmp_path, (0.0, 0.0, 0.0), 1.0).workspace
    places = np.array([[0.9, 0.5, 0.5], [0.5, 0.5, 0.7], [1.5, 0.5, 0.5]])
    found = deepest_enclosure(workspace, places)
    assert found is not None
    assert (found.name, found.number, found.depth) == ("part", 1, pytest.approx(0.3))
    assert deepest_enclosure(workspace, places[2:]) is None
