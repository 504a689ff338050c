"""Recursions along the arm: one step function a link, written out or folded into a loop."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from ccm_opt.dynamics.algorithms.ball_joint import Angles

FOLD_BASE = 10  # width of the nested loops that CasADi folds a recursion into


@dataclass(frozen=True)
class Symbols:
    """Inputs of a dynamics function, one column a link, as SX (written out) or MX (folded) symbols."""

    links: int
    folded: bool

    def column(self, name: str) -> Any:
        """Symbol of one value a revolute, shape (3 * links,)."""
        return self.matrix(name, 3 * self.links, 1)

    def matrix(self, name: str, rows: int, columns: int) -> Any:
        """Symbol of the given shape."""
        return (ca.MX if self.folded else ca.SX).sym(name, rows, columns)

    def per_ball(self, column: Any) -> Any:
        """View of a column of revolutes with one ball a column, shape (3, links)."""
        return ca.reshape(column, 3, self.links)


def sines_and_cosines(angles: Any) -> Any:
    """Sines over cosines of the angles of every ball, shape (6, links) for angles (3, links)."""
    return ca.vertcat(ca.sin(angles), ca.cos(angles))


def angles_of(trigonometry: Any) -> Angles:
    """The sines and cosines of one ball from its column of ``sines_and_cosines``."""
    return Angles(trigonometry[:3], trigonometry[3:])


def outward(step: Any, state: Any, columns: Sequence[Any]) -> tuple[Any, list[Any]]:
    """Run ``step(state, *columns) -> (state, *outputs)`` from base to tip.

    Args:
        step: CasADi function of one link.
        state: start state at the base.
        columns: inputs with one column a link.

    Returns:
        The state at the tip, and the outputs, one column a link.
    """
    links = columns[0].shape[1]
    if isinstance(columns[0], ca.MX):
        folded = step.mapaccum(f"{step.name()}_sweep", links, {"base": FOLD_BASE})
        states, *outputs = folded(state, *columns)
        return states[:, -1], outputs
    results = []
    for k in range(links):
        state, *outputs = step(state, *(column[:, k] for column in columns))
        results.append(outputs)
    return state, [ca.horzcat(*rows) for rows in zip(*results, strict=True)]


def inward(step: Any, state: Any, columns: Sequence[Any]) -> tuple[Any, list[Any]]:
    """Run a step from tip to base; inputs and outputs keep their order from base to tip."""
    state, outputs = outward(step, state, [_reversed(column) for column in columns])
    return state, [_reversed(output) for output in outputs]


def _reversed(columns: Any) -> Any:
    return columns[:, ::-1]


def cross(u: Any, v: Any) -> Any:
    """Vector product of two (3,) expressions."""
    return ca.cross(u, v)


def centripetal(omega: Any) -> Any:
    """ω × (ω × x̂), (3,): acceleration of a unit point on the link's axis due to its angular velocity alone."""
    x, y, z = omega[0], omega[1], omega[2]
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
    size = int((2 * packed.shape[0]) ** 0.5)
    places = iter(ca.vertsplit(packed))
    upper = {(i, j): next(places) for i in range(size) for j in range(i, size)}
    rows = [[upper[min(i, j), max(i, j)] for j in range(size)] for i in range(size)]
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))
