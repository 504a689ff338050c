"""Checks of straight motions in space by samples, against a grid of distances and, near surfaces, their tree.

A motion that passes is not proved to be free; that is left to the certificate.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.planning.grid_ways import GridDistances
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_CELLS = 300_000
"""Number of cells of the grid. Measured in confined scenes: filled in 10 to 60 ms, a cell is a fiftieth of the
reach."""
_TOLD = 0.1
"""Range of distances that the grid resolves, beyond the gap that is kept [arm lengths]. Taste."""
_BEYOND = 0.02
"""Distance that the grid extends beyond the arm's reach [arm lengths]; places outside count as its border."""
_SPARED = 1e-4
"""Gap that samples keep beyond contact [arm lengths]: most motions that pass are then certified."""


@dataclass(frozen=True, eq=False)
class SampledMotions:
    """Checks straight motions of one arm on a fixed base, among the surfaces of one scene.

    Attributes:
        arm: the arm.
        tree: tree of the surfaces.
        kept: distance that the arm's axis has to keep from them [m].
        box: extent of the surfaces, lower and upper corner, shape (2, 3) [m]; empty where there are none.
    """

    arm: Arm
    tree: SurfaceTree
    kept: float
    box: FloatArray

    @cached_property
    def grid(self) -> GridDistances:
        """Distances from the surfaces within the arm's reach."""
        arm = self.arm
        margin = (1.0 + _BEYOND) * arm.length
        low, high = arm.base - margin, arm.base + margin
        if len(self.box):
            beside = self.kept + _TOLD * arm.length
            low, high = np.maximum(low, self.box[0] - beside), np.minimum(high, self.box[1] + beside)
        return GridDistances.over(self.tree, (low, np.maximum(high, low)), _CELLS, self.kept + _TOLD * arm.length)

    def free_shares(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the free shares of motions that are straight in the bends, up to the first pose in contact.

        Args:
            start: configurations, shape (m, c) [rad].
            end: configurations at the other end, shape (m, c) [rad].

        Returns:
            Shape (m,): 1 where nothing was touched, 0 where the end bends a joint beyond its limit.
        """
        arm, grid = self.arm, self.grid
        link, share = arm.mount_end
        mount = (link + share) * arm.link_length
        spared = _SPARED * arm.length
        shares = np.empty(len(start))
        NativeCall(
            "free_shares_in_space",
            links=arm.links, first_link=link, counts=grid.values.shape,
            first_pair=arm.first_self_pair if arm.self_collision else arm.links,
            length=arm.link_length, mount=mount, wall=self.kept + spared, pair=2.0 * arm.radius + spared,
            low=grid.low, cell=grid.cell, place=arm.base, base=arm.base_rotation,
            grid=np.ascontiguousarray(grid.values),
            **({} if self.tree.search is None else {"surfaces": self.tree.search.for_c}),
            work=np.empty(16 * arm.links + 4),
            motions=len(start), start=np.ascontiguousarray(start), end=np.ascontiguousarray(end), share=shares,
        )()  # fmt: skip
        shares[np.any(np.abs(end) > arm.upper_limits, axis=1)] = 0.0
        return shares
