"""A run of the closed loop judged: did the arm follow its plan, and if not, which drive failed it, and when."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.dynamics.simulation.plan_needs import PlanNeeds
from ccm_opt.dynamics.simulation.run_faults import RunFault
from ccm_opt.solution import SimulationVerdict

SATURATED_ADVICE = ("a smaller planner.effort_share, which leaves the controller more", "smaller disturbances")
CONTROL_ADVICE = (
    "a smaller simulation.step",
    "another simulation.bandwidth, or other simulation.gains",
    "the other simulation.controller",
)


@dataclass(frozen=True)
class RunFaults:
    """All that went wrong in a run.

    Attributes:
        full: where an effort first met its limit; None when none did.
        limit: of that effort [N m, N].
        full_steps: number of steps in which some effort was at its limit.
        strayed: where a joint was first far off its reference; None when none was.
        largest_error: of a joint over the whole run [rad].
        lost: where the run was stopped, since the arm had left its plan for good; None when it was not.
        needs: what the plan takes of the drives of the simulated arm; None where no drive has a limit.
    """

    full: RunFault | None = None
    limit: float = np.inf
    full_steps: int = 0
    strayed: RunFault | None = None
    largest_error: float = 0.0
    lost: RunFault | None = None
    needs: PlanNeeds | None = None


def verdict_of_run(faults: RunFaults, step: float, names: tuple[str, ...]) -> SimulationVerdict:
    """The verdict on a run, as far as drives and errors decide it; what the arm touches is not known here.

    Args:
        faults: of the run.
        step: length of a step [s].
        names: of all revolutes.
    """
    full = faults.full
    met = "" if full is None else _words_of_limit(full, faults, step, names)
    fault = faults.lost or faults.strayed
    if fault is not None:
        return _off_the_plan(faults, fault, met, step, names)
    if full is None:
        return SimulationVerdict("followed", step)
    name = _name(full, names)
    reason = f"{met}{_words_of_needs(faults.needs, names)}"
    advice = _drive_advice(faults.needs, names)
    return SimulationVerdict("saturated", step, reason, joint=name, time=full.step * step, advice=advice)


def _off_the_plan(
    faults: RunFaults, fault: RunFault, met: str, step: float, names: tuple[str, ...]
) -> SimulationVerdict:
    name = _name(fault, names)
    time = fault.step * step
    off = f"the simulated {name} {_words_of_error(fault)} at {time:.4g} s"
    if faults.lost is None:
        off = f"{off}, and joints are up to {faults.largest_error:.3g} rad off in all"
    # Once a drive has nothing left the controller does not decide any more what the arm does: that is the cause.
    saturated_before = faults.full is not None and faults.full.step <= fault.step
    cause = f"{off}; before that, {met}" if saturated_before else f"{off}, though no drive was at its limit before"
    # Drives that could follow the plan are not to blame for being full: the controller drove them there.
    too_weak = faults.needs is not None and faults.needs.share > 1.0
    return SimulationVerdict(
        "strayed" if faults.lost is None else "diverged",
        step,
        f"{cause}{_words_of_needs(faults.needs, names)}",
        joint=name,
        time=time,
        advice=_drive_advice(faults.needs, names) if saturated_before or too_weak else CONTROL_ADVICE,
    )


def _words_of_needs(needs: PlanNeeds | None, names: tuple[str, ...]) -> str:
    """What the drives could hold, to go on after the reason."""
    if needs is None:
        return ""
    unit = "N" if needs.column == len(names) else "N m"
    name = (*names, "the feed axis")[needs.column]
    most = f"{needs.effort:.4g} {unit} of {name} at {needs.time:.4g} s, of which {needs.held:.4g} {unit} to hold still"
    plan = "follow this plan with the simulated arm"
    if needs.share > 1.0:
        return f"; the drives cannot {plan}: it takes {most}, and the limit is {needs.limit:.4g} {unit}"
    return f"; the drives could {plan}, at {100.0 * needs.share:.3g} % of a limit at most: {most}"


def _drive_advice(needs: PlanNeeds | None, names: tuple[str, ...]) -> tuple[str, ...]:
    if needs is None or needs.share <= 1.0:
        return SATURATED_ADVICE
    if needs.column == len(names):
        return (f"limits.feed_force above {needs.effort:.4g} N", *SATURATED_ADVICE)
    return (f"a torque limit above {needs.effort:.4g} N m for {names[needs.column]}", *SATURATED_ADVICE)


def _words_of_limit(full: RunFault, faults: RunFaults, step: float, names: tuple[str, ...]) -> str:
    axis = full.column == len(names)
    limit = f"force limit of {faults.limit:.4g} N" if axis else f"torque limit of {faults.limit:.4g} N m"
    met = f"the drive of {_name(full, names)} meets its {limit} at {full.step * step:.4g} s"
    return f"{met}; in all, drives are at limits for {faults.full_steps * step:.3g} s"


def _words_of_error(fault: RunFault) -> str:
    return f"is {fault.error:.3g} rad off the plan" if np.isfinite(fault.error) else "is not finite"


def _name(fault: RunFault, names: tuple[str, ...]) -> str:
    return (*names, "the feed axis")[fault.column]
