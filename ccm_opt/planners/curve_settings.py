"""Settings of the planner by the continuous curve."""

from dataclasses import dataclass, field

from ccm_opt.motion.settings.motion_settings import MotionSettings
from ccm_opt.nlp.arm_pose.pose_settings import PoseSettings
from ccm_opt.nlp.configuration_settings import ConfigurationSettings
from ccm_opt.planners.goal_member_settings import GoalMemberSettings
from ccm_opt.user_terms.check_settings import COST_SHARES


@dataclass(frozen=True)
class CurvePlannerSettings:
    """Numbers of the planner, from free space to the smooth path.

    Attributes:
        route_inflation: inflation of free space for routes beyond radius and clearance, as a share of the arm's length.
            Taste.
        least_margin: share of that inflation that is always kept, so that free space is never empty of width. Taste.
        corner_distance: distance that taut paths keep from corners where there is room, as a share of the arm's
            length. Taste.
        gate_width: width of free space, as a share of the arm's length, below which the tip is led straight through a
            gate. Taste: a link with more play than that passes askew.
        gate_run: straight run before and behind such a gate, in links, or in nominal links where these are longer.
            Measured: with 0.3 one of three scenes of doors and none of three gates is lost, and one takes six times as
            long; with 0.6 and 1.0 all six are found, as fast. With 1.2 an arm with 3 % of its length to spare came
            through one gate but not through three.
        run_in: straight run onto the goal along its heading, in nominal links; the longest that is free. Taste.
        run_in_samples: places of the run that have to be free. Taste.
        longest_route: routes longer than this share of the arm's length are not looked at. Taste: the arm needs some
            length to bend.
        rounding: allowed when a goal at full stretch is compared with the arm's length, as a share of it. Derived.
        configurations: routes for which a goal configuration is asked of the NLP. Taste.
        attempts: of the NLP at one configuration. Derived: its first guess with the surplus length on either side.
        further_attempts: when the search asks for more configurations. Taste.
        curvature_share: share of the tightest bend (joint limit over link length) that the curve may use. Taste: links
            on a curve bend a little more than it does.
        full_curvature_share: the same for another guess when there is none at that share. Taste.
        planning_share: share of the time limit that the search may use. Taste: timing and checks need the rest.
        cost_shares: shares of the weights of the user's costs with which a plan is sought in turn until one is
            found; the first is all of them, the last none. Taste.
        beginnings: configurations along each route from which the static question is asked. Taste: the surplus length
            to either side.
        different: largest turn of a link by which two configurations count as different [rad]. Taste.
        brought_rounds: rounds of random poses that Newton's method brings onto the goal, where neither routes nor drawn
            poses answer the static question. Taste: a tenth of a second each.
        brought: of these poses so many at most are improved by the NLP, until one serves. Taste.
        elastic_weights: of half the squared miss of a user's constraint, as a turn of the whole arm [1/rad²], where the
            pose is looked for that misses constraints least; one after the other, each from the pose before. Measured:
            the first is solved where the last alone fails, and with the last misses are exact to a thousandth.
        elastic_share: constraints that this pose misses by less than this share of the worst miss count as kept. Taste.
        neighbourhood: walls are left out that are farther beyond the arm's reach than this share of its length. Taste:
            more than any row of the search or of the optimisation looks ahead.
        outline_error: distance by which outlines of many vertices may be simplified, as a share of the arm's length.
            Taste: less than a tenth of what the optimisation keeps off.
        outline_gap_share: the same as a share of the least gap at the ends. Taste.
        members: of the members of a goal to which routes are led.
        configuration: of the configuration NLP.
        motion: of the search for a motion.
        goal_pose: of the goal pose's NLP.
    """

    route_inflation: float = 1e-3
    least_margin: float = 1e-3
    corner_distance: float = 0.016
    gate_width: float = 4e-3
    gate_run: float = 0.6
    run_in: tuple[float, ...] = (2.0, 1.0, 0.5, 0.0)
    run_in_samples: int = 9
    longest_route: float = 0.985
    rounding: float = 1e-9
    configurations: int = 2
    attempts: int = 2
    further_attempts: int = 4
    curvature_share: float = 0.9
    full_curvature_share: float = 1.0
    planning_share: float = 0.9
    cost_shares: tuple[float, ...] = COST_SHARES
    beginnings: int = 2
    different: float = 0.3
    brought_rounds: int = 20
    brought: int = 6
    elastic_weights: tuple[float, ...] = (10.0, 1e2, 1e3, 1e5)
    elastic_share: float = 0.02
    neighbourhood: float = 0.1
    outline_error: float = 5e-5
    outline_gap_share: float = 0.02
    members: GoalMemberSettings = field(default_factory=GoalMemberSettings)
    configuration: ConfigurationSettings = field(default_factory=ConfigurationSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    goal_pose: PoseSettings = field(default_factory=PoseSettings)


DEFAULT_CURVE_PLANNER = CurvePlannerSettings()
"""The numbers that are used unless others are given."""
