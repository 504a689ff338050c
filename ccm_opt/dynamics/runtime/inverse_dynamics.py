"""Joint torques of a motion (section 5.4)."""

import numpy as np

from ccm_opt.dynamics.algorithms.arm_model import arm_model
from ccm_opt.dynamics.runtime.dynamics_function import DynamicsFunction
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.jointed.frames import joint_names, revolute_angles
from ccm_opt.solution import JointStates, JointTrajectory


class InverseDynamics:
    """Torques that a motion needs, by the Newton–Euler recursion.

    Args:
        arm: the arm.
        gravity: in the world, shape (3,) [m/s²].
    """

    def __init__(self, arm: DrivenArm, gravity: FloatArray) -> None:
        self._rnea = DynamicsFunction("inverse_dynamics", arm_model(arm, gravity))

    def __call__(
        self,
        angles: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
        feed_accelerations: FloatArray | float | None = None,
    ) -> FloatArray:
        """Torques [N m], shape (N, 3 * links), for arrays of that shape, or (3 * links,) for one state.

        Args:
            angles: [rad].
            velocities: [rad/s].
            accelerations: [rad/s²].
            feed_accelerations: of the base along the base heading, shape (N,) or () [m/s²]; None: the base rests or
                moves evenly.

        Raises:
            ProblemError: when the shapes do not fit the arm.
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
        """Force on the feed axis [N], shape (N,), or () for one state; arguments as for the torques.

        It is the component along the base heading of what the base must bear to move the whole arm, gravity included.
        """
        return self.efforts(angles, velocities, accelerations, feed_accelerations)[1]

    def efforts(
        self,
        angles: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
        feed_accelerations: FloatArray | float | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Torques and the force on the feed axis by one recursion; arguments as for the torques."""
        feed = 0.0 if feed_accelerations is None else feed_accelerations
        return self._rnea.with_feed(angles, velocities, accelerations, feed)


def joint_states(arm: DrivenArm, trajectory: JointTrajectory, inverse_dynamics: InverseDynamics) -> JointStates:
    """A planar trajectory as motion and efforts of all drives: the revolutes, and the axes that carry the base."""
    angles = revolute_angles(arm, trajectory.bend_angles)
    velocities = revolute_angles(arm, trajectory.bend_velocities)
    accelerations = revolute_angles(arm, trajectory.bend_accelerations)
    carried = trajectory.coordinates.advance(trajectory.accelerations)
    torques, force = inverse_dynamics.efforts(angles, velocities, accelerations, carried)
    # All axes of the base run along the base heading, so each bears the whole force; a fixed base has no column.
    forces = np.repeat(force[:, None], len(trajectory.coordinates.base_names), axis=1)
    return JointStates(joint_names(arm), angles, velocities, accelerations, torques, forces)
