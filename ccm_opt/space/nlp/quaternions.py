"""Unit quaternions (w, x, y, z) in CasADi's symbols, shape (4, 1)."""

from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.ground.arrays import FloatArray


def product(first: Any, second: Any) -> Any:
    """Hamilton's product, of symbols or numbers: the second turn in the axes that the first has turned."""
    w, x, y, z = ca.vertsplit(first)
    a, b, c, d = ca.vertsplit(second)
    return ca.vertcat(
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


def turned_by(vector: ca.SX) -> ca.SX:
    """The turn by a rotation vector, shape (3, 1) [rad]."""
    angle = ca.sqrt(ca.sumsqr(vector) + 1e-16)  # smooth at no turn, and otherwise the same but for rounding
    return ca.vertcat(ca.cos(angle / 2), ca.sin(angle / 2) / angle * vector)


def axis(quaternion: ca.SX, number: int) -> ca.SX:
    """The x, y or z axis (0, 1 or 2) after the turn, a column of its matrix, shape (3, 1)."""
    w, x, y, z = ca.vertsplit(quaternion)
    columns = (
        ca.vertcat(w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y)),
        ca.vertcat(2 * (x * y - w * z), w**2 - x**2 + y**2 - z**2, 2 * (y * z + w * x)),
        ca.vertcat(2 * (x * z + w * y), 2 * (y * z - w * x), w**2 - x**2 - y**2 + z**2),
    )
    return columns[number]


def chained_quaternions(turns: FloatArray) -> FloatArray:
    """Products of turns one after the other, shape (n, 4), as numbers; continuous in sign."""
    chained = np.empty_like(turns)
    latest = np.array([1.0, 0.0, 0.0, 0.0])
    for step, turn in enumerate(turns):
        latest = np.asarray(product(ca.DM(latest), ca.DM(turn))).ravel()
        chained[step] = latest
    return chained


def quaternions_of(vectors: FloatArray) -> FloatArray:
    """Turns by rotation vectors as numbers, shape (n, 3) to (n, 4)."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.concatenate((np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors), axis=1)
