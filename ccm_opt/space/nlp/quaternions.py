"""Unit quaternions (w, x, y, z) in CasADi's symbols, shape (4, n): one a column."""

from collections.abc import Iterable
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.ground.arrays import FloatArray


def product(first: ca.SX, second: ca.SX) -> Any:
    """Hamilton's products, column by column: the second turn in the axes of the first."""
    return ca.vertcat(*_product_of(ca.vertsplit(first), ca.vertsplit(second)))


def _product_of(first: Iterable[Any], second: Iterable[Any]) -> tuple[Any, Any, Any, Any]:
    """Parts of Hamilton's product, of symbols or numbers."""
    w, x, y, z = first
    a, b, c, d = second
    return (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


def turned_by(vectors: ca.SX) -> ca.SX:
    """Turns by rotation vectors, shape (3, n) [rad]."""
    angle = ca.sqrt(ca.sum1(vectors**2) + 1e-16)  # smooth at no turn, and otherwise the same but for rounding
    share = ca.sin(angle / 2) / angle
    return ca.vertcat(ca.cos(angle / 2), ca.repmat(share, 3, 1) * vectors)


def axis(quaternions: ca.SX, number: int) -> ca.SX:
    """The x, y or z axis (0, 1 or 2) after each turn, a column of its matrix, shape (3, n)."""
    w, x, y, z = ca.vertsplit(quaternions)
    if number == 0:
        return ca.vertcat(w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y))
    if number == 1:
        return ca.vertcat(2 * (x * y - w * z), w**2 - x**2 + y**2 - z**2, 2 * (y * z + w * x))
    return ca.vertcat(2 * (x * z + w * y), 2 * (y * z - w * x), w**2 - x**2 - y**2 + z**2)


def chained_quaternions(turns: FloatArray) -> FloatArray:
    """Products of turns one after the other, shape (n, 4), as numbers; continuous in sign."""
    chained = np.empty_like(turns)
    latest = np.array([1.0, 0.0, 0.0, 0.0])
    for step, turn in enumerate(turns):
        latest = np.array(_product_of(latest, turn))
        chained[step] = latest
    return chained


def quaternions_of(vectors: FloatArray) -> FloatArray:
    """Turns by rotation vectors as numbers, shape (n, 3) to (n, 4)."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.concatenate((np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors), axis=1)
