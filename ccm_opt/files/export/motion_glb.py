"""A motion as a film of solids, binary glTF: the arm moves among the extruded obstacles in any viewer of 3-D scenes."""

import numpy as np

from ccm_opt.files.export.arm_description import visual_radius
from ccm_opt.files.export.export_settings import EXPORT, ExportSettings
from ccm_opt.files.export.glb import GlbWriter, MovingNode
from ccm_opt.files.export.scene_solids import Drum, Prism, Solid, prism_mesh, solid_scene
from ccm_opt.freespace.workspace import BOUNDARY_NAME
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.solution import JointTrajectory
from ccm_opt.space.scene.round_bodies import capsule_surface

GREY = (0.55, 0.57, 0.6)
ARM = (0.9, 0.45, 0.1)
TIP = (0.75, 0.1, 0.1)


def motion_glb(problem: Problem, trajectory: JointTrajectory, settings: ExportSettings = EXPORT) -> bytes:
    """A plan as a film; the walls around the room are left out, or they would hide it.

    Args:
        problem: arm and obstacles.
        trajectory: the motion; keyframes are taken from it at ``film_rate``, its ends included.
        settings: sizes.
    """
    arm = problem.arm
    writer = GlbWriter()
    grey = writer.add_material("obstacle", GREY)
    scene = solid_scene(problem.workspace, arm, settings)
    nodes = []
    for obstacle in scene.obstacles:
        if obstacle.solids and not obstacle.name.startswith(BOUNDARY_NAME):
            mesh = _joined([_mesh(solid, scene.half_depth, settings) for solid in obstacle.solids])
            nodes.append(MovingNode(obstacle.name, writer.add_mesh(*mesh, grey)))

    times, samples = film_times(trajectory.time, settings)
    positions = arm.joint_positions_at(trajectory.positions[samples])
    capsule = capsule_surface(arm.link_length, visual_radius(arm), settings.round_sides)
    link_mesh = writer.add_mesh(*capsule, writer.add_material("arm", ARM))
    tip_mesh = writer.add_mesh(*capsule, writer.add_material("last link", TIP))
    for k in range(arm.links):
        mesh_number = tip_mesh if k == arm.links - 1 else link_mesh
        nodes.append(MovingNode(f"link{k + 1:02d}", mesh_number, *_motion_of(positions[:, k : k + 2])))
    return writer.written(nodes, times)


def film_times(time: FloatArray, settings: ExportSettings) -> tuple[FloatArray, IntArray]:
    """Times of a film, and the samples nearest to them."""
    count = max(2, int(np.ceil((time[-1] - time[0]) * settings.film_rate)) + 1)
    wanted = np.linspace(time[0], time[-1], min(count, len(time)))
    samples = np.unique(np.clip(np.searchsorted(time, wanted), 0, len(time) - 1))
    return time[samples], samples


def _motion_of(ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places and turns of a link over time from both its ends in the plane, shape (T, 2, 2)."""
    along = ends[:, 1] - ends[:, 0]
    # Players take the short way between two quaternions of opposite sign; an unwrapped heading has no jump at all.
    half = 0.5 * np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    zero = np.zeros(len(ends))
    places = np.column_stack((ends[:, 0, 0], zero, ends[:, 0, 1]))
    return places, np.column_stack((zero, -np.sin(half), zero, np.cos(half)))


def _mesh(solid: Solid, half_depth: float, settings: ExportSettings) -> tuple[FloatArray, IntArray]:
    if isinstance(solid, Drum):
        angles = np.linspace(0.0, 2.0 * np.pi, 2 * settings.round_sides, endpoint=False)
        ring = solid.center + solid.radius * np.column_stack((np.cos(angles), np.sin(angles)))
        return prism_mesh(Prism(ring), half_depth)
    return prism_mesh(solid, half_depth)


def _joined(meshes: list[tuple[FloatArray, IntArray]]) -> tuple[FloatArray, IntArray]:
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + offset for (_, faces), offset in zip(meshes, offsets, strict=True)]
    return np.vstack([vertices for vertices, _ in meshes]), np.vstack(faces)
