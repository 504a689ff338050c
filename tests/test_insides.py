"""How deep places lie inside bodies, against closed formulas."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.scene.bodies import BOX_FACES, BoxBody, CapsuleBody, CylinderBody, MeshBody, SphereBody, box_corners
from ccm_opt.space.scene.insides import depth_inside

PLACES = st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3).map(np.array)


def cube_depth(point: FloatArray) -> float:
    """Depth in the cube from −1 to 1."""
    beyond = np.abs(point) - 1.0
    return float(-beyond.max() if beyond.max() <= 0.0 else -np.linalg.norm(np.maximum(beyond, 0.0)))


@given(point=PLACES)
def test_boxes_and_closed_meshes(point: FloatArray) -> None:
    """A place is as deep in a box as its nearest side is far; so it is in a mesh, whichever way its triangles turn."""
    low = -np.ones(3)
    expected = pytest.approx(cube_depth(point), abs=1e-9)
    assert depth_inside(BoxBody(low, -low), point) == expected
    corners = box_corners(low, -low)
    assert depth_inside(MeshBody(corners, BOX_FACES, closed=True), point) == expected
    assert depth_inside(MeshBody(corners, BOX_FACES[:, ::-1], closed=True), point) == expected
    if min(abs(abs(point) - 1.0)) > 1e-6:  # no ray may start on the surface
        mixed = np.concatenate((BOX_FACES[:5], BOX_FACES[5:, ::-1]))
        assert depth_inside(MeshBody(corners, mixed, closed=True), point) == expected
    assert depth_inside(MeshBody(corners, BOX_FACES), point) == pytest.approx(-abs(cube_depth(point)), abs=1e-9)


@given(point=PLACES)
def test_round_bodies(point: FloatArray) -> None:
    """Depths in balls and bars are those of their formulas."""
    assert depth_inside(SphereBody(np.ones(3), 0.5), point) == pytest.approx(0.5 - np.linalg.norm(point - 1.0))
    start = np.array([0.0, 0.0, -1.0])
    over_end = abs(point[2]) - 1.0
    beside = float(np.hypot(point[0], point[1]))
    capsule = 0.4 - np.hypot(beside, max(over_end, 0.0))
    assert depth_inside(CapsuleBody(start, -start, 0.4), point) == pytest.approx(capsule)
    outside = np.hypot(max(over_end, 0.0), max(beside - 0.4, 0.0))
    cylinder = -outside if outside > 0.0 else -max(over_end, beside - 0.4)
    assert depth_inside(CylinderBody(start, -start, 0.4), point) == pytest.approx(cylinder, abs=1e-12)
