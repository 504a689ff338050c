"""Near pairs by compiled C, called from Python: pointers are set once, so that a call passes one address."""

import ctypes
from pathlib import Path

import numpy as np

from ccm_opt.collision.contacts import Contacts
from ccm_opt.collision.pair_search import PairQuestion
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.box_tree import BoxTree
from ccm_opt.ground.compiled_source import compiled_source, pointer_to
from ccm_opt.ground.tree_for_c import TreeForC, TreeStruct

SYMBOLS = ("near_pairs",)
_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64
_DOUBLE = ctypes.c_double
_RUN = 8
"""``RUN`` of near_pairs.c."""


class _QueryStruct(ctypes.Structure):
    """``Query`` of near_pairs.c."""

    _fields_ = (
        *((name, _LONG) for name in ("links", "mount_link", "first_self_pair")),
        *((name, _DOUBLE) for name in ("mount_at", "link_length", "radius", "reach", "margin")),
        *((name, _POINTER) for name in ("error_room", "pair_room", "pair_margin")),
        ("edge_tree", TreeStruct),
        ("vertex_tree", TreeStruct),
        *((name, _POINTER) for name in ("edges", "edge_wall", "vertices", "vertex_wall", "wall_gap")),
        ("walls", _LONG),
        ("largest_gap", _DOUBLE),
        *((name, _POINTER) for name in ("found", "runs", "points")),
        *((name, _LONG) for name in ("capacity", "count", "crosses")),
        *((name, _POINTER) for name in ("first", "second", "wall")),
        *((name, _POINTER) for name in ("first_at", "second_at", "normal", "gap", "pair_margins")),
    )


class CompiledPairs:
    """Satisfies the ``PairSearch`` protocol.

    Args:
        library: compiled from near_pairs.c.
        question: arm, walls, and which pairs are wanted.
    """

    def __init__(self, library: ctypes.PyDLL, question: PairQuestion) -> None:
        arm = question.arm
        walls = question.walls
        self._function = library.near_pairs
        self._query = query = _QueryStruct()
        self._kept: list[object] = []  # C has the addresses of these
        query.links = arm.links
        query.mount_link, query.mount_at = arm.mount_end
        query.first_self_pair = arm.first_self_pair if arm.self_collision else arm.links
        query.link_length = arm.link_length
        query.radius = arm.radius
        query.reach = question.reach
        query.margin = question.margin
        for name in ("error_room", "pair_room", "pair_margin", "wall_gap"):
            setattr(query, name, self._address(getattr(question, name), np.float64))

        query.edge_tree = self._tree(walls.edge_tree)
        query.vertex_tree = self._tree(walls.vertex_tree)
        query.edges = self._address(walls.edges, np.float64)
        query.vertices = self._address(walls.vertices, np.float64)
        query.edge_wall = self._address(walls.edge_wall, np.int64)
        query.vertex_wall = self._address(walls.vertex_wall, np.int64)
        query.walls = len(walls.names)
        query.largest_gap = float(question.wall_gap.max())
        query.found = self._address(np.zeros(max(len(walls.edges), len(walls.vertices))), np.int64)
        query.runs = self._address(np.zeros(4 * (arm.links // _RUN + 1)), np.float64)

        self._points = np.empty((arm.links + 1, 2))
        query.points = self._points.ctypes.data
        self._latest: FloatArray | None = None
        self._pointer = pointer_to(query)
        self._make_room(64)

    def contacts(self, points: FloatArray) -> Contacts:
        """All pairs of a pose with a gap below the reach; ``points`` has the shape (links + 1, 2) [m]."""
        self._ask(points)
        m = self._query.count
        whole = self._whole[:, :m].copy()
        real = self._real[:, :m].copy()
        normal = self._normal[:m].copy()
        return Contacts(whole[0], real[0], whole[1], real[1], normal, real[2], real[3], whole[2])

    def crosses(self, points: FloatArray) -> bool:
        """Whether any link of a pose cuts an edge of a wall or a distant link."""
        if self._latest is not points:
            self._ask(points)
        return bool(self._query.crosses)

    def _ask(self, points: FloatArray) -> None:
        self._points[:] = points
        self._function(self._pointer)
        if self._query.count > self._query.capacity:
            self._make_room(2 * self._query.count)
            self._function(self._pointer)
        # By identity: whether a pose crosses anything is asked right after its contacts.
        self._latest = points

    def _make_room(self, capacity: int) -> None:
        """Room for so many results."""
        query = self._query
        query.capacity = capacity
        self._whole = np.empty((3, capacity), dtype=np.int64)
        self._real = np.empty((4, capacity))
        self._normal = np.empty((capacity, 2))
        query.first, query.second, query.wall = (row.ctypes.data for row in self._whole)
        query.first_at, query.second_at, query.gap, query.pair_margins = (row.ctypes.data for row in self._real)
        query.normal = self._normal.ctypes.data

    def _tree(self, tree: BoxTree) -> TreeStruct:
        for_c = TreeForC.of(tree)
        self._kept.append(for_c)
        return for_c.struct

    def _address(self, array: FloatArray | IntArray, kind: type[np.float64 | np.int64]) -> int:
        for_c = np.ascontiguousarray(array, dtype=kind)
        self._kept.append(for_c)
        return for_c.ctypes.data


def compiled_pairs(question: PairQuestion) -> CompiledPairs | None:
    """A compiled search; None where there is no compiling."""
    source = Path(__file__).with_name("near_pairs.c")
    library = compiled_source(source, SYMBOLS)
    return None if library is None else CompiledPairs(library, question)
