"""Numbers of the map of reach: the grid, and how poses are led from one cell to the next."""

from dataclasses import dataclass, field

from ccm_opt.motion.settings.motion_settings import MotionSettings


@dataclass(frozen=True)
class ReachSettings:
    """How it is found out where the tip can be.

    Attributes:
        step: width of a cell, as a share of the arm's length, where none is given. Taste.
        headings: headings that are tried in a cell, where no number is given. Taste.
        margin: room that poses keep while they are led on, in nominal links; four tenths of it a pose has to have.
            Taste: cells with less room to any pose of theirs count as not found.
        seen: room that is looked at, as a share of the arm's length; above it gaps are not told apart. Taste.
        settle_steps: most steps onto a place from the cell beside it, before it is asked whether they help. Measured:
            two of three that arrive take no more.
        settle_rounds: how often so many steps are taken. Taste.
        progress: share of the way left that a round may leave, or the place is given up. Taste.
        attempts: neighbours from which a heading is tried in a cell before it counts as not found. Measured: with two a
            map takes a third longer and has one heading in a hundred more.
        seeks: cells without a pose at most for which poses are sought anew, one after the other, when nothing more is
            reached from the cells beside. Taste: a quarter of a second each.
        seek_spacing: of these cells, in cells. Taste.
        motion: of the steps.
    """

    step: float = 1.0 / 16.0
    headings: int = 16
    margin: float = 0.024
    seen: float = 0.05
    settle_steps: int = 6
    settle_rounds: int = 4
    progress: float = 0.5
    attempts: int = 1
    seeks: int = 24
    seek_spacing: int = 3
    motion: MotionSettings = field(default_factory=MotionSettings)


REACH = ReachSettings()
"""Used where no other settings are given."""
