"""A run of the closed loop judged: did the arm follow its plan, and if not, which drive failed it, and when."""

from dataclasses import replace

import numpy as np

from ccm_opt.dynamics.simulation.run_faults import RunFault
from ccm_opt.errors import SimulationError
from ccm_opt.solution import SimulationVerdict


def verdict_of_run(
    lost: RunFault | None, full: RunFault | None, full_steps: int, step: float, names: tuple[str, ...]
) -> SimulationVerdict:
    """The verdict on a run, as far as drives and errors decide it; what the arm touches is not known here.

    Args:
        lost: where the arm left its plan for good, None when it did not.
        full: where an effort first met its limit, None when none did.
        full_steps: number of steps in which one was at its limit.
        step: length of a step [s].
        names: of all revolutes.
    """
    met = None if full is None else _met_limit(full, full_steps, step, names)
    if lost is not None:
        return _diverged(lost, met, step, names)
    return met or SimulationVerdict("followed", step)


def verdict_without_run(error: SimulationError, step: float) -> SimulationVerdict:
    """The verdict where no step could be run, with the reason."""
    return SimulationVerdict("not simulated", step, error.diagnosis.reason, advice=error.diagnosis.advice)


def _met_limit(full: RunFault, full_steps: int, step: float, names: tuple[str, ...]) -> SimulationVerdict:
    name = _name(full, names)
    limit = "force limit" if full.column == len(names) else "torque limit"
    begin = full.step * step
    spent = full_steps * step
    return SimulationVerdict(
        "saturated",
        step,
        f"the drive of {name} meets its {limit} at {begin:.4g} s; in all, drives are at limits for {spent:.3g} s",
        joint=name,
        time=begin,
        advice=("a smaller planner.effort_share, which leaves the controller more", "smaller disturbances"),
    )


def _diverged(lost: RunFault, met: SimulationVerdict | None, step: float, names: tuple[str, ...]) -> SimulationVerdict:
    name = _name(lost, names)
    time = lost.step * step
    what = f"is {lost.error:.3g} rad off the plan" if np.isfinite(lost.error) else "is not finite"
    if met is None:
        return SimulationVerdict(
            "diverged",
            step,
            f"the simulated {name} {what} at {time:.4g} s, though no drive is at its limit",
            joint=name,
            time=time,
            advice=("a smaller simulation.step", "other gains", 'simulation.controller = "computed-torque"'),
        )
    # Once a drive has nothing left the controller does not decide any more what the arm does: that is the cause.
    reason = f"the simulated {name} {what} at {time:.4g} s; before that, {met.reason}"
    return replace(met, outcome="diverged", reason=reason, joint=name, time=time)


def _name(fault: RunFault, names: tuple[str, ...]) -> str:
    return (*names, "the feed axis")[fault.column]
