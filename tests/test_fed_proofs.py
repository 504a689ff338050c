"""Proofs about ways of fed arms: what is beyond the hole is argued about as an arm that begins there."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.deadline import Deadline
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.moved_goal import moved_goals
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.scene.workspace import Obstacle, PlaneShape

from .benchmarks.feed_families import FAMILIES
from .feed_scenes import RADIUS, fed_arm, make_problem, make_room


@pytest.mark.drawn(6)
@pytest.mark.planning
@pytest.mark.parametrize("family", sorted(FAMILIES))
@settings(deadline=None, max_examples=2)
@given(seed=st.integers(0, 10**6))
def test_nothing_is_proved_of_scenes_that_have_a_reference(family: str, seed: int) -> None:
    """Every scene of the families has a way by construction."""
    assert failed(FAMILIES[family](np.random.default_rng(seed))) == ()


def slit(half: float) -> Problem:
    """A goal behind a wall with a slit of some half width [m] in it, straight ahead of the hole."""
    walls = (
        Obstacle("upper", PlaneShape(shapely.box(0.4, half, 0.5, 1.2))),
        Obstacle("lower", PlaneShape(shapely.box(0.4, -1.2, 0.5, -half))),
    )
    return make_problem(fed_arm(), make_room(*walls), TipGoal(np.array([0.7, 0.0])))


@settings(deadline=None, max_examples=20)
@given(share=st.floats(0.2, 2.0))
def test_a_slit_is_proved_closed_if_and_only_if_it_is_narrower(share: float) -> None:
    """The diameter is compared with the slit's width, and the radius that would pass is told."""
    problem = slit(share * RADIUS)
    found = failed(problem)
    if share >= 1.0:
        assert found == ()
        return
    if share < 0.99:
        (finding,) = found
        assert (finding.kind, finding.proved) == ("too thick", True)
        assert set(finding.obstacles) >= {"upper", "lower"}
        assert finding.bounds["arm.radius"] == pytest.approx(share * RADIUS, rel=5e-3)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(deadline=None, max_examples=20)
@given(share=st.floats(0.7, 0.95))
def test_the_feed_that_is_asked_for_reaches_round_a_screen(share: float) -> None:
    """Where all ways from the hole are longer than what is beyond it, feeding by what lacks proves nothing any more."""
    screen = Obstacle("screen", PlaneShape(shapely.box(0.3, -1.2, 0.35, 0.3)))
    arm = fed_arm()
    assert arm.feed is not None
    problem = make_problem(arm, make_room(screen), TipGoal(np.array([0.5, 0.0])))
    # Round the upper end of the screen it is at least as far as by its two upper corners.
    least = np.hypot(0.3, 0.3) + 0.05 + np.hypot(0.15, 0.3)
    high = share * least - arm.length + arm.feed.hole
    short = replace(problem, arm=replace(arm, feed=replace(arm.feed, high=high)))
    (finding,) = failed(short)
    assert finding.kind == "too short"
    assert "from the hole" in finding.reason
    asked = finding.bounds["arm.feed.range"]
    assert asked - arm.feed.hole + arm.length >= least
    longer = replace(short, arm=replace(short.arm, feed=replace(arm.feed, high=asked + 1e-3)))
    assert failed(longer) == ()


def test_a_goal_in_a_post_is_moved_beside_it() -> None:
    """The nearest free place within reach beyond the hole is told for fed arms as well."""
    room = make_room(Obstacle("post", PlaneShape(shapely.Point(0.5, 0.2).buffer(0.08))))
    problem = make_problem(fed_arm(), room, TipGoal(np.array([0.5, 0.15])))
    (moved,) = moved_goals(problem, failed(problem), Deadline.never())
    assert moved.key == "goal.position"
    assert moved.bound is not None
    assert failed(moved.write(problem, moved.bound + 2e-3)) == ()
