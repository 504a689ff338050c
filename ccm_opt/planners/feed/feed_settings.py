"""The numbers of the planner of a feed axis, in one place."""

from dataclasses import dataclass, field

from ccm_opt.planners.curve_settings import CurvePlannerSettings
from ccm_opt.planners.following.following_settings import FollowingSettings


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
