"""Settings of the planner by the continuous curve."""

from dataclasses import dataclass, field

from ccm_opt.motion.motion_settings import MotionSettings


@dataclass(frozen=True)
class CurvePlannerSettings:
    """Numbers of the planner, from free space to the smooth path.

    Attributes:
        motion: of the search for a motion.
    """

    motion: MotionSettings = field(default_factory=MotionSettings)
