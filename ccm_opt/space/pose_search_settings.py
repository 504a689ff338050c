"""From how many beginnings the best pose at a goal in space is looked for, where no motion is asked for."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PoseSearchSettings:
    """Of the search for the best pose at a goal in space.

    Attributes:
        drawn: poses that are drawn, at most, each of which the goal-pose NLP improves. Taste: each takes a quarter
            of a second.
        draw_share: share of the time limit that drawing may take where a motion leads to a pose, too. Taste: ducts hold
            so little of all poses that drawing finds none in any time; 1.5 s by default, in which an open scene gives
            all that are wanted.
        motion_share: share of the time limit that the search for a motion may take, at whose end is one more beginning.
            Taste.
    """

    drawn: int = 6
    draw_share: float = 0.025
    motion_share: float = 0.4


DEFAULT_POSE_SEARCH = PoseSearchSettings()
"""Used where no other settings are given."""
