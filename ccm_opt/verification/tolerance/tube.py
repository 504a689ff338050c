"""The tube: everything that the arm may sweep while an error stays within some size, for pictures."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.solution import JointTrajectory
from ccm_opt.verification.link_motion import ChainMotion
from ccm_opt.verification.tolerance.chain_cases import chain_support
from ccm_opt.verification.tolerance.error_model import ErrorModel
from ccm_opt.verification.tolerance.moving_chain import MovingChain

_TUBE_DIRECTIONS = 24
"""Directions in which the places of every joint are bounded for the picture of the tube. Taste."""
_TUBE_POSES = 160
"""Poses of that picture. Taste."""
_THIN_SHARE = 1e-3
"""Radius that an arm of no width has in that picture, as a share of its length. Taste."""


@dataclass(frozen=True)
class Tube:
    """What the arm may sweep.

    Attributes:
        region: everything that it may sweep during the motion, its width included.
        planned: what it sweeps without errors.
    """

    region: shapely.Geometry
    planned: shapely.Geometry


def tube_of(
    arm: Arm,
    trajectory: JointTrajectory,
    model: ErrorModel,
    size: float,
) -> Tube:
    """The tube of a motion at poses spread over it, bounded in some directions by the support of its joints' places.

    Args:
        arm: the arm.
        trajectory: the plan.
        model: what may be wrong.
        size: of the error [unit].
    """
    motion = ChainMotion(arm, trajectory.time, trajectory.positions)
    chain = MovingChain.through_all(motion, model)
    chosen = np.unique(np.linspace(0, len(chain) - 1, min(_TUBE_POSES, len(chain))).astype(int))
    corners = np.stack([_corners(chain, chosen, k, size) for k in range(arm.links + 1)], axis=1)
    # A link lies in the hull of the places of its ends.
    pairs = np.concatenate((corners[:, :-1], corners[:, 1:]), axis=2).reshape(-1, 2 * corners.shape[2], 2)
    hulls = shapely.convex_hull(shapely.multipoints(pairs))
    axes = shapely.linestrings(chain.middles[chosen])
    # An arm without width is drawn as a thin line.
    radius = max(arm.radius, _THIN_SHARE * arm.length)
    return Tube(_grown(hulls, radius), _grown(axes, radius))


def _corners(chain: MovingChain, interval: IntArray, joint: int, size: float) -> FloatArray:
    """Corners of a polygon about the places of one joint at some poses, shape (m, directions, 2) [m]."""
    count = len(interval)
    columns = chain.forward(np.zeros(count, dtype=np.intp), np.full(count, joint))
    nowhere = np.zeros((count, 2, 2))
    cases = chain.cases(
        columns, interval, None, nowhere, np.zeros(count), interval, interval, with_link=False
    ).middles()
    angles = np.linspace(0.0, 2.0 * np.pi, _TUBE_DIRECTIONS, endpoint=False)
    directions = np.tile(angles, (count, 1))
    support = chain_support(
        cases.lengths[:, 0], cases.angles[:, 0], size * cases.turns, size * cases.stretches, directions
    )
    support = support + size * chain.model.moves_base
    # Neighbouring sides, at ν and ν + ω, meet at h n + (h' − h cos ω) / sin ω t, with t square to n.
    step = 2.0 * np.pi / _TUBE_DIRECTIONS
    along = (np.roll(support, -1, axis=1) - support * np.cos(step)) / np.sin(step)
    normal = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    square = np.stack((-np.sin(angles), np.cos(angles)), axis=1)
    return np.asarray(chain.arm.base + support[..., None] * normal + along[..., None] * square)


def _grown(shapes: Any, radius: float) -> shapely.Geometry:
    # Grown one by one: the union of thousands of lines that cross would be far dearer.
    union: shapely.Geometry = shapely.union_all(shapely.buffer(shapes, radius, quad_segs=8))
    return union
