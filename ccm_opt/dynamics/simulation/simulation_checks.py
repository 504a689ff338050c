"""Checks of a simulation before it runs."""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.dynamics.simulation.controller import disturbed_arm
from ccm_opt.dynamics.simulation.simulation_record import DEFAULT_SIMULATION, SimulatedSteps, SimulationSettings
from ccm_opt.dynamics.simulation.stability import check_stability
from ccm_opt.errors import Diagnosis, ProblemError, SimulationError
from ccm_opt.problem import SimulationOptions
from ccm_opt.robot.driven_arm import DrivenArm
from ccm_opt.solution import JointStates, JointTrajectory


def check_options(
    arm: DrivenArm, options: SimulationOptions, *, settings: SimulationSettings = DEFAULT_SIMULATION
) -> None:
    """Refuse what no motion of the arm could be simulated with, before one is planned.

    Args:
        arm: the arm; its straight pose stands for all.
        options: gravity, step, controller and gains.
        settings: of the checks.

    Raises:
        ProblemError: saying which setting is at fault and what would do.
    """
    straight = np.zeros((1, 3 * arm.links))
    # An arm of two bends a joint leaves any plane, and nothing pulls one of a single bend out of its own.
    planar = arm.coordinates.bends_a_joint == 1 and falls_in_plane(arm, options.gravity)
    plant = disturbed_arm(arm, options.disturbances)
    try:
        # In the plane only bends move, and both orders of axes are the same arm.
        check_axes(replace(arm, axes="zyx") if planar else arm, straight, planar=planar, settings=settings)
        check_stability(plant, straight, options, planar=planar, believed=arm)
    except SimulationError as error:
        raise ProblemError(f"the simulation cannot run: {error.diagnosis}") from error


def falls_in_plane(arm: DrivenArm, gravity: FloatArray) -> bool:
    """Whether gravity, in the world, shape (3,), leaves an arm in the plane of the second bends of its joints."""
    return float(arm.base_rotation[:, 1] @ gravity) == 0.0


def check_axes(
    arm: DrivenArm, angles: FloatArray, *, planar: bool, settings: SimulationSettings = DEFAULT_SIMULATION
) -> None:
    """Refuse motions on which the ball joints are singular.

    Args:
        arm: the arm.
        angles: of all revolutes along the motion, shape (T, 3 * links) [rad].
        planar: whether the arm stays in its plane, where the bends alone move and nothing is singular.
        settings: up to which bend an arm is simulated out of its plane.

    Raises:
        SimulationError: saying what would do.
    """
    if arm.axes == "zyz":
        raise SimulationError(
            Diagnosis(
                reason="arm.axes = 'zyz' is singular where a joint is straight: no simulation out of the plane",
                stage="simulation",
                advice=('arm.axes = "zyx"', "gravity in the plane: simulation.gravity[1] = 0"),
            )
        )

    # The bends are the second revolutes; at ±90° a Z-Y-X ball has its first and third axes in one line.
    largest = float(np.max(np.abs(angles[:, 1::3])))
    limit = settings.largest_bend
    if not planar and largest > limit:
        raise SimulationError(
            Diagnosis(
                reason=f"a bend reaches {largest:.3g} rad while the arm moves in 3-D; Z-Y-X balls are singular at 90°",
                stage="simulation",
                advice=(f"bends within {limit} rad, or gravity in the plane (gravity[1] = 0)",),
                evidence={"largest_bend": largest, "limit": limit},
            )
        )


def check_finite(steps: SimulatedSteps, names: tuple[str, ...], step: float) -> None:
    """Stop at the first state that is not finite.

    Args:
        steps: some steps of the run.
        names: of all revolutes.
        step: length of a step [s].

    Raises:
        SimulationError: naming joint and time.
    """
    finite = np.isfinite(steps.states)
    if finite.all():
        return
    row, _, column = np.argwhere(~finite)[0]
    time = float((steps.first + row) * step)
    name = (*names, "feed")[column]
    raise SimulationError(
        Diagnosis(
            reason=f"the simulated state of joint {name} is not finite at {time:.4g} s",
            stage="simulation",
            advice=("a smaller simulation.step", "smaller gains", 'simulation.controller = "computed-torque"'),
            evidence={"joint": name, "time": time},
        )
    )


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
