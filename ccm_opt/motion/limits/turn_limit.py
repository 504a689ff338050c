"""The turn limit: no link turns farther in one step than the linearised rows can be trusted."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.limits.limit import Limit, LimitRows
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose


@dataclass(frozen=True)
class TurnLimit(Limit):
    """Bounds the turn of every link in a step; headings are linear in the coordinates, so the rows are exact."""

    def linearised(self, space: LinkSpace, pose: Pose, jacobians: FloatArray, turn: float) -> LimitRows:
        """One row a link: −turn ≤ Δφ ≤ turn."""
        del pose, jacobians
        matrix = space.matrix
        bound = np.full(len(matrix), turn)
        return LimitRows(matrix, -bound, bound)
