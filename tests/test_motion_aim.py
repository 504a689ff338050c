"""Goals that the tip cannot take but come near enough to: out of reach, or too near to a wall, within the tolerance."""

import pytest

from ccm_opt.core.errors import NoPlanFound
from ccm_opt.driver.pipeline import solve
from ccm_opt.io.reading import parse_problem

from .conftest import SMALL_PROBLEM


def with_goal(position: str, tolerance: float) -> str:
    """The small problem with another goal; its arm of 0.4 m stands 0.2 m below a post."""
    return SMALL_PROBLEM.replace("position = [0.3, 0.1]", f"position = {position}\nposition_tolerance = {tolerance}")


@pytest.mark.drawn(1)
@pytest.mark.parametrize(
    ("position", "tolerance"), [("[0.0, -0.42]", 0.05), ("[0.0, 0.19]", 0.03), ("[0.0, 0.21]", 0.06)]
)
def test_a_goal_is_met_within_its_tolerance(position: str, tolerance: float) -> None:
    """The tip ends where it can be, no farther from the goal than allowed, and the verifier agrees."""
    solution = solve(parse_problem(with_goal(position, tolerance)))
    assert 1e-3 < solution.metrics["tip_error_m"] <= tolerance
    assert all(check.passed for check in solution.checks)


def test_a_goal_farther_off_is_refused() -> None:
    """What the tolerance does not cover stays unreachable."""
    with pytest.raises(NoPlanFound, match="too short"):
        solve(parse_problem(with_goal("[0.42, 0.0]", 0.01)), explain=False)


def test_an_arm_that_is_near_enough_at_the_start_stays_there_or_nearly() -> None:
    """A straight arm whose tip is within the tolerance of a goal beyond its reach has a plan."""
    solution = solve(parse_problem(with_goal("[0.42, 0.0]", 0.05)))
    assert all(check.passed for check in solution.checks)
