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
        shortcuts: that are tried. Measured: among 1000 polygons 64 rounds of 32 take a third off a motion in 0.17 s,
            these two fifths in 0.28 s, and twice as many rounds hardly more.
    """

    many: int = 40
    turn: float = 0.15
    stream: int = 7
    shortcuts: ShortcutSettings = field(default_factory=lambda: ShortcutSettings(128, 64, 0.005))
