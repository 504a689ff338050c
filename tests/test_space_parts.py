"""Problems in space made in Python: checked as files are, with bodies that stay what they are."""

from typing import Any

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.scene.bodies import BOX_FACES, MeshBody, SphereBody
from tests.space_files import CUBE

ARM = {"links": 4, "link_length": 0.1, "radius": 0.01, "base": {"position": (0, 0, 0)}, "joint_limit_deg": 45}
LIMITS = {"velocity": 1.0, "acceleration": 4.0}


def made(**changes: Any) -> Problem:
    """A small problem with whatever a test wants otherwise."""
    values: dict[str, Any] = {"arm": ARM, "limits": LIMITS, "goal": (0.3, 0.1, 0.0)}
    return ccm_opt.make_problem("made", **(values | changes))


def test_tables_and_bodies() -> None:
    """Tables are read as those of a file in the unit of the call, and bodies stay themselves."""
    mesh = MeshBody.of_arrays(CUBE + 1.0, BOX_FACES)
    problem = made(
        unit="mm",
        arm=ARM | {"link_length": 100, "radius": 10},
        goal=np.array([300.0, 100.0, 0.0]),
        room=np.array([[-500, -500, -500], [3000, 3000, 3000]]),
        obstacles={"cube": mesh, "ball": {"sphere": {"center": (0, 0, 400), "radius": 50}}},
        planner={"time_limit": 5},
    )
    ball, cube = problem.workspace.obstacles
    assert (ball.name, cube.name, cube.body is mesh, mesh.closed) == ("ball", "cube", True, True)
    assert isinstance(ball.body, SphereBody)
    assert ball.body.radius == pytest.approx(0.05)
    assert isinstance(problem.goal, TipGoal)
    assert np.allclose(problem.goal.position, [0.3, 0.1, 0.0])
    assert problem.arm.length == pytest.approx(0.4)
    assert problem.planner.time_limit == 5.0
    assert len(made(goal=[{"position": (0.3, 0, 0)}, {"position": (0.2, 0.1, 0)}]).stops) == 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"arm": ARM | {"links": 3}}, r"arm\.links: .*even"),
        ({"goal": (1, 2)}, r"goal\.position"),
        ({"obstacles": {"a": {"box": [[0, 0, 0], [1, 1, 1]], "sphere": {}}}}, "exactly one of mesh, points, box"),
        ({"obstacles": {"a": {"mesh": "part.stl"}}}, "was not read from a file"),
        ({"obstacles": {"a": 3}}, "'a' is neither a solid nor a table"),
        ({"unit": "cm"}, "one of m, mm, in"),
    ],
)
def test_what_is_wrong_is_told(changes: dict[str, Any], words: str) -> None:
    """Defects of parts are told as those of a file."""
    with pytest.raises((ProblemFileError, ProblemError), match=words):
        made(**changes)


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (CUBE[:, :2], BOX_FACES, "rows \\(x, y, z\\)"),
        (CUBE, [[0, 1]], "three whole numbers"),
        (CUBE, [[0.5, 1.0, 2.0]], "three whole numbers"),
        (CUBE, [[0, 1, 8]], "a vertex is not there"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], "rows \\(x, y, z\\)"),
    ],
)
def test_arrays_that_are_no_mesh(vertices: object, faces: object, words: str) -> None:
    """A mesh from arrays has finite places and triangles of them."""
    with pytest.raises(ProblemError, match=words):
        MeshBody.of_arrays(vertices, faces)


def test_an_arm_that_is_an_object_says_that_it_leaves_the_plane() -> None:
    """Arm, limits and goal that are objects make the problem that their tables make, and stay themselves."""
    tables = made()
    objects = made(arm=tables.arm, limits=tables.limits, goal=tables.goal)
    assert objects.dimension == 3
    assert objects.arm is tables.arm
    assert objects.goal is tables.goal
    np.testing.assert_array_equal(objects.start.bends, tables.start.bends)
