"""Record of a simulation, checks before the simulation, and the efforts that a plan requires."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import Diagnosis, ProblemError, SimulationError
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.dynamics.simulation.controller import disturbed_arm, hermite
from ccm_opt.dynamics.simulation.stability import check_stability
from ccm_opt.problem import SimulationOptions
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulatedMotion, SimulationVerdict
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import angles_from_drives, drive_names, drive_torques

_LARGEST_BEND = 1.3
"""Largest bend for which an arm with Z-Y-X ball joints is simulated out of its plane [rad].

Derived: the ball joint is singular at 90°, and at 1.3 rad its yaw turns 1 / cos 1.3 = 3.7 times as fast as the link.
The 3.7 is chosen by hand.
"""


FEED_AXIS = "the feed axis"
"""Name of a feed axis in messages."""


def column_names(arm: Arm) -> tuple[str, ...]:
    """Return the names of the columns of a simulation: drives that bend the arm, then the axes of its base."""
    return (*drive_names(arm), *(arm.coordinates.base_names if arm.carrier else (FEED_AXIS,)))


def effort_units(arm: Arm) -> tuple[str, ...]:
    """Return the units of the efforts of these columns, "N m" or "N"."""
    of_base = arm.coordinates.base_units if arm.carrier else ("m",)
    return (*("N m" for _ in drive_names(arm)), *("N" if unit == "m" else "N m" for unit in of_base))


@dataclass(frozen=True)
class SimulatedSteps:
    """States and efforts of N consecutive simulation steps.

    The first of W columns are those of the drives that bend the arm; behind them are those of the axes of its base.

    Attributes:
        first: index of the first step.
        states: positions and velocities before the first step and at the end of each, shape (N + 1, 2, W).
        efforts: efforts held over each step, shape (N, W) [N m, N].
        targets: reference positions at the end of each step, shape (N, W).
        bending: number n of drives that bend the arm.
    """

    first: int
    states: FloatArray
    efforts: FloatArray
    targets: FloatArray
    bending: int

    @property
    def count(self) -> int:
        """Number N of simulated steps."""
        return len(self.efforts)

    @cached_property
    def errors(self) -> FloatArray:
        """Absolute tracking errors of the revolutes at the end of each step, shape (N, n) [rad]."""
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray(np.abs(self.states[1:, 0, : self.bending] - self.targets[:, : self.bending]))

    @cached_property
    def worst_error(self) -> float:
        """Largest tracking error of any revolute [rad]; NaN if any error is NaN; 0 if there are no steps."""
        return float(np.max(self.errors, initial=0.0))

    @cached_property
    def is_finite(self) -> bool:
        """Whether all states at the ends of the steps are finite."""
        return bool(np.isfinite(self.states[1:]).all())


@dataclass
class SimulationRecord:
    """Record of a simulated motion at the T samples of its plan, filled step by step.

    Its W columns are those of ``SimulatedSteps``.

    Attributes:
        step: length of a step [s].
        places: times of the plan's samples in units of steps, shape (T,).
        positions: positions at the samples that steps have reached, shape (T, W) [rad, m].
        efforts: efforts applied at the samples, shape (T, W) [N m, N]; 0 at samples not reached yet.
        limit: limits of the efforts, shape (W,) [N m, N].
        units: units of the efforts, "N m" or "N".
        tracking_error: largest difference of a joint's angle from its reference at the end of a step [rad].
        full_steps: number of steps in which an effort was at its limit.
        end: index of the last step that was added.
    """

    step: float
    places: FloatArray
    positions: FloatArray
    efforts: FloatArray
    limit: FloatArray
    units: tuple[str, ...]
    tracking_error: float = 0.0
    full_steps: int = 0
    end: int = 0
    _last: FloatArray | None = None

    @classmethod
    def from_plan(
        cls, time: FloatArray, start: FloatArray, step: float, limit: FloatArray, units: tuple[str, ...]
    ) -> "SimulationRecord":
        """Create an empty record for a plan with sample times (T,) [s], start positions (W,) and effort limits (W,)."""
        positions = np.repeat(start[None], len(time), axis=0)
        return cls(step, time / step, positions, np.zeros_like(positions), limit, units)

    def add(self, steps: SimulatedSteps) -> None:
        """Add simulation steps to the record by interpolating them at the plan's samples that they cover."""
        if steps.count == 0:
            return
        self.end = steps.first + steps.count
        self._last = steps.states[-1, 0]
        # A sample that lies past the end of the steps by rounding belongs to the steps.
        first = np.searchsorted(self.places, steps.first)
        here = slice(first, np.searchsorted(self.places, self.end + ROUNDING, side="right"))
        local = self.places[here] - steps.first
        # A sample at the very end belongs to the last step, not to one after it.
        index = np.minimum((local + ROUNDING).astype(int), steps.count - 1)
        self.positions[here] = hermite(local - index, self.step, steps.states[index], steps.states[index + 1])
        self.efforts[here] = steps.efforts[index]

        self.tracking_error = max(self.tracking_error, steps.worst_error)
        full = np.any(np.abs(steps.efforts) >= self.limit, axis=1)
        self.full_steps += int(np.count_nonzero(full))

    def motion(self, arm: Arm, verdict: SimulationVerdict) -> SimulatedMotion:
        """Return the whole simulated motion of an arm with a given verdict, after all steps have been added."""
        bending = len(drive_names(arm))
        base = slice(bending, bending + len(arm.base_axes))  # a fixed base has a column in the loop, but no drive
        if self._last is not None:
            # If the run was stopped, the arm is assumed to stand still from then on.
            self.positions[self.places > self.end + ROUNDING] = self._last
        return SimulatedMotion(
            angles=angles_from_drives(arm, self.positions[:, :bending].copy()),
            torques=self.efforts[:, :bending].copy(),
            tracking_error=self.tracking_error,
            saturated=self.full_steps > 0,
            base_positions=self.positions[:, base].copy(),
            saturated_time=self.full_steps * self.step,
            verdict=verdict,
        )


def check_options(arm: Arm, options: SimulationOptions) -> None:
    """Raise an error, before planning, for options with which no motion of the arm could be simulated.

    Args:
        arm: the arm, which is checked in its straight pose.
        options: gravity, step, controller and gains.

    Raises:
        ProblemError: the options are unsuitable; the message names the setting and a remedy.
    """
    if arm.unsimulated:
        return
    straight = np.zeros((1, 3 * arm.links))
    # An arm with two bends per joint may leave any plane; one with a single bend per joint does not leave its own.
    planar = arm.coordinates.bends_a_joint == 1 and arm.drives is None and falls_in_plane(arm, options.gravity)
    plant = disturbed_arm(arm, options.disturbances)
    try:
        # In the plane only bends move, and both orders of axes are equivalent.
        check_axes(replace(arm, axes="zyx") if planar else arm, straight, planar=planar)
        places = np.zeros((1, len(arm.base_axes)))
        check_stability(plant, straight, places, options, planar=planar, believed=arm)
    except SimulationError as error:
        raise ProblemError(f"the simulation cannot run: {error.diagnosis}") from error


def falls_in_plane(arm: Arm, gravity: FloatArray) -> bool:
    """Return whether gravity, shape (3,) in the world frame, lies in the plane in which a planar arm moves."""
    return float(arm.base_rotation[:, 1] @ gravity) == 0.0


def check_axes(arm: Arm, angles: FloatArray, *, planar: bool) -> None:
    """Raise an error for motions on which ball joints are singular.

    Args:
        arm: the arm.
        angles: angles of all revolutes along the motion, shape (T, 3 * links) [rad].
        planar: whether the arm stays in its plane, where only the bends move and no joint is singular.

    Raises:
        SimulationError: a ball joint is singular on the motion; the message names a remedy.
    """
    if arm.sections is not None:
        return  # arcs are nowhere singular
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
    limit = _LARGEST_BEND
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
    """Raise an error if a simulated state is not finite.

    Args:
        steps: steps of the run.
        names: names of the columns, as ``column_names`` gives them.
        step: length of a step [s].

    Raises:
        SimulationError: a state is not finite; the message names joint and time.
    """
    finite = np.isfinite(steps.states)
    if finite.all():
        return
    row, _, column = np.argwhere(~finite)[0]
    time = float((steps.first + row) * step)
    name = names[column]
    raise SimulationError(
        Diagnosis(
            reason=f"the simulated state of {name} is not finite at {time:.4g} s",
            stage="simulation",
            advice=("a smaller simulation.step", "smaller gains", 'simulation.controller = "computed-torque"'),
            evidence={"joint": name, "time": time},
        )
    )


@dataclass(frozen=True)
class PlanNeeds:
    """The effort of an exactly followed plan that is the largest fraction of its drive's limit.

    Attributes:
        column: index of the drive: one that bends the arm, or behind these an axis of the base.
        time: time at which the effort occurs [s].
        effort: magnitude of the effort [N m, N].
        held: effort that holds the arm still in that pose [N m, N].
        limit: effort limit of the drive [N m, N].
        unit: unit of these efforts.
        bending: number of drives that bend the arm.
    """

    column: int
    time: float
    effort: float
    held: float
    limit: float
    unit: str
    bending: int

    @property
    def share(self) -> float:
        """Effort as a fraction of its limit; infinite for a limit of zero."""
        return self.effort / self.limit if self.limit > 0.0 else np.inf


def largest_need(
    plant: Arm, trajectory: JointTrajectory, joints: JointStates, gravity: FloatArray, limit: FloatArray
) -> PlanNeeds | None:
    """Return the drive and the time at which a plan needs the largest fraction of an effort limit; None without limits.

    Args:
        plant: the simulated arm.
        trajectory: the plan.
        joints: angles, velocities and accelerations of the revolutes in the plan.
        gravity: gravitational acceleration, shape (3,) [m/s²].
        limit: effort limits of the drives that bend the arm and, last, of the axes of its base, (n + k,) [N m, N].
    """
    if not np.isfinite(limit).any():
        return None
    dynamics = InverseDynamics(plant, gravity)
    rest = np.zeros_like(joints.angles)
    place, still_axes = trajectory.base_positions, np.zeros_like(trajectory.base_positions)
    moved = (place, trajectory.base_velocities, trajectory.base_accelerations)
    efforts = (
        dynamics.efforts((joints.angles, joints.velocities, joints.accelerations), moved),
        dynamics.efforts((joints.angles, rest, rest), (place, still_axes, still_axes)),
    )
    moving, still = (np.abs(np.column_stack((drive_torques(plant, torques), force))) for torques, force in efforts)
    # Without a limit the fraction is zero; with a limit of zero it is huge for any effort.
    # The closed loop has a feed axis on a fixed base, too, which has no limit.
    share = moving / np.maximum(limit[: moving.shape[1]], np.finfo(np.float64).tiny)
    row, column = np.unravel_index(int(np.argmax(share)), share.shape)
    return PlanNeeds(
        int(column),
        float(trajectory.time[row]),
        float(moving[row, column]),
        float(still[row, column]),
        float(limit[column]),
        effort_units(plant)[column],
        len(drive_names(plant)),
    )
