"""Simplified outlines against shapely, and the neighbourhood of an arm against its whole room."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.neighbourhood import neighbourhood, route_workspace, simplified
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .benchmarks.polygon_fields import FieldKind, polygon_field
from .scenes import random_headings


def wavy(rng: np.random.Generator, vertices: int) -> shapely.Polygon:
    """A smooth outline with dents, with a hole that follows it."""
    angles = 2.0 * np.pi * np.arange(vertices) / vertices
    radius = 0.1 + 0.02 * np.cos(rng.integers(2, 6) * angles) + 0.01 * np.sin(rng.integers(2, 9) * angles)
    ring = radius[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    return shapely.Polygon(ring, [0.5 * ring[::-1]])


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), vertices=st.integers(50, 3000), error=st.sampled_from((1e-6, 1e-5, 1e-4, 1e-3)))
def test_a_simplified_obstacle_contains_the_old_one(seed: int, vertices: int, error: float) -> None:
    """Every point of the old obstacle lies in the new one, which reaches no farther than twice the error beyond it."""
    obstacle = Obstacle("wavy", PlaneShape(wavy(np.random.default_rng(seed), vertices), 0.003))
    simple = simplified(obstacle, error)
    grown = shapely.buffer(simple.core, simple.rounding - obstacle.rounding + 1e-12, quad_segs=64)
    assert grown.covers(obstacle.core)
    assert simple.rounding - obstacle.rounding <= error * (1.0 + 1e-9)
    assert shapely.hausdorff_distance(shapely.boundary(simple.core), shapely.boundary(obstacle.core)) <= 2.0 * error


def test_many_vertices_become_few() -> None:
    """An outline of 40 000 vertices keeps hundreds within a ten-thousandth of a metre."""
    simple = simplified(Obstacle("wavy", PlaneShape(wavy(np.random.default_rng(3), 40_000))), 1e-4)
    assert shapely.get_num_coordinates(simple.core) < 500


def test_every_smooth_outline_becomes_simple() -> None:
    """Among a hundred smooth outlines none keeps its 2000 vertices, wherever it begins."""
    obstacles = polygon_field(102, FieldKind(100, vertices=2000)).workspace.obstacles
    kept = [shapely.get_num_coordinates(simplified(each, 5e-5).core) for each in obstacles]
    assert max(kept) < 300


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_walls_left_out_are_out_of_reach(seed: int) -> None:
    """No pose comes near a wall that the neighbourhood leaves out; none at the goal near one that routes leave out."""
    scene = polygon_field(seed, FieldKind(400))
    problem = scene.problem()
    ends = resolve_ends(problem)
    near = neighbourhood(problem, ends)
    out = [each.core for each in problem.workspace.obstacles if each not in near.workspace.obstacles]
    assert out
    axis = shapely.LineString(scene.arm.joint_positions(random_headings(np.random.default_rng(seed), scene.arm, 1.0)))
    assert shapely.distance(axis, out).min() > scene.arm.radius
    routes = route_workspace(near, ends)
    beside = [each.core for each in near.workspace.obstacles if each not in routes.obstacles]
    at_goal = shapely.LineString(scene.arm.joint_positions(scene.goal))
    assert shapely.distance(at_goal, beside).min() > scene.arm.radius


@pytest.mark.parametrize("seed", [0, 1])
def test_a_walk_ends_among_the_polygons_of_a_field(seed: int) -> None:
    """The goal of a field in which a way is known touches no polygon, and is another pose than the start."""
    scene = polygon_field(seed, FieldKind.known(64))
    axis = shapely.LineString(scene.arm.joint_positions(scene.goal))
    assert (
        min(shapely.distance(axis, each.core) - each.rounding for each in scene.workspace.obstacles) > scene.arm.radius
    )
    assert not np.allclose(scene.goal, scene.start)


def test_a_room_of_few_walls_stays_as_it_is() -> None:
    """Where every wall is near and simple, planning sees the very workspace of the problem."""
    scene = polygon_field(1, FieldKind(100))
    middle = shapely.Point(scene.arm.base)
    few = tuple(each for each in scene.workspace.obstacles if shapely.distance(each.core, middle) < scene.arm.length)
    near = replace(scene, workspace=Workspace(scene.workspace.boundary, few)).problem()
    assert neighbourhood(near, resolve_ends(near)).workspace is near.workspace
