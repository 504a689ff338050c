"""Proofs that pairs of links of a planar arm do not collide on straight motions, by NumPy."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.robot.link_layout import NextPairs
from ccm_opt.scene.certificate import MotionParts, Pairs
from tests.oracles.plane_segments import closest_on_segments


@dataclass(frozen=True, eq=False)
class InterpretedProofs:
    """Proofs with the results of ``PairProofs``, by NumPy.

    Attributes:
        next_pair: as of ``PairProofs``, shape (links, links + 1).
        least: contribution of each link to the minimum distance between the axes of two links, shape (links,) [m].
    """

    next_pair: NextPairs
    least: FloatArray

    def unproved(self, parts: MotionParts, pairs: Pairs | None) -> tuple[Pairs, IntArray]:
        """Return the pairs that are not proved, and the intervals with a pair in contact halfway, as ``PairProofs``."""
        part, i, j = self._near(parts) if pairs is None else pairs
        if len(part) == 0:
            return (part, i, j), part
        middle = parts.middle
        _, _, apart = closest_on_segments(middle[part, i], middle[part, i + 1], middle[part, j], middle[part, j + 1])
        distance = np.hypot(apart[:, 0], apart[:, 1])
        direction = apart / np.maximum(distance, 1e-12)[:, None]

        # A difference of two points, one on each link, is a mean of corner differences at each end of the stretch, and
        # along the stretch leaves its chord by the sag of the links between.
        corners = np.min(
            [
                np.einsum("md,md->m", p[part, i + s] - p[part, j + t], direction)
                for p in (parts.a, parts.b)
                for s in (0, 1)
                for t in (0, 1)
            ],
            axis=0,
        )

        # sag[j] is that of the far end of link j; what the links before i turn moves both alike and cancels.
        before = np.where(i > 0, parts.chord_deviation[part, np.maximum(i - 1, 0)], 0.0)
        least = self.least[i] + self.least[j]
        unsafe: BoolArray = corners <= least + parts.chord_deviation[part, j] - before
        touching = unsafe & (distance <= least)
        return (part[unsafe], i[unsafe], j[unsafe]), part[touching]

    def _near(self, parts: MotionParts) -> Pairs:
        """Return every interval with every pair of links that may come near each other."""
        middle = 0.25 * (parts.a[:, :-1] + parts.a[:, 1:] + parts.b[:, :-1] + parts.b[:, 1:])
        x = np.ascontiguousarray(middle[..., 0])
        y = np.ascontiguousarray(middle[..., 1])

        # Any point of a link lies within half a link of its middle.
        reach = float(np.max(parts.arm.lengths)) + 2.0 * parts.moved
        found = [(np.zeros(0, int),) * 3]
        # Diagonal by diagonal: all pairs (i, i + apart) at once without an index array of links².
        for apart in range(1, parts.arm.links):
            dx = x[:, apart:] - x[:, :-apart]
            dy = y[:, apart:] - y[:, :-apart]
            both = self.least[apart:] + self.least[:-apart]
            counts = np.diagonal(self.next_pair, apart)[:-1] == np.arange(apart, parts.arm.links)
            part, i = np.nonzero(counts & (dx * dx + dy * dy < (reach[:, None] + both) ** 2))
            found.append((part, i, i + apart))
        part, i, j = (np.concatenate(column) for column in zip(*found, strict=True))
        return part, i, j
