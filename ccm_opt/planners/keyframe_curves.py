"""The continuous curves behind the keyframes of a path that was planned on the links."""

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.nearest_curves import nearest_curves


def keyframe_curves(arm: Arm, keyframes: FloatArray) -> tuple[Configuration, ...]:
    """The curves whose mean headings on the links come nearest to those of the keyframes.

    Args:
        arm: the arm.
        keyframes: of all its coordinates, shape (K, c) [rad, m].
    """
    return nearest_curves(arm, arm.headings(keyframes[:, : arm.links]))
