"""The bounds and proofs of motions in space, by numpy."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree


def bows(arm: Arm, rotations: FloatArray, turns: FloatArray, middle: FloatArray | None = None) -> FloatArray:
    """Bounds of the proof on the second derivatives of joints and tip, in C, shape (links + 1,) [m].

    Args:
        arm: the arm.
        rotations: of the links in the middle of the interval, shape (links, 3, 3).
        turns: of the joints over the interval, shape (2 links,) [rad].
        middle: bends in the middle of the interval, shape (2 links,) [rad]; they matter for joints of arcs only.
    """
    bow = np.zeros(arm.links + 1)
    NativeCall(
        "motion_bounds",
        links=arm.links, lengths=arm.lengths, carrier=arm.carrier_for_c, speed=np.zeros(arm.links), bow=bow,
        rotations=rotations, turns=np.append(turns, np.zeros(len(arm.base_axes))), arcs=arm.arcs,
        bends=np.append(np.zeros(2 * arm.links) if middle is None else middle, np.zeros(len(arm.base_axes))),
    )()  # fmt: skip
    return bow


def bows_by_numpy(arm: Arm, rotations: FloatArray, turns: FloatArray) -> FloatArray:
    """As ``bows``."""
    about_z = turns[0::2]
    about_y = turns[1::2]
    before = np.concatenate((arm.base_rotation[None], rotations[:-1]))
    rates = np.cumsum(about_z[:, None] * before[:, :, 2] + about_y[:, None] * rotations[:, :, 1], axis=0)
    norms = np.linalg.norm(rates, axis=1)
    together = np.hypot(about_z, about_y)
    both = np.abs(about_z * about_y)
    bows = np.zeros(arm.links + 1)
    drift = 0.0
    speed = 0.0
    for j in range(arm.links):
        drift += speed * together[j] + both[j]
        speed = norms[j] + 0.5 * drift
        bows[j + 1] = bows[j] + arm.lengths[j] * (speed**2 + drift)
    return bows


def near_pairs_by_numpy(arm: Arm, points: FloatArray, reach: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Links i < j whose axes are nearer than a reach [m], and their distances, each of shape (k,)."""
    first, second = arm.self_pairs
    _, _, distance, _ = segment_distances(points[first], points[first + 1], points[second], points[second + 1])
    near = distance < reach
    return first[near], second[near], distance[near]


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
class SpaceCertificateByNumpy:
    """As ``SpaceCertificate``.

    Attributes:
        arm: the arm.
        tree: of the surfaces.
        gap: from every wall that has to be left beyond the arm's radius [m].
        pair_gap: between links beyond two radii [m].
    """

    arm: Arm
    tree: SurfaceTree
    gap: float
    pair_gap: float

    def safe(self, before: FloatArray, after: FloatArray, depth: int) -> bool:
        """Whether the motion between two configurations, each of shape (c,), is proved to touch nothing."""
        whole = self._interval(self._pose(before), self._pose(after))
        pairs = self._near_pairs(whole)
        return self._walls_clear(whole, self._inspected_samples, depth) and self._pairs_clear(whole, *pairs, depth)

    def _pose(self, q: FloatArray) -> _Pose:
        return _Pose(q, self.arm.joint_positions_at(q), self.arm.link_rotations(q))

    def _interval(self, first: _Pose, last: _Pose) -> _Interval:
        middle = self._pose(0.5 * (first.q + last.q))
        turns = (last.q - first.q)[: 2 * self.arm.links]
        return _Interval(
            first, middle, last, last.points - first.points, bows_by_numpy(self.arm, middle.rotations, turns)
        )

    # ------------------------------------------------------------ walls
    @property
    def _inspected_samples(self) -> IntArray:
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
        first, second, _ = near_pairs_by_numpy(self.arm, interval.first.points, reach)
        return first, second

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
