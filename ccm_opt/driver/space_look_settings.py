"""How closely a motion in space is looked at where nothing is proved: for its room, and while it is simulated."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SpaceLookSettings:
    """How closely a motion in space is looked at after it was verified.

    Attributes:
        looks: samples at which the room is measured, at most. Taste: as many as a chart shows.
        first_looks: samples at which the simulated arm is looked at first, as far as a link; the others need only be
            looked at as far as the nearest surface of these. Taste: on the elbow with 9500 samples, as long as a
            hundredth of looking so far at all of them.
        least_reach: how far the others are looked at at least, in links. Taste.
        beyond_wanted: how far the room is looked at, in wanted gaps; a link at least. Taste: the chart's height.
    """

    looks: int = 400
    first_looks: int = 40
    least_reach: float = 1.0 / 16.0
    beyond_wanted: float = 1.5


DEFAULT_SPACE_LOOKS = SpaceLookSettings()
"""Used where no other settings are given."""
