"""Velocity products of one link, and symmetric matrices as the vectors that links pass on.

A link is symmetric about the x axis of its frame, which leaves few terms of each product.
"""

from typing import Any

import casadi as ca


def centripetal(omega: Any) -> Any:
    """ω × (ω × x̂), (3,): acceleration of a unit point on the link's axis due to its angular velocity alone."""
    x, y, z = ca.vertsplit(omega)
    return ca.vertcat(-y * y - z * z, x * y, x * z)


def gyroscopic(axial: Any, transverse: Any, omega: Any) -> Any:
    """ω × I ω of a body that is symmetric about x, (3,)."""
    spin = (axial - transverse) * omega[0]
    return ca.vertcat(0, spin * omega[2], -spin * omega[1])


def pack(M: Any) -> Any:
    """Upper triangle of a square matrix, row by row."""
    size = M.shape[0]
    return ca.vertcat(*(M[i, j] for i in range(size) for j in range(i, size)))


def unpack(packed: Any) -> Any:
    """Symmetric matrix from its packed upper triangle."""
    size = int((2 * packed.shape[0]) ** 0.5)  # n (n + 1) / 2 numbers lie between n²/2 and (n + 1)²/2
    places = iter(ca.vertsplit(packed))
    upper = {(i, j): next(places) for i in range(size) for j in range(i, size)}
    rows = [[upper[min(i, j), max(i, j)] for j in range(size)] for i in range(size)]
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))
