"""The certificate of a motion on the links: continuous in time and along the arm.

Between two keyframes link headings are linear in u. A joint then leaves the chord of its two end positions by at
most ⅛ Σ l Δφ² over the links before it, since |∂²P/∂u²| ≤ Σ l Δφ² and linear interpolation errs by ⅛ max|f''|
(links are straight: no curvature term). So link j stays within the hull of its four end positions, grown by that much.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.contacts import closest_on_segments

MAX_DEPTH = 7
"""Bisections of an interval before the certificate is refused."""


@dataclass(frozen=True)
class Certificate:
    """Certifies motions of one arm in one workspace.

    Attributes:
        arm: the arm.
        workspace: the workspace.
        tree: spatial index of the walls' cores.
    """

    arm: Arm
    workspace: Workspace
    tree: shapely.STRtree

    @classmethod
    def of(cls, arm: Arm, workspace: Workspace) -> "Certificate":
        """Index the walls once."""
        return cls(arm, workspace, shapely.STRtree([wall.core for wall in workspace.walls]))

    def failures(self, headings: FloatArray, depth: int = MAX_DEPTH) -> IntArray:
        """Intervals of a piecewise-linear motion that cannot be certified.

        Args:
            headings: link headings at the keyframes, shape (K, links) [rad].
            depth: bisections allowed.

        Returns:
            Sorted indices of intervals k (from keyframe k to k + 1); empty when the motion is safe.
        """
        start, end = headings[:-1], headings[1:]
        owner = np.arange(len(start))
        for _ in range(depth):
            bad = ~self._safe(start, end)
            if not bad.any():
                return owner[:0]
            start, end, owner = start[bad], end[bad], owner[bad]
            middle = 0.5 * (start + end)
            start, end = np.concatenate((start, middle)), np.concatenate((middle, end))
            owner = np.concatenate((owner, owner))
        return np.unique(owner[~self._safe(start, end)])

    def _safe(self, start: FloatArray, end: FloatArray) -> BoolArray:
        """Which intervals pass without bisection, shape (m,)."""
        a, b = self.arm.joint_positions(start), self.arm.joint_positions(end)
        sag = np.cumsum(self.arm.link_length * (end - start) ** 2, axis=1) / 8.0
        safe = self._clear_of_walls(a, b, sag)
        if self.arm.self_collision:
            safe[safe] &= self._clear_of_itself(start[safe], end[safe], a[safe], b[safe], sag[safe])
        return safe

    def _clear_of_walls(self, a: FloatArray, b: FloatArray, sag: FloatArray) -> BoolArray:
        count, links = sag.shape
        mount = int(self.arm.mount_length / self.arm.link_length + 1e-9)
        share = self.arm.mount_length / self.arm.link_length - mount
        first = np.stack((a[:, :-1], b[:, :-1]), axis=2)
        last = np.stack((a[:, 1:], b[:, 1:]), axis=2)
        if mount < links:
            first[:, mount] += share * (last[:, mount] - first[:, mount])
        hulls = shapely.convex_hull(shapely.multipoints(np.concatenate((first, last), axis=2)[:, mount:]))
        need = self.arm.radius + self.workspace.clearance + sag[:, mount:]
        rounding = np.array([wall.rounding for wall in self.workspace.walls])
        reach = need + rounding.max() + (0.0 if self.arm.radius > 0.0 else 1e-9)
        hull, wall = self.tree.query(hulls.ravel(), predicate="dwithin", distance=reach.ravel())
        cores = np.asarray(self.tree.geometries)[wall]
        distance = shapely.distance(hulls.ravel()[hull], cores) - rounding[wall]
        touching = distance <= need.ravel()[hull]
        safe = np.ones(count, dtype=np.bool_)
        safe[hull[touching] // (links - mount)] = False
        return safe

    def _clear_of_itself(
        self, start: FloatArray, end: FloatArray, a: FloatArray, b: FloatArray, sag: FloatArray
    ) -> BoolArray:
        """Least of the eight corner differences along the closest direction at mid-interval, for every pair."""
        i, j = np.triu_indices(self.arm.links, self.arm.first_self_pair)
        safe = np.ones(len(start), dtype=np.bool_)
        if len(i) == 0 or len(start) == 0:
            return safe
        middle = self.arm.joint_positions(0.5 * (start + end))
        centre = 0.5 * (middle[:, :-1] + middle[:, 1:])
        swing = 0.5 * self.arm.link_length * np.abs(end - start).sum(axis=1)
        reach = 2.0 * self.arm.radius + self.arm.link_length + sag[:, -1] + 2.0 * swing
        near = np.linalg.norm(centre[:, i] - centre[:, j], axis=2) < reach[:, None]
        k, pair = np.nonzero(near)
        i, j = i[pair], j[pair]
        _, _, apart = closest_on_segments(middle[k, i], middle[k, i + 1], middle[k, j], middle[k, j + 1])
        direction = apart / np.maximum(np.hypot(apart[:, 0], apart[:, 1]), 1e-12)[:, None]
        corners = [
            np.einsum("md,md->m", p[k, i + s] - p[k, j + t], direction) for p in (a, b) for s in (0, 1) for t in (0, 1)
        ]
        before = np.where(i > 0, sag[k, np.maximum(i - 1, 0)], 0.0)
        touching = np.min(corners, axis=0) <= 2.0 * self.arm.radius + sag[k, j] - before
        safe[k[touching]] = False
        return safe
