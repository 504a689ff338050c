"""The numbers of the baseline planner, in one place."""

from dataclasses import dataclass, field

from ccm_opt.hill_climbing.climbing_settings import ClimbingSettings


@dataclass(frozen=True)
class BaselineSettings:
    """What the planner around the schemas of hill climbing allows itself, and the numbers of these.

    Attributes:
        planning_share: share of the time limit that planning may use; timing and verification need the rest. Taste.
        plan_share: share of the time that is left that one plan may use, so that the others have their turn. Taste.
        joint_limit_share: share of the joint limits that moves use; the smooth path near them bends a little more.
            Taste.
        certified_gap: gap beyond contact that moves keep, as a share of the arm's length, so that the smooth path has
            somewhere to go. Taste.
        bisections: halvings of a move before it counts as blocked. Most candidate moves are discarded, so that
            fewer than the certificate's own pay. Taste.
        merging_tolerance: how far headings may move when segments of the start are merged [rad]; the follower's
            offset makes up for it exactly. Taste.
        route_inflation: inflation of the walls for routes beyond radius and clearance, as a share of the arm's length.
            Taste.
        types_tried: segment types that are tried, best first. The paper has five; the last is seldom any good. Taste.
        climbing: of the climbs, the schemas, and the plans made of them.
    """

    planning_share: float = 0.9
    plan_share: float = 0.6
    joint_limit_share: float = 0.99
    certified_gap: float = 1e-4
    bisections: int = 3
    merging_tolerance: float = 0.02
    route_inflation: float = 1e-3
    types_tried: int = 4
    climbing: ClimbingSettings = field(default_factory=ClimbingSettings)


DEFAULT_BASELINE = BaselineSettings()
"""What the planner takes when it is not given other settings."""
