"""Named poses of the arm: straight and folded."""

import math
from collections.abc import Iterator

import numpy as np
import shapely

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.jointed.arm import Arm

LIMIT_SHARE = 0.95
"""Share of the joint limit that a folded arm uses, so that it can still move either way."""
GAP_SHARE = 1.1
"""The axes of a folded arm keep at least this many times two radii apart."""


def straight_bends(arm: Arm) -> FloatArray:
    """All links along the base heading, shape (links,) [rad]."""
    return np.zeros(arm.links)


def folded_bends(arm: Arm) -> FloatArray:
    """The most compact serpentine: equal rows joined by half turns, alternately left and right.

    A half turn of m joints bends each by pi / m and sets the rows l cot(pi / 2m) apart. Of all (m, row length) whose
    bends stay within ``LIMIT_SHARE`` of the joint limit and whose distant links keep ``GAP_SHARE`` times two radii
    (with zero radius a tenth of a link) apart, the one with the smallest bounding box diagonal is taken. The first row
    lies along the base heading, the first turn is to the left.

    Args:
        arm: the arm.

    Returns:
        Joint bends, shape (links,) [rad].

    Raises:
        ProblemError: when no serpentine fits the joint limit and the radius.
    """
    candidates = sorted(_serpentines(arm), key=lambda bends: _diagonal(arm, bends))
    for bends in candidates:
        if self_distance(arm, bends) >= max(GAP_SHARE * 2.0 * arm.radius, 0.1 * arm.link_length):
            return bends
    raise ProblemError(
        f"an arm of {arm.links} links with a joint limit of {math.degrees(arm.joint_limit):g} deg cannot be folded: "
        "half a turn needs more links; give the pose by joints_deg instead"
    )


def self_distance(arm: Arm, bends: FloatArray) -> float:
    """Least distance between the axes of links far enough apart along the arm [m]; infinite without such links."""
    points = arm.joint_positions(arm.headings(bends))
    axes = np.asarray(shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1)))
    first, second = np.triu_indices(arm.links, k=arm.first_self_pair)
    return float(shapely.distance(axes[first], axes[second]).min(initial=np.inf))


def _serpentines(arm: Arm) -> Iterator[FloatArray]:
    """Serpentines by joints a turn and straight joints a row; at least one whole half turn."""
    fewest = max(2, math.ceil(min(math.pi / (LIMIT_SHARE * arm.joint_limit), arm.links)))
    for turn in range(fewest, min(fewest + 6 + math.ceil(math.pi * arm.radius / arm.link_length), arm.links - 1) + 1):
        for row in range(max(1, min(arm.links - turn, 2 * math.isqrt(turn * arm.links) + 2))):
            yield _serpentine(arm.links, turn, row)


def _serpentine(links: int, turn: int, row: int) -> FloatArray:
    left = np.concatenate((np.zeros(row), np.full(turn, math.pi / turn)))
    period = np.concatenate((left, -left))
    bends = np.resize(period, links - 1)
    return np.concatenate(([0.0], bends))


def _diagonal(arm: Arm, bends: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(arm.joint_positions(arm.headings(bends)), axis=0)))
