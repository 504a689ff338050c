"""A pose of the arm and its derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.link_space import SEGMENTS, LinkSpace, fit_coordinates, mean_heading_matrix, turns_before_segments
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import CurvatureSegment


@dataclass(frozen=True)
class Pose:
    """Coordinates with everything derived from them that a step needs.

    Attributes:
        v: coordinates, shape (p,).
        headings: of the links [rad], and then what carries the base [link lengths], shape (links,) or (c,).
        points: joint and tip positions, shape (links + 1, 2) [m].
    """

    v: FloatArray
    headings: FloatArray
    points: FloatArray

    @property
    def tip_heading(self) -> float:
        """Heading of the last link [rad]."""
        return float(self.headings[len(self.points) - 2])


@dataclass(frozen=True)
class Term:
    """One least-squares term of the step: ``Σ weight (rows δ − target)²``.

    Attributes:
        rows: shape (k, p).
        target: shape (k,).
        weight: shape (k,) or scalar.
    """

    rows: FloatArray
    target: FloatArray
    weight: FloatArray | float


def normal_equations(terms: Sequence[Term], ridge: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Hessian and gradient of a sum of least-squares terms.

    Args:
        terms: at least one, each with rows of shape (k, p).
        ridge: added to the diagonal, so that the Hessian is definite where no term reaches, shape (p,) or scalar.
    """
    rows = np.vstack([t.rows for t in terms])
    target = np.concatenate([t.target for t in terms])
    weight = np.concatenate([np.broadcast_to(np.asarray(t.weight, dtype=np.float64), (len(t.target),)) for t in terms])

    # ½ Σ w |R δ − t|² has the Hessian Rᵀ W R and at δ = 0 the gradient −Rᵀ W t.
    weighted = rows * weight[:, None]
    return rows.T @ weighted + ridge * np.eye(rows.shape[1]), -weighted.T @ target


def pose_in(space: LinkSpace, v: FloatArray) -> Pose:
    """The pose at coordinates of a link space, shape (p,)."""
    headings = space.headings(v)
    return Pose(v, headings, space.arm.points(headings))


def nearest_curve(arm: Arm, headings: FloatArray) -> Configuration:
    """The continuous curve whose mean headings on the links come nearest to given ones, shape (links,) [rad]."""
    space, v = LinkSpace.through(arm, headings)
    return space.curve(v)


def nearest_curves(arm: Arm, headings: FloatArray) -> tuple[Configuration, ...]:
    """The same, but for rounding, for many poses at once, shape (k, links) [rad]; in a fortieth of the time."""
    coordinates = fit_coordinates(mean_heading_matrix(arm.links, arm.length), headings.T, arm.length).T
    length = arm.length / SEGMENTS
    begin = coordinates[:, :1] + arm.length * coordinates[:, 1:] @ turns_before_segments().T
    curvatures = [coordinates[:, 1 + 4 * k : 6 + 4 * k] for k in range(SEGMENTS)]
    return tuple(
        Configuration(
            arm.base, tuple(CurvatureSegment(length, float(begin[i, k]), curvatures[k][i]) for k in range(SEGMENTS))
        )
        for i in range(len(coordinates))
    )
