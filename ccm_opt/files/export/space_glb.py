"""A motion in space as a film of solids, binary glTF: the arm moves among bodies that are seen through."""

import numpy as np

from ccm_opt.files.export.arm_description import visual_radius
from ccm_opt.files.export.export_settings import EXPORT, ExportSettings
from ccm_opt.files.export.glb import GlbWriter, MovingNode
from ccm_opt.files.export.motion_glb import ARM, GREY, TIP, film_times
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_kinematics import joint_positions, link_rotations
from ccm_opt.solution import JointTrajectory
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.round_bodies import capsule_surface, seen_triangles


def space_motion_glb(problem: SpaceProblem, trajectory: JointTrajectory, settings: ExportSettings = EXPORT) -> bytes:
    """A plan as a film; the sides of the room are left out, or they would hide it.

    Args:
        problem: arm and obstacles.
        trajectory: the motion; keyframes are taken from it at ``film_rate``, its ends included.
        settings: sizes.
    """
    arm = problem.arm
    writer = GlbWriter()
    glass = writer.add_material("obstacle", GREY, settings.glass)
    nodes = [
        MovingNode(each.name, writer.add_mesh(*seen_triangles(each.body, settings.round_sides), glass))
        for each in problem.workspace.obstacles
    ]
    times, samples = film_times(trajectory.time, settings)
    q = trajectory.positions[samples]
    positions = joint_positions(arm, q)
    rotations = link_rotations(arm, q)
    capsule = capsule_surface(arm.link_length, visual_radius(arm), settings.round_sides)
    link_mesh = writer.add_mesh(*capsule, writer.add_material("arm", ARM))
    tip_mesh = writer.add_mesh(*capsule, writer.add_material("last link", TIP))
    for k in range(arm.links):
        mesh_number = tip_mesh if k == arm.links - 1 else link_mesh
        turns = quaternions(rotations[:, k])
        nodes.append(MovingNode(f"link{k + 1:02d}", mesh_number, positions[:, k], turns))
    return writer.written(nodes, times)


def quaternions(rotations: FloatArray) -> FloatArray:
    """Rotations over time, shape (T, 3, 3), as quaternions x, y, z, w without jumps of sign, shape (T, 4)."""
    # Each row of this symmetric matrix is the quaternion times one of its own numbers; the largest row is exact.
    r = rotations
    matrix = np.empty((len(r), 4, 4))
    matrix[:, 3, 3] = 1.0 + r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        matrix[:, i, i] = 1.0 + r[:, i, i] - r[:, j, j] - r[:, k, k]
        matrix[:, i, j] = matrix[:, j, i] = r[:, i, j] + r[:, j, i]
        matrix[:, i, 3] = matrix[:, 3, i] = r[:, k, j] - r[:, j, k]
    largest = np.argmax(np.diagonal(matrix, axis1=1, axis2=2), axis=1)
    found = matrix[np.arange(len(r)), largest]
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    # Players take the short way between two quaternions only where these are on the same side.
    flips = np.where(np.sum(found[1:] * found[:-1], axis=1) < 0.0, -1.0, 1.0)
    return np.asarray(found * np.concatenate(([1.0], np.cumprod(flips)))[:, None])
