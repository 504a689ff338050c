"""Numbers of writing output folders."""

from dataclasses import dataclass


@dataclass(frozen=True)
class WritingSettings:
    """How long to wait for others who write to the same place.

    Attributes:
        patience: how long one waits for them [s]. Taste: a folder takes milliseconds, on a slow disk a second or two.
        look: time between two looks whether they are done [s]. Taste.
    """

    patience: float = 60.0
    look: float = 0.005


WRITING = WritingSettings()
"""What every folder is written by."""
