"""Problem files in space: what is read, and what is refused, all defects at once with key and line."""

from pathlib import Path

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.scene.bodies import BoxBody, CapsuleBody, CylinderBody, MeshBody, SphereBody
from tests.space_files import CUBE, TEXT, binary_stl, written

FOLDER = Path(__file__).parent.parent / "problems" / "space"
PLAIN = TEXT.replace('mesh = "part.stl"', "sphere = { center = [0, 0, 0], radius = 0.1 }")


def read(text: str) -> Problem:
    """A problem in space from its text."""
    problem = parse_problem(text)
    assert problem.dimension == 3
    return problem


def refusals(text: str) -> list[tuple[int, str, str]]:
    """Line, key and message of every defect of a text."""
    with pytest.raises(ProblemFileError) as refused:
        parse_problem(text)
    return [(issue.line, issue.key, issue.message) for issue in refused.value.issues]


@pytest.mark.parametrize(
    ("name", "obstacles"),
    [("elbow", 9), ("wing-box", 11), ("blade-row", 4), ("borescope", 4), ("swan-neck-in-space", 2)],
)
def test_shipped_problems_are_read(name: str, obstacles: int) -> None:
    """The problems in space that come along are read, with their meshes hashed."""
    problem = ccm_opt.load_problem(FOLDER / f"{name}.toml")
    assert problem.dimension == 3
    assert (problem.name, len(problem.workspace.obstacles)) == (name, obstacles)
    assert (problem.arm.feed is None) == (name == "swan-neck-in-space")
    assert isinstance(problem.goal, TipGoal)
    assert problem.goal.direction is not None
    assert np.linalg.norm(problem.goal.direction) == pytest.approx(1.0)
    for obstacle in problem.workspace.obstacles:
        if isinstance(obstacle.body, MeshBody):
            assert len(obstacle.body.digest) == 64
            assert obstacle.body.triangles_read == len(obstacle.body.faces)


def test_every_body_is_read_in_the_files_unit() -> None:
    """Boxes, spheres, cylinders and capsules come to lie where their keys and poses say, in metres."""
    text = PLAIN.replace("space = 3", 'space = 3\nunits = "mm"').replace("-2.0", "-500").replace("[-1.0", "[-300")
    text = text.replace(
        "[arm]",
        """[[workspace.obstacles]]
box = [[0, 0, 0], [10, 20, 30]]
pose = { position = [100, 0, 0], rotation_deg = [0, 0, 90] }
[[workspace.obstacles]]
cylinder = { from = [0, 0, 0], to = [0, 0, 500], radius = 20 }
pose = { quaternion = [2, 2, 0, 0] }
[[workspace.obstacles]]
capsule = { from = [0, 0, 0], to = [0, 0, 500], radius = 20 }
[arm]""",
    )
    ball, box, cylinder, capsule = (obstacle.body for obstacle in read(text).workspace.obstacles)
    assert isinstance(ball, SphereBody)
    assert isinstance(box, BoxBody)
    assert isinstance(cylinder, CylinderBody)
    assert isinstance(capsule, CapsuleBody)
    assert ball.radius == pytest.approx(1e-4)
    assert np.allclose(box.corners.min(axis=0), [0.08, 0.0, 0.0])
    assert np.allclose(box.corners.max(axis=0), [0.1, 0.01, 0.03])
    assert np.allclose(cylinder.end, [0.0, -0.5, 0.0])
    assert np.allclose(capsule.end, [0.0, 0.0, 0.5])
    assert cylinder.radius == capsule.radius == pytest.approx(0.02)


def test_a_start_by_joints_and_the_base_across() -> None:
    """A pose has two bends a joint, and up is what lies across the direction."""
    text = PLAIN.replace('shape = "straight"', "joints_deg = [[10, 20], [0, 0], [-45, 45], [0, 1]]")
    problem = read(text.replace("up = [0.0, 0.0, 1.0]", "up = [3.0, 0.0, 4.0]"))
    assert isinstance(problem.start, JointPose)
    assert np.allclose(np.rad2deg(problem.start.bends), [[10, 20], [0, 0], [-45, 45], [0, 1]])
    assert np.allclose(problem.arm.up, [0.0, 0.0, 1.0])
    q = problem.start.configuration(problem.arm)
    assert np.array_equal(JointPose.from_configuration(q, problem.arm.coordinates).bends, problem.start.bends)


def test_all_defects_at_once() -> None:
    """Whatever is wrong anywhere in the file is told in one go, under its key and with its line."""
    text = (
        PLAIN.replace("radius = 0.1 }", "radius = -0.1 }")
        .replace("up = [0.0, 0.0, 1.0]", "up = [2.0, 0.0, 0.0]")
        .replace('shape = "straight"', "joints_deg = [[0, 90], [0, 0], [0, 50]]")
        .replace("velocity = 1.0", "velocty = 1.0")
        .replace("position = [-0.7, 0.1, 0.0]", "position = [1, 2]\nvia = [[0, 0]]\ndirection = [0, 0, 0]")
        .replace("[arm]", "[[workspace.obstacles]]\nname = 'part'\nscale = 2.0\nbox = [[0, 0, 0], [1, 1, 0]]\n[arm]")
    )
    found = {key: line for line, key, _ in refusals(text)}
    expected = {
        "workspace.obstacles[0].sphere.radius": "radius = -0.1",
        "workspace.obstacles[1].name": "name = 'part'",
        "workspace.obstacles[1].scale": "scale = 2.0",
        "workspace.obstacles[1].box": "box = ",
        "arm.base.up": "up = ",
        "limits.velocty": "velocty",
        "start.joints_deg": "joints_deg",
        "start.joints_deg[2][1]": "joints_deg",
        "goal.position": "position = [1, 2]",
        "goal.via[0]": "via",
        "goal.direction": "direction = [0, 0, 0]",
    }
    lines = text.splitlines()
    assert found.keys() == expected.keys()
    for key, part in expected.items():
        assert part in lines[found[key] - 1], key


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("space = 3", "space = 4", "space", "2 or 3"),
        (
            'name = "part"',
            'name = "part"\nbox = [[0, 0, 0], [1, 1, 1]]',
            "workspace.obstacles[0].sphere",
            "exactly one",
        ),
        ("links = 4", 'links = 4\naxes = "zyz"', "arm.axes", "zyx"),
        ("position = [-1.0", "position = [0.0", "arm.base", "0.1 m inside 'part'"),
        ("position = [-1.0", "position = [-3.0", "arm.base", "at (-3, 0, 0) m is 1 m outside the room"),
        ("[start]", '[planner]\nmethod = "hill-climbing"\n[start]', "planner.method", "plane only"),
        ('shape = "straight"', 'shape = "folded"', "start.shape", "straight"),
        ("[-0.7, 0.1, 0.0]", "[-0.7, 0.1, 0.0]\nheading_deg = 3", "goal.heading_deg", "unknown key"),
        ("[limits]", "feed = { range = [0, 1] }\n[limits]", "limits.feed_velocity", "missing"),
    ],
)
def test_one_defect(old: str, new: str, key: str, words: str) -> None:
    """A defect is told under its key, in words that say what is expected."""
    told = {found: message for _, found, message in refusals(PLAIN.replace(old, new, 1))}
    assert words in told[key]


def test_a_mesh_is_scaled_turned_and_moved(tmp_path: Path) -> None:
    """The vertices of a mesh come to lie where scale, unit and pose say, in this order."""
    extra = "scale = 2.0\npose = { position = [100, 200, 300], rotation_deg = [90, 0, 0] }"
    file = written(tmp_path, binary_stl(), extra=extra)
    in_mm = file.read_text().replace("space = 3", 'space = 3\nunits = "mm"')
    file.write_text(in_mm.replace("2.0, ", "2e3, ").replace("2.0]", "2e3]"))
    problem = ccm_opt.load_problem(file)
    assert problem.dimension == 3
    body = problem.workspace.obstacles[0].body
    assert isinstance(body, MeshBody)
    x, y, z = 2e-3 * CUBE.T
    expected = np.column_stack((x, -z, y)) + np.array([0.1, 0.2, 0.3])
    assert np.allclose(_sorted(body.vertices), _sorted(expected), atol=1e-9)
    assert body.closed


def test_a_mesh_is_known_by_its_hash(tmp_path: Path) -> None:
    """With its hash in the problem file a mesh is read as long as it is the same file."""
    body = ccm_opt.load_problem(written(tmp_path, binary_stl())).workspace.obstacles[0].body  # type: ignore[union-attr]
    assert isinstance(body, MeshBody)
    file = written(tmp_path, binary_stl(), extra=f'sha256 = "{body.digest}"')
    ccm_opt.load_problem(file)
    written(tmp_path, binary_stl(1.5 * CUBE), extra=f'sha256 = "{body.digest}"')
    with pytest.raises(ProblemFileError, match=r"part\.stl has the SHA-256"):
        ccm_opt.load_problem(file)


def test_a_base_inside_a_closed_mesh_is_told(tmp_path: Path) -> None:
    """A base inside a mesh is a defect of the file, told with the mesh's name, the place and the depth."""
    file = written(tmp_path, binary_stl(CUBE - np.array([1.3, 0.5, 0.5])))
    with pytest.raises(ProblemFileError, match=r"the base at \(-1, 0, 0\) m is 0\.3 m inside 'part'"):
        ccm_opt.load_problem(file)


def _sorted(points: FloatArray) -> FloatArray:
    return points[np.lexsort(np.round(points, 9).T)]
