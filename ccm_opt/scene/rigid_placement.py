"""Where a body stands and how it is turned: a rigid motion from its own coordinates to those of the room."""

from dataclasses import dataclass, field

import numpy as np

from ccm_opt.core.arrays import FloatArray


@dataclass(frozen=True)
class RigidPlacement:
    """A rigid motion x ↦ R x + p.

    Attributes:
        position: p, where the body's origin comes to lie, shape (3,) [m].
        rotation: R, a rotation matrix, shape (3, 3).
    """

    position: FloatArray = field(default_factory=lambda: np.zeros(3))
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))

    @classmethod
    def turned(cls, position: FloatArray, angles: FloatArray) -> "RigidPlacement":
        """Turned about the fixed x-axis, then the fixed y-axis, then the fixed z-axis, then moved.

        Args:
            position: where the body's origin comes to lie, shape (3,) [m].
            angles: about x, y and z, shape (3,) [rad].
        """
        about_x, about_y, about_z = (_about(axis, angle) for axis, angle in enumerate(angles))
        return cls(position, about_z @ about_y @ about_x)

    @classmethod
    def of_quaternion(cls, position: FloatArray, quaternion: FloatArray) -> "RigidPlacement":
        """Turned as a quaternion (w, x, y, z) of any length but zero says, then moved."""
        w, x, y, z = quaternion / np.linalg.norm(quaternion)
        rotation = np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
                [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
                [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        return cls(position, rotation)

    @property
    def quaternion(self) -> FloatArray:
        """The rotation as a unit quaternion (w, x, y, z), w not negative, shape (4,)."""
        # The greatest of the four squares is divided by, so that nothing is lost to rounding.
        turn = self.rotation
        trace = float(np.trace(turn))
        squares = np.array([trace, *np.diag(turn)])
        skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        greatest = int(np.argmax(squares))
        if greatest == 0:
            found = np.array([1.0 + trace, *skew])
        else:
            axis = greatest - 1
            symmetric = turn[axis] + turn[:, axis]
            symmetric[axis] = 1.0 + 2.0 * turn[axis, axis] - trace
            found = np.array([skew[axis], *symmetric])
        found = found / np.linalg.norm(found)
        return np.asarray(-found if found[0] < 0.0 else found)

    @property
    def is_identity(self) -> bool:
        """Whether nothing is moved at all."""
        return bool(np.all(self.position == 0.0) and np.array_equal(self.rotation, np.eye(3)))

    def points(self, own: FloatArray) -> FloatArray:
        """Points of the body where they come to lie, shape (..., 3) [m]."""
        return np.asarray(own @ self.rotation.T + self.position)


def _about(axis: int, angle: float) -> FloatArray:
    """The rotation about a coordinate axis by an angle [rad]."""
    first = (axis + 1) % 3
    second = (axis + 2) % 3
    turn = np.eye(3)
    turn[first, first] = turn[second, second] = np.cos(angle)
    turn[first, second] = -np.sin(angle)
    turn[second, first] = np.sin(angle)
    return turn
