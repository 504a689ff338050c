"""All settings of the search for a motion in one object, a part for every stage."""

from dataclasses import dataclass, field

from ccm_opt.collision.collision_settings import CertificateSettings, ContactSettings
from ccm_opt.motion.settings.connect_settings import ConnectSettings
from ccm_opt.motion.settings.end_settings import EndSettings
from ccm_opt.motion.settings.guide_settings import GuideSettings
from ccm_opt.motion.settings.lifting_settings import LiftingSettings
from ccm_opt.motion.settings.limit_arc_settings import LimitArcSettings
from ccm_opt.motion.settings.optimisation_settings import (
    BottleneckSettings,
    InteriorPointSettings,
    ObjectiveSettings,
    OptimisationSettings,
)
from ccm_opt.motion.settings.search_settings import SearchSettings, SmoothPathSettings
from ccm_opt.motion.settings.step_settings import ContinuationSettings, GoalSettings, StepSettings, TrackingSettings
from ccm_opt.motion.settings.straightening_settings import StraighteningSettings
from ccm_opt.motion.settings.tip_walk_settings import TipWalkSettings
from ccm_opt.motion.settings.tree_settings import TreeSettings
from ccm_opt.motion.settings.user_limit_settings import UserLimitSettings


@dataclass(frozen=True)
class MotionSettings:
    """Numbers of the search for a motion.

    Attributes:
        ends: of resolving start and goal.
        contacts: of near pairs.
        certificate: of the certificate of contact.
        step: of a single step.
        continuation: of following a guide and settling on the goal.
        goal: of putting the tip onto the goal.
        tracking: of tracking a reference motion.
        user_limits: of the user's constraints.
        search: of the search over all strategies.
        guides: of the guides and candidates.
        tip_walks: of leading the tip among many walls.
        tree: of the trees of poses.
        connect: of RRT-Connect.
        limit_arcs: of poses at the goal with joints at their limits.
        lifting: of taking a motion over to an arm of many links.
        straightening: of cutting a long motion short before it is optimised.
        optimisation: of the optimisation of a motion.
        objective: weights inside its objective.
        bottleneck: how much more the busiest joints count at last.
        interior_point: of the optimisation as one nonlinear program.
        smooth_path: of the path through joint space.
    """

    ends: EndSettings = field(default_factory=EndSettings)
    contacts: ContactSettings = field(default_factory=ContactSettings)
    certificate: CertificateSettings = field(default_factory=CertificateSettings)
    step: StepSettings = field(default_factory=StepSettings)
    continuation: ContinuationSettings = field(default_factory=ContinuationSettings)
    goal: GoalSettings = field(default_factory=GoalSettings)
    tracking: TrackingSettings = field(default_factory=TrackingSettings)
    user_limits: UserLimitSettings = field(default_factory=UserLimitSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    guides: GuideSettings = field(default_factory=GuideSettings)
    tip_walks: TipWalkSettings = field(default_factory=TipWalkSettings)
    tree: TreeSettings = field(default_factory=TreeSettings)
    connect: ConnectSettings = field(default_factory=ConnectSettings)
    limit_arcs: LimitArcSettings = field(default_factory=LimitArcSettings)
    lifting: LiftingSettings = field(default_factory=LiftingSettings)
    straightening: StraighteningSettings = field(default_factory=StraighteningSettings)
    optimisation: OptimisationSettings = field(default_factory=OptimisationSettings)
    objective: ObjectiveSettings = field(default_factory=ObjectiveSettings)
    bottleneck: BottleneckSettings = field(default_factory=BottleneckSettings)
    interior_point: InteriorPointSettings = field(default_factory=InteriorPointSettings)
    smooth_path: SmoothPathSettings = field(default_factory=SmoothPathSettings)
