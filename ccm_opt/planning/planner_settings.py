"""Numbers of the planners of curves and of feed."""

from dataclasses import dataclass, field

from ccm_opt.ik.configuration_task import ConfigurationSettings
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.terms import COST_SHARES
from ccm_opt.planning.goal_members import GoalMemberSettings
from ccm_opt.planning.settings import MotionSettings


@dataclass(frozen=True)
class CurvePlannerSettings:
    """Numbers of the planner, from free space to the smooth path.

    Attributes:
        corner_distance: distance that taut paths keep from corners where there is room, as a share of the arm's
            length. Taste.
        further_attempts: when the search asks for more configurations. Taste.
        curvature_share: share of the tightest bend (joint limit over link length) that the curve may use. Taste: links
            on a curve bend a little more than it does.
        full_curvature_share: the same for another guess when there is none at that share. Taste.
        cost_shares: shares of the weights of the user's costs with which a plan is sought in turn until one is
            found; the first is all of them, the last none. Taste.
        members: of the members of a goal to which routes are led.
        configuration: of the configuration NLP.
        motion: of the search for a motion.
        goal_pose: of the goal pose's NLP.
    """

    corner_distance: float = 0.016
    further_attempts: int = 4
    curvature_share: float = 0.9
    full_curvature_share: float = 1.0
    cost_shares: tuple[float, ...] = COST_SHARES
    members: GoalMemberSettings = field(default_factory=GoalMemberSettings)
    configuration: ConfigurationSettings = field(default_factory=ConfigurationSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    goal_pose: PoseSettings = field(default_factory=PoseSettings)


DEFAULT_CURVE_PLANNER = CurvePlannerSettings()
"""The numbers that are used unless others are given."""


@dataclass(frozen=True)
class FollowingSettings:
    """Numbers of paths for a leader and of the motions along them.

    Attributes:
        samples_per_link: samples of a leader's path in a link length. Derived: cubic Hermite interpolation between 32
            errs by less than 1e-7 of a link.
        sample_period: longest time between two samples of a trajectory, between which all joints move linearly [s].
            Derived: what the timing samples with.
        links_per_sample: part of a link that the base passes at most between two samples. Taste; it holds back feeds
            that no arm needs.
        spare: gap beyond contact that the certificate asks for, as a share of the arm's length. Taste, as in the search
            for motions of a fixed base.
    """

    samples_per_link: int = 32
    sample_period: float = 5e-3
    links_per_sample: float = 0.25
    spare: float = 1e-4


@dataclass(frozen=True)
class DeviationSettings:
    """How finely the deviation from a leader is measured; all of it definitions of the reported figures.

    Attributes:
        places_per_link: places on every link whose distance from the path is taken. Taste.
        poses: of a motion that are looked at, at most; the first and the last are among them. Taste.
    """

    places_per_link: int = 8
    poses: int = 400


DEFAULT_FOLLOWING = FollowingSettings()
"""What functions take when they are not given other settings."""
DEFAULT_DEVIATION = DeviationSettings()
"""The same for the deviation."""


@dataclass(frozen=True)
class LeaderPathSettings:
    """Numbers of the search for paths that a leader may take.

    Attributes:
        curvature_share: share of the tightest bend that a path may use, so that the arm can still be steered. Taste.
        curves: curves that are asked for, at most. Taste.
    """

    curvature_share: float = 0.9
    curves: int = 60


@dataclass(frozen=True)
class FeedPlannerSettings:
    """Numbers of the planner of arms on a feed axis.

    Attributes:
        straightening: distance that the tip may move when what the mapping of a curve bends inside the guide tube is
            straightened [m]. Taste.
        leaders: of the search for paths that a leader may take.
        following: of paths for a leader and of the motions along them.
        curve: of the planner that changes shapes at a fixed feed.
    """

    straightening: float = 5e-4
    leaders: LeaderPathSettings = field(default_factory=LeaderPathSettings)
    following: FollowingSettings = field(default_factory=FollowingSettings)
    curve: CurvePlannerSettings = field(default_factory=CurvePlannerSettings)


DEFAULT_FEED = FeedPlannerSettings()
"""What the planner takes when it is not given other settings."""
