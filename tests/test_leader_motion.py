"""Motions of fed arms in space along the path of their tip: ends, tube, and how near the tip's path the arm stays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.driver.metrics import leader_deviation
from ccm_opt.io.reading import parse_problem
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.leader_motion import keyframes_behind_tip, tube_bound
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.biarc import straight_at_exit
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from tests.snakes_in_space import snake

ARM = snake(16, length=0.8, feed=Feed(-0.8, 0.0, 0.0))
PROBLEMS = Path(__file__).parents[1] / "problems"
SPACE_PROBLEMS = PROBLEMS / "space"


def pose(seed: int, feed: float) -> FloatArray:
    """A smooth pose at a feed, with bends of at most 30 degrees."""
    curve, v = CurveMap.through(ARM, np.append(np.zeros(32), -0.8))
    rng = np.random.default_rng(seed)
    v[: curve.feed_column] = np.convolve(rng.normal(size=curve.feed_column + 4), np.ones(5) / 5.0, "valid")
    v[curve.feed_column] = feed / curve.scale[curve.feed_column]
    v[: curve.feed_column] *= np.deg2rad(30.0) / np.max(np.abs(curve.configuration(v)[:-1]))
    return straight_at_exit(ARM, curve.configuration(v))


def tubed_bends(keyframes: FloatArray) -> FloatArray:
    """Bends of all joints that the guide tube holds."""
    places = keyframes[:, -1:] + ARM.link_length * np.arange(ARM.links)
    return np.repeat(places <= 0.0, 2, axis=1) * keyframes[:, :-1]


@pytest.mark.drawn(20, of="dear tests")
@given(seed=st.integers(0, 2**32), feed=st.floats(-0.6, 0.0))
@settings(deadline=None, max_examples=25)
def test_an_arm_from_its_tube_stays_on_the_path_of_its_tip(seed: int, feed: float) -> None:
    """It ends in the pose, straight in the tube, and leaves the path of its tip by parts of a link."""
    start = np.append(np.zeros(32), -0.8)
    end = pose(seed, feed)
    keyframes = keyframes_behind_tip(ARM, start, end)
    assert keyframes is not None
    assert np.array_equal(keyframes[[0, -1]], np.stack((start, end)))
    assert np.all(np.diff(keyframes[:, -1]) > 0.0)
    assert not np.any(tubed_bends(keyframes))
    assert np.all(np.abs(keyframes[:, :-1]) <= ARM.joint_limit)
    found = leader_deviation(ARM, keyframes)
    assert found is not None
    # A link of length l leaves an arc on which joints bend by 42 degrees by 0.09 l; where a pose bends at the end of
    # the tube, the link that comes out of it leaves the path by more.
    assert found.mean < 0.1 * ARM.link_length
    assert found.worst < 0.5 * ARM.link_length


@pytest.mark.drawn(20, of="dear tests")
@given(seed=st.integers(0, 2**32), feeds=st.tuples(st.floats(-0.6, 0.0), st.floats(-0.6, 0.0)))
@settings(deadline=None, max_examples=10)
def test_an_arm_on_another_path_is_drawn_back_first(seed: int, feeds: tuple[float, float]) -> None:
    """From one pose to another: both are met, no joint in the tube is bent, and steps are small.

    Beyond the tube a joint bends with a smooth step of slope 1.5 at most, and is fed by 0.4 of its length at a time.
    """
    start, end = pose(seed, feeds[0]), pose(seed + 1, feeds[1])
    keyframes = keyframes_behind_tip(ARM, start, end)
    assert keyframes is not None
    assert np.array_equal(keyframes[[0, -1]], np.stack((start, end)))
    assert not np.any(tubed_bends(keyframes))
    assert np.max(np.abs(np.diff(keyframes, axis=0))) <= 1.5 * 0.4 * ARM.joint_limit


@given(seed=st.integers(0, 2**32), feed=st.floats(-0.6, -0.1))
@settings(deadline=None, max_examples=15)
def test_bends_change_as_evenly_as_displacements_allow(seed: int, feed: float) -> None:
    """No other bends of joints beyond the tube have a smaller sum of unevenness and of displacements from the path."""
    ends = np.append(np.zeros(32), -0.8), pose(seed, feed)
    given_path = keyframes_behind_tip(ARM, *ends, np.inf)
    smooth = keyframes_behind_tip(ARM, *ends, 1e3)
    assert given_path is not None
    assert smooth is not None
    unit = ARM.length / NOMINAL_LINKS
    step = (smooth[1, -1] - smooth[0, -1]) / unit
    along = ARM.link_rotations(smooth)[..., 0]
    along = along + np.concatenate((along[:, 1:], along[:, -1:]), axis=1)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)

    def cost(q: FloatArray) -> float:
        uneven = np.diff(q[:, :-1], 2, axis=0) / step**2
        moved = (ARM.joint_positions_at(q) - ARM.joint_positions_at(given_path))[:, 1:] / unit
        across = moved - np.sum(moved * along, axis=-1, keepdims=True) * along
        return float(np.sum(uneven**2) + 1e3 * np.sum(across**2))

    free = given_path != 0.0
    free[[0, -1]] = False
    free[:, -1] = False
    assert np.array_equal(smooth[~free], given_path[~free])
    rng = np.random.default_rng(seed)
    least = cost(smooth)
    assert least < cost(given_path)
    for size in (1e-3, 1e-2):
        change = size * free * np.convolve(rng.normal(size=smooth.size), np.ones(5) / 5.0, "same").reshape(smooth.shape)
        assert cost(smooth + change) > least


def test_an_arm_that_cannot_be_drawn_back_far_enough_has_no_such_motion() -> None:
    """Its axis ends before what is out of the tube is straight."""
    short = replace(ARM, feed=Feed(-0.4, 0.0, 0.0))
    assert keyframes_behind_tip(short, pose(1, -0.2), pose(2, -0.1)) is None


@pytest.mark.drawn(1)
@pytest.mark.parametrize("name", ["elbow", "wing-box", "blade-row"])
def test_motions_among_obstacles_follow_their_tip(name: str) -> None:
    """Within 3 mm in the mean and 10 mm at worst, where an optimised motion leaves its path by up to 63 mm."""
    solution = ccm_opt.solve(ccm_opt.load_problem(SPACE_PROBLEMS / f"{name}.toml"))
    assert solution.path.candidate.endswith("on the path of the tip")
    assert solution.metrics["leader_deviation_mean_m"] < 3e-3
    assert solution.metrics["leader_deviation_worst_m"] < 10e-3


@pytest.mark.drawn(1)
@pytest.mark.parametrize("name", ["space/blade-row", "feed-s-duct"])
def test_a_bound_on_following_is_kept_and_verified(name: str) -> None:
    """In the plane and in space, also where the arm would rather change its shape; the check tells how much is used."""
    problem = ccm_opt.load_problem(PROBLEMS / f"{name}.toml", changes=["planner.follow_within=0.01"])
    solution = ccm_opt.solve(problem)
    check = next(check for check in solution.checks if check.name == "following the tip")
    assert check.passed
    assert check.limit == pytest.approx(0.01)
    assert 1.0 <= check.worst / solution.metrics["leader_deviation_worst_m"] <= 1.2


@pytest.mark.drawn(20, of="dear tests")
def test_a_bound_that_cannot_be_kept_says_by_how_much() -> None:
    """And what the straight links in the tube allow."""
    problem = ccm_opt.load_problem(SPACE_PROBLEMS / "blade-row.toml", changes=["planner.follow_within=0.001"])
    with pytest.raises(ccm_opt.NoPlanFound) as failure:
        ccm_opt.solve(problem, explain=False)
    assert "too far for planner.follow_within" in failure.value.diagnosis.reason
    assert "the tube's straight links allow no less than" in failure.value.diagnosis.reason
    assert "leader_deviation_m" in failure.value.diagnosis.evidence


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("follow_within = -1.0", r"line \d+: planner\.follow_within"),
        ('follow_within = "near"', r"line \d+: planner\.follow_within"),
    ],
)
def test_bad_bounds_are_named_by_key_and_line(line: str, words: str) -> None:
    """As every value of a problem file."""
    text = (SPACE_PROBLEMS / "swan-neck-in-space.toml").read_text() + f"\n[planner]\n{line}\n"
    with pytest.raises(ProblemFileError, match=words):
        parse_problem(text)


def test_a_bound_needs_a_feed_axis() -> None:
    """On a fixed base nothing leads, whether the problem comes from a file or is made in Python."""
    problem = ccm_opt.load_problem(PROBLEMS / "open-space.toml")
    with pytest.raises(ccm_opt.ProblemError, match=r"planner\.follow_within: only allowed together with arm\.feed"):
        ccm_opt.solve(replace(problem, planner=replace(problem.planner, follow_within=0.01)))
    text = (PROBLEMS / "open-space.toml").read_text() + "\n[planner]\nfollow_within = 0.01\n"
    with pytest.raises(ProblemFileError, match=r"planner\.follow_within: only allowed together with arm\.feed"):
        parse_problem(text)


def test_the_links_in_the_tube_bound_the_deviation() -> None:
    """A pose that bends where the tube ends is off the axis where its tip had to go straight on."""
    straight = np.append(np.zeros(32), -0.4)
    assert tube_bound(ARM, straight) == 0.0
    bent = straight.copy()
    bent[2 * 8] = 0.5  # the joint in the mouth of the tube
    # At a height z above the axis the link is z / tan 0.5 beyond the hole, and 0.05 m are straight.
    assert tube_bound(ARM, bent) == pytest.approx(0.05 * np.sin(0.5) / (np.sin(0.5) + np.cos(0.5)), rel=0.1)
