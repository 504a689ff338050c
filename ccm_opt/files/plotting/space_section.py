"""How much room there is across an arm in space, along its whole length: rays from its axis to the nearest surfaces.

The directions are carried along the arm by the shortest turns from link to link, as the curve's own frame is, so that
up stays up as far as the arm allows.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.bodies import BOX_FACES, box_corners
from ccm_opt.space.scene.round_bodies import seen_triangles
from ccm_opt.space.scene.scene import SpaceWorkspace

_ROUND_SIDES = 48
"""Of balls and bars, whose polygons then stand back behind them by a fifth of a percent of their radius."""


@dataclass(frozen=True, eq=False)
class ArmSection:
    """What rays across the arm meet.

    Attributes:
        place: along the arm, shape (N,) [m].
        free: length of the rays in four directions, up, left, down, right, at most the reach, shape (N, 4) [m].
        nearest: distance of the axis from the nearest surface on any side, which rays may miss, at most the reach,
            shape (N,) [m].
        reach: how far is looked [m].
    """

    place: FloatArray
    free: FloatArray
    nearest: FloatArray
    reach: float


def section_along(problem: SpaceProblem, points: FloatArray, count: int, reach: float) -> ArmSection:
    """The section of a pose.

    Args:
        problem: whose surfaces are met.
        points: joints and tip, shape (links + 1, 3) [m].
        count: of places along the arm.
        reach: how far is looked [m].
    """
    arm = problem.arm
    place = np.linspace(0.0, arm.length, count, endpoint=False) + 0.5 * arm.length / count
    link = np.minimum((place / arm.link_length).astype(np.intp), arm.links - 1)
    along = np.diff(points, axis=0) / arm.link_length
    origins = points[link] + (place - link * arm.link_length)[:, None] * along[link]
    up = _carried_up(along, arm.up)[link]
    left = np.cross(up, along[link])
    rays = np.stack((up, left, -up, -left), axis=1)
    free = free_lengths(_seen(problem.workspace), np.repeat(origins, 4, axis=0), rays.reshape(-1, 3), reach)
    nearest = SurfaceTree.of(problem.workspace.soup).distances(np.stack((origins, origins), axis=1), reach)
    return ArmSection(place, free.reshape(count, 4), np.maximum(nearest, 0.0), reach)


def _seen(workspace: SpaceWorkspace) -> FloatArray:
    """The surfaces that rays can meet, those of round bodies too, shape (m, 3, 3) [m]."""
    surfaces = [seen_triangles(each.body, _ROUND_SIDES) for each in workspace.obstacles]
    found = [vertices[faces] for vertices, faces in surfaces]
    if workspace.bounds is not None:
        found.append(box_corners(*workspace.bounds)[BOX_FACES])
    return np.concatenate(found) if found else np.zeros((0, 3, 3))


def _carried_up(along: FloatArray, first: FloatArray) -> FloatArray:
    """A direction across each link, carried from link to link by the shortest turn, shape (links, 3)."""
    found = [first - (first @ along[0]) * along[0]]
    for before, after in pairwise(along):
        axis = np.cross(before, after)
        latest = found[-1]
        # Rodrigues' formula for the turn that takes one unit vector to the other.
        turned = latest + np.cross(axis, latest) + np.cross(axis, np.cross(axis, latest)) / (1.0 + before @ after)
        found.append(turned / np.linalg.norm(turned))
    return np.stack(found)


def free_lengths(triangles: FloatArray, origins: FloatArray, rays: FloatArray, reach: float) -> FloatArray:
    """Length of each ray to the first triangle that it meets, at most the reach, shape (N,) [m].

    By the intersection of Möller and Trumbore (1997), for all rays with the triangles in reach of them at once.

    Args:
        triangles: shape (m, 3, 3) [m].
        origins: shape (N, 3) [m].
        rays: unit vectors, shape (N, 3).
        reach: how far is looked [m].
    """
    free = np.full(len(origins), reach)
    ends = origins + reach * rays
    # Axis by axis, each in one piece of memory: bounds of the triangles and of the rays.
    low = np.ascontiguousarray(triangles.min(axis=1).T)
    high = np.ascontiguousarray(triangles.max(axis=1).T)
    first = np.minimum(origins, ends).T
    last = np.maximum(origins, ends).T
    # Some rays at a time, near each other along the arm, so that few triangles are in their reach.
    for some in np.array_split(np.arange(len(origins)), max(len(origins) // 16, 1)):
        near = np.flatnonzero(_overlap(low, high, first[:, some].min(axis=1), last[:, some].max(axis=1)))
        meets = _overlap(low[:, None, near], high[:, None, near], first[:, some, None], last[:, some, None])
        ray, triangle = np.nonzero(meets)
        lengths = _hits(triangles[near[triangle]], origins[some[ray]], rays[some[ray]])
        np.minimum.at(free, some[ray], lengths)
    return free


def _overlap(low: FloatArray, high: FloatArray, first: FloatArray, last: FloatArray) -> BoolArray:
    """Whether boxes from low to high and from first to last, shape (3, …) each, have a place in common, shape (…)."""
    x, y, z = ((high[k] >= first[k]) & (low[k] <= last[k]) for k in range(3))
    return np.asarray(x & y & z)


def _hits(triangles: FloatArray, origins: FloatArray, rays: FloatArray) -> FloatArray:
    """Length of each ray to its triangle, inf where it does not meet it, shape (N,) [m]."""
    first = triangles[:, 1] - triangles[:, 0]
    second = triangles[:, 2] - triangles[:, 0]
    p = np.cross(rays, second)
    determinant = np.sum(p * first, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / determinant
        away = origins - triangles[:, 0]
        u = np.sum(away * p, axis=-1) * inverse
        q = np.cross(away, first)
        v = np.sum(rays * q, axis=-1) * inverse
        length = np.sum(second * q, axis=-1) * inverse
        # What is no number, from triangles without area or along the ray, is no hit either.
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (length > 0.0)
    return np.where(hit, length, np.inf)
