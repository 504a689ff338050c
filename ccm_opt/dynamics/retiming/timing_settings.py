"""The numbers of timing: shares of the limits, rounds, densities of samples."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GridSettings:
    """Where along the path the limits are written down.

    Attributes:
        intervals: wanted number of grid intervals. Measured by ``tests/benchmarks/bench_retiming.py``: against 800 the
            motion takes 1.9 % longer in the median.
    """

    intervals: int = 200


@dataclass(frozen=True)
class ProfileSettings:
    """How the fastest speed profile is found.

    Attributes:
        dense_share: share of every limit that may be used between them. Derived: between the grid's share and 1, so
            that samples, which fall elsewhere, keep the limit too.
        substeps: steps of the dense check inside one grid interval. Taste.
        newton_steps: most steps of Newton's method for one controllable speed. Taste; a handful is usual.
        directions: of the rows that stand for the bound on the acceleration of a point, over half a turn. Derived:
            the polygon of twice as many sides leaves the circle by 1 / cos(π / 32) − 1 = 0.5 %, which the grid's share
            covers.
    """

    dense_share: float = 0.996
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
        hair: sag that is allowed anyhow [m]. Derived: half of what the verifier forgives, which the driver puts in its
            place for the arm and the problem; as it stands here, for an arm of a metre.
        most_pieces: pieces that a step may be cut into so that chords stay near the path. Taste; it bounds the samples.
        unseen_share: share of the velocity that a joint gains and loses which its samples may leave unexplained; steps
            are halved until it is no more. Derived: half of what the verifier allows.
    """

    step: float = 4e-3
    hair: float = 5e-7
    most_pieces: int = 32
    unseen_share: float = 0.025


@dataclass(frozen=True)
class TimingSettings:
    """Numbers of timing along a path.

    Attributes:
        grid: where the limits are written down.
        profile: the fastest speed profile.
        smoothing: limited jerk.
        sampling: samples of the motion.
    """

    grid: GridSettings = GridSettings()
    profile: ProfileSettings = ProfileSettings()
    smoothing: SmoothingSettings = SmoothingSettings()
    sampling: SamplingSettings = SamplingSettings()


DEFAULT_TIMING = TimingSettings()
"""What a timing takes that is given no other settings."""
