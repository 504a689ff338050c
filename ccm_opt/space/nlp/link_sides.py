"""Half-spaces for the links of a pose: free of the surfaces near each, and apart from the other links near it."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.distances.segment_pairs import segment_distances
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.nlp.space_pose_settings import SpacePoseSettings
from ccm_opt.space.nlp.space_pose_task import LinkSides, free_shares


def link_sides(
    arm: SpaceArm,
    tree: SurfaceTree,
    clearance: float,
    wanted_gap: float,
    points: FloatArray,
    settings: SpacePoseSettings,
) -> LinkSides:
    """The sides of every link's region about a pose.

    Args:
        arm: the arm.
        tree: of the surfaces.
        clearance: gap that the user asks for beyond the arm's radius [m].
        wanted_gap: room beyond that [m].
        points: joints and tip, shape (links + 1, 3) [m].
        settings: how far and how many.
    """
    surfaces = _surface_sides(arm, tree, clearance, points, settings)
    return surfaces.joined(_pair_sides(arm, wanted_gap, points, settings))


def held_segments(arm: SpaceArm, points: FloatArray) -> FloatArray:
    """The parts of the links that may touch nothing, shape (k, 2, 3) [m]: those of the last k links."""
    shares = free_shares(arm)
    starts = points[:-1] + shares[:, None] * np.diff(points, axis=0)
    return np.asarray(np.stack((starts, points[1:]), axis=1)[shares < 1.0])


def _surface_sides(
    arm: SpaceArm, tree: SurfaceTree, clearance: float, points: FloatArray, settings: SpacePoseSettings
) -> LinkSides:
    segments = held_segments(arm, points)
    reach = settings.reach * arm.length
    rows = tree.planes(segments, reach, settings.most_sides, settings.behind * arm.length)
    nearest = segments[rows.link, 0] + rows.share[:, None] * (segments[rows.link, 1] - segments[rows.link, 0])
    # What a surface's rounding takes is told in the gap, so the side stands that far from the axis' nearest point.
    to_axis = np.einsum("rd,rd->r", rows.normal, nearest) - rows.gap
    link = rows.link + arm.links - len(segments)
    return LinkSides(link, rows.normal, to_axis + arm.radius + clearance, np.ones(len(link)))


def _pair_sides(arm: SpaceArm, wanted_gap: float, points: FloatArray, settings: SpacePoseSettings) -> LinkSides:
    """Two sides for every pair of links that may meet: each keeps to its side of the plane half-way between them.

    Links that are not far apart along the arm cannot keep the wanted gap, and are asked for the share of it that
    planning keeps between them.
    """
    first, second = arm.self_pairs
    if len(first) == 0:
        none = np.zeros(0, dtype=np.intp)
        return LinkSides(none, np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    ends = (points[first], points[first + 1], points[second], points[second + 1])
    first_at, second_at, distance, normal = segment_distances(*ends)
    near = np.flatnonzero((distance < settings.pair_reach * arm.length) & (distance > 0.0))
    first, second = first[near], second[near]
    one = points[first] + first_at[near, None] * (points[first + 1] - points[first])
    other = points[second] + second_at[near, None] * (points[second + 1] - points[second])
    middle = np.einsum("kd,kd->k", normal[near], 0.5 * (one + other))
    shares = arm.link_margins(first, second, wanted_gap) / (2.0 * wanted_gap)
    return LinkSides(
        np.concatenate((first, second)),
        np.concatenate((normal[near], -normal[near])),
        np.concatenate((middle, -middle)) + arm.radius,
        np.concatenate((shares, shares)),
    )
