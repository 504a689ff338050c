"""Whether the simulated arm followed its plan: what the simulation says of a plan that the verifier accepts."""

from dataclasses import dataclass
from typing import Literal

SimulationOutcome = Literal["followed", "saturated", "strayed", "touched", "diverged", "not simulated"]


@dataclass(frozen=True)
class SimulationVerdict:
    """Whether the simulated arm followed its plan, which is verified whatever the simulation says.

    Attributes:
        outcome: "followed"; "saturated", a drive met its limit; "strayed", some joint was far off its plan, 0.1 rad
            by default; "touched", the arm met a wall or itself; "diverged", the arm left the plan for good, and the run
            was stopped; "not simulated", no step was run.
        step: integration step of the run that is judged [s].
        reason: one sentence: which joint or link, when, and why; empty when followed.
        joint: name of the revolute, or of the axis that carries the base, whose drive was at fault; empty for none.
        link: number of the link that touched, counted from 1; None when none did.
        obstacle: name of the wall, or number of the other link in words, that it touched; empty for none.
        time: when it began [s], None when followed or not simulated.
        advice: what would help, most promising first.
    """

    outcome: SimulationOutcome
    step: float
    reason: str = ""
    joint: str = ""
    link: int | None = None
    obstacle: str = ""
    time: float | None = None
    advice: tuple[str, ...] = ()

    @property
    def followed(self) -> bool:
        """Whether the arm followed its plan with effort to spare and touched nothing."""
        return self.outcome == "followed"


FOLLOWED = SimulationVerdict("followed", 0.0)
"""Stands for the verdict on a run that nobody judged."""
