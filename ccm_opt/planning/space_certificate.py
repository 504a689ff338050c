"""The certificate of a motion in space.

Over an interval the coordinates are linear in t from 0 to 1. With the axes of the joints in the middle,
ω_j = Σ_{i≤j} (Δa_i z_i + Δb_i y_i) is the rate of turning of link j there, in which turns and turns back cancel. Axes
turn with the links before them, so that ω_j changes at a rate of at most D_j = D_{j−1} + S_{j−1} √(Δa_j² + Δb_j²) +
|Δa_j Δb_j|, and |ω_j| is at most S_j = |ω_j(½)| + ½ D_j all the while. A joint k then has a second derivative of at
most c_k = Σ_{j<k} l (S_j² + D_j), and since its mean velocity is the chord from end to end, a velocity of at most
|chord_k| + ½ c_k.

A point that moves by at most v over an interval, and whose distance from the walls is d(0) and d(1) at its ends, has at
any time a distance of at least ½ (d(0) + d(1) − v). What is not proved so is halved in time, link by link and pair by
pair, so that few of them are looked at again.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import NativeCall
from ccm_opt.planning.settings import SpaceCertificateSettings
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_DEEPEST = 60
"""Halvings after which numbers have no middle any more."""


class IntervalProof:
    """Proves intervals of one arm's motions safe; not for use by two threads at once.

    Args:
        arm: the arm.
        tree: of the surfaces.
        gap: from every surface that has to be left beyond the arm's radius [m].
        pair_gap: between links beyond two radii [m].
        slack: share of a link's motion by which distances may be told too small, where that is enough for the proof.
    """

    def __init__(self, arm: Arm, tree: SurfaceTree, gap: float, pair_gap: float, slack: float) -> None:
        self._ends = np.empty((2, len(arm.coordinates)))
        self._call = NativeCall(
            "prove_interval",
            links=arm.links, fed=len(arm.base_axes), length=arm.link_length, mount=arm.mount_length,
            first_link=min(int(arm.mount_length / arm.link_length + 1e-9), arm.links),
            first_pair=arm.first_self_pair if arm.self_collision else arm.links,
            wall=arm.radius + gap, pair=2.0 * arm.radius + pair_gap, slack=slack,
            start=arm.base, base=arm.base_rotation, before=self._ends[0], after=self._ends[1],
            surfaces=None if tree.search is None else tree.search.for_c,
            # Where the interval before has ended, and what is known of there: nowhere at first.
            end=np.full(len(arm.coordinates), np.nan), told=np.zeros((2, 2, arm.links)),
        )  # fmt: skip

    def safe(self, before: FloatArray, after: FloatArray, depth: int) -> bool:
        """Whether the motion between two configurations, each of shape (c,), is proved to touch nothing.

        Args:
            before: at its beginning.
            after: at its end.
            depth: how often it may be halved.
        """
        self._ends[0] = before
        self._ends[1] = after
        self._call.fields.depth = min(max(depth, 0), _DEEPEST)
        self._call()
        return bool(self._call.fields.safe)


_FIRST_CAPACITY = 256


@dataclass(frozen=True, eq=False)
class NearestPairs:
    """The nearest pair of distant links in each of some poses.

    Attributes:
        first: link nearer to the base; −1 where none is in reach, shape (T,).
        second: the other, shape (T,).
        distance: of the axes; the reach where none is in reach, shape (T,) [m].
    """

    first: IntArray
    second: IntArray
    distance: FloatArray


@dataclass(frozen=True)
class LinkPairs:
    """Pairs of links that are near each other.

    Attributes:
        first: links nearer to the base, shape (k,).
        second: the others, shape (k,).
        first_at: nearest place on the first as a share of its length, shape (k,).
        second_at: likewise on the second, shape (k,).
        distance: of the axes, shape (k,) [m].
        normal: unit vectors from the second to the first, shape (k, 3).
    """

    first: IntArray
    second: IntArray
    first_at: FloatArray
    second_at: FloatArray
    distance: FloatArray
    normal: FloatArray


class LinkMotion:
    """Bounds on the motion of an arm's links over an interval, and the pairs of its links that are near.

    Args:
        arm: the arm.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        n = arm.links
        self._first_pair = arm.first_self_pair if arm.self_collision else n
        self._bow = np.zeros(n + 1)
        self._motion = NativeCall(
            "motion_bounds",
            links=n, length=arm.link_length, base=arm.base_rotation, speed=np.zeros(n), bow=self._bow,
        )  # fmt: skip
        self._pairs = NativeCall("near_links", links=n, first_pair=self._first_pair)
        self._make_room(_FIRST_CAPACITY)

    def bows(self, rotations: FloatArray, turns: FloatArray) -> FloatArray:
        """Bounds c on the second derivatives of the joints and the tip, shape (links + 1,) [m].

        Args:
            rotations: of the links in the middle of the interval, shape (links, 3, 3).
            turns: of the joints over the interval, shape (2 links,) [rad].
        """
        n = self._arm.links
        if rotations.shape != (n, 3, 3) or turns.shape != (2 * n,):
            raise ValueError(f"got shapes {rotations.shape} and {turns.shape} for {n} links")
        self._motion.set(rotations=rotations, turns=turns)
        self._motion()
        return self._bow.copy()

    def near_pairs(self, points: FloatArray, reach: float) -> LinkPairs:
        """Pairs of distant links whose axes are nearer than a reach [m] in a pose.

        Args:
            points: joints and tip, shape (links + 1, 3) [m].
            reach: distance of the axes from which on they are left out [m].
        """
        self._pairs.set(points=self._checked(points[None])[0], reach=reach)
        self._pairs()
        if self._pairs.fields.count > self._pairs.fields.capacity:
            self._make_room(2 * self._pairs.fields.count)
            self._pairs()
        k = self._pairs.fields.count
        first, second = self._numbers[:, :k].copy()
        first_at, second_at, distance = self._reals[:, :k].copy()
        return LinkPairs(first, second, first_at, second_at, distance, self._normals[:k].copy())

    def nearest_pairs(self, points: FloatArray, reach: float) -> NearestPairs:
        """The nearest pair of distant links in every pose, the first of equally near ones.

        Args:
            points: joints and tip, shape (T, links + 1, 3) [m].
            reach: distance of the axes from which on they are left out [m].
        """
        poses = len(self._checked(points))
        nearest = NearestPairs(
            np.full(poses, -1, dtype=np.int64), np.full(poses, -1, dtype=np.int64), np.full(poses, float(reach))
        )
        NativeCall(
            "nearest_links",
            links=self._arm.links, first_pair=self._first_pair, poses=poses, reach=reach, points=points,
            **vars(nearest),
        )()  # fmt: skip
        return nearest

    def _checked(self, points: FloatArray) -> FloatArray:
        if points.ndim != 3 or points.shape[1:] != (self._arm.links + 1, 3):
            raise ValueError(f"joints have the shape {points.shape[1:]}; expected ({self._arm.links + 1}, 3)")
        return points

    def _make_room(self, capacity: int) -> None:
        """Room for so many pairs."""
        self._numbers = np.zeros((2, capacity), dtype=np.int64)
        self._reals = np.zeros((3, capacity))
        self._normals = np.zeros((capacity, 3))
        first, second = self._numbers
        first_at, second_at, distance = self._reals
        self._pairs.set(
            capacity=capacity, first=first, second=second, first_at=first_at, second_at=second_at, distance=distance,
            normal=self._normals,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class SpaceCertificate:
    """Proves that a motion whose coordinates are linear between keyframes touches nothing.

    Attributes:
        arm: the arm.
        tree: of the surfaces.
        gap: from every wall that has to be left beyond the arm's radius [m].
        pair_gap: between links beyond two radii [m].
        settings: how often intervals are halved.
    """

    arm: Arm
    tree: SurfaceTree
    gap: float = 0.0
    pair_gap: float = 0.0
    settings: SpaceCertificateSettings = field(default_factory=SpaceCertificateSettings)

    @property
    def spare(self) -> float:
        """Gap beyond contact that is proved [m]."""
        return self.pair_gap

    @property
    def kept(self) -> float:
        """Distance from the axes of the links that surfaces are proved to keep [m]."""
        return self.arm.radius + self.gap

    @cached_property
    def motion(self) -> LinkMotion:
        """Bounds on the motion of the arm's links."""
        return LinkMotion(self.arm)

    @cached_property
    def _proof(self) -> IntervalProof:
        return IntervalProof(self.arm, self.tree, self.gap, self.pair_gap, self.settings.slack)

    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Whether the motion between two configurations, each of shape (c,), is proved to touch nothing."""
        return self._proof.safe(before, after, self.settings.depth if depth is None else depth)

    def failures(self, keyframes: FloatArray, depth: int | None = None) -> IntArray:
        """Intervals of a motion through keyframes, shape (K, c), that are not proved to be safe."""
        unsafe = [k for k in range(len(keyframes) - 1) if not self.safe(keyframes[k], keyframes[k + 1], depth)]
        return np.array(unsafe, dtype=np.intp)
