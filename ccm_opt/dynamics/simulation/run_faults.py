"""What goes wrong in a simulated run: a drive that meets its limit, an arm that is far off its plan."""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.dynamics.simulation.simulation_record import SimulatedSteps
from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True)
class RunFault:
    """Where a run first goes wrong.

    Attributes:
        column: of the state that is at fault: a revolute, or after them all the feed axis.
        step: number of the state from the run's begin; state k stands at k steps.
        error: of the revolute at that state [rad]; not finite when the state is not.
    """

    column: int
    step: int
    error: float = 0.0


def first_far_off(steps: SimulatedSteps, most: float) -> RunFault | None:
    """The first state that is not finite, or a revolute of which is farther from its reference than ``most`` [rad]."""
    # Where an error is no number, the first comparison fails, too.
    if steps.worst_error <= most and steps.is_finite:
        return None
    # The feed axis, last, has errors in metres, for which there is no such bound.
    errors = np.pad(steps.errors, ((0, 0), (0, 1)))
    bad = (errors > most) | ~np.isfinite(steps.states[1:]).all(axis=1)
    row, column = np.argwhere(bad)[0]
    return RunFault(int(column), steps.first + int(row) + 1, float(errors[row, column]))


def first_saturation(steps: SimulatedSteps, limit: FloatArray) -> RunFault | None:
    """The first effort at its limit, shape (W,) [N m, N]; it is held from that state on."""
    full = np.abs(steps.efforts) >= limit
    if not full.any():
        return None
    row, column = np.argwhere(full)[0]
    return RunFault(int(column), steps.first + int(row))


def steps_before(steps: SimulatedSteps, fault: RunFault) -> SimulatedSteps:
    """The steps of a run that end before the state at fault; there may be none."""
    count = fault.step - steps.first - 1
    return replace(
        steps, states=steps.states[: count + 1], efforts=steps.efforts[:count], targets=steps.targets[:count]
    )
