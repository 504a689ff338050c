"""Settings of the shortcuts that are taken before a long motion is optimised."""

from dataclasses import dataclass, field

from ccm_opt.motion.settings.connect_settings import ShortcutSettings


@dataclass(frozen=True)
class StraighteningSettings:
    """Numbers of cutting a found motion short.

    Attributes:
        many: motions that need no more intervals to be certified are optimised as they are. Taste.
        turn: most that a link turns between two keyframes of the result [rad]. Derived: that of a step.
        stream: tells its random numbers from those of others. Taste.
        shortcuts: that are tried. Measured: in fields of 300 and 1000 polygons these halve a motion in half a second,
            and four times as many take away as much again of what is left in twice the time.
    """

    many: int = 40
    turn: float = 0.15
    stream: int = 7
    shortcuts: ShortcutSettings = field(default_factory=lambda: ShortcutSettings(64, 32, 0.005))
