"""Shells of a triangle mesh: connected pieces of its surface, their orientation, and whether they are closed.

The triangles of a shell join over edges, which are matched by their vertices. If any edges remain without a partner,
vertices that coincide up to rounding are merged, and edges that lie on each other are split at each other's vertices
(T-junctions). Neither moves the surface.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray

ROUNDING_SHARE = 1e-6
"""Distance below which two vertices of a mesh count as one, as a fraction of the mesh's extent.

Derived: eight roundings of a coordinate in single precision, far below any gap that an arm could pass.
"""
_MOST_OPEN = 200_000
"""Number of edges without a partner above which a mesh counts as a set of loose triangles and is not repaired."""
_WHOLE_NUMBERS = 2**64
"""Number of integers that fit into 64 bits."""
_MOST_AT_VERTEX = 64
"""Largest number of edges without a partner at one vertex that are compared with each other."""


@dataclass(frozen=True, eq=False)
class Shells:
    """The s connected shells of a mesh with m triangles.

    Attributes:
        number: index of the shell of each triangle, shape (m,).
        turned: whether a triangle is oriented against the majority of its shell, shape (m,).
        closed: whether every edge of a shell joins two of its triangles, shape (s,).
        orientable: whether the triangles of a shell can be oriented consistently, shape (s,).
        open_edges: end points of the k edges without a partner, shape (k, 2, 3), in the unit of the vertices.
        copies: whether a triangle duplicates an earlier one and no shell needs it, shape (m,).
    """

    number: IntArray
    turned: BoolArray
    closed: BoolArray
    orientable: BoolArray
    open_edges: FloatArray
    copies: BoolArray


@dataclass(frozen=True, eq=False)
class _HalfEdges:
    """Directed edges of triangles, as start vertex, end vertex and triangle of each, all of shape (e,)."""

    start: IntArray
    end: IntArray
    face: IntArray

    def where(self, chosen: BoolArray | IntArray) -> "_HalfEdges":
        return _HalfEdges(self.start[chosen], self.end[chosen], self.face[chosen])

    def joined(self, other: "_HalfEdges") -> "_HalfEdges":
        return _HalfEdges(
            np.concatenate((self.start, other.start)),
            np.concatenate((self.end, other.end)),
            np.concatenate((self.face, other.face)),
        )

    def keys(self, count: int) -> IntArray:
        """Return a number per half-edge that identifies its undirected edge, (e,); ``count`` is that of vertices."""
        # The product fits into 64 bits: a mesh has far fewer than 2^31 vertices.
        return np.asarray(np.minimum(self.start, self.end) * count + np.maximum(self.start, self.end))

    def grouped(self) -> tuple[IntArray, IntArray]:
        """Return all half-edges, as indices sorted by undirected edge, then file order, and where each edge begins."""
        keys = self.keys(max(self.start.max(initial=0), self.end.max(initial=0)) + 1)
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        return order, np.flatnonzero(np.append(True, keys[1:] != keys[:-1])[: len(keys)])

    def unpaired(self) -> IntArray:
        """Return the index of the last half-edge of every edge with an odd number of triangles."""
        order, begins = self.grouped()
        ends = np.append(begins[1:], len(order))
        return np.asarray(order[ends[(ends - begins) % 2 == 1] - 1])


def find_shells(vertices: FloatArray, faces: IntArray) -> Shells:
    """Return the connected shells of a triangle mesh, after matching coincident edges.

    Touching bodies stay separate shells: where more than two triangles meet in an edge, those that run in opposite
    directions are paired in file order. Whatever the pairs, a point that an odd number of crossings separates from the
    outside is inside some shell.

    Args:
        vertices: positions of the vertices, shape (v, 3).
        faces: vertex indices of each triangle, shape (m, 3).
    """
    before = repeated(faces)
    copies = before > 0
    edges = _half_edges(faces, before == 0)
    odd = edges.unpaired()
    if 0 < len(odd) <= _MOST_OPEN:
        reach = ROUNDING_SHARE * float(np.ptp(vertices[np.unique(faces)], axis=0).max())
        welded = _welded(vertices, edges.where(odd), reach)[faces]
        edges = _cut(vertices, _half_edges(welded, before == 0), reach)
        again = _half_edges(welded, before == 1)
        if len(again.face):
            needed = _needed(vertices, edges, again, reach)
            copies[needed] = False
            edges = _cut(vertices, edges.joined(again.where(np.isin(again.face, needed))), reach)
    first, second, odd = _pairs(edges)
    alike = edges.start[first] == edges.start[second]
    number, turned, orientable = _turned_alike(len(faces), edges.face[first], edges.face[second], alike)
    closed = np.ones(len(orientable), dtype=np.bool_)
    closed[number[edges.face[odd]]] = False
    open_edges = vertices[np.column_stack((edges.start[odd], edges.end[odd]))]
    return Shells(number, turned, closed, orientable, open_edges, copies)


def repeated(faces: IntArray) -> IntArray:
    """Return for each triangle the number of earlier triangles with the same vertices, shape (m,)."""
    low, middle, high = np.sort(faces, axis=1).T.astype(np.uint64)
    count = int(faces.max(initial=0)) + 1
    if count**3 < _WHOLE_NUMBERS:
        # Three small numbers are packed into one, which sorts far faster.
        step = np.uint64(count)
        order = np.argsort((low * step + middle) * step + high, kind="stable")
    else:
        order = np.lexsort((high, middle, low))
    changes = np.zeros(len(faces), dtype=np.bool_)
    for column in (low, middle, high):
        changes[1:] |= np.diff(column[order]) != 0
    place = np.arange(len(faces))
    before = np.empty(len(faces), dtype=np.intp)
    before[order] = place - np.maximum.accumulate(np.where(changes, place, 0))
    return before


def _half_edges(faces: IntArray, chosen: BoolArray) -> _HalfEdges:
    """Return the half-edges of triangles selected by a mask; degenerate triangles have none."""
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    numbers = np.flatnonzero(chosen & proper)
    corners = faces[numbers].astype(np.int64)
    return _HalfEdges(corners.ravel(), np.roll(corners, -1, axis=1).ravel(), np.repeat(numbers, 3))


def _needed(vertices: FloatArray, edges: _HalfEdges, again: _HalfEdges, reach: float) -> IntArray:
    """Return the indices of duplicate triangles that are needed because each of two touching bodies has its own.

    Every piece of an edge must have an even number of triangles. So a duplicate that is the only undecided one at a
    piece is needed if the piece has an odd number of triangles without this duplicate, and otherwise not; decisions
    spread inwards from there. Duplicates that remain undecided, such as those of whole bodies given twice, are not
    needed.
    """
    lone = edges.where(edges.unpaired())
    both = _HalfEdges(lone.start, lone.end, np.full_like(lone.face, -1)).joined(again)
    pieces = _split(vertices, both, reach)
    _, piece = np.unique(pieces.keys(len(vertices)), return_inverse=True)
    known = pieces.face < 0
    odd = np.bincount(piece[known], minlength=piece.max(initial=-1) + 1) % 2
    face, piece = pieces.face[~known], piece[~known]
    decided = []
    while len(face):
        single = np.bincount(piece, minlength=len(odd))[piece] == 1
        if not single.any():
            break
        numbers, vote = np.unique(face[single], return_inverse=True)
        needed = numbers[np.bincount(vote, np.where(odd[piece[single]] == 1, 1, -1)) > 0]
        decided.append(needed)
        odd = (odd + np.bincount(piece[np.isin(face, needed)], minlength=len(odd))) % 2
        open_ones = ~np.isin(face, numbers)
        face, piece = face[open_ones], piece[open_ones]
    return np.concatenate((np.zeros(0, dtype=np.intp), *decided))


def _welded(vertices: FloatArray, odd: _HalfEdges, reach: float) -> IntArray:
    """Return the index of each vertex after merging vertices of unpaired edges within ``reach`` of each other, (v,)."""
    known = np.arange(len(vertices), dtype=np.intp)
    border = np.unique((odd.start, odd.end))
    near = cKDTree(vertices[border]).query_pairs(reach, output_type="ndarray")
    names = _components(near[:, 0], near[:, 1], len(border))
    # A long chain of vertices, each close to the next, is not one vertex.
    order = np.argsort(names, kind="stable")
    begins = np.flatnonzero(np.diff(names[order], prepend=-1))
    places = vertices[border[order]]
    spread = np.maximum.reduceat(places, begins) - np.minimum.reduceat(places, begins)
    single = (spread.max(axis=1) <= 2.0 * reach)[names]
    known[border[single]] = border[order[begins]][names[single]]
    return known


def _cut(vertices: FloatArray, edges: _HalfEdges, reach: float) -> _HalfEdges:
    """Return half-edges, the unpaired ones split at the vertices of adjacent edges on the same line."""
    odd = edges.unpaired()
    if not 0 < len(odd) <= _MOST_OPEN:
        return edges
    kept = np.ones(len(edges.start), dtype=np.bool_)
    kept[odd] = False
    return edges.where(kept).joined(_split(vertices, edges.where(odd), reach))


def _split(vertices: FloatArray, edges: _HalfEdges, reach: float) -> _HalfEdges:
    """Return half-edges split at the vertices of adjacent half-edges on the same line."""
    start, end = edges.start, edges.end
    line = _lines(vertices, edges, reach)
    # The vertices on each line, in order along it.
    way = vertices[end] - vertices[start]
    length = np.linalg.norm(way, axis=1)
    longest = np.lexsort((-length, line))
    longest = longest[np.flatnonzero(np.diff(line[longest], prepend=-1))]
    origin, along = vertices[start[longest]], way[longest] / np.maximum(length[longest], np.finfo(float).tiny)[:, None]
    on_line = np.repeat(line, 2)
    vertex = np.column_stack((start, end)).ravel()
    from_origin = vertices[vertex] - origin[on_line]
    share = np.einsum("ij,ij->i", from_origin, along[on_line])
    beside = np.linalg.norm(from_origin - share[:, None] * along[on_line], axis=1)
    off = np.zeros(len(longest))
    np.maximum.at(off, on_line, beside)
    order = np.lexsort((vertex, share, on_line))
    new = np.append(True, (np.diff(on_line[order]) != 0) | (np.diff(vertex[order]) != 0))
    rank = np.zeros(len(order), dtype=np.int64)
    rank[order] = np.cumsum(new) - 1
    in_order = vertex[order][new]
    from_rank, to_rank = rank[::2], rank[1::2]
    straight = off[line] <= reach
    steps = np.where(straight, np.abs(to_rank - from_rank), 1)
    # One half-edge from each vertex to the next, in the direction of the whole one.
    whole = np.repeat(np.arange(len(start)), steps)
    step = np.arange(len(whole)) - np.repeat(np.cumsum(steps) - steps, steps)
    ahead = np.sign(to_rank - from_rank)[whole]
    here = from_rank[whole] + step * ahead
    cut = straight[whole]
    return _HalfEdges(
        np.where(cut, in_order[here], start[whole]),
        np.where(cut, in_order[np.where(cut, here + ahead, here)], end[whole]),
        edges.face[whole],
    )


def _lines(vertices: FloatArray, edges: _HalfEdges, reach: float) -> IntArray:
    """Return the index of the line of each edge, shape (e,): edges with a common vertex and direction are on one line.

    Args:
        vertices: positions of the vertices, shape (v, 3).
        edges: e half-edges to number.
        reach: distance by which an edge may deviate from a line.
    """
    count = len(edges.start)
    at = np.concatenate((edges.start, edges.end))
    order = np.argsort(at, kind="stable")
    at = at[order]
    edge = order % count
    way = (vertices[edges.end] - vertices[edges.start])[edge] * np.where(order < count, 1.0, -1.0)[:, None]
    length = np.linalg.norm(way, axis=1)
    joined = []
    for apart in range(1, _MOST_AT_VERTEX):
        one = np.flatnonzero(at[apart:] == at[:-apart])
        if not len(one):
            break
        other = one + apart
        # Two edges are on one line if the end of the shorter lies on the line of the longer.
        off = np.linalg.norm(np.cross(way[one], way[other]), axis=1)
        along = off <= reach * np.maximum(length[one], length[other])
        joined.append(np.column_stack((edge[one[along]], edge[other[along]])))
    pairs = np.concatenate(joined) if joined else np.zeros((0, 2), dtype=np.intp)
    return _components(pairs[:, 0], pairs[:, 1], count)


def _pairs(edges: _HalfEdges) -> tuple[IntArray, IntArray, IntArray]:
    """Return the indices of the first and second half-edges of all pairs, and of the half-edges without a partner."""
    order, begins = edges.grouped()
    counts = np.diff(np.append(begins, len(order)))
    crowded = np.repeat(counts > 2, counts)
    if crowded.any():
        order[crowded] = _pair_half_edges(edges, order[crowded], counts[counts > 2], order[~crowded])
    alone = (begins + counts - 1)[counts % 2 == 1]
    paired = order[np.delete(np.arange(len(order)), alone)] if len(alone) else order
    return paired[::2], paired[1::2], order[alone]


def _pair_half_edges(edges: _HalfEdges, numbers: IntArray, counts: IntArray, others: IntArray) -> IntArray:
    """Return the half-edges of edges with more than two triangles, sorted so that partners follow each other.

    If the number at an edge is odd, the half-edge without a partner comes last. Half-edges of one patch, whose
    triangles are connected over edges with two triangles, belong to one body and are paired first.

    Args:
        edges: all half-edges.
        numbers: indices of the half-edges to order, edge by edge.
        counts: number of half-edges of each of these edges.
        others: indices of the half-edges of all other edges, edge by edge.
    """
    edge = np.repeat(np.arange(len(counts)), counts)
    two = others[np.isin(others, edges.unpaired(), invert=True)]
    patch = _components(edges.face[two[::2]], edges.face[two[1::2]], int(edges.face.max()) + 1)[edges.face[numbers]]
    patch[_last_odd_half_edges(edge, patch)] = len(edges.face)
    _, group = np.unique(edge * (len(edges.face) + 1) + patch, return_inverse=True)
    # The first forward one pairs with the first backward one, unless orientations are inconsistent.
    back = edges.start[numbers] > edges.end[numbers]
    size = np.bincount(group)
    balanced = (2 * np.bincount(group, back) == size)[group]
    by_way = np.lexsort((edges.face[numbers], back & balanced, group))
    place = np.arange(len(numbers)) - (np.cumsum(size) - size)[group[by_way]]
    half = (size // 2)[group[by_way]]
    slot = np.where(balanced[by_way], np.where(place < half, 2 * place, 2 * (place - half) + 1), place)
    paired_up = np.empty_like(numbers)
    paired_up[np.arange(len(numbers)) - place + slot] = numbers[by_way]
    return paired_up


def _last_odd_half_edges(edge: IntArray, patch: IntArray) -> IntArray:
    """Return, for each edge at which a patch has an odd number of half-edges, the index of the last of them."""
    order = np.lexsort((patch, edge))
    changes = (np.diff(edge[order], append=-1) != 0) | (np.diff(patch[order], append=-1) != 0)
    ends = np.flatnonzero(changes)
    return np.asarray(order[ends[np.diff(ends, prepend=-1) % 2 == 1]])


def _turned_alike(
    count: int, first: IntArray, second: IntArray, alike: BoolArray
) -> tuple[IntArray, BoolArray, BoolArray]:
    """Return the shells that paired half-edges join, and the orientation of their triangles.

    In a consistent orientation, the two half-edges of an edge run in opposite directions. Every triangle is represented
    by two nodes of a graph, as it is and reversed; an edge joins the nodes that agree. A shell whose two copies are
    connected cannot be oriented.

    Args:
        count: number of triangles.
        first: triangle of the first half-edge of each pair.
        second: triangle of the second half-edge of each pair.
        alike: whether both half-edges of a pair run in the same direction.

    Returns:
        Index of the shell of each triangle, a mask of the triangles oriented against the majority of their shell, and a
        mask of the shells that are orientable.
    """
    if not alike.any():
        number = _components(first, second, count)
        shells = int(number.max(initial=-1)) + 1
        return number, np.zeros(count, dtype=np.bool_), np.ones(shells, dtype=np.bool_)
    flip = np.where(alike, count, 0)
    sheet = _components(
        np.concatenate((first, first + count)), np.concatenate((second + flip, second + count - flip)), 2 * count
    )
    as_is, over = sheet[:count], sheet[count:]
    _, one, number = np.unique(np.minimum(as_is, over), return_index=True, return_inverse=True)
    turned = as_is > over
    most = np.bincount(number, turned) > 0.5 * np.bincount(number)
    return number, turned ^ most[number], np.asarray((as_is != over)[one])


def _components(first: IntArray, second: IntArray, count: int) -> IntArray:
    """Return the index of the connected component of each of ``count`` graph nodes, shape (count,)."""
    graph = sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1], dtype=np.intp)
