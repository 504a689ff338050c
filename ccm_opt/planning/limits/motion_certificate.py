"""The certificate of a motion: the proofs of all limits about the intervals between keyframes, combined."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit import LimitOf
from ccm_opt.planning.pose import CurveUnknowns
from ccm_opt.robot.arm import Arm


class IntervalCertificate(Protocol):
    """Certifies every interval of piecewise-linear motions of an arm."""

    @property
    def arm(self) -> Arm:
        """The arm."""
        ...

    @property
    def spare(self) -> float:
        """Gap that is certified beyond contact [m]."""
        ...

    def failures(self, q: FloatArray, /, depth: int | None = None) -> IntArray:
        """Return the sorted uncertified intervals of a motion with configurations q, shape (K, c) [rad, m]."""
        ...


@dataclass(frozen=True, eq=False)
class MotionCertificate:
    """Certifies motions under several limits, in the plane and in space.

    Attributes:
        arm: the arm.
        spare: gap that is certified beyond contact [m].
        limits: all limits that have to hold between keyframes.
    """

    arm: Arm
    spare: float
    limits: tuple[LimitOf[Any], ...]

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the intervals that cannot be certified.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: number of bisections of an interval that are allowed; None for the certificate's setting.

        Returns:
            Sorted indices of intervals k (from keyframe k to k + 1); empty when the motion is certified.
        """
        return failed_intervals(self.limits, q, depth)

    def heading_failures(self, headings: FloatArray) -> IntArray:
        """Return the failed intervals of a motion given by its link headings, shape (K, links) [rad]."""
        return self.failures(self.arm.bends(headings))


def failed_intervals(limits: tuple[LimitOf[Any], ...], q: FloatArray, depth: int | None = None) -> IntArray:
    """Return the sorted intervals in which at least one limit cannot be certified.

    The arguments are those of ``MotionCertificate.failures``.
    """
    failing = np.zeros(0, dtype=np.intp)
    for limit in limits:
        failing = np.union1d(failing, limit.failures(q, depth))
    return failing


def failing_edges(
    limits: tuple[LimitOf[Any], ...], curve: CurveUnknowns, unknowns: FloatArray, depth: int | None = None
) -> IntArray:
    """Return the uncertified edges of a motion that is linear in the unknowns of a curve, sorted.

    Args:
        limits: limits that have to hold between keyframes.
        curve: map from the unknowns; cuts edges where their configurations would not be linear.
        unknowns: unknowns at the keyframes, shape (K + 1, p).
        depth: number of bisections of an interval that are allowed; None for the certificate's setting.
    """
    if curve.affine:
        return failed_intervals(limits, curve.configurations(unknowns), depth)
    edges = [curve.pieces(before, after)[:-1] for before, after in pairwise(unknowns)]
    owner = np.repeat(np.arange(len(edges)), [len(edge) for edge in edges])
    places = np.array([*(v for edge in edges for v in edge), unknowns[-1]])
    return np.unique(owner[failed_intervals(limits, curve.configurations(places), depth)])
