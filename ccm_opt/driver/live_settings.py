"""How long people wait for a plan when they drag a goal or a wall."""

from dataclasses import dataclass, replace

from ccm_opt.driver.solve_settings import Settings


@dataclass(frozen=True)
class LiveSettings:
    """How long people wait for a plan when they drag a goal or a wall.

    Attributes:
        patience: CPU time for a plan after a change [s]. Taste: what a hand that drags bears.
        free_rounds: most steps of the optimisation before it is decided where the motion ends. Measured: with
            four and three, motions last as long as with the nine and five of ``solve`` to within 1 % after 25 drags,
            and take four fifths of the time (``bench_live``).
        end_rounds: most steps after that. Taste: the next change goes on from there.
    """

    patience: float = 0.6
    free_rounds: int = 4
    end_rounds: int = 3

    def hurried(self, settings: Settings) -> Settings:
        """The settings of all stages for plans that are soon followed by others."""
        motion = settings.curve.motion
        optimisation = replace(motion.optimisation, free_rounds=self.free_rounds, end_rounds=self.end_rounds)
        return replace(settings, curve=replace(settings.curve, motion=replace(motion, optimisation=optimisation)))


LIVE = LiveSettings()
"""Used where no other settings are given."""


@dataclass(frozen=True)
class LiveInSpaceSettings:
    """How long people wait for a plan when they drag a goal in space.

    Attributes:
        patience: CPU time for the search after a change [s]. Taste: three times what the elbow takes; timing and
            verification come on top.
    """

    patience: float = 1.0


LIVE_IN_SPACE = LiveInSpaceSettings()
"""Used where no other settings are given."""
