"""Convex regions about the links of a pose, which the goal-pose program keeps them in."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray, in_space
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_PAIR_REACH = 0.1
"""Links whose axes are farther apart than this share of the arm's length have no side between them (taste)."""


@dataclass(frozen=True, eq=False)
class JointRegions:
    """Half-spaces that joints and the tip keep to, for the arm's axis: n · P ≥ b.

    The sides of a joint make a convex region. A joint lies in the regions of both its links, so that both ends of a
    link lie in the link's own, and so all of it does. Walls, and other links that must be kept apart, are behind the
    sides already by the radius and the clearance; what a link has beyond that is its gap.

    Attributes:
        joint: to which each belongs, shape (r,); that of the tip is the number of links.
        normals: unit, inwards, shape (r, d).
        offsets: b, shape (r,) [m].
        gap_shares: share of the gap that is asked for at each, shape (r,): 1 for walls, less between links that cannot
            keep so much of each other.
    """

    joint: IntArray
    normals: FloatArray
    offsets: FloatArray
    gap_shares: FloatArray

    @classmethod
    def of_links(
        cls, link: IntArray, normals: FloatArray, offsets: FloatArray, gap_shares: FloatArray
    ) -> "JointRegions":
        """Return the sides of links as sides of both their ends; arguments as of the class, by link."""
        joint = np.concatenate((link, link + 1))
        return cls(joint, np.tile(normals, (2, 1)), np.tile(offsets, 2), np.tile(gap_shares, 2))

    @property
    def most(self) -> int:
        """Most sides of any joint."""
        return int(np.max(np.bincount(self.joint), initial=0)) if len(self.joint) else 0

    @property
    def number(self) -> IntArray:
        """Of every side its number among those of its joint, shape (r,)."""
        order = np.argsort(self.joint, kind="stable")
        found = np.empty(len(order), dtype=np.intp)
        found[order] = np.arange(len(order)) - np.searchsorted(self.joint[order], self.joint[order])
        return found

    def gap(self, first_shares: FloatArray, points: FloatArray) -> float:
        """Return the gap that the held parts of all links have inside their regions [m].

        Args:
            first_shares: where on each link the part begins that must lie inside, shape (links,).
            points: joint and tip positions, shape (links + 1, d) [m].
        """
        starts = points[:-1] + first_shares[:, None] * np.diff(points, axis=0)
        held = np.vstack((starts, points[-1:]))[self.joint]
        inside = np.einsum("rd,rd->r", held, self.normals) - self.offsets
        # What is asked for no gap at all says nothing of it.
        asked = self.gap_shares > 0.0
        return float(np.min(inside[asked] / self.gap_shares[asked], initial=np.inf))


def held_segments(arm: Arm, points: FloatArray) -> FloatArray:
    """Return the parts of the links that may touch nothing, shape (k, 2, 3) [m]: those of the last k links."""
    shares = arm.free_shares
    starts = points[:-1] + shares[:, None] * np.diff(points, axis=0)
    return in_space(np.stack((starts, points[1:]), axis=1)[shares < 1.0])


LinkSides = tuple[IntArray, FloatArray, FloatArray, FloatArray]
"""Link, normal, offset and share of the gap of every side, as ``JointRegions`` has them."""


def regions_about(
    arm: Arm,
    tree: SurfaceTree,
    clearance: float,
    wanted_gap: float,
    points: FloatArray,
    settings: PoseSettings,
) -> JointRegions:
    """Return the sides of every link's region about a pose, for both its ends.

    Args:
        arm: the arm.
        tree: of the walls or surfaces.
        clearance: gap that the user asks for beyond the arm's radius [m].
        wanted_gap: room beyond that [m].
        points: joints and tip, shape (links + 1, d) [m].
        settings: how far and how many.
    """
    sides = (_surface_sides(arm, tree, clearance, points, settings), _pair_sides(arm, wanted_gap, points))
    return JointRegions.of_links(*(np.concatenate(column) for column in zip(*sides, strict=True)))


def _surface_sides(
    arm: Arm, tree: SurfaceTree, clearance: float, points: FloatArray, settings: PoseSettings
) -> LinkSides:
    segments = held_segments(arm, points)
    # A polygon has few edges; nothing of it need stand out behind a side.
    behind = settings.behind * arm.length if arm.dimension == 3 else 0.0
    rows = tree.planes(segments, settings.reach * arm.length, settings.most_sides, behind)
    nearest = segments[rows.link, 0] + rows.share[:, None] * (segments[rows.link, 1] - segments[rows.link, 0])
    # What a surface's rounding takes is told in the gap, so the side stands that far from the axis' nearest point.
    to_axis = np.einsum("rd,rd->r", rows.normal, nearest) - rows.gap
    link = rows.link + arm.links - len(segments)
    return link, rows.normal[:, : arm.dimension], to_axis + arm.radius + clearance, np.ones(len(link))


def _pair_sides(arm: Arm, wanted_gap: float, points: FloatArray) -> LinkSides:
    """Two sides for every pair of links that may meet: each keeps to its side of the plane half-way between them.

    Links that are not far apart along the arm cannot keep the wanted gap, and are asked for the share of it that
    planning keeps between them.
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
        np.concatenate((middle, -middle)) + arm.radius,
        np.concatenate((shares, shares)),
    )
