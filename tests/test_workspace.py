"""The workspace's questions about its walls, against looking at every wall."""

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.scene.workspace import Workspace
from tests.scenes import clutter, mixed_walls


def shape_at(rng: np.random.Generator) -> shapely.Geometry:
    """A point, a line or several points, in the room or out of it."""
    places = rng.uniform(-1.5, 1.5, (5, 2))
    return (shapely.Point(places[0]), shapely.LineString(places), shapely.MultiPoint(places))[int(rng.integers(3))]


def gaps(room: Workspace, shape: shapely.Geometry) -> np.ndarray:
    """Distances of a shape from every wall, one by one [m]."""
    return np.array([shapely.distance(wall.core, shape) - wall.rounding for wall in room.walls])


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), mixed=st.booleans())
def test_the_nearest_wall_is_the_nearest_of_all(seed: int, *, mixed: bool) -> None:
    """The wall named has the least of all distances, and all distances are those to the walls one by one."""
    room = mixed_walls() if mixed else clutter(seed % 40, 20).workspace
    shape = shape_at(np.random.default_rng(seed))
    wall, gap = room.nearest(shape)
    every = gaps(room, shape)
    assert gap == every.min() == every[wall]
    assert np.array_equal(room.apart(shape), every)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), mixed=st.booleans(), distance=st.floats(0.0, 1.0))
def test_the_room_nearby_has_the_obstacles_within_the_distance(seed: int, distance: float, *, mixed: bool) -> None:
    """Those obstacles stay that come within the distance of a shape, in their order."""
    room = mixed_walls() if mixed else clutter(seed % 40, 20).workspace
    shape = shape_at(np.random.default_rng(seed))
    within = gaps(room, shape)[:-1] <= distance
    kept = tuple(obstacle for obstacle, near in zip(room.obstacles, within, strict=True) if near)
    assert room.near(shape, distance).obstacles == kept
