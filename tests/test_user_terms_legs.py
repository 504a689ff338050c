"""User constraints where the motion has legs, or the arm is fed: kept on every leg, and planned for with a feed too."""

from dataclasses import replace

import pytest

from ccm_opt.core.errors import NoPlanFound
from ccm_opt.driver.pipeline import solve
from ccm_opt.ik.quantities import Quantities
from ccm_opt.ik.terms import Constraint
from ccm_opt.io.reading import parse_problem

from .conftest import SMALL_PROBLEM

SEQUENCE = (
    SMALL_PROBLEM.split("[goal]", maxsplit=1)[0]
    + """
[[goal]]
position = [0.3, 0.1]

[[goal]]
position = [0.32, -0.12]
"""
)
FED = SMALL_PROBLEM.replace("links = 4", "links = 4\nfeed = { range = [0.0, 0.3], hole = 0.0 }").replace(
    "acceleration = 10.0", "acceleration = 10.0\nfeed_velocity = 0.1\nfeed_acceleration = 0.5"
)


def tip_below(height: float) -> Constraint:
    """The tip stays below a height [m]."""
    return Constraint("low tip", lambda q: q.tip[1], upper=height, where="motion")


def feed_below(place: float) -> Constraint:
    """The base stays short of a place on its axis [m]."""

    def feed(q: Quantities) -> object:
        return q.base_feed

    return Constraint("short feed", feed, upper=place, where="motion")


def test_a_constraint_holds_on_every_leg() -> None:
    """Its check is made for each goal, and its residual is the worst of them."""
    solution = solve(parse_problem(SEQUENCE), constraints=[tip_below(0.15)])
    names = [check.name for check in solution.checks if "low tip" in check.name]
    assert names == ["constraint low tip, goal 1", "constraint low tip, goal 2"]
    assert solution.metrics["residual_low_tip"] <= 1e-6
    assert solution.joint_positions[:, -1, 1].max() <= 0.15 + 1e-6


@pytest.mark.drawn(6, of="whole plans")
def test_a_constraint_on_the_feed_is_planned_for() -> None:
    """A motion that would use more feed uses less where it may not; where no motion can, the constraint is named."""
    near = parse_problem(FED.replace("position = [0.3, 0.1]", "position = [0.37, 0.1]"))
    solution = solve(near, constraints=[feed_below(0.02)])
    assert solution.trajectory.base_positions[:, 0].max() <= 0.02 + 1e-6
    assert solution.metrics["residual_short_feed"] <= 1e-6

    problem = parse_problem(FED.replace("position = [0.3, 0.1]", "position = [0.5, 0.1]"))
    solution = solve(problem, constraints=[feed_below(0.31)])
    assert solution.trajectory.base_positions[-1, 0] > 0.1
    assert solution.metrics["residual_short_feed"] == 0.0
    in_short = replace(problem, planner=replace(problem.planner, time_limit=0.2))
    with pytest.raises(NoPlanFound, match="short feed"):
        solve(in_short, constraints=[feed_below(0.05)], explain=False)
