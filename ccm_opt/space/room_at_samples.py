"""Gaps of an arm in space at the samples of a motion: between its surface and all others, and between its own links."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.space_kinematics import exposed_links
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.motion.space_link_motion import LinkMotion
from ccm_opt.space.problem import SpaceProblem


@dataclass(frozen=True, eq=False)
class NearestOfSamples:
    """The least gap of every sample, and where it is.

    Attributes:
        gap: between the surfaces; the reach where nothing is nearer, shape (T,) [m].
        link: from 1; 0 where nothing is near, shape (T,).
        other: number of the surface's owner, or of the other link from 1, shape (T,).
    """

    gap: FloatArray
    link: IntArray
    other: IntArray


@dataclass(frozen=True, eq=False)
class GapsAtSamples:
    """Gaps between bare surfaces, without clearance.

    Attributes:
        walls: to the nearest surface of the scene.
        itself: between links that may not meet.
        names: of the owners of surfaces.
        reach: beyond which gaps to walls are not told apart [m].
    """

    walls: NearestOfSamples
    itself: NearestOfSamples
    names: tuple[str, ...]
    reach: float

    @classmethod
    def of(
        cls, problem: SpaceProblem, points: FloatArray, reach: float | None = None, own_reach: float | None = None
    ) -> "GapsAtSamples":
        """The gaps of poses.

        Args:
            problem: surfaces and arm.
            points: joints and tip of every pose, shape (T, links + 1, 3) [m].
            reach: how far is looked; a link's length when None [m].
            own_reach: how far is looked for other links; as far as for walls when None [m].
        """
        arm = problem.arm
        soup = problem.workspace.soup
        far = arm.link_length if reach is None else reach
        walls = _walls(problem, SurfaceTree.of(soup), points, far)
        return cls(walls, _itself(problem, points, far if own_reach is None else own_reach), soup.names, far)

    def other(self, near: NearestOfSamples, sample: int) -> str:
        """What a link is near to in a sample, in words."""
        number = int(near.other[sample])
        return f"'{self.names[number]}'" if near is self.walls else f"link {number}"


def _walls(problem: SpaceProblem, tree: SurfaceTree, points: FloatArray, reach: float) -> NearestOfSamples:
    arm = problem.arm
    link, exposed = exposed_links(arm, points)
    count = len(points)
    if link == arm.links or len(problem.workspace.soup) == 0:
        return _nothing(count, reach)
    found = tree.nearest(exposed.reshape(-1, 2, 3), reach + arm.radius, together=exposed.shape[1])
    gap = found.gap.reshape(count, -1) - arm.radius
    best = np.argmin(gap, axis=1)
    rows = np.arange(count)
    owner = found.owner.reshape(count, -1)[rows, best]
    return NearestOfSamples(gap[rows, best], np.where(owner >= 0, link + best + 1, 0), owner)


def _itself(problem: SpaceProblem, points: FloatArray, reach: float) -> NearestOfSamples:
    arm = problem.arm
    if not arm.self_collision:
        return _nothing(len(points), reach)
    nearest = LinkMotion(arm).nearest_pairs(points, reach + 2.0 * arm.radius)
    found = nearest.first >= 0
    gap = np.where(found, nearest.distance - 2.0 * arm.radius, reach)
    return NearestOfSamples(gap, nearest.first + 1, np.where(found, nearest.second + 1, -1))


def _nothing(count: int, reach: float) -> NearestOfSamples:
    return NearestOfSamples(np.full(count, reach), np.zeros(count, dtype=np.intp), np.full(count, -1, dtype=np.intp))
