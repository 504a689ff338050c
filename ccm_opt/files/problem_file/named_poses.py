"""The named poses of a problem file, ``shape = "straight"`` and ``shape = "folded"``, as bends of the joints."""

import math
from collections.abc import Iterator

import numpy as np
import shapely

from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file.reading_settings import FOLD, FoldSettings
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm


def straight_bends(arm: Arm) -> FloatArray:
    """All links along the base heading, shape (links,) [rad]."""
    return np.zeros(arm.links)


def folded_bends(arm: Arm, settings: FoldSettings = FOLD) -> FloatArray:
    """The most compact serpentine: equal rows joined by half turns, alternately left and right.

    A half turn of m joints bends each by pi / m and sets the rows l cot(pi / 2m) apart. Of all (m, row length) whose
    bends stay within a share of the joint limit and whose distant links keep their gap, the one with the smallest
    diagonal of its bounding box is taken. The first row lies along the base heading, the first turn is to the left.

    Args:
        arm: the arm.
        settings: share of the joint limit, and gap.

    Returns:
        Joint bends, shape (links,) [rad].

    Raises:
        ProblemError: when no serpentine fits the joint limit and the radius.
    """
    gap = max(settings.gap_in_diameters * 2.0 * arm.radius, settings.least_gap_in_links * arm.link_length)
    candidates = sorted(_serpentines(arm, settings.limit_share), key=lambda bends: _diagonal(arm, bends))
    for bends in candidates:
        if self_distance(arm, bends) >= gap:
            return bends
    raise ProblemError(
        f"an arm of {arm.links} links with a joint limit of {math.degrees(arm.joint_limit):g} deg cannot be folded: "
        "half a turn needs more links; give the pose by joints_deg instead"
    )


def self_distance(arm: Arm, bends: FloatArray) -> float:
    """Least distance between the axes of links far enough apart along the arm [m]; infinite without such links."""
    points = arm.joint_positions(arm.headings(bends))
    axes = np.asarray(shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1)))
    first, second = arm.distant_pairs
    return float(shapely.distance(axes[first], axes[second]).min(initial=np.inf))


def _serpentines(arm: Arm, limit_share: float) -> Iterator[FloatArray]:
    """Serpentines by joints a turn and straight joints a row; at least one whole half turn."""
    sharpest = limit_share * arm.joint_limit
    fewest = max(2, math.ceil(min(math.pi / sharpest, arm.links)))
    # Rows of a thick arm lie two radii apart, which takes turns of about π r / l joints.
    for_thickness = math.ceil(math.pi * arm.radius / arm.link_length)
    most = min(fewest + 6 + for_thickness, arm.links - 1)
    for turn in range(fewest, most + 1):
        # The box is square for rows of about 0.8 √(turn · links); much longer ones have no smallest diagonal.
        rows = max(1, min(arm.links - turn, 2 * math.isqrt(turn * arm.links) + 2))
        for row in range(rows):
            yield _serpentine(arm.links, turn, row)


def _serpentine(links: int, turn: int, row: int) -> FloatArray:
    """Rows of ``row`` straight joints and half turns of ``turn`` joints, alternately left and right."""
    left = np.concatenate((np.zeros(row), np.full(turn, math.pi / turn)))
    period = np.concatenate((left, -left))
    bends = np.resize(period, links - 1)
    return np.concatenate(([0.0], bends))


def _diagonal(arm: Arm, bends: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(arm.joint_positions(arm.headings(bends)), axis=0)))
