"""Recursions along the arm: the function of one link, applied from base to tip or from tip to base, written out.

The compiled runtime has the same two loops in C (``runtime/recursion.c``), so these serve its interpreted stand-in, the
mass matrix and the tests. Written-out expressions grow linearly with the arm and build in 0.12 s for 1152 joints; loops
folded by CasADi (``mapaccum``) build faster, but its virtual machine takes twice as long for every call of them.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca

from ccm_opt.dynamics.algorithms.ball_joint import Angles


class ModelSymbols(NamedTuple):
    """Symbols of an arm's numbers, one column a link; see ``ArmModel``.

    Attributes:
        bodies: shape (4, links).
        drives: shape (6, links).
        world: shape (5,).
    """

    bodies: Any
    drives: Any
    world: Any


def model_symbols(links: int) -> ModelSymbols:
    """Symbols of the numbers of an arm with so many links."""
    return ModelSymbols(ca.SX.sym("bodies", 4, links), ca.SX.sym("drives", 6, links), ca.SX.sym("world", 5))


def per_ball(column: Any) -> Any:
    """View of a column of all revolutes, (3 * links,), with one ball a column, (3, links)."""
    return ca.reshape(column, 3, column.shape[0] // 3)


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
    outputs_of_links = []
    for k in range(links):
        state, *outputs = step(state, *(column[:, k] for column in columns))
        outputs_of_links.append(outputs)
    return state, [ca.horzcat(*column) for column in zip(*outputs_of_links, strict=True)]


def inward(step: Any, state: Any, columns: Sequence[Any]) -> tuple[Any, list[Any]]:
    """Run a step from tip to base; inputs and outputs keep their order from base to tip."""
    state, outputs = outward(step, state, [_reversed(column) for column in columns])
    return state, [_reversed(output) for output in outputs]


def _reversed(columns: Any) -> Any:
    return columns[:, ::-1]
