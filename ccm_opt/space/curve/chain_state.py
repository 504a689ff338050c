"""Where the links of an arm in space are, and how they move with the coordinates of a curve, in one pass."""

from typing import NamedTuple, Protocol

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.jointed.space_kinematics import positions_of_links, rotations_by_numpy


class ChainState(NamedTuple):
    """An arm at coordinates v, of which there are p.

    Attributes:
        q: the configuration, shape (c,) [rad, m].
        positions: of the joints and the tip, shape (links + 1, 3) [m].
        rotations: of the links, shape (links, 3, 3).
        omega: Ω, by which the links turn with v, shape (links, 3, p) [rad].
        jacobian: dP, by which joints and tip move with v, shape (links + 1, 3, p) [m].
    """

    q: FloatArray
    positions: FloatArray
    rotations: FloatArray
    omega: FloatArray
    jacobian: FloatArray


class ChainEvaluator(Protocol):
    """Evaluates an arm with q = B v + q₀; not for use by two threads at once."""

    def at(self, v: FloatArray) -> ChainState:
        """The arm at coordinates of shape (p,)."""
        ...


class ChainByNumpy:
    """Evaluates an arm where nothing is compiled, with the results of compiled code but for rounding.

    Args:
        arm: the arm.
        matrix: B, shape (c, p).
        offset: q₀, shape (c,).
    """

    def __init__(self, arm: SpaceArm, matrix: FloatArray, offset: FloatArray) -> None:
        self._arm = arm
        self._matrix = matrix
        self._offset = offset

    def at(self, v: FloatArray) -> ChainState:
        """The arm at coordinates of shape (p,).

        A joint turns what is beyond it about the z axis of the link before and about its own y axis:
        Ω_j = Ω_(j−1) + z B_a + y B_b, and its link carries the next joint along: dP_(j+1) = dP_j + l Ω_j × t_j.
        """
        arm = self._arm
        bends = 2 * arm.links
        q = self._matrix @ v + self._offset
        rotations = rotations_by_numpy(arm, q)
        about_z = np.concatenate((arm.base_rotation[None, :, 2], rotations[:-1, :, 2]))
        about_y = rotations[:, :, 1]
        turns = (
            about_z[:, :, None] * self._matrix[0:bends:2, None] + about_y[:, :, None] * self._matrix[1:bends:2, None]
        )
        omega = np.cumsum(turns, axis=0)
        jacobian = np.zeros((arm.links + 1, 3, len(v)))
        np.cumsum(arm.link_length * np.cross(omega, rotations[:, :, :1], axis=1), axis=0, out=jacobian[1:])
        jacobian += np.multiply.outer(arm.direction, self._matrix[bends:].sum(axis=0))
        return ChainState(q, positions_of_links(arm, q, rotations), rotations, omega, jacobian)
