"""What is kept of a simulated motion: its state at the plan's own samples, its largest error, full efforts."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.dynamics.simulation.reference import hermite
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.jointed.coordinates import Coordinates
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
