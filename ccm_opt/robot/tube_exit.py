"""Limits on bends just beyond the end of the guide tube.

Every joint is straight as it leaves the guide tube, so a bend just beyond the tube has to be made, or undone, within a
short length of feed.
"""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

STRAIGHT_BEFORE = 0.3
"""Length beyond the end of the guide tube on which joints stay straight, in nominal links (1/24 of the arm). A shorter
one needs more stops of the feed."""
FREE_AFTER = 2.0
"""Distance beyond the end of the guide tube at which joints may bend up to their limits, in nominal links (1/24 of the
arm)."""
_FEW_LINKS = 36
"""Number of links above which joints need only a part of the distance from ``STRAIGHT_BEFORE`` to ``FREE_AFTER``, as
they bend less. Measured: arms of 60 links need it in helical pipes; arms of 36 links lose clearance among baffles."""


def free_before(arm: Arm) -> float:
    """Return the arc length beyond the end of the guide tube on which joints stay straight [m].

    The feed stops once for every emerging joint within this length, so that no joint begins to bend while the tube
    still holds it.
    """
    return STRAIGHT_BEFORE * arm.length / NOMINAL_LINKS


def bend_shares(arm: Arm, places: FloatArray) -> FloatArray:
    """Return the fraction of its bend limit that each joint may use, given its distance from the guide tube.

    The fraction grows smoothly from 0 near the end of the tube to 1 farther out; without a tube all fractions are 1.

    Args:
        arm: the arm, with or without a guide tube.
        places: arc lengths from the end of the tube to the joints, shape (joints,) [m].

    Returns:
        Fractions from 0 to 1, shape (joints,).
    """
    if not arm.base_axes:
        return np.ones(len(places))
    free_after = STRAIGHT_BEFORE + (FREE_AFTER - STRAIGHT_BEFORE) * (
        1.0 if arm.links <= _FEW_LINKS else NOMINAL_LINKS / arm.links
    )
    return smooth_step(places, free_before(arm), free_after * arm.length / NOMINAL_LINKS)


def smooth_step(places: FloatArray, first: float, last: float) -> FloatArray:
    """Return 3 x² − 2 x³ with x growing from 0 at ``first`` to 1 at ``last`` and clipped to [0, 1].

    The result has the shape of ``places`` and zero slope at both ends.
    """
    x = np.clip((places - first) / (last - first), 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


def straight_at_exit(arm: Arm, q: FloatArray) -> FloatArray:
    """Return a configuration in space with the bends of all joints inside or just outside the guide tube set to zero.

    Such a joint would have to bend within the short feed since it left the tube, which no smooth joint path can do.
    The caller has to restore the tip position afterwards. Without a tube the configuration is returned unchanged.

    Args:
        arm: the arm, with or without a guide tube.
        q: configuration, shape (c,) [rad, m].
    """
    if not arm.base_axes:
        return q
    places = arm.joint_places[:-1] + float(np.sum(q[2 * arm.links :])) - arm.hole
    straight = q.copy()
    straight[: 2 * arm.links].reshape(-1, 2)[places <= free_before(arm)] = 0.0
    return straight
