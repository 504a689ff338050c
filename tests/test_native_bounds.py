"""Extreme numbers at every door into C: an error in words or an answer, and never memory that is another's.

``python -m tests.sanitizers`` watches what the doors let through.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import CcmError, ProblemError
from ccm_opt.dynamics.algorithms.arm_model import arm_model
from ccm_opt.dynamics.runtime.inverse_dynamics import ForwardDynamics, InverseDynamics
from ccm_opt.dynamics.simulation.controller import CompiledLoop
from ccm_opt.planning import followable_ways
from ccm_opt.planning.curve_map import poses_with
from ccm_opt.planning.followable_ways import FollowSearch, WayArcs, WayEnd
from ccm_opt.planning.grid_ways import TipGrid
from ccm_opt.planning.limits.clearance_rows import free_half_planes
from ccm_opt.planning.sampled_check import SampledCheck
from ccm_opt.planning.surface_certificate import SpaceCertificate
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.contact_finder import SurfaceFinder, WallFinder, nearest_links
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.dynamics_arms import swan_neck
from tests.oracles.space_certificate import bows
from tests.scenes import ROOM, make_arm, mixed_walls
from tests.snakes_in_space import snake
from tests.surface_scenes import random_segments, random_triangles, triangle_soup

LINKS = 5
EXTREMES = (0.0, -0.0, 1.0, -0.3, 5e-324, 1e-310, 1e15, 1e39, -1e39, 1e154, 1e308, -1e308, np.inf, -np.inf, np.nan)
numbers = st.sampled_from(EXTREMES) | st.floats(-2.0, 2.0)
pytestmark = [
    pytest.mark.filterwarnings("ignore::RuntimeWarning"),  # numpy tells of what is no number
    pytest.mark.filterwarnings("ignore:.*invalid value:RuntimeWarning"),
]
attack = settings(max_examples=40, deadline=None)


def table(*shape: int) -> st.SearchStrategy[FloatArray]:
    """Arrays of a shape, extreme here and there."""
    return arrays(np.float64, shape, elements=numbers)


@attack
@example(vertices=np.eye(6, 3), rounding=np.nan, segments=np.zeros((4, 2, 3)), reach=1.0)
@given(vertices=table(6, 3), rounding=numbers, segments=table(4, 2, 3), reach=numbers)
def test_surfaces(vertices: FloatArray, rounding: float, segments: FloatArray, reach: float) -> None:
    """Meshes beyond single precision are refused before a tree is built; any segment and reach may be asked for."""
    faces = np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 5], [0, 0, 0], [5, 1, 0]] * 4)
    with suppress(ProblemError):
        MeshBody.of_arrays(vertices, faces)
    triangles = vertices[faces]
    scenes = [triangle_soup(triangles, np.full(len(faces), rounding), np.zeros(len(faces), dtype=np.intp))]
    scenes.append(random_triangles(np.random.default_rng(1), 30))
    for scene in scenes:
        with suppress(ProblemError):
            tree = SurfaceTree.from_triangles(scene)
            assert np.all(np.isfinite(scene.triangles))
            assert np.all(np.isfinite(scene.rounding))
            tree.distances(segments, reach, 1e-3)
            tree.nearest(segments, reach, 2)
            tree.planes(segments, reach)
            tree.grid(segments[0, 0], float(segments[0, 1, 0]), (3, 2, 4), reach)


@pytest.mark.parametrize("far", [1e39, 1e308, np.inf, np.nan, -1e200])
def test_places_beyond_are_refused_in_words(far: float) -> None:
    """Neither a mesh made in Python nor a scene that was moved there gets into C."""
    with pytest.raises(ProblemError, match="within 1e"):
        MeshBody.of_arrays([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, far, 0.0]], [[0, 1, 2]])
    scene = random_triangles(np.random.default_rng(2), 9)
    with pytest.raises(ProblemError, match="the scene reaches to"):
        SurfaceTree.from_triangles(replace(scene, triangles=scene.triangles + far))


def links_finder(arm: Arm) -> SurfaceFinder:
    """Finds the links of an arm that are near each other."""
    return SurfaceFinder(arm, SurfaceTree.from_triangles(TriangleSoup.joined([])), (), 0.0, 0.01, 0.1)


@attack
@given(q=table(2 * LINKS), other=table(2 * LINKS), depth=st.integers(-3, 10**9))
def test_arms_in_space(q: FloatArray, other: FloatArray, depth: int) -> None:
    """Bends of any size have places, or none; no interval of what is no number is proved, however deep."""
    arm = snake(LINKS)
    arm.joint_positions_at(q)
    chain = poses_with(arm, other[None, :2], q[None], np.outer(other, [1.0, 2.0]))[0]
    bows(arm, arm.link_rotations(other), q)
    finder = links_finder(arm)
    finder.near_links(chain.points, 0.1)
    nearest_links(arm, np.stack((chain.points, chain.points)), np.inf)
    for points in (np.outer(np.arange(LINKS + 1), q[:3]), np.resize(other, (LINKS + 1, 3))):
        finder.near_links(points, 0.3)
    certificate = SpaceCertificate(arm, SurfaceTree.from_triangles(random_triangles(np.random.default_rng(3), 20)))
    safe = certificate.safe(q, other, min(depth, 12))
    assert not safe or np.all(np.isfinite(q) & np.isfinite(other))


def test_arrays_of_another_shape_are_refused() -> None:
    """What C would read beyond is told with the shape that it must have."""
    arm = snake(LINKS)
    tree = SurfaceTree.from_triangles(random_triangles(np.random.default_rng(3), 20))
    refused = (
        lambda: arm.joint_positions_at(np.zeros(2 * LINKS - 1)),
        lambda: arm.link_rotations(np.zeros((3, 2))),
        lambda: poses_with(arm, np.zeros((1, 1)), np.zeros((1, 3)), np.zeros((3, 1))),
        lambda: links_finder(arm).near_links(np.zeros((LINKS, 3)), 1.0),
        lambda: nearest_links(arm, np.zeros((2, LINKS, 3)), 1.0),
        lambda: tree.distances(np.zeros((4, 3)), 1.0),
        lambda: tree.nearest(np.zeros((5, 2, 3)), 1.0, 2),
        lambda: Certificate(make_arm(LINKS, 0.01), Workspace(ROOM)).failures(np.zeros((3, LINKS - 1))),
    )
    for ask in refused:
        with pytest.raises(ValueError, match=r"shape|expected"):
            ask()


@pytest.mark.drawn(20, of="dear tests")
@attack
@given(headings=table(3, LINKS), reach=numbers)
def test_arms_in_the_plane(headings: FloatArray, reach: float) -> None:
    """Headings of any size touch, or are free; none that are no number are certified."""
    arm = make_arm(LINKS, 0.01)
    room = mixed_walls()
    failures = Certificate(arm, room).failures(arm.bends(headings), depth=3)
    still = np.isfinite(headings).all(axis=1)
    assert set(np.flatnonzero(~(still[:-1] & still[1:]))) <= set(failures.tolist())
    finder = WallFinder(arm, room.flat_walls, 0.0, 0.0, min(abs(reach), 1e3))
    finder.find(arm.joint_positions(headings[0]))
    finder.find(np.resize(headings, (LINKS + 1, 2)))
    shares = SampledCheck.for_workspace(arm, room).free_shares(headings[:2], headings[1:])
    assert np.all((shares >= 0.0) & (shares <= 1.0))
    walls = room.wall_segments
    free_half_planes(np.resize(headings, (2, 6, 2)), walls, abs(reach))


@attack
@given(corner=table(2), size=numbers)
def test_obstacles_in_the_plane(corner: FloatArray, size: float) -> None:
    """An obstacle of any size and place is refused, or its walls are met."""
    arm = make_arm(LINKS, 0.01)
    with suppress(CcmError, ValueError, shapely.errors.GEOSException):
        room = Workspace(ROOM, (Obstacle("far", PlaneShape(shapely.box(*corner, *(corner + size)))),))
        Certificate(arm, room).failures(np.zeros((2, LINKS)), depth=2)
        WallFinder(arm, room.flat_walls, 0.0, 0.0, 0.1).find(arm.joint_positions(np.zeros(LINKS)))


@attack
@given(place=table(3), frame=table(3, 3), goal=table(3), directed=st.booleans())
def test_followable_ways(place: FloatArray, frame: FloatArray, goal: FloatArray, directed: bool) -> None:
    """Ways may begin and end anywhere, in any frame."""
    arcs = WayArcs.for_radius(0.1, 0.3, 0.05)
    shape = (4, 5, 6)
    search = FollowSearch(np.zeros(3), 0.05, np.ones(shape, np.float32), np.ones(shape), arcs, 0.3, 0.1, 2.0)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(followable_ways, "MOST_STATES", 50)
        search.connecting_arc_indices(place, frame, WayEnd(goal, frame[0] if directed else None))


@attack
@given(price=arrays(np.float32, (3, 4, 2), elements=st.floats(width=32)), gaps=table(3, 4, 2))
def test_ways_through_grids(price: FloatArray, gaps: FloatArray) -> None:
    """Prices and gaps may be anything."""
    grid = TipGrid(np.zeros(3), 0.1, gaps, 1.0, 0.01)
    grid._settled(price, (0, 0, 0), None)
    if np.any(price > 0.0):
        grid._settled(price, (0, 0, 0), (2, 3, 1))


@attack
@given(states=table(3, 2, 3 * LINKS), feed=numbers, computed=st.booleans())
def test_dynamics(states: FloatArray, feed: float, computed: bool) -> None:
    """States of any size have torques and accelerations, be they no numbers."""
    arm = swan_neck(LINKS)
    gravity = np.array([0.0, 0.0, -9.81])
    InverseDynamics(arm, gravity).feed_forces(*states, feed)
    ForwardDynamics(arm, gravity).with_feed(*states, feed)
    model = arm_model(arm, gravity)
    width = 3 * LINKS + 1
    each = np.ones(width)
    options = {"step": 1e-3, "computed": computed, "kp": each, "kd": each, "limit": each, "carried": each[:1]}
    loop = CompiledLoop(model, model, options)
    reference = np.resize(states, (4, 3, width))
    noise = np.resize(states, (4, 2, width - 1))
    loop.run(np.resize(states, (2, width)), reference, noise, 10**12)
    loop.run(np.resize(states, (2, width)), reference, noise, -(10**12))
    for wrong in (reference[:, :, :-1], reference[:, :2]):
        with pytest.raises(ValueError, match="expected"):
            loop.run(np.zeros((2, wrong.shape[2])), wrong, noise, 0)
    with pytest.raises(ValueError, match="noise"):
        loop.run(np.zeros((2, width)), reference, noise[:3], 0)


def test_nothing_is_asked_of_nothing() -> None:
    """Empty arrays are answered by empty ones."""
    arm = snake(LINKS)
    assert arm.joint_positions_at(np.zeros((0, 2 * LINKS))).shape == (0, LINKS + 1, 3)
    tree = SurfaceTree.from_triangles(random_triangles(np.random.default_rng(3), 20))
    assert len(tree.distances(np.zeros((0, 2, 3)), 1.0)) == 0
    assert len(tree.planes(np.zeros((0, 2, 3)), 1.0).gap) == 0
    assert len(nearest_links(arm, np.zeros((0, LINKS + 1, 3)), 1.0).gap) == 0
    assert len(Certificate(make_arm(LINKS, 0.01), Workspace(ROOM)).failures(np.zeros((1, LINKS)))) == 0
    assert len(random_segments(np.random.default_rng(1), 0)) == 0
