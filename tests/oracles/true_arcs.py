"""The body of an arm of true arcs, by numpy: its centre line, and how near it comes to bodies and to itself.

Nothing of the package's kinematics is used: sections are arcs of constant curvature whose frames are transported along
them without roll, and distances from bodies are those of points from balls, boxes, cylinders and capsules.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.scene.bodies import Body


def section_bends(counts: Sequence[int], joint_bends: FloatArray) -> FloatArray:
    """Bends of the sections, shape (T, s, 2) [rad]: sums of those of their joints, the first of which does not bend.

    Args:
        counts: number of joints of each section.
        joint_bends: bends of all joints, shape (T, links, 2) [rad].
    """
    ends = 1 + np.concatenate(([0], np.cumsum(counts)))
    return np.stack([joint_bends[:, i:j].sum(axis=1) for i, j in pairwise(ends)], axis=1)


def centre_lines(
    base: FloatArray, rotation: FloatArray, lengths: FloatArray, bends: FloatArray, step: float
) -> tuple[FloatArray, FloatArray]:
    """Points of the centre line at T poses, shape (T, m, 3) [m], and their arc lengths, (m,) [m].

    Args:
        base: position of the base, shape (3,) [m].
        rotation: rotation whose columns are the direction of the straight arm, left and up, shape (3, 3).
        lengths: length of each section, shape (s,) [m].
        bends: bends of each section about up and about left, shape (T, s, 2) [rad].
        step: greatest distance of points along the arm [m].
    """
    count = len(bends)
    place = np.broadcast_to(base, (count, 3))
    frame = np.broadcast_to(rotation, (count, 3, 3))
    points, at = [place[:, None]], [np.zeros(1)]
    for k, length in enumerate(lengths.tolist()):
        share = np.linspace(0.0, 1.0, int(np.ceil(length / step)) + 1)[1:]
        total = np.linalg.norm(bends[:, k], axis=1)[:, None]
        # The arc bends towards left for a turn about up, and downwards for a turn about left.
        aside = np.stack((bends[:, k, 0], -bends[:, k, 1]), axis=1) / np.maximum(total, 1e-12)
        angle = total * share
        ahead = length * share * np.sinc(angle / np.pi)
        away = length * share * np.sin(0.5 * angle) * np.sinc(0.5 * angle / np.pi)
        local = np.concatenate((ahead[..., None], away[..., None] * aside[:, None]), axis=2)
        points.append(place[:, None] + np.einsum("tij,tmj->tmi", frame, local))
        at.append(at[-1][-1] + length * share)
        place = points[-1][:, -1]
        cos, sin = np.cos(total[:, 0]), np.sin(total[:, 0])
        turn = np.zeros((count, 3, 3))
        turn[:, 0, 0] = cos
        turn[:, 1:, 0], turn[:, 0, 1:] = sin[:, None] * aside, -sin[:, None] * aside
        turn[:, 1:, 1:] = np.eye(2) + (cos - 1.0)[:, None, None] * aside[:, :, None] * aside[:, None]
        frame = frame @ turn
    return np.concatenate(points, axis=1), np.concatenate(at)


def distances(body: Body, points: FloatArray) -> FloatArray:
    """Distances of points (..., 3) from a solid body, 0 inside, shape (...) [m]."""
    if body.kind == "sphere":
        return np.asarray(np.maximum(np.linalg.norm(points - body.center, axis=-1) - body.radius, 0.0))
    if body.kind == "box":
        inverse = np.linalg.inv(body.placement.rotation)
        own = (points - body.placement.position) @ inverse.T
        return np.asarray(np.linalg.norm(own - np.clip(own, body.low, body.high), axis=-1))
    assert body.kind != "mesh"
    axis = body.end - body.start
    size = float(np.linalg.norm(axis))
    along = (points - body.start) @ axis / size
    if body.kind == "capsule":
        nearest = body.start + np.clip(along, 0.0, size)[..., None] * axis / size
        return np.asarray(np.maximum(np.linalg.norm(points - nearest, axis=-1) - body.radius, 0.0))
    aside = np.linalg.norm(points - body.start - along[..., None] * axis / size, axis=-1)
    beyond = np.maximum(np.maximum(-along, along - size), 0.0)
    return np.asarray(np.hypot(beyond, np.maximum(aside - body.radius, 0.0)))


def least_own_distance(points: FloatArray, at: FloatArray, apart: float) -> float:
    """Least distance of two points of one centre line that are farther apart along it than a length [m].

    Args:
        points: points of the centre line at T poses, shape (T, m, 3) [m].
        at: their arc lengths, shape (m,) [m].
        apart: that length [m].
    """
    first, second = np.nonzero(at[None] - at[:, None] > apart)
    if not len(first):
        return np.inf
    return min(float(np.min(np.linalg.norm(pose[first] - pose[second], axis=1))) for pose in points)
