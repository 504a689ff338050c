"""What is sampled of straight motions in space agrees with distances of densely sampled poses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.planning.rrt_connect import PointTree
from ccm_opt.planning.sampled_motions import SampledMotions
from ccm_opt.problem import Problem
from ccm_opt.robot.base_axes import BaseAxis
from ccm_opt.robot.coordinates import DriveLimits
from ccm_opt.scene.distances.surface_tree import SurfaceTree

CARRIER = (
    BaseAxis(np.array([0.0, 0.6, 0.8]), -0.6, 0.6, revolute=True, point=np.array([0.1, 0.0, 0.2])),
    BaseAxis(np.array([1.0, 0.0, 0.0]), -0.6, 0.6, revolute=False),
)
"""Axes below an arm."""
POSES = 150
"""Of a motion that are looked at."""


def scene(seed: int) -> Problem:
    """A short arm among balls and boxes."""
    rng = np.random.default_rng(seed)
    bodies: dict[str, object] = {}
    for k in range(6):
        center, radius = rng.uniform(-0.6, 0.6, 3), rng.uniform(0.03, 0.1)
        if np.linalg.norm(center) > radius + 0.02:  # clear of the base
            bodies[f"ball {k}"] = {"sphere": {"center": center.tolist(), "radius": radius}}
    for k in range(4):
        low = rng.uniform(-0.6, 0.5, 3)
        high = low + rng.uniform(0.02, 0.2, 3)
        if np.linalg.norm(np.clip(0.0, low, high)) > 0.02:  # clear of the base
            bodies[f"box {k}"] = {"box": [low.tolist(), high.tolist()]}
    return ccm_opt.make_problem(
        "sampled",
        arm={"links": 8, "link_length": 0.08, "radius": 0.015, "joint_limit_deg": 60, "base": {"position": (0, 0, 0)}},
        obstacles=bodies,
        limits={"velocity": 1.0, "acceleration": 4.0},
        goal={"position": (0.3, 0.0, 0.2)},
    )


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10_000), carried=st.booleans())
def test_motions_are_free_as_far_as_samples_say(seed: int, carried: bool) -> None:
    """Up to the share no link is deeper in anything than half its radius; beyond it something is touched."""
    problem = scene(seed)
    if carried:
        limits = replace(problem.limits, axes=DriveLimits(*np.ones((4, 2))))
        problem = replace(problem, arm=replace(problem.arm, mount_length=0.0, carrier=CARRIER), limits=limits)
    arm = problem.arm
    tree = SurfaceTree.from_triangles(problem.workspace.triangle_soup)
    motions = SampledMotions(arm, tree, 0.0, problem.workspace.extent)
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(-0.6, 0.6, (2, 6, len(arm.coordinates)))
    shares = motions.free_shares(start, end)
    assert np.all((shares >= 0.0) & (shares <= 1.0))
    for first, last, share in zip(start, end, shares, strict=True):
        gaps = np.array([gap(problem, tree, first + u * (last - first)) for u in np.linspace(0.0, 1.0, POSES)])
        before = np.linspace(0.0, 1.0, POSES) <= share
        if share > 0.0:
            assert gaps[before].min() > -0.5 * arm.radius
        if share < 1.0:
            assert gaps.min() < 0.05 * arm.radius


def gap(problem: Problem, tree: SurfaceTree, q: np.ndarray) -> float:
    """Least gap of a pose to surfaces and between links [m]."""
    arm = problem.arm
    points = arm.joint_positions_at(q)
    _, axes = arm.exposed_links(points)
    first, second = arm.self_pairs
    least = float(tree.distances(axes, 1.0).min()) - arm.radius
    for i, j in zip(first, second, strict=True):
        s = np.linspace(0.0, 1.0, 20)[:, None]
        one = points[i] + s * (points[i + 1] - points[i])
        other = points[j] + s * (points[j + 1] - points[j])
        apart = np.linalg.norm(one[:, None] - other[None], axis=-1).min()
        least = min(least, float(apart) - 2.0 * arm.radius)
    return least


def test_a_bend_beyond_its_limit_ends_a_motion() -> None:
    """The end of a motion keeps the limits of all joints, or nothing of the motion counts."""
    problem = replace(scene(0), workspace=replace(scene(0).workspace, obstacles=()))
    arm = problem.arm
    motions = SampledMotions(arm, SurfaceTree.from_triangles(problem.workspace.triangle_soup), 0.0, np.zeros((0, 3)))
    end = np.zeros((1, 2 * arm.links))
    end[0, 5] = 1.1 * arm.joint_limit
    assert motions.free_shares(np.zeros_like(end), end) == pytest.approx(0.0)
    assert motions.free_shares(np.zeros_like(end), 0.5 * end) == pytest.approx(1.0)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_trees_grow_from_their_nearest_nodes_until_they_meet(seed: int) -> None:
    """Where nothing is in the way, an extension hangs on the nearest node, no longer than asked, and the trees meet."""
    problem = replace(scene(0), workspace=replace(scene(0).workspace, obstacles=()))
    arm = replace(problem.arm, self_collision=False)
    motions = SampledMotions(arm, SurfaceTree.from_triangles(problem.workspace.triangle_soup), 0.0, np.zeros((0, 3)))
    size = 2 * arm.links
    rng = np.random.default_rng(seed)
    own, other = PointTree.empty(size), PointTree.empty(size)
    own.add(rng.uniform(-0.5, 0.5, (5, size)), np.full(5, -1))
    other.add(rng.uniform(-0.5, 0.5, (3, size)), np.full(3, -1))
    target = rng.uniform(-0.5, 0.5, (1, size))
    nearest = int(np.argmin(np.linalg.norm(own.nodes - target, axis=1)))
    for tree in (own, other):
        tree.reserve(4)
    call = motions.connection(np.zeros(size), np.eye(size), {
        "size": size, "longest": 0.1, "end": np.empty(size), "own": own.for_c, "other": other.for_c,
        "targets": 1, "target": target, "fresh": 5,
    })  # fmt: skip
    call()
    assert call.fields.growth.own.count == 6
    assert own.parents[5] == nearest
    step = own.points[5] - own.points[nearest]
    assert np.linalg.norm(step) == pytest.approx(min(0.1, np.linalg.norm(target - own.points[nearest])))
    assert list(call.fields.growth.met) == [5, int(np.argmin(np.linalg.norm(other.nodes - own.points[5], axis=1)))]
