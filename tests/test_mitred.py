"""Outlines with corners that stay corners."""

import warnings

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.core.polygons import mitred

from .scenes import random_polygon

NEEDLE = shapely.Polygon([
    (0.521639001757304, 0.1779014574373929),
    (0.25645710488663265, -0.04886660019195344),
    (0.507496866133573, 0.19204359306112387),
    (0.47336067669698106, 0.22617978249771584),
])  # fmt: skip
"""Its last corner turns back as exactly as rounding allows, and GEOS does not grow it."""


def test_the_tip_of_a_needle_grows_and_nobody_is_warned() -> None:
    """Where GEOS divides by zero, nobody is told so, and the tip of the needle is grown, too."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        grown = mitred(NEEDLE, 0.02, 1.02)
        room = mitred(shapely.box(-1.0, -1.0, 1.0, 1.0).difference(NEEDLE), -0.02, 1.02)
    assert shapely.distance(shapely.Point(NEEDLE.exterior.coords[-2]), room) >= 0.02 * (1.0 - 1e-9)
    with np.errstate(all="ignore"):
        assert shapely.contains(grown, shapely.buffer(NEEDLE, 0.02 * (1.0 - 1e-9)))


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 0.3), st.floats(1.02, 5.0), st.booleans())
def test_a_grown_shape_holds_all_that_is_within_the_distance(
    seed: int, distance: float, limit: float, needle: bool
) -> None:
    """However near corners are cut off, all points within the distance lie inside, of needles as well.

    GEOS leaves out dents of less than a hundredth of the distance (its simplify factor), which may cost as much.
    """
    rng = np.random.default_rng(seed)
    shape = random_polygon(rng, np.zeros(2))
    if needle:
        corners = shapely.get_coordinates(shape)[:-1]
        out = corners[0] + rng.uniform(0.1, 3.0) * (corners[0] - corners.mean(axis=0))
        shape = shapely.Polygon(np.vstack((corners[0], out, corners)))
    grown = mitred(shape, distance, limit)
    with np.errstate(all="ignore"):
        assert shapely.contains(shapely.buffer(grown, 0.01 * distance), shapely.buffer(shape, distance))
