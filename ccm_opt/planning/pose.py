"""A pose of the arm and its derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Pose:
    """Unknowns of the curve with everything derived from them that a step needs.

    An arm of n links in d dimensions has c coordinates, the curve p unknowns; links turn about t axes, one in the plane
    and three in space.

    Attributes:
        v: unknowns, shape (p,).
        q: the configuration, shape (c,): headings of the links [rad] in the plane, their joints' turns [rad] in space,
            and then what carries the base [link lengths, in space m].
        slopes: derivatives of it by the unknowns, shape (c, p).
        points: joint and tip positions, shape (n + 1, d) [m].
        moving: derivatives of the points, shape (n + 1, d, p) [m].
        turning: angular velocities of the links for a unit of each unknown, shape (n, t, p) [rad].
        frames: rotations of the links, shape (n, d, d); the first column is the direction of the link.
    """

    v: FloatArray
    q: FloatArray
    slopes: FloatArray
    points: FloatArray
    moving: FloatArray
    turning: FloatArray
    frames: FloatArray

    @property
    def tip(self) -> FloatArray:
        """Position of the tip, shape (d,) [m]."""
        return np.asarray(self.points[-1])

    @property
    def tip_direction(self) -> FloatArray:
        """Direction of the last link, shape (d,)."""
        return np.asarray(self.frames[-1, :, 0])

    @property
    def directions(self) -> FloatArray:
        """Unit vectors along the links, shape (n, d)."""
        return np.asarray(self.frames[:, :, 0])

    @property
    def tip_heading(self) -> float:
        """Heading of the last link in the plane, whole turns counted [rad]."""
        return float(self.q[len(self.frames) - 1])


@dataclass(frozen=True)
class Term:
    """One least-squares term of the step: ``Σ weight (rows δ − target)²``.

    Attributes:
        rows: shape (k, p).
        target: shape (k,).
        weight: shape (k,) or scalar.
    """

    rows: FloatArray
    target: FloatArray
    weight: FloatArray | float


def normal_equations(terms: Sequence[Term], ridge: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Hessian and gradient of a sum of least-squares terms.

    Args:
        terms: at least one, each with rows of shape (k, p).
        ridge: added to the diagonal, so that the Hessian is definite where no term reaches, shape (p,) or scalar.
    """
    rows = np.vstack([t.rows for t in terms])
    target = np.concatenate([t.target for t in terms])
    weight = np.concatenate([np.broadcast_to(np.asarray(t.weight, dtype=np.float64), (len(t.target),)) for t in terms])

    # ½ Σ w |R δ − t|² has the Hessian Rᵀ W R and at δ = 0 the gradient −Rᵀ W t.
    weighted = rows * weight[:, None]
    return rows.T @ weighted + ridge * np.eye(rows.shape[1]), -weighted.T @ target
