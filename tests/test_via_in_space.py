"""Places that the tip passes on its way, by the search and through the optimisation."""

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.planning import way_strategies
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.optimisation.optimise import optimise
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.planning.via_places import first_violation, passings
from tests.snakes_in_space import boxes, least_gaps, snake, task_of

seeds = st.integers(0, 2**32 - 1)
GOAL = GoalPose(np.array([0.55, 0.5, 0.0]))
ASIDE = np.array([0.7, -0.25, 0.3])
"""A place far from the straight way to the goal."""


@given(seeds)
@settings(max_examples=60, deadline=None)
def test_passings_are_the_nearest_in_order(seed: int) -> None:
    """As near in all as any choice of legs in the same order."""
    rng = np.random.default_rng(seed)
    tips = rng.normal(size=(int(rng.integers(2, 6)), 3))
    places = rng.normal(size=(int(rng.integers(1, 4)), 3))
    found = passings(tips, places)
    assert np.all(np.diff(found.leg) >= 0)
    passed = tips[found.leg] + found.share[:, None] * (tips[found.leg + 1] - tips[found.leg])

    def nearest(place: np.ndarray, leg: int) -> float:
        step = tips[leg + 1] - tips[leg]
        share = np.clip((place - tips[leg]) @ step / (step @ step), 0.0, 1.0)
        return float(np.sum((tips[leg] + share * step - place) ** 2))

    least = min(
        sum(nearest(place, leg) for place, leg in zip(places, legs, strict=True))
        for legs in combinations_with_replacement(range(len(tips) - 1), len(places))
    )
    assert np.sum((passed - places) ** 2) == pytest.approx(least, abs=1e-12)


def test_places_are_missed_in_their_order() -> None:
    """A path that passes them the other way round misses the second."""
    tips = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    assert first_violation(tips, tips[[1, 2]], 0.1) is None
    number, away = first_violation(tips, tips[[2, 1]], 0.1) or (-1, 0.0)
    assert number == 1
    assert away == pytest.approx(1.0)


@pytest.mark.parametrize("links", [12, 24, 36])
def test_an_optimised_motion_still_passes_a_place(links: int) -> None:
    """Shorter motions would leave it aside."""
    arm = snake(links)
    task = replace(task_of(arm, boxes([]), GOAL, via=(ASIDE,)), via_reach=0.02)
    found = find_by_ways(task)
    better = optimise(found, task)
    tips = arm.joint_positions_at(better.configurations)[:, -1]
    assert first_violation(tips, ASIDE[None], 0.02) is None
    assert len(better.configurations) != len(found.configurations)
    assert tips[-1] == pytest.approx(GOAL.position, abs=1e-6)


def test_where_no_way_leads_past_a_place_it_is_a_goal_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sampler and poses by inverse kinematics lead from place to place too."""
    monkeypatch.setattr(way_strategies.SpaceRun, "follow_ways", lambda *_, **__: None)
    arm = snake(12)
    triangle_soup = boxes([([0.4, -0.6, 0.5], [0.8, 0.6, 0.6])])
    task = task_of(arm, triangle_soup, GOAL, via=(ASIDE,))
    motion = find_by_ways(task)
    assert motion.candidate == "from place to place"
    tips = arm.joint_positions_at(motion.configurations)[:, -1]
    assert first_violation(tips, ASIDE[None], task.via_reach) is None
    assert min(least_gaps(arm, triangle_soup, motion.configurations)) > 0.0
