"""Checks of places in a problem file in space: bars with two ends, the base in the room and in no body, odd scales."""

from collections.abc import Mapping, Sequence

import numpy as np

from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.keypath import KeyPath
from ccm_opt.files.problem_file.placement import PlacedFile
from ccm_opt.files.problem_file.reading_settings import READING
from ccm_opt.files.problem_file.schema import (
    SpaceArmTable,
    SpaceObstacleTable,
    SpaceStartTable,
    SpaceWorkspaceTable,
)
from ccm_opt.files.problem_file.space_build import build_space_arm, build_space_pose, build_space_workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import METRES, LengthUnit
from ccm_opt.ground.length_words import words_in
from ccm_opt.problem.imported_drawing import ODD_RATIO
from ccm_opt.space.distances.enclosures import ways_out
from ccm_opt.space.distances.insides import depth_inside
from ccm_opt.space.scene.bodies import MeshBody
from ccm_opt.space.scene.scene import ROOM_NAME, SpaceWorkspace
from ccm_opt.space.scene.surfaces import box_about

BODY_KEYS = ("mesh", "box", "sphere", "cylinder", "capsule")


def check_bars(table: SpaceObstacleTable, path: KeyPath, issues: Issues) -> bool:
    """Whether the ends of a bar, if it is one, are two places; else that is noted. A capsule may be a ball."""
    if table.cylinder is not None and np.allclose(table.cylinder.start, table.cylinder.end, rtol=1e-12, atol=1e-12):
        issues.add((*path, "cylinder"), "both ends are the same place; expected two different ones")
        return False
    return True


def check_space_base(
    workspace: SpaceWorkspaceTable,
    obstacles: Sequence[tuple[int, SpaceObstacleTable]],
    meshes: Mapping[int, MeshBody],
    arm: SpaceArmTable,
    start: SpaceStartTable,
    units: LengthUnit,
    issues: Issues,
) -> None:
    """The base may touch walls, as the mount does, but not stand inside an obstacle or outside the room."""
    usable = [
        (number, item)
        for number, item in obstacles
        if number in meshes or sum(getattr(item, key) is not None for key in BODY_KEYS if key != "mesh") == 1
    ]
    room = build_space_workspace(workspace, usable, meshes)
    built = build_space_arm(arm)
    base = built.base + build_space_pose(start, built).feed * built.direction
    rounding = READING.depth_rounding * max(float(np.ptp(room.extent, axis=0).max()), built.length)
    for obstacle in room.obstacles:
        if (depth := depth_inside(obstacle.body, base)) > rounding:
            where = f"the base at {_place(base, units)} is {_length(depth, units)} inside '{obstacle.name}'"
            with words_in(units):
                ways = " or ".join(ways_out(room, obstacle.name, "it"))
            issues.add(("arm", "base"), f"{where}; {ways}")
    if (depth := depth_outside_room(room, base)) > rounding:
        place = _place(base, units)
        issues.add(
            ("arm", "base"), f"the base at {place} is {_length(depth, units)} outside the {ROOM_NAME}; move it in"
        )


def refuse_meshes_outside(
    workspace: SpaceWorkspaceTable, meshes: Mapping[int, MeshBody], units: str, issues: Issues
) -> None:
    """Refuse meshes that lie wholly outside the room: nobody means to plan without them."""
    if workspace.bounds is None:
        return
    room = np.array(workspace.bounds)
    for number, body in meshes.items():
        box = box_about(body.vertices)
        if np.any(box[0] > room[1]) or np.any(box[1] < room[0]):
            scale = body.scale / METRES[units]
            placed = PlacedFile(body.file, box, body.placement.position, scale, "scale", "pose.position")
            issues.add(("workspace", "obstacles", number, "mesh"), placed.told_outside(room, units))


def depth_outside_room(workspace: SpaceWorkspace, point: FloatArray) -> float:
    """How far a place is outside the room [m]; not above 0 inside of it, or where there is none."""
    if workspace.bounds is None:
        return 0.0
    beyond = np.maximum(workspace.bounds[0] - point, point - workspace.bounds[1])
    return float(np.linalg.norm(np.maximum(beyond, 0.0)))


def hint_at_mesh_scale(meshes: Mapping[int, MeshBody], arm: SpaceArmTable, issues: Issues) -> None:
    """Beside other defects say that a mesh does not fit the arm, which may be where they come from."""
    for number, body in meshes.items():
        odd = odd_mesh_size(body, arm.links * arm.link_length)
        if odd is not None:
            issues.add(("workspace", "obstacles", number, "scale"), odd)


def odd_mesh_size(body: MeshBody, arm_length: float) -> str | None:
    """A warning where a mesh is so much larger or smaller than the arm that its scale must be wrong.

    Args:
        body: the mesh.
        arm_length: length of the arm [m].
    """
    extent = float(np.ptp(body.vertices, axis=0).max())
    ratio = extent / arm_length
    if ODD_RATIO**-1 < ratio < ODD_RATIO:
        return None
    larger = ratio > 1.0
    times = f"{ratio if larger else 1.0 / max(ratio, 1e-300):.3g} times {'larger' if larger else 'smaller'}"
    return (
        f"{body.file} is {times} than the arm is long: {extent:.4g} m against {arm_length:.4g} m; is scale the length "
        "of one unit of the mesh? (0.001 where the mesh is in millimetres and the file in metres)"
    )


def _place(point: FloatArray, units: str) -> str:
    x, y, z = point / METRES[units]
    return f"({x:.4g}, {y:.4g}, {z:.4g}) {units}"


def _length(metres: float, units: str) -> str:
    return f"{metres / METRES[units]:.4g} {units}"
