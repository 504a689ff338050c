"""Joint torques of a motion (section 5.4)."""

from ccm_opt.arrays import FloatArray
from ccm_opt.dynamics.batch import BatchedDynamics
from ccm_opt.dynamics.model import arm_model
from ccm_opt.dynamics.rnea import build_rnea
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.frames import joint_names, revolute_angles
from ccm_opt.solution import JointStates, JointTrajectory


class InverseDynamics:
    """Torques that a motion needs, by compiled Newton–Euler recursion.

    Args:
        arm: the arm.
        gravity: in the world, shape (3,) [m/s²].
    """

    def __init__(self, arm: Arm, gravity: FloatArray) -> None:
        self._rnea = BatchedDynamics("rnea", build_rnea, arm_model(arm, gravity))

    def __call__(self, angles: FloatArray, velocities: FloatArray, accelerations: FloatArray) -> FloatArray:
        """Torques [N m], shape (N, 3 * links), for arrays of that shape, or (3 * links,) for one state.

        Args:
            angles: [rad].
            velocities: [rad/s].
            accelerations: [rad/s²].

        Raises:
            ProblemError: when the shapes do not fit the arm.
        """
        return self._rnea(angles, velocities, accelerations)


def joint_states(arm: Arm, trajectory: JointTrajectory, inverse_dynamics: InverseDynamics) -> JointStates:
    """A planar trajectory as motion and torques of all revolutes."""
    angles = revolute_angles(arm, trajectory.bend_angles)
    velocities = revolute_angles(arm, trajectory.bend_velocities)
    accelerations = revolute_angles(arm, trajectory.bend_accelerations)
    torques = inverse_dynamics(angles, velocities, accelerations)
    return JointStates(joint_names(arm), angles, velocities, accelerations, torques)
