"""Goals of looking at a place: free lines of sight, views, plans, messages, and problem files."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, Finding, NoPlanFound, ProblemError, ProblemFileError, UnreachableGoal
from ccm_opt.core.polyline import vector_heading
from ccm_opt.core.progress import Stages
from ccm_opt.driver.sight_lines import hidden_by_arm
from ccm_opt.driver.views import SampledViews, ViewPlanner
from ccm_opt.problem import LookAt, Obstacle, PlaneShape, Problem, Tolerances
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.verification.sight import SIGHT_HALF_ANGLE, free_half_angle
from ccm_opt.verification.tool_chain import motion_of
from ccm_opt.verification.verifier import verify
from ccm_opt.verification.wall_clearance import CheckedSurfaces

PLANE = """
schema = 1
name = "look"
[workspace]
bounds = [-0.2, -0.6, 1.0, 0.6]
[[workspace.obstacles]]
name = "rib"
box = [0.45, 0.1, 0.5, 0.6]
[arm]
links = 8
link_length = 0.1
radius = 0.02
base = [0, 0]
joint_limit_deg = 60.0
[planner]
optimiser = "none"
wanted_gap = 0.0
[limits]
velocity = 1.0
acceleration = 4.0
[start]
shape = "straight"
[[goal]]
look_at = [0.45, 0.3]
distance = [0.1, 0.3]
normal = [-1, 0]
angle_deg = 60
field_of_view_deg = 40
pause = 0.2
[[goal]]
look_at = [0.7, -0.6]
distance = [0.2, 0.4]
field_of_view_deg = 30
"""
SPACE = """
schema = 1
space = 3
name = "spot"
[[workspace.obstacles]]
name = "plate"
box = [[0.5, -0.3, -0.3], [0.52, 0.3, 0.3]]
[arm]
links = 10
link_length = 0.08
radius = 0.01
base = { position = [0, 0, 0], direction = [1, 0, 0] }
joint_limit_deg = 45.0
[planner]
optimiser = "none"
wanted_gap = 0.0
[limits]
velocity = 1.0
acceleration = 4.0
[start]
joints_deg = [[45, 0], [45, 0], [0, 0], [0, 0], [0, 0], [0, 0], [0, 0], [0, 0], [0, 0], [0, 0]]
[goal]
look_at = [0.5, 0.1, 0.05]
distance = [0.08, 0.2]
normal = [-1, 0, 0]
angle_deg = 40
field_of_view_deg = 60
"""


def _loaded(text: str, folder: Path) -> Problem:
    file = folder / "problem.toml"
    file.write_text(text, encoding="utf-8")
    return ccm_opt.load_problem(file)


def _triangles(rng: np.random.Generator) -> FloatArray:
    """Return triangles of various sizes about the unit cube, shape (m, 3, 3)."""
    middles = rng.uniform(-1.0, 1.0, (30, 1, 3))
    return np.asarray(middles + rng.uniform(0.02, 0.5, (30, 1, 1)) * rng.normal(size=(30, 3, 3)))


def _surfaces(triangles: FloatArray) -> CheckedSurfaces:
    count = len(triangles)
    return CheckedSurfaces._over(triangles, np.zeros(count), np.arange(count), tuple(map(str, range(count))))


def _looking(tip: FloatArray, place: FloatArray) -> Any:
    """Return a motion at rest of a thin straight arm whose tip looks at a place; nothing of it is near the sight."""
    along = (place - tip) / np.linalg.norm(place - tip)
    arm = replace(Arm.snake(length=8.0, links=2, radius=1e-4), base=tip - 8.0 * along)
    if len(tip) == 2:
        arm = replace(arm, base_heading=vector_heading(along))
    else:
        arm = replace(arm, direction=along, up=np.linalg.svd(along[None])[2][1])
    return motion_of(arm, np.array([0.0, 1.0]), np.zeros((2, 2 * (len(tip) - 1))))


@given(seed=st.integers(0, 100_000))
def test_free_cones_of_sight_are_those_of_a_ray_caster(seed: int) -> None:
    """No ray within a cone that the verifier calls free meets a triangle, and the cone is as wide as distances allow.

    Between samples of the line, distances change by at most the way along it; pieces cost up to a tenth.
    """
    rng = np.random.default_rng(seed)
    triangles = _triangles(rng)
    tip, place = rng.uniform(-1.2, 1.2, (2, 3))
    sight = tip - place
    away = float(np.linalg.norm(sight))
    free, _ = free_half_angle(_surfaces(triangles), _looking(tip, place), 1, place)
    if free > 0.0:
        across = np.linalg.svd(sight[None])[2][1:]
        turns = rng.uniform(0.0, 2.0 * np.pi, 60)
        aside = np.tan(free) * away * np.sqrt(rng.uniform(size=60))
        rays = sight + aside[:, None] * (np.cos(turns)[:, None] * across[0] + np.sin(turns)[:, None] * across[1])
        assert not np.any(_shares_hit(place, rays, triangles) > 0.01 + 1e-9)
    if np.any(_shares_hit(place, sight[None], triangles) > 1e-4 + 1e-9):
        assert free == 0.0
    elif free < 0.999 * 10.0 * SIGHT_HALF_ANGLE:
        shares = np.geomspace(0.01, 1.0, 400)
        points = place + shares[:, None] * sight
        nearest = trimesh.triangles.closest_point(
            np.repeat(triangles, 400, axis=0), np.tile(points, (len(triangles), 1))
        )
        distances = np.linalg.norm(nearest.reshape(-1, 400, 3) - points, axis=2).min(axis=0)
        steps = shares[1] / shares[0] - 1.0
        assert 1.1 * np.tan(free) >= (np.min(distances / (shares * away)) - steps) / (1.0 + steps) - 1e-6


def _shares_hit(place: FloatArray, rays: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return where rays of given lengths from a place meet triangles, as fractions of their lengths below 1."""
    edges = triangles[:, 1:] - triangles[:, :1]
    systems = np.stack(np.broadcast_arrays(rays[:, None], -edges[:, 0], -edges[:, 1]), axis=-1)
    share, one, other = np.moveaxis(
        np.linalg.solve(systems, (triangles[:, 0] - place)[None, :, :, None])[..., 0], -1, 0
    )
    return np.asarray(share[(one >= 0.0) & (other >= 0.0) & (one + other <= 1.0) & (share < 1.0 - 1e-9)])


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 100_000), dimension=st.sampled_from([2, 3]))
def test_from_all_of_a_view_the_place_is_seen(seed: int, dimension: int) -> None:
    """Every tip and direction within the tolerances of a view keeps all conditions, as the verifier sees them."""
    rng = np.random.default_rng(seed)
    problem = _scene(rng, dimension)
    normal = rng.normal(size=dimension)
    normal /= np.linalg.norm(normal)
    look_at = LookAt(
        0.3 * rng.normal(size=dimension),
        (0.1, float(rng.uniform(0.15, 0.4))),
        float(rng.uniform(0.1, 2.9)),
        normal if rng.uniform() < 0.5 else None,
        float(rng.uniform(0.2, 1.5)),
    )
    surfaces = CheckedSurfaces.from_workspace(problem.workspace)
    for view in SampledViews.of(problem, look_at).chosen(problem.start):
        offset = rng.normal(size=dimension)
        tip = view.goal.position + view.tolerances.position * offset / np.linalg.norm(offset)
        sight = look_at.place - tip
        away = float(np.linalg.norm(sight))
        assert look_at.distance[0] <= away <= look_at.distance[1]
        if look_at.normal is not None:
            assert np.arccos(-sight @ look_at.normal / away) <= look_at.angle
        assert view.goal.direction is not None
        off = np.arccos(np.clip(sight @ view.goal.direction / away, -1.0, 1.0))
        assert off + view.tolerances.heading <= 0.5 * look_at.field_of_view
        assert free_half_angle(surfaces, _looking(tip, look_at.place), 1, look_at.place)[0] >= SIGHT_HALF_ANGLE


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_place_behind_a_thin_sheet_is_hidden(dimension: int) -> None:
    """Neither planner nor verifier looks through a sheet of 2 mm whose other side is looked at, but at this side."""
    low, high = np.full(dimension, -0.9), np.full(dimension, 0.9)
    low[0], high[0] = 0.55, 0.552
    problem = _scene(np.random.default_rng(0), dimension, np.stack((low, high))[None])
    surfaces = CheckedSurfaces.from_workspace(problem.workspace)
    tip = np.array([0.05, 0.0, 0.0][:dimension])
    for x, seen in ((0.55, True), (0.552, False)):
        place = np.array([x, 0.02, 0.01][:dimension])
        assert np.any(SampledViews.of(problem, LookAt(place, (0.4, 0.55), 1.0)).seeing) == seen
        assert (free_half_angle(surfaces, _looking(tip, place), 1, place)[0] >= SIGHT_HALF_ANGLE) == seen


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_scanned_surface_is_seen_but_past_what_was_scanned_before_it(dimension: int) -> None:
    """The balls about a place on a scanned wall do not hide it; one of the same scan on the line of sight does."""
    place, tip = np.array([0.55, 0.02, 0.01][:dimension]), np.array([0.2, 0.0, 0.0][:dimension])
    grid = np.stack(np.meshgrid(*[np.arange(-0.5, 0.5, 0.02)] * (dimension - 1)), axis=-1).reshape(-1, dimension - 1)
    wall = np.column_stack((np.full(len(grid), 0.55), grid))
    bare = _scene(np.random.default_rng(0), dimension, np.zeros((0, 2, dimension)))
    for before, seen in ((0.5, False), (0.95, False), (0.0, True)):
        points = np.vstack((wall, place + before * (tip - place)))
        scan = (
            PlaneShape(shapely.MultiPoint(points), 0.015)
            if dimension == 2
            else MeshBody.of_points(points, radius=0.015)
        )
        problem = replace(bare, workspace=replace(bare.workspace, obstacles=(Obstacle("scan", scan),)))
        errors = problem.workspace.surface_errors
        surfaces = CheckedSurfaces.from_workspace(problem.workspace)
        looking = _looking(tip, place)
        assert (free_half_angle(surfaces, looking, 1, place, errors)[0] >= SIGHT_HALF_ANGLE) == seen
        assert free_half_angle(surfaces, looking, 1, place)[0] == 0.0
    look_at = LookAt(place, (0.3, 0.4), 1.0, np.eye(dimension)[0] * -1.0, 0.8)
    views = list(SampledViews.of(problem, look_at).chosen(problem.start))
    assert views
    for view in views:
        assert free_half_angle(surfaces, _looking(view.goal.position, place), 1, place, errors)[0] >= SIGHT_HALF_ANGLE


def _scene(rng: np.random.Generator, dimension: int, boxes: FloatArray | None = None) -> Problem:
    """Return a problem with a few random boxes, or given ones."""
    arm: dict[str, Any] = {"links": 10, "link_length": 0.06, "radius": 0.005, "joint_limit_deg": 60.0}
    arm["base"] = [0.0, 0.0] if dimension == 2 else {"position": [0.0, 0.0, 0.0]}
    if boxes is None:
        low = rng.uniform(-0.5, 0.4, (6, dimension))
        boxes = np.stack((low, low + rng.uniform(0.02, 0.2, low.shape)), axis=1)
        boxes = boxes[np.linalg.norm(np.clip(0.0, boxes[:, 0], boxes[:, 1]), axis=1) > 0.1]
    return ccm_opt.make_problem(
        "scene",
        arm=arm,
        room=[-1.0, -1.0, 1.0, 1.0] if dimension == 2 else [[-1.0] * 3, [1.0] * 3],
        obstacles=[shapely.box(*box.ravel()) if dimension == 2 else {"box": box.tolist()} for box in boxes],
        limits={"velocity": 1.0, "acceleration": 1.0},
        goal=[0.3, 0.1, 0.1][:dimension],
    )


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the folder of a plan of two views in the plane, made by the command line."""
    folder = tmp_path_factory.mktemp("views")
    (folder / "look.toml").write_text(PLANE, encoding="utf-8")
    done = CliRunner().invoke(app, ["solve", str(folder / "look.toml"), "--out", str(folder / "runs"), "--no-pictures"])
    assert done.exit_code == 0, done.output
    return ccm_opt.load(folder / "runs" / "look")


def _failed(problem: Problem, plan: Any) -> set[str]:
    checks = verify(problem, plan.trajectory, plan.joints)
    return {check.name for check in checks if not check.passed}


@pytest.mark.drawn(20, of="dear tests")
def test_a_plan_of_views_is_rejected_where_it_breaks_a_condition_of_a_view(plan: Any) -> None:
    """The verifier finds each single condition broken, of a stop and of the goal, and the line of sight of both."""
    problem = plan.problem
    assert problem.goal.look_at == plan.problem.goals[-1].goal.look_at
    assert not _failed(problem, plan)
    first, last = problem.stops[0].goal.look_at, problem.goal.look_at

    def changed(**values: Any) -> Problem:
        look_at = replace(first, **values)
        stop = replace(problem.stops[0], goal=ccm_opt.TipGoal.looking(look_at), tolerances=look_at.tolerances)
        return replace(problem, stops=(stop,))

    points = problem.arm.joint_positions_at(plan.trajectory.positions)
    tip = points[plan.trajectory.stops[0]][-1]
    away = float(np.linalg.norm(tip - first.place))
    assert _failed(changed(distance=(1.1 * away, 2.0)), plan) == {"stop 1 least distance"}
    assert _failed(changed(distance=(0.01, 0.9 * away)), plan) == {"stop 1 greatest distance"}
    beside = np.array([[0.7, -0.7], [0.7, 0.7]]) @ (first.place - tip)
    assert "stop 1 field of view" in _failed(changed(place=tip + beside), plan)
    assert _failed(changed(normal=np.array([1.0, 0.0])), plan) == {"stop 1 normal"}
    for number, look_at in ((plan.trajectory.stops[0], first), (-1, last)):
        middle = 0.5 * (look_at.place + points[number][-1])
        name = "stop 1 line of sight" if look_at is first else "goal line of sight"
        post = Obstacle("post", PlaneShape(shapely.Point(middle).buffer(1e-3)))
        workspace = replace(problem.workspace, obstacles=(*problem.workspace.obstacles, post))
        assert name in _failed(replace(problem, workspace=workspace), plan)


def test_an_arm_may_hide_what_it_looks_at() -> None:
    """An arm bent to a ring hides what is beyond its own links, for planner and verifier, and not what is beside."""
    arm = replace(Arm.snake(length=1.0, links=10, radius=0.02), base=np.zeros(2))
    q = np.full(10, np.deg2rad(34.0))
    points = arm.joint_positions_at(q)
    centre = points.mean(axis=0)
    beyond = centre + 2.0 * (centre - points[-1])
    motion = motion_of(arm, np.array([0.0, 1.0]), np.stack((q, q)))
    assert np.array_equal(hidden_by_arm(arm, q, np.stack((beyond, centre))), [True, False])
    assert free_half_angle(None, motion, 1, beyond)[0] == 0.0
    assert free_half_angle(None, motion, 1, centre)[0] > SIGHT_HALF_ANGLE


@pytest.mark.drawn(20, of="dear tests")
def test_a_spot_in_space_is_looked_at(tmp_path: Path) -> None:
    """A plan in space to a view passes all checks, and its problem is the same after it is written and read."""
    problem = _loaded(SPACE, tmp_path)
    solution = ccm_opt.solve(problem)
    names = {check.name for check in solution.checks if check.name.startswith("goal ")}
    ends = ("least distance", "greatest distance", "field of view", "normal", "line of sight")
    assert names == {f"goal {end}" for end in ends}
    ccm_opt.save(solution, tmp_path / "spot")
    again, look_at = ccm_opt.load(tmp_path / "spot").problem.goal.look_at, problem.goal.look_at
    assert look_at is not None
    np.testing.assert_allclose(again.normal, look_at.normal)
    np.testing.assert_allclose(np.append(again.place, again.distance), np.append(look_at.place, look_at.distance))
    np.testing.assert_allclose((again.angle, again.field_of_view), (look_at.angle, look_at.field_of_view))


def test_what_is_proved_of_one_view_is_not_proved_of_the_place(tmp_path: Path) -> None:
    """Where planning to each view fails, with a proof, no proof is claimed, since other views were not sampled."""

    class Refusing:
        def plan(self, problem: Problem) -> JointPath:
            assert problem.goal.look_at is None
            reason = "the view is too far"
            raise UnreachableGoal(Diagnosis(reason, "motion", findings=(Finding("too short", reason),)))

    with pytest.raises(NoPlanFound, match=r"of \d+ views") as failure:
        ViewPlanner(Refusing(), Stages()).plan(_loaded(SPACE, tmp_path))
    assert not failure.value.diagnosis.proved
    assert failure.value.diagnosis.findings


def test_views_are_sampled_once_and_ranked_from_each_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two legs to a place share its views; each tries first one for which the line of sight turns less from its own."""
    problem = _loaded(SPACE, tmp_path)
    counts: list[LookAt] = []
    sampled = SampledViews.of

    def counted(problem: Problem, look_at: LookAt) -> SampledViews:
        counts.append(look_at)
        return sampled(problem, look_at)

    monkeypatch.setattr(SampledViews, "of", counted)
    first: list[Any] = []

    class Refusing:
        def plan(self, problem: Problem) -> JointPath:
            assert problem.goal.for_tip is not None
            first.append(problem.goal.for_tip.direction)
            raise UnreachableGoal(Diagnosis("refused", "motion"))

    planner = ViewPlanner(Refusing(), Stages())
    for bend in (-0.15, 0.15):
        start = replace(problem.start, bends=np.full((10, 2), bend))
        with pytest.raises(NoPlanFound, match="refused"):
            planner.plan(replace(problem, start=start))
    assert counts == [problem.goal.look_at]
    half = len(first) // 2
    assert not np.array_equal(first[:half], first[half:])
    # The best views of both starts, exchanged, turn no less in all.
    ahead = [np.diff(problem.arm.joint_positions_at(np.full(20, bend))[-2:], axis=0)[0] for bend in (-0.15, 0.15)]
    turns = np.arccos(np.array([first[0], first[half]]) @ np.transpose(ahead) / problem.arm.link_length)
    assert np.trace(turns) <= np.trace(turns[::-1]) + 1e-9


@pytest.mark.planning
@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("look_at", "[0.51, 0.1, 0.05]", "10.0 mm inside 'plate'"),
        ("look_at", "[0.5, 1.9, 0.05]", "out of reach"),
        ("normal", "[1, 0, 0]", "hidden by 'plate'"),
        ("normal", "[1, 0, 0]", "reverse goal.normal"),
        ("distance", "[0.002, 0.009]", "goal.distance, 9.0 mm, is less than the tip's radius"),
    ],
)
def test_what_prevents_a_view_is_named(tmp_path: Path, key: str, value: str, words: str) -> None:
    """A place that is not seen is refused with the obstacle and by how much, or what is out of reach."""
    lines = [f"{key} = {value}" if line.startswith(f"{key} =") else line for line in SPACE.splitlines()]
    with pytest.raises(NoPlanFound, match=r"goal\.look_at: ") as failure:
        ccm_opt.solve(_loaded("\n".join(lines), tmp_path), explain=False)
    found = failure.value.diagnosis
    assert any(words in line for line in (found.reason, *found.advice)), found


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("distance = [0.08, 0.2]", "", "only allowed together with distance"),
        ("field_of_view_deg = 60", "", "only allowed together with field_of_view_deg"),
        ("look_at = [0.5, 0.1, 0.05]", "position = [0.5, 0.1, 0.05]", "only allowed together with look_at"),
        ("normal = [-1, 0, 0]", "", "only allowed together with normal"),
        ("[0.08, 0.2]", "[0.2, 0.08]", "expected the least value below the greatest"),
        ("angle_deg = 40", "angle_deg = 100", "angle_deg"),
        ("angle_deg = 40", "position_tolerance = 0.1", "only allowed together with position"),
        ("angle_deg = 40", "direction = [1, 0, 0]", "only allowed together with position"),
    ],
)
def test_keys_of_views_that_do_not_go_together_are_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    """A key about a view is refused where another one is missing or takes its effect."""
    with pytest.raises(ProblemFileError, match=words):
        _loaded(SPACE.replace(old, new), tmp_path)


def test_views_made_in_python_are_checked(tmp_path: Path) -> None:
    """A goal whose tolerances are not those of its view, or with impossible values, is refused."""
    problem = _loaded(SPACE, tmp_path)
    with pytest.raises(ProblemError, match="tolerances must be those"):
        replace(problem, tolerances=Tolerances())
    look_at = problem.goal.look_at
    assert look_at is not None
    for changes in ({"distance": (0.2, 0.1)}, {"field_of_view": 3.1}, {"angle": 2.0}, {"normal": np.ones(3)}):
        wrong = replace(look_at, **changes)  # type: ignore[arg-type]  # wrong on purpose
        with pytest.raises(ProblemError):
            replace(problem, goal=ccm_opt.TipGoal.looking(wrong), tolerances=wrong.tolerances)
