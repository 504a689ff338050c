"""How closely the room that a motion keeps is looked at."""

from dataclasses import dataclass


@dataclass(frozen=True)
class RoomSettings:
    """Numbers of the record of a motion's room; no check depends on them.

    Attributes:
        samples: of the motion whose gaps are kept, at most, its ends and stops aside; the least gap does not depend on
            them. Taste: more than a chart shows.
        enough: share of the wanted gap below which a motion counts as having less than was wanted. Taste: planning
            keeps the wanted gap by soft rows, which give way a little.
        reach: gaps beyond this share of the arm's length are not told apart. Taste: several times
            the wanted gap that is usual.
        reach_wanted: the same in multiples of the wanted gap; the larger of the two reaches counts. Taste.
    """

    samples: int = 240
    enough: float = 0.9
    reach: float = 0.05
    reach_wanted: float = 4.0


DEFAULT_ROOM = RoomSettings()
"""Used where no other settings are given."""
