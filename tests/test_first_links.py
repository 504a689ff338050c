"""The proof that the first links cannot turn to a goal for the whole arm: true where it speaks, and it speaks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from ccm_opt.cli.compare.suites import Scene, clutter, random_polygon
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import UnreachableGoal
from ccm_opt.diagnosis.checks import CHEAP_CHECKS, failed
from ccm_opt.diagnosis.explain import refuse_closed
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.problem import JointPose, Problem, Tolerances
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .scenes import make_arm

ROOM = shapely.box(-1.3, -1.3, 1.3, 1.3)
POST = shapely.box(0.075, -0.03, 0.12, 0.03)
"""So near before the base that two links of 42 mm that bend by 60° cannot turn past it."""


def whole_arm_problem(obstacles: tuple[Obstacle, ...], start: FloatArray, goal: FloatArray) -> Problem:
    """From one pose of the whole arm to another, by bends."""
    arm = make_arm(24)
    scene = Scene(arm, Workspace(ROOM, obstacles), arm.headings(start), arm.headings(goal))
    return scene.problem(JointPose(goal), 20.0)


def past_post(first: float, last: float, post: shapely.Polygon = POST) -> Problem:
    """A straight arm that turns from one side of a post to the other [rad]."""
    straight = np.zeros(24)
    return whole_arm_problem((Obstacle("post", PlaneShape(post)),), straight + first * _BASE, straight + last * _BASE)


_BASE = np.eye(24)[0]


def hemmed_in(problem: Problem) -> bool:
    """Whether the necessary checks say so, as proved."""
    return any(finding.kind == "hemmed in" and finding.proved for finding in failed(problem))


def test_a_post_before_the_base_is_named_with_what_helps() -> None:
    """The post is named, without it nothing is proved, and the whole turn that leads round it is told."""
    problem = past_post(2.0, -2.0)
    (found,) = failed(problem, CHEAP_CHECKS)
    assert (found.kind, found.obstacles, found.proved) == ("hemmed in", ("post",), True)
    assert "with joint 1 at 245.4°, a whole turn away, they lie the same way" in found.reason
    assert not hemmed_in(replace(problem, workspace=problem.workspace.without_obstacle("post")))
    # The bound is what the radius must fall below at least: an arm between it and the arm's own is shut off, too.
    thinner = replace(problem.arm, radius=0.5 * (found.bounds["arm.radius"] + problem.arm.radius))
    assert hemmed_in(replace(problem, arm=thinner))
    assert not hemmed_in(past_post(2.0, 2.0 * np.pi - 2.0))


def test_two_links_are_shut_off_where_a_dense_look_at_their_bends_says_so() -> None:
    """An independent look, by shapely at every degree, finds the poses of two links in two pieces, too."""
    arm = make_arm(24)
    base = np.deg2rad(np.arange(-150.0, 151.0))
    second = np.deg2rad(np.arange(-60.0, 61.0))
    headings = np.stack(np.broadcast_arrays(base[:, None], base[:, None] + second), axis=-1)
    joints = arm.link_length * np.cumsum(np.stack((np.cos(headings), np.sin(headings)), axis=-1), axis=2)
    lines = np.concatenate((np.zeros((*headings.shape[:2], 1, 2)), joints), axis=2)
    free = shapely.distance(shapely.linestrings(lines), POST) > arm.radius
    pieces, _ = ndimage.label(free, structure=np.ones((3, 3)))
    start, goal = (int(pieces[np.argmin(np.abs(base - turn)), 60]) for turn in (2.0, -2.0))
    assert 0 < start != goal > 0


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=4)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_a_known_motion_passes_is_not_proved_shut(seed: int) -> None:
    """Polygons strewn beside a known motion of the arm prove nothing against it, however near the base they are."""
    rng = np.random.default_rng(seed)
    arm = make_arm(24)
    ways = rng.uniform(-1.0, 1.0, (3, 24)) * arm.bend_limits * np.where(np.arange(24), 1.0, 0.5)
    share = np.linspace(0.0, 1.0, 200)[:, None]
    bends = np.vstack([a + share * (b - a) for a, b in pairwise(ways)])
    # Only the first three links count; the others may touch each other and the walls.
    swept = shapely.MultiLineString([arm.joint_positions(pose)[:4] for pose in arm.headings(bends)])
    obstacles = [
        Obstacle(f"polygon {k}", PlaneShape(random_polygon(rng, rng.uniform(-0.2, 0.2, 2)))) for k in range(30)
    ]
    beside = tuple(obstacle for obstacle in obstacles if shapely.distance(obstacle.core, swept) > arm.radius)
    problem = whole_arm_problem(beside, ways[0], ways[-1])
    assert not hemmed_in(problem)


@pytest.mark.parametrize("curve", [0.0, 0.02])
def test_a_goal_within_tolerance_of_the_open_side_is_not_refused(curve: float) -> None:
    """A goal that may be missed by as much as leads to the start's own side is no proof."""
    problem = past_post(2.0, -2.0)
    wide = replace(problem, tolerances=Tolerances(position=1e-3, heading=4.0 + curve))
    assert hemmed_in(problem)
    assert not hemmed_in(wide)


@pytest.mark.drawn(6, of="whole plans")
def test_the_search_asks_for_the_proof_before_what_takes_long() -> None:
    """Three links that are shut off end the search as unreachable."""
    scene = clutter(8086, 30)
    problem = scene.problem(JointPose(scene.arm.bends(scene.goal)), 20.0)
    assert not any(finding.kind == "hemmed in" for finding in failed(problem, CHEAP_CHECKS))
    (found,) = (finding for finding in failed(problem) if finding.kind == "hemmed in")
    assert "first 3 links" in found.reason
    with pytest.raises(UnreachableGoal, match="first 3 links"):
        MotionPlanner(refuse=refuse_closed).plan(problem)
