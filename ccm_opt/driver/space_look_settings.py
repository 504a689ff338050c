"""How closely a motion in space is looked at where nothing is proved: for its room, and while it is simulated."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SpaceLookSettings:
    """How closely a motion in space is looked at after it was verified.

    Attributes:
        looks: samples at which the room is measured, at most. Taste: as many as a chart shows.
        first_reach: how far is looked for surfaces near the simulated arm at first, in links; where nothing is so near,
            farther. Measured on the elbow with 2400 samples: 0.03 s against 0.4 s for a whole link at once.
        farther: by which factor it is looked farther then, up to a link. Taste.
        beyond_wanted: how far the room is looked at, in wanted gaps; a link at least. Taste: the chart's height.
    """

    looks: int = 400
    first_reach: float = 1.0 / 16.0
    farther: float = 4.0
    beyond_wanted: float = 1.5


DEFAULT_SPACE_LOOKS = SpaceLookSettings()
"""Used where no other settings are given."""
