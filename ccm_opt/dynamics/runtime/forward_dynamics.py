"""Joint accelerations under given torques."""

from ccm_opt.dynamics.algorithms.arm_model import arm_model
from ccm_opt.dynamics.runtime.dynamics_function import DynamicsFunction
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.driven_arm import DrivenArm


class ForwardDynamics:
    """Accelerations that torques cause, by the articulated-body algorithm.

    Args:
        arm: the arm.
        gravity: in the world, shape (3,) [m/s²].
    """

    def __init__(self, arm: DrivenArm, gravity: FloatArray) -> None:
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
        return self._aba.of_joints(angles, velocities, torques)

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
        return self._aba.with_feed(angles, velocities, torques, thrust)
