"""By how much the poses of an arm lack a distance that they ought to keep."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree


def distance_lacking(arm: Arm, tree: SurfaceTree, points: FloatArray, kept: float) -> FloatArray:
    """By how much the axes of the links beyond the mount are nearer to surfaces than they ought to be.

    Args:
        arm: whose links they are.
        tree: of the surfaces.
        points: joints and tip of some poses, shape (k, links + 1, 3) [m].
        kept: distance from the axes that surfaces ought to keep [m].

    Returns:
        Of every pose, at least 0, shape (k,) [m].
    """
    first = int(np.ceil(arm.mount_length / arm.link_length - 1e-9))
    segments = np.stack((points[:, first:-1], points[:, first + 1 :]), axis=2)
    distances = tree.distances(segments.reshape(-1, 2, 3), kept)
    return np.asarray(kept - np.min(distances.reshape(len(points), -1), axis=1, initial=kept))
