"""Numbers of the planners of curves and of feed."""

from dataclasses import dataclass, field

from ccm_opt.ik.configuration_task import ConfigurationSettings
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.terms import COST_SHARES
from ccm_opt.planning.goal_members import GoalMemberSettings
from ccm_opt.planning.settings import MotionSettings, SmoothPathSettings


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


@dataclass(frozen=True)
class ElasticBandSettings:
    """Numbers of an elastic band and of its steps.

    Attributes:
        steps: at most. Taste.
        settled: largest shift of a point, in distances between points, below which the band counts as settled. Taste.
        largest_step: of a point along its normal, in distances between points, so that neighbours do not cross. Taste.
        tension: weight of the band's length against its bending, both without units. Taste; just enough to take up
            slack.
        tightness: how much more bending counts at the curvature limit than on a straight band. Taste.
        tightness_power: how suddenly it does so on the way to the limit. Taste.
        most_tight: curvature, as a share of the limit, beyond which bending counts no more than there; a kink would
            otherwise swamp all other terms. Taste.
        ridge: weight of the shifts themselves, which keeps the Hessian definite. Taste.
        least_slant: sine of the angle between the band and the direction of a wall below which the wall lies ahead or
            behind and bounds no shift sideways. Taste.
    """

    steps: int = 80
    settled: float = 2e-3
    largest_step: float = 0.3
    tension: float = 0.02
    tightness: float = 30.0
    tightness_power: int = 6
    most_tight: float = 1.5
    ridge: float = 1e-3
    least_slant: float = 0.3


@dataclass(frozen=True)
class ChordSettings:
    """Numbers of Newton's method for the places on a leader's path that are a link apart.

    Attributes:
        most_steps: at most. Taste; from a chord's length ahead it needs four or five.
        settled: step at which it has arrived [arm lengths]. Derived: rounding.
        least_slope: slope of distance over arc length that it assumes at least. Taste; a path that bends less than
            a U-turn has more.
    """

    most_steps: int = 40
    settled: float = 1e-13
    least_slope: float = 0.2


@dataclass(frozen=True)
class FollowingSettings:
    """Numbers of paths for a leader and of the motions along them.

    Attributes:
        samples_per_link: samples of a leader's path in a link length. Derived: cubic Hermite interpolation between 32
            errs by less than 1e-7 of a link.
        feed_step: feed between two keyframes, in link lengths; arms of many links take ``least_feed_step``. Taste.
        least_feed_step: the same as a share of the arm's length; the larger of both counts. Taste.
        least_lead: how far the first joint off the feed axis must be ahead of where the path leaves the axis, in link
            lengths; nearer, the spline through both would swing. Taste.
        sample_period: longest time between two samples of a trajectory, between which all joints move linearly [s].
            Derived: what the timing samples with.
        links_per_sample: part of a link that the base passes at most between two samples. Taste; it holds back feeds
            that no arm needs.
        samples_per_span: places of every span of a path at which the feed is read off to see where it turns. Taste.
        spare: gap beyond contact that the certificate asks for, as a share of the arm's length. Taste, as in the search
            for motions of a fixed base.
        spare_at_ends: share of the narrower end's gap that the certificate may ask for along the motion. Taste.
        contact_reach: contacts of a pose nearer than this are listed, as a share of the arm's length. Taste.
        chords: of finding an arm's joints on a leader's path.
        band: of elastic bands.
        smooth_path: of the smooth path through the keyframes.
    """

    samples_per_link: int = 32
    feed_step: float = 1.0 / 8.0
    least_feed_step: float = 1.0 / 300.0
    least_lead: float = 0.1
    sample_period: float = 5e-3
    links_per_sample: float = 0.25
    samples_per_span: int = 12
    spare: float = 1e-4
    spare_at_ends: float = 0.5
    contact_reach: float = 0.02
    chords: ChordSettings = field(default_factory=ChordSettings)
    band: ElasticBandSettings = field(default_factory=ElasticBandSettings)
    smooth_path: SmoothPathSettings = field(default_factory=SmoothPathSettings)


@dataclass(frozen=True)
class DeviationSettings:
    """How finely the deviation from a leader is measured; all of it definitions of the reported figures.

    Attributes:
        places_per_link: places on every link whose distance from the path is taken. Taste.
        poses: of a motion that are looked at, at most; the first and the last are among them. Taste.
        straight_turn: a place of the path is straight when the path turns by no more than this within a link length to
            either side [rad]. Taste: half a degree.
    """

    places_per_link: int = 8
    poses: int = 400
    straight_turn: float = 0.008726646259971648


DEFAULT_FOLLOWING = FollowingSettings()
"""What functions take when they are not given other settings."""
DEFAULT_DEVIATION = DeviationSettings()
"""The same for the deviation."""


@dataclass(frozen=True)
class LeaderPathSettings:
    """Numbers of the search for paths that a leader may take.

    Attributes:
        curvature_share: share of the tightest bend that a path may use, so that the arm can still be steered. Taste.
        free_space_margins: kept by free space beyond radius and clearance, widest first, as shares of a link's
            sagitta at its joint limit: links are chords of the path and cut its corners by that much. Taste.
        band_margins: kept by elastic bands beyond radius and clearance where there is room, in link lengths.
            Taste.
        band_gap: the same as a share of the wanted gap, tried first where it is more. Measured in tubes that leave just
            the wanted gap, at 48 links: at 1 the band has no play, swings, and lasts 1.5 times as long.
        band_spacing: distance between the points of a band, in link lengths. Taste.
        least_band_spacing: the same as a share of the arm's length, for arms of many links; the larger of both counts.
            Measured on clutter at 48 links: points nearer together turn sharply one by one where corners push them, and
            a step costs the cube of their number.
        band_evenness: length over which a band's change of curvature weighs as much as its curvature, as a share of
            the arm's length. Taste.
        chord_allowance: share of a path's length by which the arm on it may be longer than its chords. Taste.
        curve_stretches: lengths of the continuous curve that are tried, over that of the taut path. Taste.
        curve_attempts: attempts of the configuration's NLP at one curve. Taste.
        curves: curves that are asked for, at most. Taste.
        first_curves: the same where other straight beginnings may do as well. Taste.
    """

    curvature_share: float = 0.9
    free_space_margins: tuple[float, ...] = (1.0, 0.4, 0.1)
    band_margins: tuple[float, ...] = (0.2, 0.05, 0.01)
    band_gap: float = 0.8
    band_spacing: float = 1.0 / 3.0
    least_band_spacing: float = 1.0 / 90.0
    band_evenness: float = 1.0 / 16.0
    chord_allowance: float = 1e-2
    curve_stretches: tuple[float, ...] = (1.03, 1.1, 1.25, 1.5, 2.0)
    curve_attempts: int = 3
    curves: int = 60
    first_curves: int = 5


@dataclass(frozen=True)
class FeedPlannerSettings:
    """Numbers of the planner of arms on a feed axis.

    Attributes:
        planning_share: share of the time limit that planning may use; timing and verification need the rest. Taste.
        member_share: share of the time limit that each member of a goal that is a set may use before any may use more.
            Taste.
        way_spacing: between the places of a way into a goal that is a set at which it may end, in link lengths. Taste.
        following_share: share of the time limit that paths for a leader may be looked for. Taste.
        reshaping_share: share of the time limit that one change of shape may use. Taste.
        compared_seconds: CPU time of one that is only compared with what is at hand already [s]. Measured on bent
            starts: those that are found take 0.1 to 0.4 s; a share of the time limit let one in vain take 3 s.
        paths_reshaped_to: leaders' paths to which a change of shape is tried. Taste.
        least_links_reshaped: shapes of fewer links beyond the hole are not changed. Derived: a single link has no
            shape.
        straightening: distance that the tip may move when what the mapping of a curve bends inside the guide tube is
            straightened [m]. Taste.
        same_pose: bends that differ by less are the same [rad]. Taste; far above the rounding of chords, far below
            anything that shows.
        bends_moved_out: how far beyond the first place where joints may bend those bends are moved to that are too
            near to the hole, in link lengths. Taste.
        bends_moved_share: share of its limit that a joint takes over of such bends. Taste.
        separation: further keyframes where a change of shape ends. Derived: with two more of the same pose no span of
            the cubic spline, which four control points shape, mixes the change with a moving feed.
        drawn_back_shares: of the way that it takes to draw both ends back onto the axis, from which the arm is led
            straight to the goal's path, in the order in which they are tried. Taste.
        led_in_vain: leaders' paths to which leading the arm straight may fail before others wait until shapes have been
            changed. Measured in crowds of 50 polygons: ten paths in vain took 5 s, the change of shape 0.3 s.
        worth_shortening: times the duration of the straight line between its ends from which on a motion is
            optimised. Taste: a motion that follows its leader without drawing back is as long as its feed.
        long: times the duration of the straight line between its ends from which on a motion is put off. Taste.
        put_off: motions that are put off before the shortest of them is taken, and others that are tried where one
            grazes walls. Taste: looking for one costs as much as making its path.
        keyframes_a_link: of the optimisation, to a link length that a motion's feed carries the arm. Taste: at fewer,
            joints bend late behind the hole.
        most_keyframes: of the optimisation. Taste: its cost grows with them and with the cube of the links.
        optimising_share: share of the time limit that the optimisation of one motion may use. Taste: what is not
            finished then is certified all the same.
        time_samples: places of a path at which its speed is bounded. Derived: several to every span of the paths that
            occur.
        grazing: share of the wanted gap, or of what the ends have of it, below which a path waits for a few others.
            Taste.
        room_exponent: of paths that are compared, the one with a certain share of another's room may last that share
            to this power as long. Taste.
        least_room: share of the wanted gap that counts for paths with less. Taste.
        room_samples: places of a path at which its room is measured. Taste.
        finer_samples: samples to a keyframe of an optimised motion, beside which an even path is laid. Taste.
        tight_gap: room on either side of the arm, in link lengths, below which a place of the axis is tight: no joint
            can bend there as paths would have it. Taste.
        tight_spacing: places of the axis that are looked at, in link lengths. Taste.
        tight_places: of which paths are tried that stay straight up to their end. Taste.
        refusals_listed: of the reasons why motions were refused a diagnosis lists so many. Taste.
        leaders: of the search for paths that a leader may take.
        following: of paths for a leader and of the motions along them.
        curve: of the planner that changes shapes at a fixed feed.
    """

    planning_share: float = 0.9
    member_share: float = 0.02
    way_spacing: float = 0.5
    following_share: float = 0.4
    reshaping_share: float = 0.25
    compared_seconds: float = 0.8
    paths_reshaped_to: int = 3
    least_links_reshaped: int = 2
    straightening: float = 5e-4
    same_pose: float = 1e-7
    bends_moved_out: float = 0.25
    bends_moved_share: float = 0.5
    separation: int = 2
    drawn_back_shares: tuple[float, ...] = (0.0, 0.25, 0.5, 0.75, 1.0)
    led_in_vain: int = 2
    worth_shortening: float = 1.2
    long: float = 2.5
    put_off: int = 2
    keyframes_a_link: float = 2.0
    most_keyframes: int = 48
    optimising_share: float = 0.1
    time_samples: int = 1500
    grazing: float = 0.5
    room_exponent: float = 0.5
    least_room: float = 0.02
    room_samples: int = 200
    finer_samples: int = 4
    tight_gap: float = 0.05
    tight_spacing: float = 0.05
    tight_places: int = 3
    refusals_listed: int = 20
    leaders: LeaderPathSettings = field(default_factory=LeaderPathSettings)
    following: FollowingSettings = field(default_factory=FollowingSettings)
    curve: CurvePlannerSettings = field(default_factory=CurvePlannerSettings)


DEFAULT_FEED = FeedPlannerSettings()
"""What the planner takes when it is not given other settings."""
