"""Convex regions of free space around the links of a pose, in which the goal-pose NLP keeps the links."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray, in_space
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_PAIR_REACH = 0.1
"""Distance of the axes of two links beyond which no side separates them, as a fraction of the arm's length
(heuristic)."""


@dataclass(frozen=True, eq=False)
class JointRegions:
    """Half-spaces n · P ≥ b, called sides, in which the positions P of the joints and the tip must stay.

    The sides of a joint form a convex region. A joint lies in the regions of both its links, so both ends of a link lie
    in the region of that link, and hence the whole link does. The offsets include the radius and the required clearance
    from walls and other links; the gap of a link is its least distance from its sides.

    Attributes:
        joint: index of the joint of each of the r sides, shape (r,); the tip has the index ``links``.
        normals: inward unit normals n, shape (r, d).
        offsets: offsets b, shape (r,) [m].
        gap_shares: fraction of the gap that each side requires, shape (r,): 1 for walls, less between links that cannot
            keep the full gap from each other.
    """

    joint: IntArray
    normals: FloatArray
    offsets: FloatArray
    gap_shares: FloatArray

    @classmethod
    def of_links(
        cls, link: IntArray, normals: FloatArray, offsets: FloatArray, gap_shares: FloatArray
    ) -> "JointRegions":
        """Return regions of joints from sides of links, which apply to both ends of a link.

        Args:
            link: index of the link of each of the k sides, shape (k,).
            normals: inward unit normals, shape (k, d).
            offsets: offsets b in n · P ≥ b, shape (k,) [m].
            gap_shares: fraction of the gap that each side requires, shape (k,).
        """
        joint = np.concatenate((link, link + 1))
        return cls(joint, np.tile(normals, (2, 1)), np.tile(offsets, 2), np.tile(gap_shares, 2))

    @property
    def most(self) -> int:
        """Maximum over all joints of the number of sides of a joint's region."""
        return int(np.max(np.bincount(self.joint), initial=0)) if len(self.joint) else 0

    @property
    def number(self) -> IntArray:
        """Index of each side among the sides of its joint, shape (r,)."""
        order = np.argsort(self.joint, kind="stable")
        found = np.empty(len(order), dtype=np.intp)
        found[order] = np.arange(len(order)) - np.searchsorted(self.joint[order], self.joint[order])
        return found

    def gap(self, first_shares: FloatArray, points: FloatArray) -> float:
        """Return the least gap between any link and the sides of its region [m]; negative if a side is crossed.

        Each side's gap is divided by the fraction of it that the side requires. The parts of the arm that may touch
        obstacles are left out.

        Args:
            first_shares: fraction of each link at which its constrained part starts, shape (links,).
            points: joint and tip positions, shape (links + 1, d) [m].
        """
        starts = points[:-1] + first_shares[:, None] * np.diff(points, axis=0)
        held = np.vstack((starts, points[-1:]))[self.joint]
        inside = np.einsum("rd,rd->r", held, self.normals) - self.offsets
        # A side that requires no gap says nothing about it.
        required = self.gap_shares > 0.0
        return float(np.min(inside[required] / self.gap_shares[required], initial=np.inf))


def held_segments(arm: Arm, points: FloatArray) -> FloatArray:
    """Return the centre-line segments of all links, without the parts that may touch obstacles, as segments in space.

    Args:
        arm: the arm.
        points: positions of joints and tip, shape (links + 1, d) [m].

    Returns:
        Both ends of the segment on each of the last k links, shape (k, 2, 3) [m]; the k links are those not wholly
        allowed to touch obstacles.
    """
    shares = arm.free_shares
    starts = points[:-1] + shares[:, None] * np.diff(points, axis=0)
    return in_space(np.stack((starts, points[1:]), axis=1)[shares < 1.0])


LinkSides = tuple[IntArray, FloatArray, FloatArray, FloatArray]
"""Link index, inward normal, offset and gap fraction of every side, as in ``JointRegions``."""


def regions_about(
    arm: Arm,
    tree: SurfaceTree,
    clearance: float,
    wanted_gap: float,
    points: FloatArray,
    settings: PoseSettings,
) -> JointRegions:
    """Return convex regions around the links of a pose, bounded by walls and by other links.

    Args:
        arm: the arm.
        tree: distance tree of the walls or surfaces.
        clearance: clearance that the user requires beyond the arm's radius [m].
        wanted_gap: preferred clearance beyond the required one [m].
        points: positions of joints and tip, shape (links + 1, d) [m].
        settings: maximum distance of walls that bound a region, and maximum number of sides.
    """
    sides = (_surface_sides(arm, tree, clearance, points, settings), _pair_sides(arm, wanted_gap, points))
    return JointRegions.of_links(*(np.concatenate(column) for column in zip(*sides, strict=True)))


def _surface_sides(
    arm: Arm, tree: SurfaceTree, clearance: float, points: FloatArray, settings: PoseSettings
) -> LinkSides:
    segments = held_segments(arm, points)
    # A polygon has few edges, so nothing of it need protrude through a side.
    behind = settings.behind * arm.length if arm.dimension == 3 else 0.0
    rows = tree.planes(segments, settings.reach * arm.length, settings.most_sides, behind)
    nearest = segments[rows.link, 0] + rows.share[:, None] * (segments[rows.link, 1] - segments[rows.link, 0])
    # The distance already accounts for a surface's rounding, so the side lies that far from the nearest point of the
    # axis.
    to_axis = np.einsum("rd,rd->r", rows.normal, nearest) - rows.gap
    link = rows.link + arm.links - len(segments)
    return link, rows.normal[:, : arm.dimension], to_axis + arm.radii[link] + clearance, np.ones(len(link))


def _pair_sides(arm: Arm, wanted_gap: float, points: FloatArray) -> LinkSides:
    """Return two sides for every pair of nearby links that may collide: each link stays on its side of the mid-plane.

    Links that are close together along the arm cannot keep the preferred clearance from each other; their sides require
    the fraction of the clearance that ``Arm.link_margins`` gives.

    Args:
        arm: the arm.
        wanted_gap: preferred clearance beyond the required one [m].
        points: positions of joints and tip, shape (links + 1, d) [m].
    """
    first, second = arm.self_pairs
    if len(first) == 0:
        return np.zeros(0, dtype=np.intp), np.zeros((0, arm.dimension)), np.zeros(0), np.zeros(0)
    ends = (points[first], points[first + 1], points[second], points[second + 1])
    first_at, second_at, distance, normal = segment_distances(*ends)
    near = np.flatnonzero((distance < _PAIR_REACH * arm.length) & (distance > 0.0))
    first, second = first[near], second[near]
    one = points[first] + first_at[near, None] * (points[first + 1] - points[first])
    other = points[second] + second_at[near, None] * (points[second + 1] - points[second])
    middle = np.einsum("kd,kd->k", normal[near], 0.5 * (one + other))
    shares = arm.link_margins(first, second, wanted_gap) / (2.0 * wanted_gap)
    return (
        np.concatenate((first, second)),
        np.concatenate((normal[near], -normal[near])),
        np.concatenate((middle, -middle)) + np.tile(0.5 * (arm.radii[first] + arm.radii[second]), 2),
        np.concatenate((shares, shares)),
    )
