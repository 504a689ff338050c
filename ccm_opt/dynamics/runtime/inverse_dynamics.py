"""Inverse and forward dynamics of an arm, evaluated by compiled functions."""

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.native import NativeCall, native_constant
from ccm_opt.dynamics.algorithms.arm_model import ArmModel, arm_model
from ccm_opt.problem.solution import JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import coupling_of_revolutes, joint_names, revolute_angles

DynamicsKind = Literal["inverse_dynamics", "forward_dynamics"]
"""Direction of the dynamics: from accelerations to torques, or from torques to accelerations."""
JointsCall: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Function from three arrays of joint values to one, each of shape (3 * links,)."""
FeedCall: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray, FloatArray | float], tuple[FloatArray, FloatArray]]
"""Function like ``JointsCall`` with a value of the feed axis, shape (), as an additional argument and result."""


def arm_for_c(model: ArmModel) -> dict[str, Any]:
    """Return an arm's parameters and working memory as named fields of ``Arm`` in recursion.c."""
    links = model.structure.links
    work = np.zeros((links, native_constant(f"work_per_link__{model.structure.variant}")))
    arrays = {"bodies": model.bodies, "drives": model.drives, "world": model.world, "attached": model.attached}
    carrier = {"axes": len(model.axes), "axis": model.axes, "inertia": model.axis_inertia, "ground": model.ground}
    fields = {"links": links, **arrays, "work": work, **carrier}
    if model.coupling is None:
        return fields
    coupled = model.coupling.shape[1]
    whole = coupled + model.of_base
    reduced = np.zeros(12 * links + whole * (whole + 3))
    first = np.argmax(model.coupling != 0.0, axis=0) // 3
    moved = {"coupled": coupled, "coupling": model.coupling, "first": first, "armature": model.armature}
    return fields | moved | {"reduced": reduced}


def columns_of(kind: DynamicsKind, model: ArmModel) -> int:
    """Return the number of columns of states: of all revolutes, or in forward dynamics of coupled ones, of drives."""
    return model.structure.joints if kind == "inverse_dynamics" else model.coordinates


class CompiledFunction:
    """Inverse or forward dynamics of one arm, evaluated by compiled code; not thread-safe.

    Args:
        kind: inverse or forward dynamics.
        model: dynamic model of the arm.
    """

    def __init__(self, kind: DynamicsKind, model: ArmModel) -> None:
        self._many, self._one = (
            NativeCall(
                f"{kind}__{model.structure.variant}", arm=arm_for_c(model), count=1,
                packed=np.zeros((4, model.coordinates + model.of_base)),
            )
            for _ in range(2)
        )  # fmt: skip
        self._of_base = model.of_base
        self.one, self.one_with_feed = self._single_state_calls(columns_of(kind, model))

    def _single_state_calls(self, joints: int) -> tuple[JointsCall, FeedCall]:
        """Return functions that evaluate the dynamics in a single state.

        They are closures over fixed memory, which keeps the overhead of a call small.

        Returns:
            A function of three arrays of shape (3 * links,) to the result for the joints, with a feed of 0, and a
            function of the three arrays and a feed to the results for joints and feed. Both raise ValueError, TypeError
            or NotImplementedError for other arrays.
        """
        q, qd, third, out = np.zeros((4, joints))
        feed, out_feed, rest = np.zeros((3, self._of_base))
        self._one.set(q=q, qd=qd, third=third, feed=feed, place=rest, pace=rest, out=out, out_feed=out_feed)
        address = self._one.address
        function = self._one.function
        copy_of_out = out.copy

        # Views reject arrays of another shape, type or layout, and copy faster than numpy's assignment; a slice made
        # once need not be constructed in every call. Both are noticeable next to 0.4 µs for a recursion.
        into_q = q.data
        into_qd = qd.data
        into_third = third.data
        whole = slice(None)

        def one(first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
            into_q[whole] = first  # type: ignore[call-overload]  # memoryviews take any buffer
            into_qd[whole] = second  # type: ignore[call-overload]
            into_third[whole] = third  # type: ignore[call-overload]
            function(address)
            return copy_of_out()

        def one_with_feed(
            first: FloatArray, second: FloatArray, third: FloatArray, value: FloatArray | float
        ) -> tuple[FloatArray, FloatArray]:
            into_q[whole] = first  # type: ignore[call-overload]
            into_qd[whole] = second  # type: ignore[call-overload]
            into_third[whole] = third  # type: ignore[call-overload]
            feed[0] = value
            function(address)
            feed[0] = 0.0  # what ``one`` expects
            return copy_of_out(), out_feed[0]

        return one, one_with_feed

    def many(
        self,
        first: FloatArray,
        second: FloatArray,
        third: FloatArray,
        feed: FloatArray,
        place: FloatArray | None = None,
        pace: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Evaluate the dynamics in N states.

        Args:
            first: as for ``DynamicsFunction.with_feed``, shape (N, 3 * links).
            second: likewise.
            third: likewise.
            feed: accelerations of a feed axis, or efforts, shape (N,); those of the k axes that carry the base, (N, k).
            place: positions of these axes, shape (N, k) [m, rad]; None at zero.
            pace: their velocities, shape (N, k); None at rest.

        Returns:
            Efforts or accelerations, of the shapes of ``third`` and ``feed``.
        """
        out, out_feed = np.empty(first.shape), np.empty(feed.shape)
        rest = np.zeros(feed.shape)
        self._many.set(
            count=len(first), q=first, qd=second, third=third, feed=feed, out=out, out_feed=out_feed,
            place=rest if place is None else place, pace=rest if pace is None else pace,
        )  # fmt: skip
        self._many()
        return out, out_feed


MISFIT = (TypeError, ValueError, NotImplementedError)
"""Errors that memory views raise for anything but contiguous doubles of the expected shape."""


class DynamicsFunction:
    """Inverse or forward dynamics of one arm, for states of any number, number type and memory layout.

    Args:
        kind: inverse or forward dynamics.
        model: dynamic model of the arm.
    """

    def __init__(self, kind: DynamicsKind, model: ArmModel) -> None:
        function = CompiledFunction(kind, model)
        self._one = function.one
        self._one_with_feed = function.one_with_feed
        self._many = function.many
        self._joints = columns_of(kind, model)

    def of_joints(self, first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
        """Return the result for the joints with a feed of 0, of the shape of the arguments.

        The arguments are those of ``with_feed``.
        """
        # A single state of contiguous doubles is tried first, since inspecting the arguments takes longer than this.
        try:
            return self._one(first, second, third)
        except MISFIT:
            return self._general(first, second, third, 0.0)[0]

    def with_feed(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Evaluate the dynamics in one or several states of joints and feed axis.

        Args:
            first: angles of the revolutes, shape (3 * links,) or (N, 3 * links) [rad].
            second: velocities of the revolutes, of the same shape [rad/s].
            third: accelerations [rad/s²] for inverse dynamics, torques [N m] for forward dynamics, of the same shape.
            feed: acceleration [m/s²] or force [N] of the feed axis, shape () or (N,).

        Returns:
            Torques or accelerations of the joints, of the shape of the arguments, and force or acceleration of the feed
            axis, shape () or (N,).

        Raises:
            ProblemError: the shapes do not match.
        """
        try:
            return self._one_with_feed(first, second, third, feed)
        except MISFIT:
            return self._general(first, second, third, feed)

    def _general(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """Evaluate the dynamics in states of any number, type and layout, after checks and conversions."""
        shape = np.shape(first)
        fits = len(shape) in {1, 2} and shape[-1] == self._joints
        if not fits or np.shape(second) != shape or np.shape(third) != shape:
            shown = f"{shape}, {np.shape(second)}, {np.shape(third)}"
            raise ProblemError(f"joint states have shapes {shown}; expected three of (N, {self._joints})")
        q, qd, last = (np.atleast_2d(np.asarray(state, dtype=np.float64)) for state in (first, second, third))
        out, out_feed = self._many(q, qd, last, np.broadcast_to(feed, q.shape[:1]))
        if len(shape) == 1:
            return out[0], out_feed[0]
        return out, out_feed


class InverseDynamics:
    """Torques that a motion of an arm requires, by the recursive Newton–Euler algorithm.

    Args:
        arm: the arm.
        gravity: gravitational acceleration in the world frame, shape (3,) [m/s²].
    """

    def __init__(self, arm: Arm, gravity: FloatArray) -> None:
        self._rnea = DynamicsFunction("inverse_dynamics", arm_model(arm, gravity))
        self._carried = CompiledFunction("inverse_dynamics", arm_model(arm, gravity)).many if arm.carrier else None

    def efforts(
        self, revolutes: tuple[FloatArray, FloatArray, FloatArray], axes: tuple[FloatArray, FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the torques of the revolutes and the efforts of the k axes of the base in N states.

        Args:
            revolutes: angles, velocities and accelerations of the revolutes, each of shape (N, 3 * links).
            axes: positions, velocities and accelerations of the axes, each of shape (N, k); none for a fixed base.

        Returns:
            Shapes (N, 3 * links) [N m] and (N, k) [N, N m].
        """
        place, velocity, acceleration = (np.ascontiguousarray(each, dtype=np.float64) for each in axes)
        if self._carried is not None:
            q, qd, qdd = (np.ascontiguousarray(each, dtype=np.float64) for each in revolutes)
            return self._carried(q, qd, qdd, acceleration, place, velocity)
        # Feed axes all run along the base heading, so each bears the whole force.
        torques, force = self._rnea.with_feed(*revolutes, acceleration.sum(axis=1))
        return torques, np.repeat(force[:, None], acceleration.shape[1], axis=1)

    def __call__(
        self,
        angles: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
        feed_accelerations: FloatArray | float | None = None,
    ) -> FloatArray:
        """Return the torques of the revolutes in N states, shape (N, 3 * links), or in one, shape (3 * links,) [N m].

        Args:
            angles: angles of the revolutes, of the shape of the result [rad].
            velocities: velocities of the revolutes, of this shape [rad/s].
            accelerations: accelerations of the revolutes, of this shape [rad/s²].
            feed_accelerations: accelerations of the base along the base heading, shape (N,) or () [m/s²]; None when the
                base rests or moves evenly.

        Raises:
            ProblemError: the shapes do not fit the arm.
        """
        if feed_accelerations is None:
            return self._rnea.of_joints(angles, velocities, accelerations)
        return self._rnea.with_feed(angles, velocities, accelerations, feed_accelerations)[0]

    def feed_forces(
        self,
        angles: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
        feed_accelerations: FloatArray | float | None = None,
    ) -> FloatArray:
        """Return the force on the feed axis [N], shape (N,), or () for one state; arguments as for ``__call__``.

        The force is the component, along the base heading, of the force that accelerates the whole arm and supports its
        weight.
        """
        feed = 0.0 if feed_accelerations is None else feed_accelerations
        return self._rnea.with_feed(angles, velocities, accelerations, feed)[1]


class MassMatrix:
    """Mass matrix of an arm, payload and rotors included: of its revolutes, or of the drives that couple them.

    The columns of the matrix are the torques for unit accelerations, at rest and without gravity.

    Args:
        arm: the arm.
    """

    def __init__(self, arm: Arm) -> None:
        self._dynamics = InverseDynamics(arm, np.zeros(3))
        self._axes = len(arm.base_axes)
        self._coupling = coupling_of_revolutes(arm)

    def __call__(self, angles: FloatArray) -> FloatArray:
        """Return the mass matrix M at joint angles (3 * links,) [rad], shape (n, n) for n drives [kg m²]."""
        return self.with_base(angles, np.zeros(self._axes))[self._axes :, self._axes :]

    def with_base(self, angles: FloatArray, place: FloatArray) -> FloatArray:
        """Return the mass matrix with the k axes of the base first, shape (n + k, n + k) [kg, kg m, kg m²].

        Args:
            angles: angles of the revolutes, shape (3 * links,) [rad].
            place: positions of the axes, shape (k,) [m, rad]; without effect for a feed axis.
        """
        each = np.eye(len(angles)) if self._coupling is None else self._coupling.T
        unit = np.vstack((np.zeros((self._axes, len(angles))), each))
        gains = np.vstack((np.eye(self._axes), np.zeros((len(each), self._axes))))
        states, places = np.broadcast_to(angles, unit.shape), np.broadcast_to(place, gains.shape)
        rest = np.zeros_like(states)
        torques, forces = self._dynamics.efforts((states, rest, unit), (places, np.zeros_like(gains), gains))
        columns = np.column_stack((forces, torques if self._coupling is None else torques @ self._coupling))
        return np.asarray(0.5 * (columns + columns.T))


def joint_states(arm: Arm, trajectory: JointTrajectory, inverse_dynamics: InverseDynamics) -> JointStates:
    """Return motion and efforts of all revolutes along a trajectory, and of the axes that carry the base."""
    angles = revolute_angles(arm, trajectory.bend_angles)
    velocities = revolute_angles(arm, trajectory.bend_velocities)
    accelerations = revolute_angles(arm, trajectory.bend_accelerations)
    axes = (trajectory.base_positions, trajectory.base_velocities, trajectory.base_accelerations)
    torques, on_axes = inverse_dynamics.efforts((angles, velocities, accelerations), axes)
    return JointStates(joint_names(arm), angles, velocities, accelerations, torques, on_axes)


class ForwardDynamics:
    """Accelerations that torques on an arm cause, by the articulated-body algorithm.

    Those of drives that move several revolutes together are found from their mass matrix; the arrays of an arm with m
    such drives have m columns in the place of 3 * links.

    Args:
        arm: the arm.
        gravity: gravitational acceleration in the world frame, shape (3,) [m/s²].
    """

    def __init__(self, arm: Arm, gravity: FloatArray) -> None:
        self._aba = DynamicsFunction("forward_dynamics", arm_model(arm, gravity))

    def __call__(self, angles: FloatArray, velocities: FloatArray, torques: FloatArray) -> FloatArray:
        """Return the accelerations of the revolutes [rad/s²], shape (N, 3 * links), or (3 * links,) for one state.

        The force on a feed axis is zero. Results are not finite where a ball joint is singular and its drives have no
        rotor inertia: θ2 = ±90° with axes ``zyx``, θ2 = 0 with axes ``zyz``.

        Args:
            angles: angles of the revolutes, of the shape of the result [rad].
            velocities: velocities of the revolutes, of this shape [rad/s].
            torques: torques of the revolutes, of this shape [N m].

        Raises:
            ProblemError: the shapes do not fit the arm.
        """
        return self._aba.of_joints(angles, velocities, torques)

    def with_feed(
        self, angles: FloatArray, velocities: FloatArray, torques: FloatArray, thrust: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the accelerations of the revolutes, and of the base along its feed axis, shape (N,) or () [m/s²].

        Args:
            angles: angles of the revolutes, shape (N, 3 * links) or (3 * links,) [rad].
            velocities: velocities of the revolutes, of this shape [rad/s].
            torques: torques of the revolutes, of this shape [N m].
            thrust: force on the base along the base heading, shape (N,) or () [N].
        """
        return self._aba.with_feed(angles, velocities, torques, thrust)
