"""Settings of timing: usable fractions of the limits, iterations, and densities of samples."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GridSettings:
    """Settings of the grid along a path at whose points the limits are imposed.

    Attributes:
        intervals: preferred number of grid intervals. Measured by ``tests/benchmarks/bench_retiming.py``: the motion
            takes 1.9 % longer in the median than with 800 intervals.
        intervals_a_span: least mean number of grid intervals between two knots of the path. Heuristic.
    """

    intervals: int = 200
    intervals_a_span: int = 2


@dataclass(frozen=True)
class ProfileSettings:
    """Settings of the search for the fastest speed profile along a path.

    Attributes:
        dense_share: fraction of every limit that may be used between grid points. Derived: between the fraction at grid
            points and 1, so that samples, which lie elsewhere, respect the limit, too.
        substeps: number of steps per grid interval at which limits are checked. Heuristic.
        negligible: factor of slowing down up to which another round is not worthwhile. Heuristic.
        newton_steps: maximum number of steps of Newton's method per controllable speed. Heuristic; a few usually
            suffice.
        directions: number of directions over half a turn in which the acceleration of a point is bounded. Derived: the
            polygon of twice as many sides exceeds the circle by 1 / cos(π / 32) − 1 = 0.5 %, which the unused fraction
            of the limits covers.
    """

    dense_share: float = 0.996
    substeps: int = 5
    negligible: float = 1.004
    newton_steps: int = 60
    directions: int = 16


@dataclass(frozen=True)
class SmoothingSettings:
    """Settings for smoothing the fastest motion so that its jerk is limited.

    Attributes:
        halvings: number of smoothing windows tried, each half as long as the previous one, beginning with half of the
            duration. Heuristic.
        neighbour_factors: further windows tried, as multiples of the best halved window. Derived: √½ and √2 lie
            halfway.
        evaluations: number of points, besides the corners of the speed profile, at which limits are evaluated to
            compare windows. Heuristic.
    """

    halvings: int = 10
    neighbour_factors: tuple[float, ...] = (0.5**0.5, 2.0**0.5)
    evaluations: int = 1000


@dataclass(frozen=True)
class SamplingSettings:
    """Settings of the sampling of a timed motion.

    Attributes:
        step: largest time between two samples [s]. Heuristic: 250 samples per second, a usual rate for robot drives.
        min_chord_deviation: deviation of chords between samples from the path that is always allowed [m]. Derived: half
            of the verifier's tolerance; the default is for an arm of one metre, callers set it for theirs.
        most_pieces: maximum number of pieces into which a step is divided so that chords stay near the path. Heuristic:
            bounds the number of samples.
        unseen_share: fraction of a joint's change of velocity that its sampled accelerations may leave unexplained;
            steps are halved until this holds. Derived: half of what the verifier allows.
    """

    step: float = 4e-3
    min_chord_deviation: float = 5e-7
    most_pieces: int = 32
    unseen_share: float = 0.025


@dataclass(frozen=True)
class TimingSettings:
    """Settings of timing a motion along a path.

    Attributes:
        grid: the grid along the path.
        profile: the search for the fastest speed profile.
        smoothing: the smoothing that limits jerk.
        sampling: the sampling of the motion.
    """

    grid: GridSettings = GridSettings()
    profile: ProfileSettings = ProfileSettings()
    smoothing: SmoothingSettings = SmoothingSettings()
    sampling: SamplingSettings = SamplingSettings()


DEFAULT_TIMING = TimingSettings()
"""Default settings of timing."""
