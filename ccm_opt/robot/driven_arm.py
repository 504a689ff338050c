"""The arms that can be timed, driven and simulated: whatever has ball joints, masses and perhaps a feed axis."""

from typing import TypeAlias

from ccm_opt.robot.arm import Arm
from ccm_opt.robot.space_arm import SpaceArm

DrivenArm: TypeAlias = Arm | SpaceArm
"""An arm as its drives see it; what bends it and how is in its coordinates, where it begins in its base frame."""
