"""The numbers of following a leader, in one place."""

from dataclasses import dataclass, field

from ccm_opt.motion.settings.search_settings import SmoothPathSettings


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
