"""Surfaces to be seen: pieces, the fewest sets, what is seen, plans, messages, and problem files."""

import json
import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.errors import NoPlanFound, ProblemError, ProblemFileError
from ccm_opt.driver.pose_finding import PoseFinder
from ccm_opt.driver.set_cover import fewest_sets
from ccm_opt.driver.view_sampling import ViewSampler
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem, problem_from_mapping
from ccm_opt.io.reading_back import load_posed
from ccm_opt.problem import Coverage, JointPose, TipGoal
from ccm_opt.scene.surface_pieces import SurfacePieces
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.verification import coverage as verified
from ccm_opt.verification.sight import free_half_angles
from ccm_opt.verification.tool_chain import motion_of
from ccm_opt.verification.verifier import verify
from ccm_opt.verification.wall_clearance import CheckedSurfaces

PLANE = """
schema = 1
name = "see"
[workspace]
bounds = [-0.2, -0.6, 1.0, 0.6]
[[workspace.obstacles]]
name = "rib"
box = [0.55, 0.0, 0.6, 0.6]
[[workspace.obstacles]]
name = "post"
circle = { center = [0.3, -0.4], radius = 0.03 }
[arm]
links = 6
link_length = 0.1
radius = 0.02
base = [0, 0]
joint_limit_deg = 80.0
[limits]
velocity = 1.0
acceleration = 4.0
[start]
joints_deg = [-20, 0, 0, 0, 0, 0]
[goal]
see = ["rib"]
within = [0.5, 0.0, 0.57, 0.55]
share = 0.8
spacing = 0.05
distance = [0.1, 0.4]
angle_deg = 60
field_of_view_deg = 70
[planner]
order = "free"
optimiser = "none"
wanted_gap = 0.0
"""
SPACE = """
schema = 1
space = 3
name = "slab"
[workspace]
bounds = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
[[workspace.obstacles]]
name = "slab"
box = [[0.2, 0.2, 0.3], [0.83, 0.71, 0.4]]
[arm]
links = 4
link_length = 0.05
radius = 0.01
base = { position = [0, 0.5, 0.5], direction = [1, 0, 0] }
joint_limit_deg = 60.0
[limits]
velocity = 1.0
acceleration = 4.0
[start]
shape = "straight"
[goal]
see = ["slab", "room"]
share = 0.5
spacing = 0.2
distance = [0.1, 0.4]
field_of_view_deg = 70
[planner]
order = "free"
"""


def problem_of(text: str, **changes: object) -> ccm_opt.Problem:
    """Return the problem of a file whose lines of some keys are replaced."""
    for key, value in changes.items():
        text, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", text)
        assert count, key
    return parse_problem(text)


@settings(max_examples=12)
@given(spacing=st.floats(0.05, 0.7), text=st.sampled_from([PLANE, SPACE]))
def test_pieces_tile_surfaces_and_are_those_of_the_verifier(spacing: float, text: str) -> None:
    """Sizes of pieces add up to those of the surfaces, no edge is too long, and planner and verifier divide alike."""
    problem = problem_of(text)
    coverage = problem.coverage
    assert coverage is not None
    pieces = SurfacePieces.of(problem.workspace, coverage.surfaces, spacing, None)
    corners, sizes, normals = verified._pieces(problem.workspace, replace(coverage, spacing=spacing, within=None))
    whole = 1.3 if problem.dimension == 2 else 6.0 + 2.0 * (0.63 * 0.51 + 0.63 * 0.1 + 0.51 * 0.1)
    assert np.isclose(np.sum(pieces.sizes), whole)
    edges = pieces.corners - np.roll(pieces.corners, 1, axis=1)
    assert np.max(np.linalg.norm(edges, axis=2)) <= spacing * (1.0 + 1e-6)
    order, other = (np.lexsort(each.round(9).T) for each in (pieces.centres, corners.mean(axis=1)))
    np.testing.assert_allclose(pieces.centres[order], corners.mean(axis=1)[other], atol=1e-9)
    np.testing.assert_allclose(np.sort(pieces.sizes), np.sort(sizes))
    np.testing.assert_allclose(np.abs(np.sum(pieces.normals[order] * normals[other], axis=1)), 1.0)


_BENT_TOOL = (
    "[arm.tool]\ntip = {tip}\ndirection = {ahead}\nbodies = [{{ circle = {{ center = {centre}, radius = 0.01 }} }}]\n"
)
_TOOL = {
    2: _BENT_TOOL.format(tip=[0.04, 0.02], ahead=[1.0, 1.0], centre=[0.02, 0.01]),
    3: _BENT_TOOL.replace("circle", "sphere").format(tip=[0.03, 0.0, 0.02], ahead=[1, 0, 1], centre=[0.02, 0.0, 0.01]),
}
_EVEN = """[[arm.sections]]
drive = "section"
length = 0.15
radius = 0.01
bend_limit_deg = 120
[[arm.sections]]
drive = "section"
length = 0.15
radius = 0.01
bend_limit_deg = 120
[limits]
"""
_ARM = re.compile(r"(?m)^(links|link_length|radius|joint_limit_deg) = .*\n")
_FEED = "feed = { range = [0.0, 0.2] }\n[limits]\nfeed_velocity = 0.1\nfeed_acceleration = 0.5\n"
_GANTRY = """axes = [
    { kind = "revolute", axis = [1, 0, 0], range_deg = [-90, 90], velocity = 1.0, acceleration = 4.0 },
    { kind = "prismatic", axis = [0, 0, 1], range = [-0.1, 0.2], velocity = 0.1, acceleration = 0.5 },
] }"""
_COUPLING = """coupling = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0], [0, 0, 0.6], [0, 0, 0], [0, 0, 0.3], [0, 0, 0]]
[limits]
"""


@pytest.mark.parametrize("tool", [False, True])
@pytest.mark.parametrize(
    ("text", "layout"),
    [(PLANE, ""), (PLANE, _FEED), (PLANE, _EVEN), (SPACE, ""), (SPACE, _FEED), (SPACE, _EVEN), (SPACE, _GANTRY),
     (SPACE, _COUPLING)],
)  # fmt: skip
def test_poses_are_those_of_the_arm_as_it_is(text: str, layout: str, tool: bool) -> None:
    """Configurations of sampled poses have their tip, direction and limits, whatever the arm is made of."""
    text = text.replace("box = [0.55, 0.0, ", "box = [0.55, 0.2, ")
    text = text.replace("position = [0, 0.5, 0.5]", "position = [0.3, 0.5, 0.6]")
    text = text.replace("joints_deg = [-20, 0, 0, 0, 0, 0]", 'shape = "straight"')
    if layout == _GANTRY:
        text = text.replace("direction = [1, 0, 0] }", f"direction = [1, 0, 0], {layout}")
    else:
        text = text.replace("[limits]\n", layout or "[limits]\n")
    if layout == _EVEN:
        head, arm, rest = re.split(r"(?m)^(?=\[arm\]|\[\[arm\.sections)", text, maxsplit=2)
        text = head + _ARM.sub("", arm) + rest
    if tool:
        text = text.replace("[limits]\n", _TOOL[3 if text.startswith(SPACE[:20]) else 2] + "[limits]\n")
    problem = parse_problem(text)
    arm = problem.arm
    finder = PoseFinder.of(problem)
    poses = [finder.start, *finder.drawn(50)]
    assert len(poses) > 1
    for pose in poses:
        q = finder.configuration(pose)
        assert q.shape == (len(arm.coordinates),)
        assert np.all(q >= arm.lower_limits - 1e-9)
        assert np.all(q <= arm.upper_limits + 1e-9)
        last, tip = points_with_tool(arm, q)[-2:]
        axes = slice(None, None, 2 if len(pose.tip) > arm.dimension else 1)
        np.testing.assert_allclose(tip, pose.tip[axes], atol=1e-9)
        np.testing.assert_allclose((tip - last) / np.linalg.norm(tip - last), pose.tip_direction[axes], atol=1e-7)
        assert finder.safe(q, q)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_fewest_sets_are_as_few_as_there_are(seed: int) -> None:
    """Sets cover what is asked, no fewer do, and the bound on their number holds."""
    rng = np.random.default_rng(seed)
    covers = rng.random((6, 8)) < 0.35
    weights = rng.uniform(0.1, 1.0, 8)
    least = rng.uniform(0.2, 1.0) * float(weights @ np.any(covers, axis=0))
    cover = fewest_sets(covers, weights, least, rng.random(6), 10.0)

    def weighs(sets: object) -> float:
        return float(weights @ np.any(covers[list(sets)], axis=0))  # type: ignore[call-overload]

    assert weighs(cover.sets) >= least * (1.0 - 1e-6)
    fewer = combinations(range(6), len(cover.sets) - 1)
    assert all(weighs(sets) < least * (1.0 + 1e-6) for sets in fewer)
    assert cover.fewest <= len(cover.sets)


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_seen_is_what_lines_of_shapely_reach(seed: int) -> None:
    """A place that counts as seen has a free line of sight; one that does not has something in or beside it."""
    rng = np.random.default_rng(seed)
    problem = problem_of(PLANE)
    coverage = Coverage(("rib", "room"), 1.0, 0.07, (0.05, 0.7), np.deg2rad(140.0), np.deg2rad(75.0))
    q = rng.uniform(-0.6, 0.6, 6)
    motion = motion_of(problem.arm, np.zeros(1), q[None])
    points = motion.points[0]
    walls = [obstacle.outline() for obstacle in problem.workspace.obstacles]
    arm = shapely.LineString(points[:-1]).buffer(problem.arm.radius)
    room = problem.workspace.boundary
    if not room.contains(shapely.Point(points[-1])) or any(wall.contains(shapely.Point(points[-1])) for wall in walls):
        return
    found = verified.seen_pieces(problem.workspace, coverage, motion, [0])
    for place, seen in zip(found.corners.mean(axis=1), found.seen, strict=True):
        sight = place - points[-1]
        away = float(np.linalg.norm(sight))
        ahead = points[-1] - points[-2]
        off = float(np.arccos(np.clip(sight @ ahead / away / np.linalg.norm(ahead), -1.0, 1.0)))
        line = shapely.LineString((points[-1] + 0.001 * sight, points[-1] + 0.995 * sight))
        # Links that hold the tip do not count, so that the last link is left out.
        free = room.contains(line) and not any(wall.intersects(line) for wall in walls)
        free &= not line.intersects(arm) or bool(arm.distance(shapely.Point(points[-1])) <= 0.0)
        if seen:
            assert free
            assert 0.05 - 1e-9 <= away <= 0.7 + 1e-9
            assert off <= np.deg2rad(70.0) + 1e-6
        elif 0.051 <= away <= 0.699 and off < np.deg2rad(69.0):
            near = line.buffer(0.011 * away)
            steep = min(abs(sight[0]), abs(sight[1])) / away >= np.cos(np.deg2rad(76.0))
            hidden = any(wall.intersects(near) for wall in walls) or near.intersects(arm)
            assert hidden or steep or not room.contains(near) or _along_a_wall(sight)


def _along_a_wall(sight: np.ndarray) -> bool:
    """Return whether a line of sight is farther from one of the normals of upright walls than is allowed."""
    return bool(np.max(np.abs(sight)) / np.linalg.norm(sight) > np.sin(np.deg2rad(74.0)))


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), text=st.sampled_from([PLANE, SPACE]))
def test_planned_sights_are_those_of_the_verifier(seed: int, text: str) -> None:
    """What the planner takes as seen in a pose is seen, and it misses only what has little room beside the line."""
    problem = problem_of(text)
    assert problem.coverage is not None
    coverage = replace(problem.coverage, spacing=0.15, within=None, field_of_view=np.deg2rad(120.0))
    pieces = SurfacePieces.of(problem.workspace, coverage.surfaces, coverage.spacing, None)
    sampler = ViewSampler(problem, coverage, pieces, problem.workspace.surface_tree)
    poses = np.random.default_rng(seed).uniform(-0.5, 0.5, (3, len(problem.arm.coordinates)))
    planned = sampler.from_poses(problem.arm, poses)
    motion = motion_of(problem.arm, np.arange(3.0), poses)
    np.testing.assert_allclose(planned.tips, motion.points[:, -1], atol=1e-12)
    surfaces = CheckedSurfaces.from_workspace(problem.workspace)
    for k, mine in enumerate(planned.sees):
        assert np.all(
            verified.seen_places(problem.workspace, coverage, motion, pieces.centres[mine], pieces.normals[mine], k)
        )
        sights = pieces.centres - planned.tips[k]
        away = np.linalg.norm(sights, axis=1)
        ahead = sights @ planned.axes[k] > np.cos(np.deg2rad(59.9)) * away
        square = np.abs(np.sum(sights * pieces.normals, axis=1)) > np.cos(coverage.angle - 0.001) * away
        near = (away > coverage.distance[0] + 1e-6) & (away < coverage.distance[1] - 1e-6)
        missed = np.flatnonzero(~mine & ahead & square & near)
        if len(missed):
            assert np.all(free_half_angles(surfaces, motion, k, pieces.centres[missed])[0] < np.deg2rad(0.65))


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_a_rib_is_seen_from_the_fewest_views(tmp_path: Path) -> None:
    """A plan sees what is asked; its folder keeps problem and views, and fails if less of it is seen."""
    file = tmp_path / "see.toml"
    file.write_text(PLANE)
    run = CliRunner().invoke(app, ["solve", str(file), "--no-pictures", "--out", str(tmp_path)])
    assert run.exit_code == 0, run.output
    assert "see enough" in run.output or "1 view sees enough" in run.output
    folder = tmp_path / "see"
    record = json.loads((folder / "solution.json").read_text())
    assert record["problem"]["goal"]["see"] == ["rib"]
    assert len(record["tour"]["views"]) == len(record["tour"]["order"])
    seen = next(check for check in record["checks"] if check["name"] == "surface seen")
    assert seen["worst"] >= 80.0

    plan = ccm_opt.load(folder)
    assert plan.problem.coverage is not None
    strict = replace(plan.problem, coverage=replace(plan.problem.coverage, share=1.0, within=None))
    failed = [check.name for check in verify(strict, plan.trajectory, plan.joints) if not check.passed]
    assert failed == ["surface seen"]

    record["problem"]["goal"]["share"] = 1.0
    (folder / "solution.json").write_text(json.dumps(record))
    checked = CliRunner().invoke(app, ["check", str(folder)])
    assert checked.exit_code != 0
    assert "urface seen" in checked.output
    del record["tour"]["views"]
    (folder / "solution.json").write_text(json.dumps(record))
    with pytest.raises(ProblemError, match="views of the tour"):
        load_posed(folder)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@pytest.mark.parametrize(
    ("text", "changes", "words"),
    [
        (PLANE, {"share": 0.95, "within": "[0.5, 0.0, 0.65, 0.6]"}, r"of 'rib', 95 % is wanted\n +\d+ %"),
        (SPACE, {"share": 0.9, "spacing": 0.3}, r"of 'slab' and 'room', 90 % is wanted\n +\d+ % out of reach"),
    ],
)
def test_what_cannot_be_seen_is_told_with_its_share(text: str, changes: dict[str, object], words: str) -> None:
    """The message says how much can be seen, how much is wanted, and what prevents the rest."""
    with pytest.raises(NoPlanFound, match=r"together see \d+(\.\d+)? % " + words) as found:
        ccm_opt.solve(problem_of(text, **changes))
    assert "goal.share" in found.value.diagnosis.advice[0]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("see", '["wall"]', "no flat surfaces are named 'wall'"),
        ("see", '["post"]', "no flat surfaces are named 'post'"),
        ("order", '"given"', 'needs planner.order = "free"'),
        ("order", '"free"\nend = "last"', "which has no last goal"),
        ("spacing", "1e-6", "pieces; expected at most"),
        ("spacing", "0.05\nposition = [0.3, 0.1]", "exactly one"),
        ("share", "0.5\nnormal = [1, 0]", "look_at"),
        ("share", '0.5\nname = "ribs"', "name: only allowed together with position"),
    ],
)
def test_files_with_defects_are_refused(key: str, value: str, words: str) -> None:
    """Unknown and round surfaces, orders, divisions that are too fine, and keys of other goals are refused."""
    with pytest.raises((ProblemFileError, ProblemError), match=words):
        problem_of(PLANE, **{key: value})
    with pytest.raises(ProblemFileError, match="needs it"):
        parse_problem(PLANE.replace("share = 0.8\n", ""))


def test_problems_are_written_as_posed_only() -> None:
    """A problem with surfaces to see is the same after writing and reading; one with its views is not written."""
    for text in (PLANE, SPACE):
        problem = problem_of(text)
        again = problem_from_mapping(problem_data(problem))
        assert again.coverage is not None
        assert problem.coverage is not None
        assert replace(again.coverage, within=None) == replace(problem.coverage, within=None)
    views = replace(problem_of(PLANE), planner=ccm_opt.PlannerOptions(), goal=TipGoal.at((0.3, 0.2)), source="")
    with pytest.raises(ProblemError, match="as posed"):
        problem_data(views)
    with pytest.raises(ProblemError, match=r"TipGoal\.seeing"):
        replace(problem_of(PLANE), goal=JointPose(np.zeros(6)))


def test_what_needs_a_goal_for_the_tip_refuses_surfaces() -> None:
    """Searches for a pose, and the planner of single motions, say that they take no surfaces."""
    for ask in (ccm_opt.find_pose, ccm_opt.BuiltInPlanner().plan):
        with pytest.raises(ProblemError, match=r"goal\.see"):
            ask(problem_of(PLANE))
