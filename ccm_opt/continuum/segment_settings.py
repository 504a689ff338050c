"""How densely curves are sampled where segments are classified, fitted and joined."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SegmentSettings:
    """Numbers of samples in the algebra of segments.

    Attributes:
        sign_samples: headings at which the signs of a segment's curvature are looked for, on each of its cubic pieces.
            Taste.
        fit_samples: headings that a least-squares fit of one segment looks at. Taste: thirteen for each value that it
            finds.
        mean_places: places of mean poses that are compared before the best is refined. Taste; they stand
            denser at the ends, near which the least of several minima lies.
    """

    sign_samples: int = 32
    fit_samples: int = 65
    mean_places: int = 41


DEFAULT_SEGMENTS = SegmentSettings()
"""The numbers that are used unless others are passed."""
