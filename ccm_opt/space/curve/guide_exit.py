"""How far joints may bend as a guide tube lets them go: not at all just beyond its end, and then more and more.

Every joint that comes out of the tube is straight as it passes the end, so a bend just beyond it has to be made, and
taken back, over a short way of the feed.
"""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.curve.nominal_links import NOMINAL_LINKS

STRAIGHT_BEFORE = 0.3
"""Nominal links beyond a guide tube on which joints are straight: the less, the more places to stop at."""
FREE_AFTER = 2.0
"""Nominal links beyond it from where on they bend as they like."""


def free_before(arm: SpaceArm) -> float:
    """Arc length beyond the end of the guide tube on which joints stay straight [m].

    Every joint that comes out stops there once, so that none begins to bend while the tube still holds it.
    """
    return STRAIGHT_BEFORE * arm.length / NOMINAL_LINKS


def free_shares_of_bends(arm: SpaceArm, places: FloatArray) -> FloatArray:
    """Share of its bend that a joint at a place takes, which grows smoothly beyond a guide tube, shape (joints,).

    Args:
        arm: with or without a guide tube.
        places: arc lengths of joints beyond the end of the tube, shape (joints,) [m].
    """
    if not arm.base_axes:
        return np.ones(len(places))
    straight = free_before(arm)
    x = np.clip((places - straight) / (FREE_AFTER * arm.length / NOMINAL_LINKS - straight), 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


def straight_at_exit(arm: SpaceArm, q: FloatArray) -> FloatArray:
    """A configuration without the bends of joints that stand where they stay straight just beyond a guide tube.

    A motion to such a bend would have to make it on the short way since the joint left the tube, and no smooth path
    does. The tip has to be put back to its place afterwards.

    Args:
        arm: with or without a guide tube.
        q: shape (c,) [rad, m].
    """
    if not arm.base_axes:
        return q
    places = arm.link_length * np.arange(arm.links) + float(np.sum(q[2 * arm.links :])) - arm.hole
    straight = q.copy()
    straight[: 2 * arm.links].reshape(-1, 2)[places <= free_before(arm)] = 0.0
    return straight
