"""What a simulation records, and its numbers."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.dynamics.simulation.controller import hermite
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.solution import SimulatedMotion, SimulationVerdict


@dataclass(frozen=True)
class SimulatedSteps:
    """Some consecutive steps; the feed axis is the last of W = 3 * links + 1 columns.

    Attributes:
        first: number of the first of them.
        states: positions and velocities before the first and at the end of each, shape (N + 1, 2, W).
        efforts: held over each, shape (N, W) [N m, N].
        targets: positions of the reference at the end of each, shape (N, W).
    """

    first: int
    states: FloatArray
    efforts: FloatArray
    targets: FloatArray

    @property
    def count(self) -> int:
        """Number of steps, N."""
        return len(self.efforts)

    @cached_property
    def errors(self) -> FloatArray:
        """How far each revolute is from its reference at the end of each step, shape (N, W - 1) [rad]."""
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray(np.abs(self.states[1:, 0, :-1] - self.targets[:, :-1]))

    @cached_property
    def worst_error(self) -> float:
        """The largest of the errors; not a number where some error is none; 0 of no steps."""
        return float(np.max(self.errors, initial=0.0))

    @cached_property
    def is_finite(self) -> bool:
        """Whether all states at the ends of steps are finite."""
        return bool(np.isfinite(self.states[1:]).all())


@dataclass
class SimulationRecord:
    """What is kept of the simulated motion, filled as the steps come; the feed axis is the last column.

    Attributes:
        step: length of a step [s].
        places: times of the plan's samples in units of steps, shape (T,).
        positions: at the samples that steps have reached, shape (T, W).
        efforts: held at the samples, shape (T, W) [N m, N]; 0 where no step has been.
        limit: of the efforts, shape (W,) [N m, N].
        tracking_error: largest difference of a joint's angle from its reference at the end of a step [rad].
        full_steps: number of steps in which some effort was at its limit.
        end: number of the last step that was added.
    """

    step: float
    places: FloatArray
    positions: FloatArray
    efforts: FloatArray
    limit: FloatArray
    tracking_error: float = 0.0
    full_steps: int = 0
    end: int = 0
    _last: FloatArray | None = None

    @classmethod
    def from_plan(cls, time: FloatArray, start: FloatArray, step: float, limit: FloatArray) -> "SimulationRecord":
        """A record to be filled, at the samples of a plan: time (T,) [s], positions at its start (W,), limits (W,)."""
        positions = np.repeat(start[None], len(time), axis=0)
        return cls(step, time / step, positions, np.zeros_like(positions), limit)

    def add(self, steps: SimulatedSteps) -> None:
        """Interpolate some steps at the samples inside them."""
        if steps.count == 0:
            return
        self.end = steps.first + steps.count
        self._last = steps.states[-1, 0]
        # A sample that rounding puts past the end of the steps belongs to them.
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

    def motion(self, coordinates: Coordinates, verdict: SimulationVerdict) -> SimulatedMotion:
        """The whole simulated motion, once all steps were added."""
        drives = coordinates.drive_count  # a fixed base has a column in the loop, but no drive
        if self._last is not None:
            # An arm whose run was stopped is taken as standing still from there on.
            self.positions[self.places > self.end + ROUNDING] = self._last
        return SimulatedMotion(
            angles=self.positions[:, : coordinates.revolutes].copy(),
            torques=self.efforts[:, : coordinates.revolutes].copy(),
            tracking_error=self.tracking_error,
            saturated=self.full_steps > 0,
            base_positions=self.positions[:, coordinates.revolutes : drives].copy(),
            saturated_time=self.full_steps * self.step,
            verdict=verdict,
        )


@dataclass(frozen=True)
class SimulationSettings:
    """Numbers of the checks before a simulation and of its run.

    Attributes:
        largest_bend: bend up to which an arm of Z-Y-X balls is simulated out of its plane [rad]. Derived: at 90° the
            ball is singular, and at 1.3 rad its yaw turns 1 / cos 1.3 = 3.7 times as fast as the link; taste beyond
            that.
        strayed: error of a joint above which the arm does not follow its plan [rad]. Taste.
        lost: error of a joint at which the arm has left its plan for good and the run is stopped [rad]. Taste: a joint
            that is off by a whole radian follows nothing.
        advised_damping: advised derivative gain over the least stable one. Taste.
    """

    largest_bend: float = 1.3
    strayed: float = 0.1
    lost: float = 1.0
    advised_damping: float = 1.2


DEFAULT_SIMULATION = SimulationSettings()
"""What every simulation uses unless it is given others."""


@dataclass(frozen=True)
class BrakingSettings:
    """Numbers of coming to rest along a planned motion.

    Attributes:
        step: largest time between two samples while braking [s]. Taste.
        limit_shares: shares of every limit to brake with, the first with which all samples keep the limits: between the
            places that are checked, the planned motion's own accelerations change. Taste.
        least_time: braking from the planned rate to rest takes at least this, however slowly the axes move [s]. Taste.
    """

    step: float = 2e-3
    limit_shares: tuple[float, ...] = (0.97, 0.93, 0.87, 0.8)
    least_time: float = 4e-3


DEFAULT_BRAKING = BrakingSettings()
"""What every braking uses unless it is given others."""
