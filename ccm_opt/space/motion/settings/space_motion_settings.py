"""All numbers of the search for a motion in space in one object, a part for every stage."""

from dataclasses import dataclass, field
from functools import partial

from ccm_opt.space.motion.settings.schedule_settings import ScheduleSettings
from ccm_opt.space.motion.settings.space_end_settings import EndingSettings, GoalPoseSettings, SpaceConnectSettings
from ccm_opt.space.motion.settings.space_lifting_settings import LiftingSettings
from ccm_opt.space.motion.settings.space_optimisation_settings import SpaceObjectiveSettings, SpaceOptimisationSettings
from ccm_opt.space.motion.settings.space_proof_settings import SpaceCertificateSettings, SpaceSmoothPathSettings
from ccm_opt.space.motion.settings.space_step_settings import SpaceGuideSettings, SpaceStepSettings
from ccm_opt.space.motion.settings.way_settings import FollowableWaySettings, SlideSettings, WaySettings


@dataclass(frozen=True)
class SpaceMotionSettings:
    """All numbers of the search.

    Attributes:
        certificate: of proofs.
        step: of single steps.
        guide: of what leads the tip.
        ways: that the tip may take.
        followable: ways for arms that follow their tip.
        slide: of arms that are slid along them.
        goal_poses: by drawn curves.
        swing: trees between poses that have been unbent; they meet after few draws or not at all. Measured on curled
            arms beside a post, where some hundred draws are enough.
        connect: trees as the last resort.
        lifting: of arms of many links.
        ending: of the pose in which a motion ends.
        schedule: of the path parameter along a motion.
        objective: of the optimisation.
        optimisation: of a found motion.
        smooth_path: through joint space.
    """

    certificate: SpaceCertificateSettings = field(default_factory=SpaceCertificateSettings)
    step: SpaceStepSettings = field(default_factory=SpaceStepSettings)
    guide: SpaceGuideSettings = field(default_factory=SpaceGuideSettings)
    ways: WaySettings = field(default_factory=WaySettings)
    followable: FollowableWaySettings = field(default_factory=FollowableWaySettings)
    slide: SlideSettings = field(default_factory=SlideSettings)
    goal_poses: GoalPoseSettings = field(default_factory=GoalPoseSettings)
    swing: SpaceConnectSettings = field(default_factory=partial(SpaceConnectSettings, draws=1000, base_share=0.8))
    connect: SpaceConnectSettings = field(default_factory=SpaceConnectSettings)
    lifting: LiftingSettings = field(default_factory=LiftingSettings)
    ending: EndingSettings = field(default_factory=EndingSettings)
    schedule: ScheduleSettings = field(default_factory=ScheduleSettings)
    objective: SpaceObjectiveSettings = field(default_factory=SpaceObjectiveSettings)
    optimisation: SpaceOptimisationSettings = field(default_factory=SpaceOptimisationSettings)
    smooth_path: SpaceSmoothPathSettings = field(default_factory=SpaceSmoothPathSettings)
