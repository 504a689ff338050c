"""The feed axis and goals in sequence in problem files: what becomes of them, what is refused, what is written back."""

import numpy as np
import pytest

from ccm_opt.core.errors import ProblemFileError, UnreachableGoal
from ccm_opt.driver.pipeline import solve
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem, problem_from_mapping
from ccm_opt.problem import JointPose, TipGoal
from ccm_opt.robot.base_axes import Feed

from .conftest import SMALL_PROBLEM

FED = SMALL_PROBLEM.replace("links = 4", "links = 4\nfeed = { range = [-0.2, 0.15] }").replace(
    "acceleration = 10.0", "acceleration = 10.0\nfeed_velocity = 0.1\nfeed_acceleration = 0.5"
)
VIEWS = (
    FED.split("[goal]", maxsplit=1)[0]
    + """
[[goal]]
position = [0.3, 0.1]
pause = 0.5
position_tolerance = 0.002

[[goal]]
joints_deg = [0, 0, 10, 20]
feed = 0.1
"""
)


def keys_of(text: str) -> dict[str, str]:
    """Key paths of the defects of a text, with their messages."""
    with pytest.raises(ProblemFileError) as caught:
        parse_problem(text)
    return {issue.key: issue.message for issue in caught.value.issues}


def test_a_feed_axis_starts_at_its_least_position_and_its_guide_ends_at_its_greatest() -> None:
    """Unless the file says otherwise."""
    problem = parse_problem(FED)
    assert problem.arm.feed == Feed(-0.2, 0.15, 0.15)
    assert isinstance(problem.start, JointPose)
    assert problem.start.feed == -0.2
    assert (problem.limits.feed_velocity, problem.limits.feed_acceleration, problem.limits.feed_force) == (
        0.1,
        0.5,
        None,
    )
    given = parse_problem(FED.replace("0.15] }", "0.15], hole = 0.3 }").replace("[start]", "[start]\nfeed = 0.05"))
    assert given.arm.feed == Feed(-0.2, 0.15, 0.3)
    assert isinstance(given.start, JointPose)
    assert given.start.feed == 0.05


def test_lengths_and_rates_are_in_the_unit_of_the_file() -> None:
    """Whatever has a length in it scales, and is written back as it was read; forces are in SI units."""
    further = "feed_jerk = 2.0\nfeed_force = 9.0\ntip_velocity = 0.3\npoints = [{ at = 0.2, acceleration = 0.7 }]"
    inches = FED.replace("feed_velocity", f"{further}\nfeed_velocity")
    inches = inches.replace('name = "small"', 'name = "small"\nunits = "in"')
    for length in ("link_length = 0.1", "position = [0.3, 0.1]"):
        assert length in inches
    problem = parse_problem(inches)
    assert problem.arm.feed is not None
    assert problem.arm.feed.high == pytest.approx(0.15 * 0.0254)
    limits = problem.limits
    tip, point = limits.points
    scaled = (limits.feed_velocity, limits.feed_acceleration, limits.feed_jerk, tip.velocity, point.acceleration)
    assert scaled == pytest.approx(0.0254 * np.array([0.1, 0.5, 2.0, 0.3, 0.7]))
    assert limits.feed_force == 9.0
    written = problem_data(problem)["limits"]
    assert (written["feed_velocity"], written["feed_jerk"], written["tip_velocity"]) == (0.1, 2.0, 0.3)
    assert written["points"] == [{"at": 0.2, "acceleration": 0.7}]


def test_goals_in_sequence_are_stops_and_the_last_goal() -> None:
    """Every goal but the last is a stop with its own tolerances and pause."""
    problem = parse_problem(VIEWS)
    (stop,) = problem.stops
    assert isinstance(stop.goal, TipGoal)
    assert (stop.tolerances.position, stop.pause) == (0.002, 0.5)
    assert isinstance(problem.goal, JointPose)
    np.testing.assert_allclose(problem.goal.bends, np.deg2rad([0, 0, 10, 20]))
    assert problem.goal.feed == 0.1


@pytest.mark.parametrize("text", [FED, VIEWS])
def test_what_is_written_back_is_the_same_problem(text: str) -> None:
    """The data of a problem with a feed axis and stops give that problem again."""
    data = problem_data(parse_problem(text))
    assert problem_data(problem_from_mapping(data)) == data


@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        ("[0, 0, 10, 20]", "[5, 0, 10, 20]", "goal[1].joints_deg[0]", "still inside the guide"),
        ("feed = 0.1\n", "feed = 0.2\n", "goal[1].feed", "outside the range of the feed axis, -0.2 m to 0.15 m"),
        ("pause = 0.5", "pause = -0.5", "goal[0].pause", "at least 0"),
        ("pause = 0.5", "feed = 0.1", "goal[0].feed", "with a tip goal the feed is planned"),
        ("feed = 0.1\n", "feed = 0.1\npause = 1", "goal[1].pause", "no goal follows"),
        ("position = [0.3, 0.1]\n", "", "goal[0]", "expected exactly one of position"),
    ],
)
def test_defects_of_feed_and_sequence_are_named(old: str, new: str, key: str, message: str) -> None:
    """Each with the key path of the goal it is about."""
    assert old in VIEWS
    found = keys_of(VIEWS.replace(old, new))
    assert message in found[key]


def test_a_stop_out_of_reach_is_refused_before_planning() -> None:
    """The reason says which of the goals it is."""
    with pytest.raises(UnreachableGoal, match=r"^goal\[0\]\.position: .*too short"):
        solve(parse_problem(VIEWS.replace("position = [0.3, 0.1]", "position = [0.7, 0.1]")), explain=False)
