"""Inverse and forward dynamics by compiled functions."""

from typing import Any, Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.native import NativeCall, native_constant
from ccm_opt.dynamics.algorithms.arm_model import ArmModel, arm_model
from ccm_opt.problem.solution import JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import joint_names, revolute_angles

DynamicsKind = Literal["inverse_dynamics", "forward_dynamics"]
"""From accelerations to torques, or from torques to accelerations."""


def arm_for_c(model: ArmModel) -> dict[str, Any]:
    """An arm's numbers and working memory as ``Arm`` of recursion.c."""
    links = model.structure.links
    work = np.zeros((links, native_constant(f"work_per_link__{model.structure.variant}")))
    return {"links": links, "bodies": model.bodies, "drives": model.drives, "world": model.world, "work": work}


class DynamicsFunction:
    """A function of three joint states and one value of the feed axis, to a joint state and one value of the feed.

    Not for use by two threads at once.

    Args:
        kind: which of the two.
        model: the arm's model.
    """

    def __init__(self, kind: DynamicsKind, model: ArmModel) -> None:
        self._call = NativeCall(f"{kind}__{model.structure.variant}", arm=arm_for_c(model))
        self._joints = model.structure.joints

    def __call__(
        self, first: FloatArray, second: FloatArray, third: FloatArray, feed: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Evaluate at states of shape (3 * links,) or (N, 3 * links), all three alike, and a feed of () or (N,).

        Returns:
            The results for the joints, of the states' shape, and for the feed axis, of shape () or (N,).

        Raises:
            ProblemError: when the shapes do not fit.
        """
        shape = np.shape(first)
        fits = len(shape) in {1, 2} and shape[-1] == self._joints
        if not fits or np.shape(second) != shape or np.shape(third) != shape:
            shown = f"{shape}, {np.shape(second)}, {np.shape(third)}"
            raise ProblemError(f"joint states have shapes {shown}; expected three of (N, {self._joints})")
        count = 1 if len(shape) == 1 else shape[0]
        out = np.empty(shape)
        out_feed = np.empty(count)
        feeds = np.broadcast_to(feed, count)
        self._call.set(count=count, q=first, qd=second, third=third, feed=feeds, out=out, out_feed=out_feed)
        self._call()
        return out, out_feed[0] if len(shape) == 1 else out_feed


class InverseDynamics:
    """Torques that a motion needs, by the Newton–Euler recursion.

    Args:
        arm: the arm.
        gravity: in the world, shape (3,) [m/s²].
    """

    def __init__(self, arm: Arm, gravity: FloatArray) -> None:
        self._rnea = DynamicsFunction("inverse_dynamics", arm_model(arm, gravity))

    def __call__(
        self,
        angles: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
        feed_accelerations: FloatArray | float = 0.0,
    ) -> FloatArray:
        """Torques [N m], shape (N, 3 * links), for arrays of that shape, or (3 * links,) for one state.

        Args:
            angles: [rad].
            velocities: [rad/s].
            accelerations: [rad/s²].
            feed_accelerations: of the base along the base heading, shape (N,) or () [m/s²].

        Raises:
            ProblemError: when the shapes do not fit the arm.
        """
        return self.efforts(angles, velocities, accelerations, feed_accelerations)[0]

    def feed_forces(
        self,
        angles: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
        feed_accelerations: FloatArray | float = 0.0,
    ) -> FloatArray:
        """Force on the feed axis [N], shape (N,), or () for one state; arguments as for the torques.

        It is the component along the base heading of what the base must bear to move the whole arm, gravity included.
        """
        return self.efforts(angles, velocities, accelerations, feed_accelerations)[1]

    def efforts(
        self,
        angles: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
        feed_accelerations: FloatArray | float = 0.0,
    ) -> tuple[FloatArray, FloatArray]:
        """Torques and the force on the feed axis by one recursion; arguments as for the torques."""
        return self._rnea(angles, velocities, accelerations, feed_accelerations)


class MassMatrix:
    """Mass matrix of an arm, payload and rotors included.

    Its columns are what unit accelerations need where nothing weighs and nothing moves yet.

    Args:
        arm: the arm.
    """

    def __init__(self, arm: Arm) -> None:
        self._dynamics = InverseDynamics(arm, np.zeros(3))

    def __call__(self, angles: FloatArray) -> FloatArray:
        """Mass matrix M, shape (3 * links, 3 * links) [kg m²], at angles of shape (3 * links,) [rad]."""
        return self.with_feed(angles)[1:, 1:]

    def with_feed(self, angles: FloatArray) -> FloatArray:
        """Mass matrix with the feed axis first, shape (3 * links + 1, 3 * links + 1); units with kg and kg m."""
        unit = np.eye(len(angles) + 1)
        states = np.broadcast_to(angles, (len(unit), len(angles)))
        torques, forces = self._dynamics.efforts(states, np.zeros_like(states), unit[:, 1:], unit[:, 0])
        columns = np.column_stack((forces, torques))
        return np.asarray(0.5 * (columns + columns.T))


def joint_states(arm: Arm, trajectory: JointTrajectory, inverse_dynamics: InverseDynamics) -> JointStates:
    """A planar trajectory as motion and efforts of all drives: the revolutes, and the axes that carry the base."""
    angles = revolute_angles(arm, trajectory.bend_angles)
    velocities = revolute_angles(arm, trajectory.bend_velocities)
    accelerations = revolute_angles(arm, trajectory.bend_accelerations)
    carried = trajectory.coordinates.advance(trajectory.accelerations)
    torques, force = inverse_dynamics.efforts(angles, velocities, accelerations, carried)
    # All axes of the base run along the base heading, so each bears the whole force; a fixed base has no column.
    forces = np.repeat(force[:, None], len(trajectory.coordinates.base_names), axis=1)
    return JointStates(joint_names(arm), angles, velocities, accelerations, torques, forces)


class ForwardDynamics:
    """Accelerations that torques cause, by the articulated-body algorithm.

    Args:
        arm: the arm.
        gravity: in the world, shape (3,) [m/s²].
    """

    def __init__(self, arm: Arm, gravity: FloatArray) -> None:
        self._aba = DynamicsFunction("forward_dynamics", arm_model(arm, gravity))

    def __call__(self, angles: FloatArray, velocities: FloatArray, torques: FloatArray) -> FloatArray:
        """Accelerations [rad/s²], shape (N, 3 * links), for arrays of that shape, or (3 * links,) for one state.

        The thrust on a feed axis is zero. Not finite where the ball joint is singular and its drives have no rotor
        inertia: θ2 = ±90° under ``zyx``, θ2 = 0 under ``zyz``.

        Args:
            angles: [rad].
            velocities: [rad/s].
            torques: [N m].

        Raises:
            ProblemError: when the shapes do not fit the arm.
        """
        return self._aba(angles, velocities, torques)[0]

    def with_feed(
        self, angles: FloatArray, velocities: FloatArray, torques: FloatArray, thrust: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations of the joints, and of the base along its feed axis, shape (N,) or () [m/s²].

        Args:
            angles: [rad].
            velocities: [rad/s].
            torques: [N m].
            thrust: on the base along the base heading, shape (N,) or () [N].
        """
        return self._aba(angles, velocities, torques, thrust)
