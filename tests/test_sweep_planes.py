"""Half-planes round sweeps in C against numpy."""

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import SHORTEST
from ccm_opt.planning.limits.clearance_rows import free_half_planes
from tests.oracles.sweep_planes import planes_by_numpy
from tests.scenes import clutter, mixed_walls


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    far=st.sampled_from((0.01, 0.1, 0.6)),
    size=st.sampled_from((1e-9, 0.02, 0.2)),
    cluttered=st.booleans(),
)
def test_compiled_half_planes_are_those_of_numpy(seed: int, far: float, size: float, *, cluttered: bool) -> None:
    """Whatever the sweeps, the walls and the reach, C and numpy find the same half-planes in the same order."""
    workspace = clutter(seed % 7, 30).workspace if cluttered else mixed_walls()
    walls = workspace.wall_segments
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.0, 1.0, (40, 1, 2)) + rng.normal(0.0, size, (40, 6, 2))
    compiled = free_half_planes(corners, walls, far)
    by_numpy = planes_by_numpy(corners, walls, far)
    # A wall within rounding of the reach, or two at nearly the same distance, may fall either way.
    links = shapely.linestrings(corners[:, 2:4])
    cut = walls.tree.query(links, predicate="dwithin", distance=10.0 * SHORTEST)[0]
    # A link that a wall cuts half-way has no direction to keep from it; certified motions have none.
    for sweep in np.setdiff1d(np.arange(len(corners)), cut):
        one, other = (np.column_stack((p[1], p[2]))[p[0] == sweep] for p in (compiled, by_numpy))
        assert len(one) == len(other)
        apart = np.abs(one[:, None] - other[None]).max(axis=2)
        assert np.all(apart.min(axis=1, initial=1.0) < 1e-6)


def test_links_far_from_all_walls_have_no_half_planes() -> None:
    """Nothing near, nothing found; and no sweeps at all are no question."""
    walls = mixed_walls().wall_segments
    corners = np.full((3, 6, 2), 50.0)
    for count in (3, 0):
        some = corners[:count]
        assert len(free_half_planes(some, walls, 0.1)[0]) == 0
        assert len(planes_by_numpy(some, walls, 0.1)[0]) == 0
