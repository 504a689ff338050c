"""How far the points of an arm move while its joints turn evenly: bounds that a certificate can stand on.

Over an interval the coordinates are linear in t from 0 to 1. With the axes of the joints in the middle,
ω_j = Σ_{i≤j} (Δa_i z_i + Δb_i y_i) is the rate of turning of link j there, in which turns and turns back cancel. Axes
turn with the links before them, so that ω_j changes at a rate of at most D_j = D_{j−1} + S_{j−1} √(Δa_j² + Δb_j²) +
|Δa_j Δb_j|, and |ω_j| is at most S_j = |ω_j(½)| + ½ D_j all the while. A joint k then has a second derivative of at
most c_k = Σ_{j<k} l (S_j² + D_j), and since its mean velocity is the chord from end to end, a velocity of at most
|chord_k| + ½ c_k.
"""

import ctypes
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.compiled_source import pointer_to
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.distances.segment_pairs import segment_distances
from ccm_opt.space.motion.arm_library import arm_library

_FIRST_CAPACITY = 256


class _MotionStruct(ctypes.Structure):
    """``MotionQuery`` of arm_motion.c."""

    _fields_ = (
        ("links", ctypes.c_int64),
        ("length", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("rotations", "turns", "base", "speed", "bow")),
    )


class _PairStruct(ctypes.Structure):
    """``PairQuery`` of arm_motion.c."""

    _fields_ = (
        ("links", ctypes.c_int64),
        ("first_pair", ctypes.c_int64),
        ("reach", ctypes.c_double),
        ("points", ctypes.c_void_p),
        ("capacity", ctypes.c_int64),
        ("count", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("first", "second", "first_at", "second_at", "distance", "normal")),
    )


class _NearestPairStruct(ctypes.Structure):
    """``NearestPairQuery`` of arm_motion.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("links", "first_pair", "poses")),
        ("reach", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("points", "first", "second", "distance")),
    )


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

    def __init__(self, arm: SpaceArm) -> None:
        self._arm = arm
        self._library = arm_library()
        n = arm.links
        self._first_pair = arm.first_self_pair if arm.self_collision else n
        self._base = np.ascontiguousarray(arm.base_rotation, dtype=np.float64)
        self._speed = np.zeros(n)
        self._bow = np.zeros(n + 1)
        self._motion = _MotionStruct(links=n, length=arm.link_length, base=self._base.ctypes.data)
        self._motion.speed = self._speed.ctypes.data
        self._motion.bow = self._bow.ctypes.data
        self._pairs = _PairStruct(links=n, first_pair=self._first_pair)
        self._make_room(_FIRST_CAPACITY)
        self._motion_pointer = pointer_to(self._motion)
        self._pairs_pointer = pointer_to(self._pairs)

    def bows(self, rotations: FloatArray, turns: FloatArray) -> FloatArray:
        """Bounds c on the second derivatives of the joints and the tip, shape (links + 1,) [m].

        Args:
            rotations: of the links in the middle of the interval, shape (links, 3, 3).
            turns: of the joints over the interval, shape (2 links,) [rad].
        """
        if self._library is None:
            return self._interpreted_bows(rotations, turns)
        rotations = np.ascontiguousarray(rotations)
        turns = np.ascontiguousarray(turns)
        self._motion.rotations = rotations.ctypes.data
        self._motion.turns = turns.ctypes.data
        self._library.motion_bounds(self._motion_pointer)
        return self._bow.copy()

    def near_pairs(self, points: FloatArray, reach: float) -> LinkPairs:
        """Pairs of distant links whose axes are nearer than a reach [m] in a pose.

        Args:
            points: joints and tip, shape (links + 1, 3) [m].
            reach: distance of the axes from which on they are left out [m].
        """
        if self._library is None:
            return self._interpreted_pairs(points, reach)
        points = np.ascontiguousarray(points)
        self._pairs.points = points.ctypes.data
        self._pairs.reach = reach
        self._library.near_links(self._pairs_pointer)
        if self._pairs.count > self._pairs.capacity:
            self._make_room(2 * self._pairs.count)
            self._library.near_links(self._pairs_pointer)
        k = self._pairs.count
        first, second = self._numbers[:, :k].copy()
        first_at, second_at, distance = self._reals[:, :k].copy()
        return LinkPairs(first, second, first_at, second_at, distance, self._normals[:k].copy())

    def nearest_pairs(self, points: FloatArray, reach: float) -> NearestPairs:
        """The nearest pair of distant links in every pose, the first of equally near ones.

        Args:
            points: joints and tip, shape (T, links + 1, 3) [m].
            reach: distance of the axes from which on they are left out [m].
        """
        poses = len(points)
        nearest = NearestPairs(
            np.full(poses, -1, dtype=np.int64), np.full(poses, -1, dtype=np.int64), np.full(poses, float(reach))
        )
        if self._library is None:
            for pose, joints in enumerate(points):
                pairs = self._interpreted_pairs(joints, reach)
                if len(pairs.first):
                    k = int(np.argmin(pairs.distance))
                    nearest.first[pose] = pairs.first[k]
                    nearest.second[pose] = pairs.second[k]
                    nearest.distance[pose] = pairs.distance[k]
            return nearest
        points = np.ascontiguousarray(points)
        arrays = (points, nearest.first, nearest.second, nearest.distance)
        addresses = (array.ctypes.data for array in arrays)
        query = _NearestPairStruct(self._arm.links, self._first_pair, poses, reach, *addresses)
        self._library.nearest_links(pointer_to(query))
        return nearest

    def _make_room(self, capacity: int) -> None:
        """Room for so many pairs."""
        self._pairs.capacity = capacity
        self._numbers = np.zeros((2, capacity), dtype=np.int64)
        self._reals = np.zeros((3, capacity))
        self._normals = np.zeros((capacity, 3))
        self._pairs.first, self._pairs.second = (row.ctypes.data for row in self._numbers)
        self._pairs.first_at, self._pairs.second_at, self._pairs.distance = (row.ctypes.data for row in self._reals)
        self._pairs.normal = self._normals.ctypes.data

    # ------------------------------------------------------------ without a compiler
    def _interpreted_bows(self, rotations: FloatArray, turns: FloatArray) -> FloatArray:
        arm = self._arm
        about_z = turns[0::2]
        about_y = turns[1::2]
        before = np.concatenate((self._base[None], rotations[:-1]))
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
            bows[j + 1] = bows[j] + arm.link_length * (speed**2 + drift)
        return bows

    def _interpreted_pairs(self, points: FloatArray, reach: float) -> LinkPairs:
        first, second = np.triu_indices(self._arm.links, self._first_pair)
        first_at, second_at, distance, normal = segment_distances(
            points[first], points[first + 1], points[second], points[second + 1]
        )
        near = distance < reach
        return LinkPairs(first[near], second[near], first_at[near], second_at[near], distance[near], normal[near])
