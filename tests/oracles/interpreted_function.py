"""One arm's dynamics in CasADi's virtual machine: the steps of one link, swept along the chain by Python.

The compiled runtime has the same loops in C (``recursion.c``). Written-out expressions grow linearly with the arm.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.algorithms.aba import aba_steps
from ccm_opt.dynamics.algorithms.arm_model import ArmModel, Structure
from ccm_opt.dynamics.algorithms.rnea import rnea_steps
from ccm_opt.dynamics.runtime.inverse_dynamics import DynamicsFunction


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


def build_rnea(structure: Structure) -> Any:
    """CasADi function ``rnea(q, qd, qdd, feed, bodies, drives, world) -> (tau, thrust)``.

    ``q``, ``qd``, ``qdd`` and ``tau`` are columns of 3 * links, ``feed`` is the acceleration of the base along the base
    heading and ``thrust`` the force along it; ``bodies`` (4, links), ``drives`` (6, links) and ``world`` (5,) are those
    of ``ArmModel``.
    """
    q = ca.SX.sym("q", structure.joints)
    qd = ca.SX.sym("qd", structure.joints)
    qdd = ca.SX.sym("qdd", structure.joints)
    feed = ca.SX.sym("feed")
    bodies, drives, world = model_symbols(structure.links)

    steps = rnea_steps(structure)
    trig = sines_and_cosines(per_ball(q))
    rates = per_ball(qd)
    rate_changes = per_ball(qdd)
    tip, (loads,) = outward(steps.outward, steps.base(world, feed), [trig, rates, rate_changes, bodies])
    columns = [trig, loads, rates, rate_changes, bodies, drives]
    force, (torques,) = inward(steps.inward, steps.tip(tip, world), columns)

    return ca.Function(
        "rnea",
        [q, qd, qdd, feed, bodies, drives, world],
        [ca.vec(torques), force[0]],
        ["q", "qd", "qdd", "feed", "bodies", "drives", "world"],
        ["tau", "thrust"],
    )


def build_aba(structure: Structure) -> Any:
    """CasADi function ``aba(q, qd, tau, thrust, bodies, drives, world) -> (qdd, feed)``, as ``build_rnea`` does.

    A base that does not slide has the acceleration 0, whatever the thrust.
    """
    q = ca.SX.sym("q", structure.joints)
    qd = ca.SX.sym("qd", structure.joints)
    tau = ca.SX.sym("tau", structure.joints)
    thrust = ca.SX.sym("thrust")
    bodies, drives, world = model_symbols(structure.links)

    steps = aba_steps(structure)
    trig = sines_and_cosines(per_ball(q))
    rates = per_ball(qd)
    _, (motion,) = outward(steps.velocity, ca.DM.zeros(3), [trig, rates])
    columns = [trig, motion, per_ball(tau), rates, bodies, drives]
    whole_arm, (solved,) = inward(steps.inertia, steps.tip(world), columns)
    at_base, feed = steps.base(whole_arm, thrust, world)
    _, (accelerations,) = outward(steps.acceleration, at_base, [trig, motion, solved, bodies])

    return ca.Function(
        "aba",
        [q, qd, tau, thrust, bodies, drives, world],
        [ca.vec(accelerations), feed],
        ["q", "qd", "tau", "thrust", "bodies", "drives", "world"],
        ["qdd", "feed"],
    )


BUILDERS: dict[str, Callable[[Structure], Any]] = {"inverse_dynamics": build_rnea, "forward_dynamics": build_aba}


class InterpretedFunction:
    """A CasADi function (state, state, state, feed, bodies, drives, world) -> (state, feed) called through buffers.

    Buffers are set once: CasADi's ordinary call converts every argument, which takes longer than the function itself.
    Not for use by two threads at once.

    Args:
        kind: ``inverse_dynamics`` or ``forward_dynamics``.
        model: the arm's model.
    """

    def __init__(self, kind: str, model: ArmModel) -> None:
        self._buffer, self._evaluate = BUILDERS[kind](model.structure).buffer()
        joints = model.structure.joints
        self._states = [np.zeros(joints) for _ in range(3)]
        self._feed = np.zeros(1)
        self._out = np.zeros(joints)
        self._out_feed = np.zeros(1)
        numbers = [np.ascontiguousarray(x) for x in (model.bodies, model.drives, model.world)]
        self._inputs = [*self._states, self._feed, *numbers]  # kept: the buffer has their addresses
        for i, array in enumerate(self._inputs):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate((self._out, self._out_feed)):
            self._buffer.set_res(i, array.data)

    def one(self, first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
        """The function at one state, three arrays of shape (3 * links,), to the joints' result for a feed of 0.

        Raises:
            ValueError: for arrays that are not contiguous doubles of that shape; or TypeError, NotImplementedError.
        """
        return self.one_with_feed(first, second, third, 0.0)[0]

    def one_with_feed(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """The function at one state and a feed of shape (), to both results; raises what ``one`` does."""
        for array, value in zip(self._states, (first, second, third), strict=True):
            array.data[:] = value  # type: ignore[call-overload]  # memoryviews take any buffer of their shape
        self._feed[0] = feed
        self._evaluate()
        # Copied, for the next call writes into the same buffers.
        return self._out.copy(), self._out_feed[0]

    def both(self, first: FloatArray, second: FloatArray, third: FloatArray, feed: float = 0.0) -> FloatArray:
        """The function at one state; the result for the feed axis stands after that for the joints."""
        for array, value in zip(self._states, (first, second, third), strict=True):
            array[:] = value
        self._feed[0] = feed
        self._evaluate()
        return np.concatenate((self._out, self._out_feed))

    def many(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The function at N states, three arrays of shape (N, 3 * links), feed (N,)."""
        out = np.empty(first.shape)
        out_feed = np.empty(len(feed))
        for i, state in enumerate(zip(first, second, third, feed, strict=True)):
            result = self.both(*state)
            out[i] = result[:-1]
            out_feed[i] = result[-1]
        return out, out_feed


class DrivenFunction:
    """Dynamics of drives that move revolutes together, from the inverse dynamics of the revolutes, in numpy.

    Args:
        kind: ``inverse_dynamics`` or ``forward_dynamics``.
        model: the arm's model.
    """

    def __init__(self, kind: str, model: ArmModel) -> None:
        self._inverse = DynamicsFunction("inverse_dynamics", model)
        self._model, self._kind = model, kind

    def both(self, first: FloatArray, second: FloatArray, third: FloatArray, feed: float = 0.0) -> FloatArray:
        """The function at one state of the drives; the result for the feed axis stands last."""
        if self._kind == "inverse_dynamics":
            return self._needed(first, second, np.append(third, feed))
        rest = np.zeros(len(first) + 1)
        size = len(rest) if self._model.world[4] else len(first)
        still = self._needed(first, rest[:-1], rest)
        mass = np.stack([self._needed(first, rest[:-1], unit) - still for unit in np.eye(len(rest))])[:size, :size]
        wanted = np.append(third, feed) - self._needed(first, second, rest)
        return np.append(np.linalg.solve(mass, wanted[:size]), rest[size:])

    def _needed(self, values: FloatArray, rates: FloatArray, gains: FloatArray) -> FloatArray:
        coupling, added = self._model.coupling, self._model.armature
        assert coupling is not None
        torques, thrust = self._inverse.with_feed(*(coupling @ each for each in (values, rates, gains[:-1])), gains[-1])
        return np.append(coupling.T @ torques + (0.0 if added is None else added * gains[:-1]), thrust)
