"""Problems in the plane that are planned in space, where each joint bends about the normal of the plane alone."""

import itertools
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.planning.plane_in_space import needs_space, problem_in_space
from ccm_opt.problem import Problem
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .benchmarks.bench_random_arms import toml
from .benchmarks.swept_file import broken_promises

ROW = {"links": 3, "link_length": 0.06, "radius": 0.015, "joint_limit_deg": 45.0}
FED: dict[str, Any] = {
    "schema": 1,
    "name": "fed",
    "workspace": {
        "bounds": [-0.6, -0.5, 0.9, 0.6],
        "clearance": 0.002,
        "obstacles": [
            {"name": "lower wall", "box": [0.05, -0.5, 0.1, -0.06]},
            {"name": "upper wall", "box": [0.05, 0.06, 0.1, 0.6]},
            {"name": "pipe", "circle": {"center": [0.35, -0.1], "radius": 0.05}},
        ],
    },
    "arm": {
        "base": [0.0, 0.0],
        "base_heading_deg": 0.0,
        "feed": {"range": [-0.5, 0.1]},
        "sections": [{**ROW, "links": 6, "locked": [3]}, {**ROW, "link_length": 0.05, "radius": 0.012}],
        "tool": {
            "tip": [0.04, 0.02],
            "direction": [0.0, 1.0],
            "bodies": [{"capsule": {"from": [0.0, 0.0], "to": [0.03, 0.02], "radius": 0.008}}],
            "mass": 0.1,
        },
    },
    "limits": {"velocity": 1.5, "acceleration": 6.0, "feed_velocity": 0.3, "feed_acceleration": 1.0},
    "start": {"shape": "straight", "feed": -0.45},
    "goal": {"position": [0.4, 0.2], "heading_deg": 120.0},
}


@cache
def free_problem() -> Problem:
    """A problem in the plane without obstacles."""
    return ccm_opt.make_problem(
        "free",
        arm=ccm_opt.Arm.snake(length=0.5, links=6, radius=0.01),
        limits={"velocity": 1.0, "acceleration": 4.0},
        room=(-2.0, -2.0, 2.0, 2.0),
        goal={"position": (0.3, 0.1)},
    )


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_places_and_distances_are_those_of_the_plane(seed: int) -> None:
    """Joints are in the same places, as far from prisms as from their outlines, and in prisms if in outlines."""
    rng = np.random.default_rng(seed)
    frame = shapely.box(0.1, 0.1, 0.4, 0.3).difference(shapely.box(0.2, 0.15, 0.3, 0.25))
    shapes = (
        PlaneShape(shapely.affinity.rotate(frame, rng.uniform(0.0, 360.0), origin=(0.0, 0.0))),
        PlaneShape(shapely.LineString(rng.uniform(-0.5, 0.5, (3, 2))), rng.uniform(0.0, 0.05)),
        PlaneShape(shapely.MultiPoint(rng.uniform(-0.5, 0.5, (3, 2))), 0.02),
    )
    room = shapely.Polygon([(-0.7, -0.7), (0.9, -0.6), (0.7, 0.8), (0.0, 0.6), (-0.6, 0.7)])
    workspace = Workspace(room, tuple(Obstacle(f"shape {k}", shape) for k, shape in enumerate(shapes)))
    arm = ccm_opt.Arm.snake(length=0.5, links=6, radius=0.01, heading_deg=rng.uniform(-180.0, 180.0))
    flat = replace(free_problem(), arm=arm, workspace=workspace)
    whole = problem_in_space(flat)
    bends = rng.uniform(-1.0, 1.0, 6)
    points = flat.arm.joint_positions_at(bends)
    in_space = whole.arm.joint_positions_at(np.column_stack((np.zeros(6), -bends)).ravel())
    np.testing.assert_array_equal(in_space[:, 1], 0.0)
    np.testing.assert_allclose(in_space[:, [0, 2]], points, atol=1e-12)
    links = np.stack((in_space[:-1], in_space[1:]), axis=1)
    gaps = SurfaceTree.from_triangles(whole.workspace.triangle_soup).nearest(links, 0.1).gap
    outlines = [(shapely.boundary(shapes[0].core), 0.0), (room.exterior, 0.0)]
    outlines += [(each.core, each.rounding) for each in shapes[1:]]
    lines = [shapely.LineString(ends) for ends in itertools.pairwise(points)]
    expected = [min(shapely.distance(core, line) - rounding for core, rounding in outlines) for line in lines]
    apart = np.minimum(expected, 0.1)
    assert np.all(gaps <= apart + 1e-9)
    if room.contains(shapely.LineString(points)):
        np.testing.assert_allclose(gaps, apart, atol=1e-9)
    for place, point in zip(in_space, points, strict=True):
        depth = depth_inside(whole.workspace.obstacles[0].body, place)
        within = shapely.contains(shapes[0].core, shapely.Point(point))
        assert abs(depth) < 1e-9 or (depth > 0.0) == within


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_a_fed_arm_with_a_tool_and_a_locked_joint_is_planned_in_space(tmp_path: Path) -> None:
    """Through a gap, by the commands; the plan touches nothing and keeps its limits by a model of its own."""
    file = tmp_path / "fed.toml"
    file.write_text(toml(FED))
    assert needs_space(ccm_opt.load_problem(file).arm)
    solved = CliRunner().invoke(app, ["solve", str(file), "--out", str(tmp_path), "--no-pictures"])
    assert solved.exit_code == 0, solved.output
    with np.load(tmp_path / "fed" / "solution.npz") as arrays:
        assert broken_promises(FED, dict(arrays)) == []
        assert np.all(arrays["bend_angles"][:, 2] == 0.0)
    assert CliRunner().invoke(app, ["check", str(tmp_path / "fed")]).exit_code == 0
    record = json.loads((tmp_path / "fed" / "solution.json").read_text())
    assert record["simulation"]["outcome"] == "followed"
