"""Motions whose tip follows a path that the user gives, planned and verified."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem, problem_from_mapping
from ccm_opt.planning.limits.following import FollowingLimit
from ccm_opt.planning.path_fit import fitted_path
from ccm_opt.planning.tip_path import TipPath
from ccm_opt.problem.solution import Solution
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import BaseAxis
from ccm_opt.verification.verifier import verify

from .arc_arms import arc_arm

PROBLEM = """
schema = 1
space = 3
name = "path"

[workspace]
bounds = [[-1.0, -0.5, -0.5], [1.0, 0.5, 0.5]]

[arm]
links = 20
link_length = 0.03
radius = 0.008
base = { position = [-0.7, 0, 0], direction = [1, 0, 0] }
joint_limit_deg = 30
feed = { range = [0.0, 0.6], hole = 0.65 }

[limits]
velocity = 1.0
acceleration = 5.0
feed_velocity = 0.1
feed_acceleration = 0.5

[start]
shape = "straight"

[goal]
path = PATH

[planner]
follow_within = 0.004
"""
POST = """[[workspace.obstacles]]
name = "post"
sphere = { center = [0.25, 0.06, 0.0], radius = 0.03 }
[arm]"""
BEND = [[-0.1, 0, 0], [0.02, 0.0, 0.0], [0.1, 0.005, 0.0], [0.2, 0.04, 0.01], [0.3, 0.09, 0.04], [0.38, 0.15, 0.08]]


def with_path(path: list[list[float]], **changes: str) -> ccm_opt.Problem:
    """The problem with a path of the tip, and with lines of the file exchanged."""
    text = PROBLEM.replace("PATH", repr(path))
    for old, new in changes.items():
        text = text.replace(old, new)
    return parse_problem(text)


@pytest.fixture(scope="module")
def solution() -> Solution:
    """A plan along a path that leaves the axis of the feed in space."""
    return ccm_opt.solve(with_path(BEND))


def distances(points: FloatArray) -> FloatArray:
    """Distances of points (k, 3) from the natural spline through the path, by brute force, (k,) [m]."""
    path = np.array(BEND)
    chords = np.linalg.norm(np.diff(path, axis=0), axis=1)
    curve = CubicSpline(np.concatenate(([0.0], np.cumsum(chords))), path, bc_type="natural")
    samples = curve(np.linspace(0.0, curve.x[-1], 20001))
    return np.array([np.min(np.linalg.norm(samples - point, axis=1)) for point in points])


@pytest.mark.drawn(20, of="dear tests")
def test_the_tip_follows_the_path_and_the_arm_follows_the_tip(solution: Solution) -> None:
    """Swept at samples, the tip is on the path within its tolerance, and the verifier's bound is close to that."""
    assert solution.path.candidate == "along goal.path"
    worst = float(np.max(distances(solution.joint_positions[::5, -1])))
    checks = {check.name: check for check in solution.checks}
    assert 0.99 * worst <= checks["goal path"].worst <= 1.05 * worst + 1e-5
    assert checks["goal path"].limit == pytest.approx(1e-3)
    assert checks["following the tip"].worst <= 0.004


@pytest.mark.drawn(20, of="dear tests")
def test_a_tip_that_leaves_its_path_or_returns_on_it_is_refused(solution: Solution) -> None:
    """Whichever planner made the motion: along another path, and backwards."""
    elsewhere = [place if k != 3 else [0.2, 0.05, 0.01] for k, place in enumerate(BEND)]
    backwards = BEND[::-1]
    for path in (elsewhere, backwards):
        goal = ccm_opt.TipGoal(np.array(path[-1]), path=np.array(path))
        checks = verify(replace(solution.problem, goal=goal), solution.trajectory, solution.joints)
        assert not next(check for check in checks if check.name == "goal path").passed


def test_a_path_that_does_not_begin_at_the_tip_is_refused() -> None:
    """With the place where it should begin."""
    with pytest.raises(
        ccm_opt.ProblemError, match=r"goal\.path begins .* from the tip at the start; begin it at \[-0\.1"
    ):
        ccm_opt.solve(with_path([[-0.1, 0.1, 0.0], *BEND[1:]]))


@pytest.mark.parametrize(
    ("path", "changes", "words"),
    [
        ([*BEND[:2], [0.05, 0.1, 0.0]], {}, "the tip leaves the path by"),
        (BEND, {"follow_within = 0.004": "follow_within = 0.0001"}, "too far for planner.follow_within"),
        (BEND, {"[arm]": POST}, "in contact: link .* too near to 'post'"),
    ],
)
def test_paths_that_cannot_be_followed_say_why(path: list[list[float]], changes: dict[str, str], words: str) -> None:
    """The tip's or the arm's deviation, or the obstacle, with what would help."""
    with pytest.raises(ccm_opt.NoPlanFound, match=words) as failure:
        ccm_opt.solve(with_path(path, **changes), explain=False)
    assert failure.value.diagnosis.advice


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("feed = 0.1", r"line \d+: goal\.feed: only allowed with a whole-arm goal"),
        (
            "direction_tolerance_deg = 3",
            r"line \d+: goal\.direction_tolerance_deg: only allowed together with position",
        ),
        *(
            (f"[planner]\n{key}", rf"line \d+: planner\.{key.split()[0]}: goal\.path fixes the motion")
            for key in (
                "wanted_gap = 0.01",
                "seed = 2",
                "tries = 3",
                'optimiser = "none"',
                "weights = { bending = 0.5 }",
            )
        ),
    ],
)
def test_keys_without_effect_beside_a_path_are_refused(lines: str, words: str) -> None:
    """By key and line; none is silently ignored."""
    text = PROBLEM.replace("PATH", str(BEND)).replace(
        "[planner]", lines if "[planner]" in lines else f"{lines}\n[planner]"
    )
    with pytest.raises(ccm_opt.ProblemError, match=words):
        parse_problem(text)


def test_bad_paths_are_named_by_key_and_line() -> None:
    """A path stands in the place of a position, and has two points or more."""
    for lines, words in (
        ("[[0, 0, 0]]", r"line \d+: goal\.path"),
        ("[[0, 0, 0], [0, 0]]", r"line \d+: goal\.path"),
        (f"{BEND}\nposition = [0, 0, 0]", r"line \d+: goal"),
        (f"{BEND}\nvia = [[0, 0, 0]]", r"line \d+: goal\.via"),
    ):
        with pytest.raises(ccm_opt.ProblemError, match=words):
            parse_problem(PROBLEM.replace("PATH", lines))
    with pytest.raises(ccm_opt.ProblemError, match=r"line \d+: goal\.path: only allowed together with"):
        with_path(BEND, **{"feed = { range": "# ", "feed_": "# ", "follow_within": "# "})
    with pytest.raises(ccm_opt.ProblemError, match="same point twice"):
        with_path([BEND[0], BEND[0], BEND[1]])


def test_a_path_is_written_back() -> None:
    """As points in the file's unit, in the place of a position."""
    problem = with_path(BEND)
    again = problem_from_mapping(problem_data(problem))
    assert again.goal.path is not None
    assert np.array_equal(again.goal.path, np.array(BEND))


def six_axis_arm() -> Arm:
    """An arm of three sections that bend evenly, on three prismatic and three revolute axes."""
    axes = [BaseAxis(axis, -3.0, 3.0, revolute=False) for axis in np.eye(3)]
    axes += [BaseAxis(axis, -3.0, 3.0, revolute=True) for axis in np.eye(3)[::-1]]
    return arc_arm((6, 6, 6), (0.3, 0.3, 0.3), carrier=tuple(axes))


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=4, deadline=None)
@given(st.integers(0, 10**6), st.booleans())
def test_sections_on_six_axes_follow_a_path(seed: int, flat: bool) -> None:
    """The tip exactly, at all times, and the arm within 5 % of its length, from any straight start."""
    arm = six_axis_arm()
    rng = np.random.default_rng(seed)
    start = np.append(np.zeros(2 * arm.links), [0.1, -0.2, 0.3, *rng.uniform(-1.0, 1.0, 3)])
    tip, frame = arm.joint_positions_at(start)[-1], arm.link_rotations(start)[-1]
    s = np.linspace(0.0, 1.0, 12)
    turn = rng.uniform(-1.2, 1.2, (2, 1)) * [[1.0], [0.0 if flat else 1.0]] * s**2
    along = np.stack((np.cos(turn[0]) * np.cos(turn[1]), np.sin(turn[0]) * np.cos(turn[1]), np.sin(turn[1])), axis=1)
    steps = arm.length / 11 * 0.5 * (along[1:] + along[:-1])
    path = TipPath(tip + np.vstack((np.zeros(3), np.cumsum(steps, axis=0))) @ frame.T, arm.length / 400)
    spline = fitted_path(arm, start, path)
    assert np.array_equal(spline(0.0), start)
    q = np.asarray(spline(np.linspace(0.0, 1.0, 777)))
    assert arm.sections is not None
    assert arm.sections.misfit(q[:, :-6]) < 1e-9
    tips = arm.joint_positions_at(q)[:, -1]
    samples = path.at(np.linspace(0.0, path.length, 20001))
    nearest, index = cKDTree(samples).query(tips)
    tangent = path.tangents(np.asarray(index) * path.length / 20000)
    off = tips - samples[index]
    assert np.max(np.linalg.norm(off - np.sum(off * tangent, axis=1)[:, None] * tangent, axis=1)) < 1e-6
    assert np.max(nearest) < 1e-4
    assert np.linalg.norm(tips[-1] - path.points[-1]) < 1e-9
    assert FollowingLimit(arm, 1.0).worst_deviation(q) < 0.05 * arm.length


@pytest.mark.drawn(20, of="dear tests")
def test_the_bound_on_following_holds_between_samples(solution: Solution) -> None:
    """Of the centre line at a hundred places of every link, at five moments between samples, by brute force."""
    positions, arm = solution.trajectory.positions, solution.problem.arm
    at = np.arange(0.0, len(positions) - 1.0, 3.7)
    between = np.stack([np.interp(at, np.arange(len(positions)), column) for column in positions.T], axis=1)
    points = arm.joint_positions_at(between)
    share = np.linspace(0.0, 1.0, 30)[:, None]
    places = points[:, :-1, None] + share * (points[:, 1:, None] - points[:, :-1, None])
    tips = solution.joint_positions[:, -1]
    hole = arm.base + arm.hole * arm.direction
    leading = positions[:, -1] + arm.length > arm.hole
    corners = np.vstack((hole, tips[leading]))
    path = np.concatenate([np.linspace(a, b, 40) for a, b in pairwise(corners)])
    outside = between[:, -1, None, None] + arm.joint_places[:-1, None] + arm.lengths[:, None] * share[:, 0] > arm.hole
    worst = float(np.max(cKDTree(path).query(places[outside])[0]))
    bound = next(check for check in solution.checks if check.name == "following the tip").worst
    assert worst <= bound <= 1.3 * worst + 2e-4


@pytest.mark.drawn(20, of="dear tests")
def test_a_tendon_driven_arm_on_six_axes_follows_a_scanned_path() -> None:
    """From the file to the verified plan: the tip exactly, the arm within the bound, and both again from the folder."""
    problem = ccm_opt.load_problem(Path(__file__).parent.parent / "problems" / "space" / "scanned-path.toml")
    solution = ccm_opt.solve(problem)
    checks = {check.name: check for check in solution.checks}
    assert all(check.passed for check in solution.checks)
    assert checks["goal path"].worst < 1e-6
    assert checks["following the tip"].worst < 0.015
    assert solution.metrics["leader_deviation_mean_m"] < 0.015 * problem.arm.length
    again = problem_from_mapping(problem_data(problem))
    assert np.allclose(again.arm.axis_rows, problem.arm.axis_rows)
    assert again.goal.path is not None


def test_sections_follow_only_a_path_within_a_bound() -> None:
    """With another goal, ``follow_within`` of such an arm is refused by key and line."""
    text = (Path(__file__).parent.parent / "problems" / "space" / "scanned-path.toml").read_text()
    begin = text.index("path = [")
    text = text[:begin] + "position = [0.3, 0.1, 0.1]\n" + text[text.index("[planner]") :]
    with pytest.raises(ccm_opt.ProblemError, match=r"line \d+: .*follow_within: .*only"):
        parse_problem(text)
