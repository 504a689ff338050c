"""The numbers of timing: shares of the limits, rounds, densities of samples."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GridSettings:
    """Where along the path the limits are written down.

    Attributes:
        intervals: wanted number of grid intervals. Measured by ``tests/benchmarks/bench_retiming.py``: against 800 the
            motion takes 1.9 % longer in the median.
        most_intervals: most grid intervals, whatever the number of knots. Taste; it bounds the time.
    """

    intervals: int = 200
    most_intervals: int = 1500


@dataclass(frozen=True)
class ProfileSettings:
    """How the fastest speed profile is found.

    Attributes:
        dense_share: share of every limit that may be used between them. Derived: between the grid's share and 1, so
            that samples, which fall elsewhere, keep the limit too.
        tightenings: rounds after which rows are tightened where a limit was passed between grid points; after later
            rounds speed is bounded there. Measured on the random paths of ``tests/test_retiming.py``: a few in a
            hundred need more.
        rounds: most runs of TOPP-RA. Measured on the same paths: with friction three or four are usual.
        settled: relative change of the duration from round to round by which friction counts as known. Taste.
        substeps: steps of the dense check inside one grid interval. Taste.
        newton_steps: most steps of Newton's method for one controllable speed. Taste; a handful is usual.
        directions: of the rows that stand for the bound on the acceleration of a point, over half a turn. Derived:
            the polygon of twice as many sides leaves the circle by 1 / cos(π / 32) − 1 = 0.5 %, which the grid's share
            covers.
    """

    dense_share: float = 0.996
    tightenings: int = 3
    rounds: int = 10
    settled: float = 2e-3
    substeps: int = 5
    newton_steps: int = 60
    directions: int = 16


@dataclass(frozen=True)
class SmoothingSettings:
    """How a motion with limited jerk is found from the fastest one.

    Attributes:
        halvings: windows that are tried: so many, each half of the one before, from half the motion on. Taste.
        beside: windows that are tried beside the best of these, as shares of it. Derived: √½ and √2 lie halfway.
        looks: places, beside the corners of the profile, at which limits are looked at to compare windows. Taste.
    """

    halvings: int = 10
    beside: tuple[float, ...] = (0.5**0.5, 2.0**0.5)
    looks: int = 1000


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
        unseen_share: share of the velocity that a joint gains and loses which its samples may leave unexplained; steps
            are halved until it is no more. Derived: half of what the verifier allows.
        unseen_floor: the same as a share of what the acceleration limit allows over the whole motion. Derived: so is
            this.
    """

    step: float = 4e-3
    least_samples: int = 100
    most_numbers: int = 30_000_000
    spare_share: float = 0.5
    hair: float = 5e-7
    most_pieces: int = 32
    cuttings: int = 8
    unseen_share: float = 0.025
    unseen_floor: float = 5e-4


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
