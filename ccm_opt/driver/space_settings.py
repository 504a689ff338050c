"""The numbers of all stages of a solve in space; those of the plane's planners are not even loaded for it."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ccm_opt.driver.tries_settings import TriesSettings
from ccm_opt.dynamics.simulation.simulation_settings import SimulationSettings
from ccm_opt.planners.following.following_settings import FollowingSettings
from ccm_opt.retiming.paul_settings import PaulSettings
from ccm_opt.retiming.timing_settings import TimingSettings
from ccm_opt.user_terms.check_settings import COST_SHARES, TermCheckSettings
from ccm_opt.verification.tolerance.tolerance_settings import ToleranceSettings

if TYPE_CHECKING:
    from ccm_opt.diagnosis.diagnosis_settings import TrialSettings
    from ccm_opt.driver.solve_settings import Settings


@dataclass(frozen=True)
class SpaceSettings:
    """Settings of the stages of a solve in space.

    Attributes:
        following: of the limits of a feed axis.
        timing: of timing along a path.
        transitions: of timing by Paul's transitions.
        tries: which of several tries is the best.
        tolerance: how closely the errors that a motion survives are sought.
        user_terms: how users' constraints are checked on the finished motion.
        cost_shares: shares of the weights of the user's costs with which a plan is sought.
        simulation: of the simulation and the checks before it.
        trials: of changes that might help where there is no plan; the defaults when None.
    """

    following: FollowingSettings = field(default_factory=FollowingSettings)
    timing: TimingSettings = field(default_factory=TimingSettings)
    transitions: PaulSettings = field(default_factory=PaulSettings)
    tries: TriesSettings = field(default_factory=TriesSettings)
    tolerance: ToleranceSettings = field(default_factory=ToleranceSettings)
    user_terms: TermCheckSettings = field(default_factory=TermCheckSettings)
    cost_shares: tuple[float, ...] = COST_SHARES
    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    trials: "TrialSettings | None" = None


DEFAULT_IN_SPACE = SpaceSettings()
"""What every solve in space uses unless it is given others."""


def settings_in_space(settings: "Settings | None") -> SpaceSettings:
    """Those of a solve's settings that count in space; the defaults when None."""
    if settings is None:
        return DEFAULT_IN_SPACE
    return SpaceSettings(
        following=settings.feed.following,
        timing=settings.timing,
        transitions=settings.transitions,
        tries=settings.tries,
        tolerance=settings.tolerance,
        user_terms=settings.user_terms,
        cost_shares=settings.curve.cost_shares,
        simulation=settings.simulation,
        trials=settings.diagnosis.space_trials,
    )
