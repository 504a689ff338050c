"""A smooth path of an optimised motion of a fed arm, its joints straight while the guide tube holds them.

The spline beside few keyframes bends a joint a little before it comes out of the tube. Drawn onto its legs instead it
would be certified, but all corners. So it is sampled finely, what is bent in the tube is moved on to the next joints,
and a spline is laid beside the samples: as smooth as the first, and straight where it must be.
"""

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.clamped_spline import DEGREE, clamped_spline
from ccm_opt.motion.limits.motion_certificate import IntervalCertificate
from ccm_opt.motion.settings.search_settings import SmoothPathSettings
from ccm_opt.motion.spline_path import certified_spline


def even_spline(
    arm: Arm,
    poses: FloatArray,
    travel: float,
    certificate: IntervalCertificate,
    finer: int,
    settings: SmoothPathSettings,
) -> BSpline | None:
    """The certified spline of poses near keyframes; None when there is none.

    Args:
        arm: with a feed axis.
        poses: keyframes, shape (K, c) [rad, link lengths].
        travel: how far beyond the hole a joint stays straight [m].
        certificate: of the path.
        finer: samples to a keyframe.
        settings: of the spline.
    """
    if len(poses) <= DEGREE:
        return None
    fine = clamped_spline(poses)(np.linspace(0.0, 1.0, finer * len(poses)))
    straightened = arm.poses(_straight_in_tube(arm, arm.configurations(fine), travel))
    straightened[0] = poses[0]
    straightened[-1] = poses[-1]
    return certified_spline(straightened, certificate, settings)


def _straight_in_tube(arm: Arm, q: FloatArray, travel: float) -> FloatArray:
    """Configurations, shape (K, c), with bends of joints that the tube holds there or beside moved on to the next."""
    feeds = arm.coordinates.advance(q)
    # A sample shapes the spline as far as the third beside it.
    around = np.pad(feeds, DEGREE, mode="edge")
    least = np.lib.stride_tricks.sliding_window_view(around, 2 * DEGREE + 1).min(axis=1)
    held = arm.held(least - travel)
    straight = q.copy()
    for joint in range(arm.links - 1):
        moved = np.where(held[:, joint], straight[:, joint], 0.0)
        straight[:, joint] -= moved
        straight[:, joint + 1] += moved
    straight[:, : arm.links][held] = 0.0
    return straight
