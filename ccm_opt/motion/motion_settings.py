"""All settings of the search for a motion in one object, a part for every stage."""

from dataclasses import dataclass, field

from ccm_opt.motion.guides.guide_settings import GuideSettings
from ccm_opt.motion.lifting_settings import LiftingSettings
from ccm_opt.motion.tree.tree_settings import TreeSettings


@dataclass(frozen=True)
class StepSettings:
    """Numbers of a single step of the continuation.

    Attributes:
        limit_share: share of a joint limit that planning uses; what accepted poses and splines overshoot stays below
            the limit. Taste.
        keep_share: share of the planning margin that every accepted pose keeps. Taste.
        largest_turn: largest turn of a link in one step [rad], so that the linearised rows hold. Taste.
    """

    limit_share: float = 0.98
    keep_share: float = 0.4
    largest_turn: float = 0.15


@dataclass(frozen=True)
class MotionSettings:
    """Numbers of the search for a motion.

    Attributes:
        step: of a single step.
        guides: of the guides and candidates.
        tree: of the trees of poses.
        lifting: of taking a motion over to an arm of many links.
    """

    step: StepSettings = field(default_factory=StepSettings)
    guides: GuideSettings = field(default_factory=GuideSettings)
    tree: TreeSettings = field(default_factory=TreeSettings)
    lifting: LiftingSettings = field(default_factory=LiftingSettings)
