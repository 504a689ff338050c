"""The numbers of timing: shares of the limits, rounds, densities of samples."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GridSettings:
    """Where along the path the limits are written down.

    Attributes:
        intervals: wanted number of grid intervals. Measured by ``tests/benchmarks/bench_retiming.py``: against 800 the
            motion takes 1.9 % longer in the median.
        most_intervals: most grid intervals, whatever the number of knots. Taste; it bounds the time.
        even_share: share of the intervals that is spread evenly over the spans, for those where the path turns rather
            than moves; the others go by length. Taste.
        end_halvings: extra points in the first interval and in the last, each half as far from the end of the path as
            the one before. Taste.
        stop_points: extra points on either side of a stop. Taste.
        stop_ratio: distance of each of them from the stop, as a share of that of the one before. Taste.
        stopped: share of the greatest ``|q'|`` of all knots below which the path stops at a knot. Taste, far above
            rounding and far below what a path that moves has.
    """

    intervals: int = 200
    most_intervals: int = 1500
    even_share: float = 0.3
    end_halvings: int = 8
    stop_points: int = 10
    stop_ratio: float = 0.7
    stopped: float = 1e-6


@dataclass(frozen=True)
class ProfileSettings:
    """How the fastest speed profile is found.

    Attributes:
        grid_share: share of every limit used at the grid points. Taste: it leaves room for what is passed between them.
        dense_share: share of every limit that may be used between them. Derived: between the grid's share and 1, so
            that samples, which fall elsewhere, keep the limit too.
        tightenings: rounds after which rows are tightened where a limit was passed between grid points; after later
            rounds speed is bounded there. Measured on the random paths of ``tests/test_retiming.py``: a few in a
            hundred need more.
        rounds: most runs of TOPP-RA. Measured on the same paths: with friction three or four are usual.
        negligible: stretch of time that is not worth another round. Taste.
        settled: relative change of the duration from round to round by which friction counts as known. Taste.
        jerk_share: share of the jerk limits that may go to the shape of the path, whose third derivative jumps at
            knots. Taste.
        tangent_share: share of the way to the speeds of the round before at which the tangent of friction is taken,
            once rows are no longer tightened. Measured: with 1 the rounds of 1 in 120 random paths with friction swing
            between 8.5 and 21.7 s; with 0.5 they come to 7.5 s, and no other path is timed slower by more than 0.02 %.
        least_tangent: share of the speed at which the tangent of friction was taken, below which it is not taken in the
            next round. Measured: without, the rounds of 1 in 240 random paths with friction end at 1.6 times the best
            duration, with it at most 1.002 times.
        friction_share: share of the room above the static part that half the friction may take in the rows. Derived:
            below 1, so that some room is left for moving; at terminal velocity half the friction takes 0.5.
        substeps: steps of the dense check inside one grid interval. Taste.
        speed_cap: bound on ṡ², in units in which a motion takes about 1 s, where nothing moves and so no limit bounds
            it. Taste.
        newton_steps: most steps of Newton's method for one controllable speed. Taste; a handful is usual.
        slowest: what stands for a squared speed of zero inside, as a share of the least that is not. Taste; slowing
            down mends the rows.
        directions: of the rows that stand for the bound on the acceleration of a point, over half a turn. Derived:
            the polygon of twice as many sides leaves the circle by 1 / cos(π / 32) − 1 = 0.5 %, which the grid's share
            covers.
    """

    grid_share: float = 0.99
    dense_share: float = 0.996
    tightenings: int = 3
    rounds: int = 10
    negligible: float = 1.004
    settled: float = 2e-3
    jerk_share: float = 0.7
    least_tangent: float = 0.5
    friction_share: float = 0.7
    tangent_share: float = 0.5
    substeps: int = 5
    speed_cap: float = 1e6
    newton_steps: int = 60
    slowest: float = 1e-6
    directions: int = 16


@dataclass(frozen=True)
class SmoothingSettings:
    """How a motion with limited jerk is found from the fastest one.

    Attributes:
        halvings: windows that are tried: so many, each half of the one before, from half the motion on. Taste.
        beside: windows that are tried beside the best of these, as shares of it. Derived: √½ and √2 lie halfway.
        looks: places, beside the corners of the profile, at which limits are looked at to compare windows. Taste.
        period: time between looks at the smoothed motion, which has no grid of its own [s]. Taste.
    """

    halvings: int = 10
    beside: tuple[float, ...] = (0.5**0.5, 2.0**0.5)
    looks: int = 1000
    period: float = 1e-3


@dataclass(frozen=True)
class SamplingSettings:
    """How a timed motion is sampled.

    Attributes:
        step: largest time between two samples [s]. Taste: 250 samples a second, as drives of robots take them.
        least_samples: steps of a short motion, whatever the time between them. Taste.
        most_numbers: steps times coordinates of the arm; a motion of more is not sampled. Taste: an array of them has a
            quarter of a gigabyte, and a fed arm of 24 links moves for 40 minutes.
        spare_share: share of the gap that a path is certified to spare that chords between samples may use. Derived:
            the other half is the verifier's, whose bounds are not sharp.
        hair: sag that is allowed anyhow [m]. Derived: half of what the verifier forgives, which the driver puts in its
            place for the arm and the problem; as it stands here, for an arm of a metre.
        most_pieces: pieces that a step may be cut into so that chords stay near the path. Taste; it bounds the samples.
        cuttings: most rounds of cutting steps, for chords and again for accelerations. Measured: the first leaves few
            steps too long for chords.
        jump: change of an acceleration or effort, as a share of its limit, at which a sample is put when it happens at
            once. A drive's reference that is interpolated between two samples beside a jump passes the accelerations
            before and after it by up to a third of the jump. Taste: what smaller ones add is within the share that
            plans leave.
        beside_jump: share of a step by which such a sample is at least away from its neighbours. Derived: nearer than
            this to a sample, a jump adds less than 4 %.
        unseen_share: share of the velocity that a joint gains and loses which its samples may leave unexplained; steps
            are halved until it is no more. Derived: half of what the verifier allows.
        unseen_floor: the same as a share of what the acceleration limit allows over the whole motion. Derived: so is
            this.
        small_stretch: stretch of time that keeps the samples where they are on the path; steps are shorter by as much
            before it. Taste.
        resamplings: most samplings, each of a motion slower than the last by at least a small stretch. Derived: they
            reach 1.8 times the duration.
        most_stretch: from which on a motion is not slowed down but given up: samples this far beyond a limit are those
            of a path that nothing can be driven along, as one with a corner is, and a motion as slow has millions of
            them. Taste.
    """

    step: float = 4e-3
    least_samples: int = 100
    most_numbers: int = 30_000_000
    spare_share: float = 0.5
    hair: float = 5e-7
    most_pieces: int = 32
    cuttings: int = 8
    jump: float = 0.1
    beside_jump: float = 0.02
    unseen_share: float = 0.025
    unseen_floor: float = 5e-4
    small_stretch: float = 1.01
    resamplings: int = 60
    most_stretch: float = 100.0


@dataclass(frozen=True)
class TimingSettings:
    """Numbers of timing along a path.

    Attributes:
        grid: where the limits are written down.
        profile: the fastest speed profile.
        smoothing: limited jerk.
        sampling: samples of the motion.
        standing: path length in joint space below which a path counts as standing still [rad]. Taste, above rounding.
    """

    grid: GridSettings = GridSettings()
    profile: ProfileSettings = ProfileSettings()
    smoothing: SmoothingSettings = SmoothingSettings()
    sampling: SamplingSettings = SamplingSettings()
    standing: float = 1e-9


DEFAULT_TIMING = TimingSettings()
"""What a timing takes that is given no other settings."""
