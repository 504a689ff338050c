"""Time limits for explaining failures by solving changed problems."""

from dataclasses import dataclass, field
from functools import partial


@dataclass(frozen=True)
class TrialSettings:
    """Time limits of trials, in which changed problems are solved to see whether a change helps.

    Attributes:
        longest_try: CPU time limit of one trial [s]. Heuristic.
        longest_further_try: CPU time limit of one trial once a helpful change is known [s]. Heuristic.
        longest_search: CPU time limit of causes and trials together, counted from when a cause is known [s]. Heuristic:
            users who wait for changes already have the cause.
        patience: CPU time after which no new trial starts once a helpful change is known [s]. Heuristic.
    """

    longest_try: float = 2.5
    longest_further_try: float = 0.6
    longest_search: float = 15.0
    patience: float = 2.0


@dataclass(frozen=True)
class DiagnosisSettings:
    """Settings for explaining why a problem has no plan.

    Attributes:
        trials: time limits of trial solves for problems in the plane.
        space_trials: time limits of trial solves in space, where finding a motion takes several times as long.
    """

    trials: TrialSettings = field(default_factory=TrialSettings)
    space_trials: TrialSettings = field(
        default_factory=partial(TrialSettings, longest_try=4.0, longest_further_try=2.0, patience=6.0)
    )
