"""Certificate of a motion: proof that all limits hold in the intervals between keyframes."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit import LimitOf
from ccm_opt.planning.pose import CurveUnknowns
from ccm_opt.robot.arm import Arm


class IntervalCertificate(Protocol):
    """Interface of a certificate of contact for the intervals of piecewise-linear motions of an arm."""

    @property
    def arm(self) -> Arm:
        """Arm whose motions are certified."""
        ...

    @property
    def spare(self) -> float:
        """Certified gap beyond contact [m]."""
        ...

    def failures(self, q: FloatArray, /, depth: int | None = None) -> IntArray:
        """Return the sorted indices of the intervals of a motion that cannot be certified.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: allowed number of bisections of an interval; None for the certificate's setting.
        """
        ...


@dataclass(frozen=True, eq=False)
class MotionCertificate:
    """Certificate of piecewise-linear motions of an arm under several limits.

    Attributes:
        arm: the arm.
        spare: certified gap beyond contact [m].
        limits: all limits that have to hold between keyframes.
    """

    arm: Arm
    spare: float
    limits: tuple[LimitOf[Any], ...]

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the indices of the intervals of a motion in which at least one limit cannot be certified.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: allowed number of bisections of an interval; None for the certificate's setting.

        Returns:
            Sorted indices of intervals k (from keyframe k to k + 1); empty when the motion is certified.
        """
        return failed_intervals(self.limits, q, depth)

    def heading_failures(self, headings: FloatArray) -> IntArray:
        """Return the indices of uncertified intervals of a planar motion, given by link headings (K, links) [rad]."""
        return self.failures(self.arm.bends(headings))


def failed_intervals(limits: tuple[LimitOf[Any], ...], q: FloatArray, depth: int | None = None) -> IntArray:
    """Return the sorted indices of the intervals of a motion in which at least one limit cannot be certified.

    Args:
        limits: the limits.
        q: configurations at the keyframes, shape (K, c) [rad, m].
        depth: allowed number of bisections of an interval; None for the certificate's setting.
    """
    failing = [each for limit in limits if len(each := limit.failures(q, depth))]
    return np.unique(np.concatenate(failing)) if failing else np.zeros(0, dtype=np.intp)


def failing_edges(
    limits: tuple[LimitOf[Any], ...], curve: CurveUnknowns, unknowns: FloatArray, depth: int | None = None
) -> IntArray:
    """Return the sorted indices of the uncertified intervals of a motion that is linear in the unknowns of a curve.

    Args:
        limits: limits that have to hold between keyframes.
        curve: map from the unknowns to configurations, which divides intervals in which configurations are not linear.
        unknowns: unknowns at the keyframes, shape (K + 1, p).
        depth: allowed number of bisections of an interval; None for the certificate's setting.
    """
    if curve.affine:
        return failed_intervals(limits, curve.configurations(unknowns), depth)
    edges = [curve.pieces(before, after)[:-1] for before, after in pairwise(unknowns)]
    owner = np.repeat(np.arange(len(edges)), [len(edge) for edge in edges])
    places = np.array([*(v for edge in edges for v in edge), unknowns[-1]])
    return np.unique(owner[failed_intervals(limits, curve.configurations(places), depth)])
