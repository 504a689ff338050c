"""Which of several plans for one problem is the best."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TriesSettings:
    """Which of several plans for one problem is the best.

    Attributes:
        room_share: share of the gap that the roomiest try keeps, as far as it is wanted, that a try must keep to be
            taken. Taste, like the share of the wanted gap below which a record calls a motion short of room.
    """

    room_share: float = 0.9


DEFAULT_TRIES = TriesSettings()
"""Used where no other settings are given."""
