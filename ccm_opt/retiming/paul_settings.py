"""The numbers of timing by Paul's transitions."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PaulSettings:
    """How legs and their transitions are found.

    Attributes:
        windows: largest half transition as a share of the shorter leg beside it, in the order in which they are worth a
            try. Derived: ½ is the greatest at which neighbours fit into their leg; each halves the miss of the corner.
        share: share of every limit that is used. Taste.
        least_samples: samples in half a transition, at least, so that the samples show what happens in it. Taste.
        rounds: most rounds of lengthening legs; what is left after them is met by stretching time. Taste.
        drive_rounds: most rounds of slowing down where a limit beyond those of the legs is passed, such as that on
            torques: legs by themselves in the first half, then all of them. Taste.
        longest: most samples of a motion; a motion that needs more time than that is given up. Taste.
        shortening: factors by which legs are shortened where the limits leave room. Taste.
        sweeps: sweeps with each factor. Taste.
        static_points: places along the polygon at which the joints must be able to hold the arm. Taste.
        no_leg: legs shorter than this in joint space are left out [rad, m]. Taste, above rounding.
    """

    windows: tuple[float, ...] = (0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625)
    share: float = 0.995
    least_samples: int = 2
    rounds: int = 60
    drive_rounds: int = 24
    longest: int = 1_000_000
    shortening: tuple[float, ...] = (0.8, 0.9, 0.95, 0.98, 0.99)
    sweeps: int = 12
    static_points: int = 400
    no_leg: float = 1e-9


DEFAULT_PAUL = PaulSettings()
"""What a timing takes that is given no other settings."""
