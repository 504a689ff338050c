"""The numbers around OMPL's planner; those of the planner itself are OMPL's own."""

from dataclasses import dataclass, field

from ccm_opt.motion.settings.connect_settings import ConnectSettings
from ccm_opt.motion.settings.search_settings import SmoothPathSettings


@dataclass(frozen=True)
class OmplSettings:
    """What the planner of OMPL is given and allowed.

    Attributes:
        planning_share: share of the time limit that planning may use; timing and verification need the rest. Taste: as
            the baseline's.
        goal_share: share of the time limit within which poses at a goal for the tip are drawn. Taste.
        goal_poses: such poses that are enough. Taste: trees grow from all of them.
        simplifying_share: share of the time limit that is kept for OMPL's shortening of the way. Taste.
        searched_gap: gap beyond contact that the ways of OMPL keep, as a share of the arm's length. Taste.
        certified_gap: the same of the smooth path, which leaves the way at its corners by what is between the two.
            Taste: as the baseline's.
        longest_turn: turn of a link by which a way is cut into legs, so that a corner that is refined is a short
            stretch of it [rad]. Taste.
        beyond_tube: in space, how far behind a guide tube joints begin to bend, in link lengths. Taste: so that a
            smooth path may begin to bend them a little earlier.
        smooth: how the smooth path is found. Derived: a corner of legs of the longest turn is refined until the tip
            leaves it by less than what is between the two gaps.
        draws: how poses at a goal for the tip are drawn.
    """

    planning_share: float = 0.9
    goal_share: float = 0.2
    goal_poses: int = 10
    simplifying_share: float = 0.15
    searched_gap: float = 3e-4
    certified_gap: float = 1e-4
    longest_turn: float = 0.2
    beyond_tube: float = 0.2
    smooth: SmoothPathSettings = field(default_factory=lambda: SmoothPathSettings(refinements=10))
    draws: ConnectSettings = field(default_factory=ConnectSettings)


DEFAULT_OMPL = OmplSettings()
"""What the planner takes when it is not given other settings."""
