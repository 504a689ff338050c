"""The numbers of the explanation of failures: how long changed problems are tried."""

from dataclasses import dataclass, field
from functools import partial


@dataclass(frozen=True)
class TrialSettings:
    """How changed problems are tried, and for how long.

    Attributes:
        longest_try: CPU time that one try may use at most [s]. Taste.
        longest_further_try: the same when something that helps is known [s]. Taste.
        longest_search: CPU time for causes and tries together, from when there is a reason on [s]. Taste: who waits
            for changes has the reason already.
        patience: CPU time after which nothing new is begun when something that helps is known [s]. Taste.
    """

    longest_try: float = 2.5
    longest_further_try: float = 0.6
    longest_search: float = 15.0
    patience: float = 2.0


@dataclass(frozen=True)
class DiagnosisSettings:
    """Numbers of the explanation of failures.

    Attributes:
        trials: of the tries of changed problems.
        space_trials: the same in space, where a motion takes some times as long to find.
    """

    trials: TrialSettings = field(default_factory=TrialSettings)
    space_trials: TrialSettings = field(
        default_factory=partial(TrialSettings, longest_try=4.0, longest_further_try=2.0, patience=6.0)
    )
