"""The numbers of all stages of a solve in one place; what a problem file sets is not among them."""

from dataclasses import dataclass, field, fields

from ccm_opt.diagnosis.diagnosis_settings import DiagnosisSettings
from ccm_opt.driver.tries_settings import TriesSettings
from ccm_opt.dynamics.simulation.simulation_settings import BrakingSettings, SimulationSettings
from ccm_opt.ground.expected import expect
from ccm_opt.planners.baseline.baseline_settings import BaselineSettings
from ccm_opt.planners.curve_settings import CurvePlannerSettings
from ccm_opt.planners.feed.feed_settings import FeedPlannerSettings
from ccm_opt.planners.reach_settings import ReachSettings
from ccm_opt.retiming.paul_settings import PaulSettings
from ccm_opt.retiming.timing_settings import TimingSettings
from ccm_opt.user_terms.check_settings import TermCheckSettings
from ccm_opt.verification.room_settings import RoomSettings
from ccm_opt.verification.tolerance.tolerance_settings import ToleranceSettings
from ccm_opt.verification.verification_settings import VerificationSettings


@dataclass(frozen=True)
class Settings:
    """Settings of every stage; each class says of each number what it means and where it comes from.

    To change one, replace what is on the way to it, for example
    ``Settings(timing=replace(TimingSettings(), standing=1e-8))``.

    Attributes:
        curve: of the curve planner, from free space to the smooth path.
        reach: of the map of where the tip can be.
        feed: of the planner for an arm on a feed axis.
        hill_climbing: of the paper's planner.
        timing: of timing along a path.
        transitions: of timing by Paul's transitions.
        verification: tolerances of the verifier.
        tries: which of several tries is the best.
        room: how closely the room that a motion keeps is looked at.
        tolerance: how closely the errors that a motion survives are sought.
        user_terms: how users' constraints are checked on the finished motion.
        simulation: of the simulation and the checks before it.
        braking: of coming to rest where a motion is given another goal.
        diagnosis: of the explanation of failures.
    """

    curve: CurvePlannerSettings = field(default_factory=CurvePlannerSettings)
    reach: ReachSettings = field(default_factory=ReachSettings)
    feed: FeedPlannerSettings = field(default_factory=FeedPlannerSettings)
    hill_climbing: BaselineSettings = field(default_factory=BaselineSettings)
    timing: TimingSettings = field(default_factory=TimingSettings)
    transitions: PaulSettings = field(default_factory=PaulSettings)
    verification: VerificationSettings = field(default_factory=VerificationSettings)
    tries: TriesSettings = field(default_factory=TriesSettings)
    room: RoomSettings = field(default_factory=RoomSettings)
    tolerance: ToleranceSettings = field(default_factory=ToleranceSettings)
    user_terms: TermCheckSettings = field(default_factory=TermCheckSettings)
    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    braking: BrakingSettings = field(default_factory=BrakingSettings)
    diagnosis: DiagnosisSettings = field(default_factory=DiagnosisSettings)

    def __post_init__(self) -> None:
        for each in fields(self):
            kind: object = each.default_factory
            if isinstance(kind, type):
                expect(getattr(self, each.name), kind, f"{kind.__name__} for {each.name}=")


DEFAULT_SETTINGS = Settings()
"""What every solve uses unless it is given others."""
