"""Chains of links grown at random: ends, bends, lengths and gaps; and what they find that nothing else does."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning import sampled_run
from ccm_opt.planning.followable_ways import WayEnd
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.link_chains import LinkChain, LinkChains
from ccm_opt.planning.sampled_poses import CurvePoints, chained_goal_poses
from ccm_opt.planning.way_strategies import SpaceRun
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from tests.snakes_in_space import boxes, task_of
from tests.space_arms import space_arm

if TYPE_CHECKING:
    from ccm_opt.planning.pose import Pose
    from ccm_opt.planning.search import Failure

LINK = 0.05
KEPT = 0.012
GAP = 0.5 * LINK
PAIR = 0.02
FIRST_PAIR = 3
BEND = 0.5
AHEAD = np.array([1.0, 0.0, 0.0])
START = WayEnd(np.zeros(3), AHEAD)
BOXES = [([0.15, -0.4, -0.4], [0.16, 0.03, 0.4]), ([0.4, 0.0, -0.4], [0.41, 0.4, 0.4])]
"""Two plates across the way with their gaps on different sides."""


def chains_of(links: int, *, exact: bool) -> LinkChains:
    """Chains of joints that bend less near the beginning."""
    limits = BEND * np.clip(np.arange(links) / 2.0, 0.0, 1.0)
    box = np.array([[-0.1, -0.4, -0.4], [0.8, 0.4, 0.4]])
    return LinkChains(SurfaceTree.from_triangles(boxes(BOXES)), box, LINK, limits, FIRST_PAIR, PAIR, exact)


def box_gaps(places: FloatArray) -> float:
    """Least distance of a polyline from the plates, by dense samples."""
    share = np.linspace(0.0, 1.0, 201)[:, None, None]
    samples = (places[:-1] + share * np.diff(places, axis=0)).reshape(-1, 3)
    outside = [
        np.linalg.norm(np.maximum(np.maximum(low - samples, samples - high), 0.0), axis=1)
        for low, high in np.array(BOXES)
    ]
    return float(np.min(outside))


def bends(directions: FloatArray) -> FloatArray:
    """Angles between neighbouring directions."""
    return np.asarray(np.arccos(np.clip(np.sum(directions[:-1] * directions[1:], axis=1), -1.0, 1.0)))


def looked_at(chain: LinkChain, chains: LinkChains, goal: WayEnd) -> None:
    """Fail where a chain is none that was asked for."""
    directions = chain.directions
    assert chain.before[0] == pytest.approx(START.place, abs=1e-12)
    assert chain.behind[-1] == pytest.approx(goal.place, abs=1e-12)
    if goal.direction is not None:
        assert directions[-1] == pytest.approx(goal.direction, abs=1e-9)
    assert np.linalg.norm(chain.before[-1] - chain.behind[0]) < GAP
    assert len(chain.places) == len(directions) + 1
    assert len(directions) == len(chains.limits) if chains.exact else len(directions) <= len(chains.limits)
    whole = np.vstack((AHEAD, directions))
    first = len(chain.before) - 1
    assert np.all(bends(whole)[:first] <= chains.limits[:first] + 1e-6)
    assert np.all(bends(whole) <= BEND + 1e-6)
    for part in (chain.before, chain.behind):
        if len(part) < 2:
            continue
        assert np.linalg.norm(np.diff(part, axis=0), axis=1) == pytest.approx(LINK, abs=1e-12)
        assert box_gaps(part) > KEPT - 1e-9
        for i in range(len(part) - 1):
            for j in range(i + FIRST_PAIR, len(part) - 1):
                assert links_apart(part[i : i + 2], part[j : j + 2]) > PAIR - 2e-4


def links_apart(one: FloatArray, other: FloatArray) -> float:
    """Distance of two links, by samples."""
    share = np.linspace(0.0, 1.0, 101)[:, None]
    points = [link[0] + share * (link[1] - link[0]) for link in (one, other)]
    return float(np.min(np.linalg.norm(points[0][:, None] - points[1], axis=2)))


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 10_000), st.booleans(), st.booleans())
def test_chains_are_what_was_asked_for(seed: int, exact: bool, directed: bool) -> None:
    """Links of every part touch nothing, and bend no more than they may; both ends are met, with one gap at most."""
    chains = chains_of(18 if exact else 24, exact=exact)
    goal = WayEnd(np.array([0.6, 0.1, 0.05]), np.array([0.8, 0.6, 0.0]) if directed else None)
    rng = np.random.default_rng(seed)
    for strays in (0.0, 0.3):
        for chain in chains.grown(START, goal, KEPT, GAP, strays, rng)[:6]:
            looked_at(chain, chains, goal)


def test_chains_pass_plates_that_overlap() -> None:
    """There are some through the gaps on different sides, the same for the same seed."""
    chains = chains_of(24, exact=False)
    goal = WayEnd(np.array([0.6, 0.1, 0.05]), None)
    first, again = (
        [chain for seed in range(6) for chain in chains.grown(START, goal, KEPT, GAP, 0.0, np.random.default_rng(seed))]
        for _ in range(2)
    )
    assert len(first) > 0
    assert np.array_equal(first[0].places, again[0].places)


def test_a_clamped_chain_begins_straight() -> None:
    """Joints that may not bend do not."""
    chains = chains_of(18, exact=True)
    chains.limits[:4] = 0.0
    goal = WayEnd(np.array([0.7, 0.0, 0.1]), None)
    found = [
        chain for seed in range(8) for chain in chains.grown(START, goal, KEPT, GAP, 0.3, np.random.default_rng(seed))
    ]
    assert all(np.max(np.abs(chain.before[:5, 1:]), initial=0.0) < 1e-12 for chain in found)


def test_no_pose_at_the_goal_is_a_failure_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no chain becomes a pose, no tree grows, and the failure does not speak of trees."""
    task = task_of(space_arm(8), boxes(BOXES), GoalPose(np.array([0.6, 0.1, 0.05])))
    monkeypatch.setattr(sampled_run, "chained_goal_poses", lambda *_: [])
    failures: list[Failure] = []
    assert SpaceRun.from_task(task).by_chains(0, failures) is None
    assert [failure.message for failure in failures] == ["no collision-free pose at the goal was found"]


def test_few_new_poses_are_made_of_one_growth() -> None:
    """They differ from each other and from those known, and none is made after the deadline."""
    task = task_of(space_arm(16, link_length=0.05), boxes(BOXES[:1]), GoalPose(np.array([0.6, 0.1, 0.05])))
    run = SpaceRun.from_task(task)
    points = CurvePoints(run.stepper, run.start)
    known: list[Pose] = []
    for turn in range(6):
        found = chained_goal_poses(task, points, known, turn, np.random.default_rng(turn))
        assert len(found) <= 6
        known += found
    assert len(known) > 1
    for i, pose in enumerate(known):
        for other in known[:i]:
            assert np.max(np.linalg.norm(pose.points - other.points, axis=1)) >= 0.03 * task.arm.length
    late = replace(task, deadline=Deadline.after(0.0))
    assert chained_goal_poses(late, points, [], 0, np.random.default_rng(0)) == []
