"""Bodies of a scene in space: their triangles enclose them, and placements are rigid."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.scene.bodies import CYLINDER_SIDES, BoxBody, CapsuleBody, CylinderBody, RigidPlacement, SphereBody
from ccm_opt.scene.workspace import Obstacle, Workspace

ANGLES = st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3).map(np.array)
PLACES = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


def volume(triangles: FloatArray) -> float:
    """Volume that closed triangles enclose, positive where they turn left as seen from outside."""
    return float(np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6.0)


@given(low=PLACES, size=st.floats(0.1, 2.0), angles=ANGLES)
def test_box_triangles_enclose_its_volume(low: FloatArray, size: float, angles: FloatArray) -> None:
    """The twelve triangles of a box, however it is turned, turn left seen from outside and enclose its volume."""
    box = BoxBody(low, low + size, RigidPlacement.turned(-low, angles))
    assert volume(box.triangles) == pytest.approx(size**3)


@given(start=PLACES, way=PLACES.filter(lambda way: np.linalg.norm(way) > 0.1), radius=st.floats(0.01, 1.0))
def test_prism_contains_its_cylinder(start: FloatArray, way: FloatArray, radius: float) -> None:
    """The prism about a cylinder touches it with every side and has the volume that many sides have."""
    cylinder = CylinderBody(start, start + way, radius)
    triangles = cylinder.triangles
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    axis = way / np.linalg.norm(way)
    walls = np.abs(normals @ axis) < 0.5
    from_axis = np.einsum("ij,ij->i", normals[walls], triangles[walls, 0] - start)
    assert np.allclose(from_axis, radius, atol=1e-9)
    sides = CYLINDER_SIDES
    area = sides * radius**2 * np.tan(np.pi / sides)
    assert volume(triangles) == pytest.approx(area * float(np.linalg.norm(way)))
    corners = triangles.reshape(-1, 3) - start
    beside = np.linalg.norm(corners - (corners @ axis)[:, None] * axis, axis=1)
    assert beside.max() == pytest.approx(radius + cylinder.error)


@given(angles=ANGLES, place=PLACES)
def test_placement_from_its_own_quaternion(angles: FloatArray, place: FloatArray) -> None:
    """A rotation is the same when it is made again from its quaternion."""
    placement = RigidPlacement.turned(place, angles)
    again = RigidPlacement.of_quaternion(place, placement.quaternion)
    assert np.allclose(again.rotation, placement.rotation, atol=1e-12)


def test_turns_are_about_fixed_axes_in_order() -> None:
    """A quarter turn about x and then one about z takes the z axis to the x axis, by way of minus y."""
    placement = RigidPlacement.turned(np.zeros(3), np.deg2rad([90.0, 0.0, 90.0]))
    assert np.allclose(placement.points(np.array([0.0, 0.0, 1.0])), [1.0, 0.0, 0.0])


def test_soup_of_a_scene() -> None:
    """The soup has every body's triangles under its name, in order, and then the sides of the room."""
    bounds = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    bodies = (
        Obstacle("ball", SphereBody(np.zeros(3), 0.5)),
        Obstacle("bar", CapsuleBody(np.zeros(3), np.ones(3), 0.25)),
        Obstacle("block", BoxBody(np.zeros(3), np.ones(3))),
    )
    workspace = Workspace(bounds=bounds, obstacles=bodies)
    triangle_soup = workspace.triangle_soup
    assert triangle_soup.names == ("ball", "bar", "block", "room")
    assert triangle_soup.owner.tolist() == [0, 1] + [2] * 12 + [3] * 12
    assert triangle_soup.rounding.tolist() == [0.5, 0.25] + [0.0] * 24
    assert volume(triangle_soup.triangles[triangle_soup.owner == 3]) == pytest.approx(8.0)
    assert np.allclose(workspace.extent, [[-1.0] * 3, [1.25] * 3])
    assert len(Workspace(bounds=None).triangle_soup) == 0
