"""Checks of straight motions in space by samples, against a grid of distances and, near surfaces, their tree.

What it lets pass is not proved; that is left to the certificate.
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
"""Of the grid. Measured in confined scenes: filled in 10 to 60 ms, a cell is a fiftieth of the reach."""
_TOLD = 0.1
"""Distances that the grid tells apart, beyond the gap that is kept [arm lengths]. Taste."""
_BEYOND = 0.02
"""By how much the grid reaches farther than the arm [arm lengths]; what lies beyond counts as its border."""
_SPARED = 1e-4
"""Gap that samples keep beyond contact [arm lengths]: most of what they let pass is then certified."""


@dataclass(frozen=True, eq=False)
class SampledMotions:
    """Looks at poses of straight motions of one arm on a fixed base, among the surfaces of one scene.

    Attributes:
        arm: the arm.
        tree: of the surfaces.
        kept: distance that the arm's axis has to keep from them [m].
        box: where the surfaces are, lower and upper corner, shape (2, 3) [m]; empty where there are none.
    """

    arm: Arm
    tree: SurfaceTree
    kept: float
    box: FloatArray

    @cached_property
    def grid(self) -> GridDistances:
        """Distances from the surfaces in what the arm reaches."""
        arm = self.arm
        margin = (1.0 + _BEYOND) * arm.length
        low, high = arm.base - margin, arm.base + margin
        if len(self.box):
            beside = self.kept + _TOLD * arm.length
            low, high = np.maximum(low, self.box[0] - beside), np.minimum(high, self.box[1] + beside)
        return GridDistances.over(self.tree, (low, np.maximum(high, low)), _CELLS, self.kept + _TOLD * arm.length)

    def free_shares(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """How far motions that are straight in the bends come before a pose touches something, as shares of the whole.

        Args:
            start: configurations, shape (m, c) [rad].
            end: likewise.

        Returns:
            Shape (m,): 1 where nothing was met, 0 where the end bends a joint beyond its limit.
        """
        arm, grid = self.arm, self.grid
        link, _ = arm.mount_end
        spared = _SPARED * arm.length
        share = np.empty(len(start))
        NativeCall(
            "free_shares_in_space",
            links=arm.links, first_link=link, counts=grid.values.shape,
            first_pair=arm.first_self_pair if arm.self_collision else arm.links,
            length=arm.link_length, mount=arm.mount_length, wall=self.kept + spared, pair=2.0 * arm.radius + spared,
            low=grid.low, cell=grid.cell, place=arm.base, base=arm.base_rotation,
            grid=np.ascontiguousarray(grid.values),
            **({} if self.tree.search is None else {"surfaces": self.tree.search.for_c}),
            work=np.empty(16 * arm.links + 4),
            motions=len(start), start=np.ascontiguousarray(start), end=np.ascontiguousarray(end), share=share,
        )()  # fmt: skip
        share[np.any(np.abs(end) > arm.upper_limits, axis=1)] = 0.0
        return share
