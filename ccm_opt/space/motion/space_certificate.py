"""What makes a motion in space safe: distances at both ends of an interval, and bounds on what moves in between.

A point that moves by at most v over an interval, and whose distance from the walls is d(0) and d(1) at its ends, has at
any time a distance of at least ½ (d(0) + d(1) − v). What is not proved so is halved in time, link by link and pair by
pair, so that few of them are looked at again.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.distances.segment_pairs import segment_distances
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.motion.chain import Chains
from ccm_opt.space.motion.interval_proof import IntervalProof, interval_proof
from ccm_opt.space.motion.settings.space_proof_settings import SpaceCertificateSettings
from ccm_opt.space.motion.space_link_motion import LinkMotion


class EdgeCondition(Protocol):
    """Something beside contact that a motion has to keep."""

    def holds_between(self, before: FloatArray, after: FloatArray) -> bool:
        """Whether it is kept on an edge that is linear between two configurations, each of shape (c,)."""
        ...


@dataclass(frozen=True, eq=False)
class _Pose:
    """A configuration with the places of its joints.

    Attributes:
        q: shape (c,) [rad, m].
        points: joints and tip, shape (links + 1, 3) [m].
        rotations: of the links, shape (links, 3, 3).
    """

    q: FloatArray
    points: FloatArray
    rotations: FloatArray


@dataclass(frozen=True, eq=False)
class _Interval:
    """A motion whose coordinates are linear, with what bounds it.

    Attributes:
        first: where it begins.
        middle: halfway.
        last: where it ends.
        chords: ways of joints and tip from end to end, shape (links + 1, 3) [m].
        bows: bounds on their second derivatives, shape (links + 1,) [m].
    """

    first: _Pose
    middle: _Pose
    last: _Pose
    chords: FloatArray
    bows: FloatArray

    @property
    def speeds(self) -> FloatArray:
        """How far joints and tip move at most, shape (links + 1,) [m]."""
        return np.asarray(np.linalg.norm(self.chords, axis=1) + 0.5 * self.bows)


@dataclass(frozen=True, eq=False)
class SpaceCertificate:
    """Proves that a motion whose coordinates are linear between keyframes touches nothing.

    Attributes:
        arm: the arm.
        tree: of the surfaces.
        gap: from every wall that has to be left beyond the arm's radius [m].
        pair_gap: between links beyond two radii [m].
        settings: how often intervals are halved.
        beside: what else every edge has to keep, at samples; None for nothing.
    """

    arm: SpaceArm
    tree: SurfaceTree
    gap: float = 0.0
    pair_gap: float = 0.0
    settings: SpaceCertificateSettings = field(default_factory=SpaceCertificateSettings)
    beside: EdgeCondition | None = None

    @cached_property
    def motion(self) -> LinkMotion:
        """Bounds on the motion of the arm's links."""
        return LinkMotion(self.arm)

    @cached_property
    def _compiled(self) -> IntervalProof | None:
        return interval_proof(self.arm, self.tree, self.gap, self.pair_gap, self.settings.slack)

    @cached_property
    def _chains(self) -> Chains:
        return Chains(self.arm)

    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Whether the motion between two configurations, each of shape (c,), is proved to touch nothing."""
        if self.beside is not None and not self.beside.holds_between(before, after):
            return False
        depth = self.settings.depth if depth is None else depth
        if self._compiled is not None:
            return self._compiled.safe(before, after, depth)
        whole = self._interval(self._pose(before), self._pose(after))
        pairs = self._near_pairs(whole)
        return self._walls_clear(whole, self._looked_at, depth) and self._pairs_clear(whole, *pairs, depth)

    def failures(self, keyframes: FloatArray, depth: int | None = None) -> IntArray:
        """Intervals of a motion through keyframes, shape (K, c), that are not proved to be safe."""
        unsafe = [k for k in range(len(keyframes) - 1) if not self.safe(keyframes[k], keyframes[k + 1], depth)]
        return np.array(unsafe, dtype=np.intp)

    def _pose(self, q: FloatArray) -> _Pose:
        return _Pose(q, *self._chains.places(q))

    def _interval(self, first: _Pose, last: _Pose) -> _Interval:
        middle = self._pose(0.5 * (first.q + last.q))
        turns = (last.q - first.q)[: 2 * self.arm.links]
        return _Interval(first, middle, last, last.points - first.points, self.motion.bows(middle.rotations, turns))

    # ------------------------------------------------------------ walls
    @cached_property
    def _looked_at(self) -> IntArray:
        """Links that walls may not touch: all that do not lie wholly in the mount."""
        first = int(self.arm.mount_length / self.arm.link_length + 1e-9)
        return np.arange(min(first, self.arm.links), self.arm.links)

    def _axes(self, points: FloatArray, links: IntArray) -> FloatArray:
        """Axes of some links beyond the mount, shape (k, 2, 3) [m]."""
        axes = np.stack((points[links], points[links + 1]), axis=1)
        share = self.arm.mount_length / self.arm.link_length - links
        inside = np.flatnonzero((share > 0.0) & (share < 1.0))
        for k in inside:
            axes[k, 0] += share[k] * (axes[k, 1] - axes[k, 0])
        return axes

    def _walls_clear(self, interval: _Interval, links: IntArray, depth: int) -> bool:
        """Whether some links keep off the walls."""
        speeds = interval.speeds
        most = np.maximum(speeds[links], speeds[links + 1])
        kept = self.arm.radius + self.gap
        # Distances count up to what would prove everything, and need not be known beyond.
        reach = kept + float(np.max(most, initial=0.0))
        start = self.tree.distances(self._axes(interval.first.points, links), reach)
        end = self.tree.distances(self._axes(interval.last.points, links), reach)
        if np.any(start < kept) or np.any(end < kept):
            return False
        left = links[start + end - most < 2.0 * kept]
        if len(left) == 0 or depth == 0:
            return len(left) == 0
        return all(self._walls_clear(half, left, depth - 1) for half in self._halves(interval))

    def _halves(self, interval: _Interval) -> Iterator[_Interval]:
        yield self._interval(interval.first, interval.middle)
        yield self._interval(interval.middle, interval.last)

    # ------------------------------------------------------------ the arm itself
    def _near_pairs(self, interval: _Interval) -> tuple[IntArray, IntArray]:
        """Pairs of links that may come too near in an interval."""
        arm = self.arm
        if not arm.self_collision:
            return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
        reach = 2.0 * arm.radius + self.pair_gap + 2.0 * float(np.max(interval.speeds))
        near = self.motion.near_pairs(interval.first.points, reach)
        return near.first, near.second

    def _pairs_clear(self, interval: _Interval, i: IntArray, j: IntArray, depth: int) -> bool:
        """Whether pairs (i, j) of links keep apart."""
        if len(i) == 0:
            return True
        kept = 2.0 * self.arm.radius + self.pair_gap
        start = _apart(interval.first.points, i, j)
        end = _apart(interval.last.points, i, j)
        if np.any(start < kept) or np.any(end < kept):
            return False
        # What both links have in common does not bring them nearer: chords and bows count by their differences.
        most = np.zeros(len(i))
        for at_i in (i, i + 1):
            for at_j in (j, j + 1):
                chord = np.linalg.norm(interval.chords[at_j] - interval.chords[at_i], axis=1)
                most = np.maximum(most, chord + 0.5 * (interval.bows[at_j] - interval.bows[at_i]))
        left = start + end - most < 2.0 * kept
        if not np.any(left) or depth == 0:
            return not np.any(left)
        return all(self._pairs_clear(half, i[left], j[left], depth - 1) for half in self._halves(interval))


def _apart(points: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """Distances of the axes of links i and j, shape (k,) [m]."""
    return segment_distances(points[i], points[i + 1], points[j], points[j + 1])[2]
