"""Settings of all stages of planning, which users may replace."""

from dataclasses import dataclass, field, fields

from ccm_opt.core.arguments import expect
from ccm_opt.diagnosis.diagnosis_settings import DiagnosisSettings
from ccm_opt.driver.clearance_over_time import ClearanceSettings
from ccm_opt.dynamics.retiming.timing_settings import TimingSettings
from ccm_opt.planning.pose_beginnings import PoseSearchSettings
from ccm_opt.planning.settings import CurvePlannerSettings, SpaceMotionSettings
from ccm_opt.planning.tip_reach import ReachSettings
from ccm_opt.verification.tolerance.error_model import ToleranceSettings
from ccm_opt.verification.verification_settings import VerificationSettings


@dataclass(frozen=True)
class Settings:
    """Settings of every stage of planning; each class documents the meaning and origin of its numbers.

    To change a number, replace the settings that contain it, for example
    ``Settings(timing=replace(TimingSettings(), grid=GridSettings(intervals=400)))``.

    Attributes:
        curve: settings of the planner of planar arms, from free space to the smooth path.
        space: settings of the planner of arms in space.
        poses: settings of the search for the best pose at a goal.
        reach: settings of reachability maps.
        timing: settings of the timing along a path.
        verification: tolerances of the verifier.
        room: settings of the record of a motion's clearance.
        tolerance: precision of the tolerated errors of a motion.
        diagnosis: settings of the search for reasons of failures and for helpful changes.
    """

    curve: CurvePlannerSettings = field(default_factory=CurvePlannerSettings)
    space: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    poses: PoseSearchSettings = field(default_factory=PoseSearchSettings)
    reach: ReachSettings = field(default_factory=ReachSettings)
    timing: TimingSettings = field(default_factory=TimingSettings)
    verification: VerificationSettings = field(default_factory=VerificationSettings)
    room: ClearanceSettings = field(default_factory=ClearanceSettings)
    tolerance: ToleranceSettings = field(default_factory=ToleranceSettings)
    diagnosis: DiagnosisSettings = field(default_factory=DiagnosisSettings)

    def __post_init__(self) -> None:
        for each in fields(self):
            kind: object = each.default_factory
            if isinstance(kind, type):
                expect(getattr(self, each.name), kind, f"{kind.__name__} for {each.name}=")


DEFAULT_SETTINGS = Settings()
"""Default settings of all stages."""
