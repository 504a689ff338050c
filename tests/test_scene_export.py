"""Obstacles in URDF and MJCF: convex parts tile them, and MuJoCo and Pinocchio feel what our own geometry feels."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.mjcf_models import mjcf_text
from ccm_opt.io.robot_models import scene_meshes, triangles_stl
from ccm_opt.io.scene_solids import SolidScene, convex_parts, prism_mesh, solid_scene
from ccm_opt.io.urdf_models import urdf_text
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.dynamics_arms import loose_limits, swan_neck

GRAVITY = np.array([0.0, 0.0, -9.81])
HOOK = shapely.Polygon([(0.3, 0.1), (0.6, 0.1), (0.6, 0.5), (0.3, 0.5), (0.3, 0.4), (0.5, 0.4), (0.5, 0.2), (0.3, 0.2)])
RING = shapely.Polygon(
    [(-0.6, 0.1), (-0.2, 0.1), (-0.2, 0.6), (-0.6, 0.6)], [[(-0.5, 0.2), (-0.3, 0.2), (-0.3, 0.5), (-0.5, 0.5)]]
)
ROOM = shapely.Polygon(
    [(-0.8, -0.3), (0.8, -0.3), (0.8, 0.9), (0.2, 0.9), (0.2, 0.7), (-0.1, 0.7), (-0.1, 0.9), (-0.8, 0.9)]
)
SHEET = Obstacle("sheet", PlaneShape(shapely.LineString([(0.2, -0.25), (0.7, -0.1)])))
OBSTACLES = (
    Obstacle("hook", PlaneShape(HOOK)),
    Obstacle("ring", PlaneShape(RING)),
    Obstacle("post", PlaneShape(shapely.Point(0.0, 0.5), 0.05)),
    Obstacle("wall / é", PlaneShape(shapely.LineString([(-0.7, -0.1), (-0.3, -0.1), (-0.3, -0.2)]), 0.02)),
    SHEET,
    Obstacle("hook_2", PlaneShape(shapely.box(0.7, 0.6, 0.75, 0.65))),
)


def arm_in_the_room(links: int = 6) -> Arm:
    """A thin arm whose mount ends within its first link."""
    arm = swan_neck(links)
    return replace(arm, radius=0.01, mount_length=0.4 * arm.link_length, base=np.array([0.1, 0.0]))


def scene_for(arm: Arm) -> SolidScene:
    """The solids of all obstacles and of a room with corners that point inwards."""
    return solid_scene(Workspace(ROOM, OBSTACLES), arm)


def arm_axis(arm: Arm, bends: FloatArray) -> shapely.LineString:
    """The axis of the arm beyond its mount, which ends on the first link."""
    points = arm.joint_positions(arm.headings(bends))
    mount = points[0] + arm.mount_length * (points[1] - points[0]) / arm.link_length
    return shapely.LineString([mount, *points[1:]])


def gap_of(arm: Arm, bends: FloatArray) -> float:
    """Distance of the arm beyond its mount from everything, by shapely: negative where only the radius reaches in."""
    line = arm_axis(arm, bends)
    outside = shapely.difference(shapely.box(-5, -5, 5, 5), ROOM)
    solids = [outside, *(shapely.buffer(o.core, o.rounding, quad_segs=64) if o.rounding else o.core for o in OBSTACLES)]
    return float(min(shapely.distance(line, solid) for solid in solids)) - arm.radius


@st.composite
def polygons(draw: st.DrawFn) -> shapely.Polygon:
    """Star-shaped polygons, convex or not, some with a hole."""
    count = draw(st.integers(3, 12))
    radii = np.array([draw(st.floats(0.5, 2.0)) for _ in range(count)])
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) + draw(st.floats(0.0, 1.0))
    ring = radii[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    return shapely.Polygon(ring, [0.2 * ring] if draw(st.booleans()) and count > 4 else [])


@settings(max_examples=60, deadline=None)
@given(polygon=polygons())
def test_convex_parts_tile_a_polygon(polygon: shapely.Polygon) -> None:
    """Each part is convex, none overlaps another, and together they are the polygon, its hole left free."""
    parts = [shapely.Polygon(corners) for corners in convex_parts(polygon)]
    for part in parts:
        assert part.area == pytest.approx(part.convex_hull.area, rel=1e-9)
        assert part.exterior.is_ccw
    assert sum(part.area for part in parts) == pytest.approx(polygon.area, rel=1e-9)
    assert shapely.symmetric_difference(shapely.union_all(parts), polygon).area < 1e-9


@settings(max_examples=40, deadline=None)
@given(polygon=polygons())
def test_meshes_of_parts_are_closed_and_turned_outwards(polygon: shapely.Polygon) -> None:
    """Every edge has its opposite, and the volume by the divergence theorem is area times depth."""
    for corners in convex_parts(polygon):
        vertices, faces = prism_mesh(corners, 0.5)
        edges = {(a, b) for face in faces.tolist() for a, b in zip(face, face[1:] + face[:1], strict=True)}
        assert all((b, a) in edges for a, b in edges)
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        volume = float(np.sum(a * np.cross(b, c))) / 6.0
        assert volume == pytest.approx(shapely.Polygon(corners).area, rel=1e-9)
        assert len(triangles_stl(vertices[faces])) == 84 + 50 * len(faces)


def mujoco_scene(arm: Arm) -> tuple[Any, Any, Any]:
    """MuJoCo, a model of arm and scene, and its data."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", GRAVITY, scene_for(arm)))
    return mujoco, model, mujoco.MjData(model)


BENDS = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(np.array)
ARM = arm_in_the_room()


@pytest.mark.planning
@settings(max_examples=60, deadline=None)
@given(bends=BENDS)
def test_mujoco_feels_contact_where_our_geometry_does(bends: FloatArray) -> None:
    """For any pose: contact where the arm beyond its mount reaches into a solid, and none where there is a gap.

    Poses right through the sheet aside.
    """
    mujoco, model, data = mujoco_scene(ARM)
    gap = gap_of(ARM, bends)
    data.qpos[:] = revolute_angles(ARM, bends)
    mujoco.mj_forward(model, data)
    touching = any(contact.dist < 0.0 for contact in data.contact)
    # MuJoCo's capsules miss one in fifteen boxes that their axis goes right through, however thick a sheet is made.
    through = arm_axis(ARM, bends).intersects(SHEET.core)
    # Round ends of walls and the disc are exact there, and circumscribed polygons here.
    if abs(gap) > 1e-4 and not through:
        assert touching == (gap < 0.0)


def test_contacts_go_by_the_names_of_obstacles() -> None:
    """An arm that leans on the hook touches a geom of its name, as the problem file calls it."""
    mujoco, model, data = mujoco_scene(ARM)
    names = {model.geom(k).name for k in range(model.ngeom)}
    assert {"hook", "ring", "post", "wall / é", "sheet", "hook_2", "workspace boundary"} <= names
    axis = arm_axis(ARM, bends := np.array([-0.6, 0.6, 0.3, 0.0, 0.0, 0.0]))
    assert shapely.intersects(axis, HOOK)
    data.qpos[:] = revolute_angles(ARM, bends)
    mujoco.mj_forward(model, data)
    touched = {model.geom(int(geom)).name.split("/")[0] for contact in data.contact for geom in contact.geom}
    assert "hook" in touched


def test_the_mount_may_touch_walls() -> None:
    """A wall that only the mount reaches into makes no contact; with a shorter mount it does."""
    mujoco = pytest.importorskip("mujoco")
    near_base = shapely.box(0.05, -0.02, 0.15, 0.005)
    for mount, contacts in ((0.9, False), (0.1, True)):
        arm = replace(ARM, mount_length=mount * ARM.link_length)
        workspace = Workspace(shapely.box(-2, -2, 2, 2), (Obstacle("floor", PlaneShape(near_base)),))
        model = mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", GRAVITY, solid_scene(workspace, arm)))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert bool(data.ncon) == contacts


def written_urdf(arm: Arm, folder: Path) -> Path:
    """The URDF of arm and scene with its meshes."""
    scene = scene_for(arm)
    path = folder / "arm.urdf"
    path.write_text(urdf_text(arm, "arm", loose_limits(arm), scene))
    for name, content in scene_meshes(scene, "arm.urdf.meshes").items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    return path


def pinocchio_scene(arm: Arm, folder: Path) -> tuple[Any, Any, Any, Any]:
    """Pinocchio, the model of the URDF, its collision geometry with all pairs of arm and obstacles, and the data."""
    pin = pytest.importorskip("pinocchio")
    path = written_urdf(arm, folder)
    text = path.read_text().replace('filename="', f'filename="file://{folder}/')  # it takes no relative names
    path.write_text(text)
    model = pin.buildModelFromUrdf(str(path))
    geometry = pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.COLLISION)
    moving = [k for k, item in enumerate(geometry.geometryObjects) if item.name.startswith("link")]
    still = [k for k, item in enumerate(geometry.geometryObjects) if item.name.startswith("obstacle")]
    for a in moving:
        for b in still:
            geometry.addCollisionPair(pin.CollisionPair(a, b))
    return pin, model, geometry, pin.GeometryData(geometry)


def test_the_urdf_feels_contact_where_our_geometry_does(tmp_path: Path) -> None:
    """The least distance that Pinocchio finds for random poses is that of our own geometry."""
    pin, model, geometry, data = pinocchio_scene(ARM, tmp_path)
    rng = np.random.default_rng(3)
    for _ in range(25):
        bends = rng.uniform(-1.0, 1.0, 6)
        pin.updateGeometryPlacements(model, model.createData(), geometry, data, revolute_angles(ARM, bends))
        pin.computeDistances(geometry, data)
        least = min(result.min_distance for result in data.distanceResults)
        gap = gap_of(ARM, bends)
        if gap > 1e-4:
            assert least == pytest.approx(gap, abs=1e-4)
        elif gap < -1e-4:
            assert least <= 1e-6


def test_the_urdf_has_a_tip_and_a_link_for_every_obstacle(tmp_path: Path) -> None:
    """The tip stands at the end of the last link; every link has one parent, and every mesh is a file."""
    path = written_urdf(ARM, tmp_path)
    robot = ET.parse(path).getroot()  # noqa: S314 - our own text
    links = [link.get("name") for link in robot.findall("link")]
    children = [str(child.get("link")) for child in robot.findall("joint/child")]
    assert sorted([*children, "world"]) == sorted(map(str, links))
    assert {"tip", "obstacle_hook", "obstacle_wall", "obstacle_hook_2", "obstacle_workspace_boundary"} <= set(links)
    meshes = [str(mesh.get("filename")) for mesh in robot.iter("mesh")]
    assert meshes
    assert all((tmp_path / name).is_file() for name in meshes)
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    bends = np.array([0.5, 0.2, -0.1, 0.3, 0.2, 0.1])
    pin.framesForwardKinematics(model, data, revolute_angles(ARM, bends))
    tip = ARM.joint_positions(ARM.headings(bends))[-1]
    np.testing.assert_allclose(data.oMf[model.getFrameId("tip")].translation, [tip[0], 0.0, tip[1]], atol=1e-14)


def test_a_fed_arm_and_names_that_are_alike_get_along(tmp_path: Path) -> None:
    """Obstacles whose names differ in signs alone get different links; the arm may stand on a feed axis."""
    alike = tuple(
        Obstacle(name, PlaneShape(shapely.Point(0.3 * k, 0.8), 0.01)) for k, name in enumerate(("a b", "a-b", "a\tb"))
    )
    arm = replace(ARM, feed=Feed(0.0, 0.1, 0.1))
    scene = solid_scene(Workspace(shapely.box(-2, -2, 2, 2), alike), arm)
    assert len({obstacle.slug for obstacle in scene.obstacles}) == 4
    assert len({obstacle.name for obstacle in scene.obstacles}) == 4
    path = tmp_path / "arm.urdf"
    path.write_text(urdf_text(arm, "arm", replace(loose_limits(arm), feed_velocity=1.0), scene))
    assert ET.parse(path).getroot().find("joint[@name='feed']") is not None  # noqa: S314 - our own text
    mujoco = pytest.importorskip("mujoco")
    assert mujoco.MjModel.from_xml_string(mjcf_text(arm, "arm", GRAVITY, scene)).ngeom >= 7
