"""What a plan takes of the drives of the arm that is simulated, which may be heavier than its controller believes."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.solution import JointStates, JointTrajectory


@dataclass(frozen=True)
class PlanNeeds:
    """Where a plan takes the greatest share of what a drive can give, were it followed exactly.

    Attributes:
        column: of the drive: a revolute, or after them all the feed axis.
        time: when [s].
        effort: that it takes there [N m, N].
        held: part of it that holds the arm still [N m, N].
        limit: that the drive has [N m, N].
    """

    column: int
    time: float
    effort: float
    held: float
    limit: float

    @property
    def share(self) -> float:
        """Of the limit."""
        return self.effort / self.limit if self.limit > 0.0 else np.inf


def needs_of_plan(
    plant: DrivenArm, trajectory: JointTrajectory, joints: JointStates, gravity: FloatArray, limit: FloatArray
) -> PlanNeeds | None:
    """The greatest need of a plan; None where no drive has a limit.

    Args:
        plant: the arm that is simulated.
        trajectory: the plan.
        joints: the same for all revolutes.
        gravity: shape (3,) [m/s²].
        limit: of the efforts of all revolutes and, last, of the thrust along the feed axis, shape (3 * links + 1,).
    """
    if not np.isfinite(limit).any():
        return None
    dynamics = InverseDynamics(plant, gravity)
    rest = np.zeros_like(joints.angles)
    feed = trajectory.coordinates.advance(trajectory.accelerations)
    moving = np.abs(np.column_stack(dynamics.efforts(joints.angles, joints.velocities, joints.accelerations, feed)))
    still = np.abs(np.column_stack(dynamics.efforts(joints.angles, rest, rest)))
    # A drive without a limit has a share of nothing; one that can give nothing is short of whatever is asked.
    share = moving / np.maximum(limit, np.finfo(np.float64).tiny)
    row, column = np.unravel_index(int(np.argmax(share)), share.shape)
    return PlanNeeds(
        int(column),
        float(trajectory.time[row]),
        float(moving[row, column]),
        float(still[row, column]),
        float(limit[column]),
    )
