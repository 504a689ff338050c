"""What the tip of an arm in space is asked for: a place, and perhaps a direction; by how much it is missed."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.curve.chain_state import ChainState


@dataclass(frozen=True)
class TipTarget:
    """A place for the tip and perhaps a direction for the last link.

    Attributes:
        position: shape (3,) [m].
        direction: a unit vector, shape (3,), or None when any will do.
    """

    position: FloatArray
    direction: FloatArray | None = None

    def errors(self, state: ChainState, length_unit: float) -> tuple[FloatArray, FloatArray]:
        """What the tip lacks, and how that changes with the coordinates.

        Args:
            state: the arm at its coordinates.
            length_unit: length that counts as much as one radian [m].

        Returns:
            Errors of place, and of direction along two axes across the last link, shape (3,) or (5,), and the
            derivatives of tip and direction themselves, shape (3, p) or (5, p).
        """
        error = (self.position - state.positions[-1]) / length_unit
        rows = state.jacobian[-1] / length_unit
        if self.direction is None:
            return error, rows
        last = state.rotations[-1]
        across = last[:, 1:]
        missing = self.angle(last[:, 0]) * _unit(across.T @ self.direction)
        # dt = ω × t, so y·dt = ω·(t × y) = ω·z, and z·dt = −ω·y with the axes x = t, y and z of the link.
        turning = np.stack((last[:, 2] @ state.omega[-1], -(last[:, 1] @ state.omega[-1])))
        return np.concatenate((error, missing)), np.concatenate((rows, turning))

    def angle(self, direction: FloatArray) -> float:
        """Angle between a unit vector and the direction asked for [rad]; 0 when any will do."""
        if self.direction is None:
            return 0.0
        sine = float(np.linalg.norm(np.cross(direction, self.direction)))
        return float(np.arctan2(sine, direction @ self.direction))


def _unit(vector: FloatArray) -> FloatArray:
    """A vector of length 1; the first axis where there is none, so that a link that points backwards turns at all."""
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else np.eye(len(vector))[0]
