"""Joins open pieces of a drawing end to end: chains between junctions, and closed loops."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.import_settings import IMPORT
from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True)
class Piece:
    """A polyline of a drawing.

    Attributes:
        points: shape (k, 2); a closed piece does not repeat its first point.
        closed: whether the last point is joined to the first.
        curved: whether it is a flattened curve.
        half_width: half the width with which it is drawn.
        name: of the shape that it becomes; a chain has that of its first piece.
    """

    points: FloatArray
    closed: bool = False
    curved: bool = False
    half_width: float = 0.0
    name: str = ""


def joined_pieces(pieces: Sequence[Piece], gap: float) -> list[Piece]:
    """Join open pieces where exactly two ends meet; where more meet, chains end.

    Args:
        pieces: open pieces, each of some length; what is drawn twice, whole or in parts, counts once.
        gap: ends no farther apart than this meet; a short leg then bridges them.

    Returns:
        Chains in the order of their first pieces; a loop is a closed piece.

    Raises:
        ProblemError: ends lie so densely that it cannot be told which of them meet.
    """
    pieces = _drawn_once(pieces, gap)
    if not pieces:
        return []
    # Ends that meet are led to one of them, so that GEOS sees them meet.
    ends = _meeting(np.array([piece.points[[0, -1]] for piece in pieces]).reshape(-1, 2), gap).reshape(-1, 2, 2)
    led = [np.vstack((a, piece.points, b)) for piece, (a, b) in zip(pieces, ends, strict=True)]
    chains = shapely.get_parts(shapely.line_merge(shapely.multilinestrings([shapely.LineString(one) for one in led])))
    middles = shapely.points([0.5 * (piece.points[0] + piece.points[1]) for piece in pieces])
    ours, of_chain = shapely.STRtree(chains).query(middles, predicate="dwithin", distance=gap)
    members = [ours[of_chain == k] for k in range(len(chains))]
    order = sorted(range(len(chains)), key=lambda k: int(members[k].min()))
    return [_chain(chains[k], [pieces[number] for number in np.sort(members[k])]) for k in order]


def _chain(line: shapely.LineString, members: Sequence[Piece]) -> Piece:
    points = shapely.get_coordinates(shapely.remove_repeated_points(line))
    closed = bool(shapely.is_closed(line))
    curved = any(piece.curved for piece in members)
    half_width = max(piece.half_width for piece in members)
    return Piece(points[:-1] if closed else points, closed, curved, half_width, members[0].name)


def _drawn_once(pieces: Sequence[Piece], gap: float) -> list[Piece]:
    """The pieces that lie on no longer ones, and of equal ones the first."""
    lines = np.array([shapely.LineString(piece.points) for piece in pieces])
    tree = shapely.STRtree(lines)
    middles = shapely.line_interpolate_point(lines, 0.5, normalized=True)
    ours, others = tree.query(middles, predicate="dwithin", distance=gap)
    lengths = shapely.length(lines)
    # A piece may lie on one that is longer by rounding alone, but of two that lie on each other one stays.
    before = (lengths[others] > lengths[ours] + gap) | ((abs(lengths[others] - lengths[ours]) <= gap) & (others < ours))
    ours, others = ours[before], others[before]
    on = shapely.covers(shapely.buffer(lines[others], gap), lines[ours])
    lost = set(ours[on].tolist())
    return [piece for k, piece in enumerate(pieces) if k not in lost]


def _meeting(points: FloatArray, gap: float) -> FloatArray:
    """The points, but those joined by steps of at most ``gap`` all at the first of them; shape as given."""
    # Equal points are one place, however many there are; pairs are sought among different ones only.
    places, place_of = np.unique(points, axis=0, return_inverse=True)
    tree = cKDTree(places)
    if tree.count_neighbors(tree, gap) > IMPORT.most_meeting * len(places):
        raise ProblemError("open lines end in crowds too dense to tell which of them meet; join them, or simplify")
    pairs = tree.query_pairs(gap, output_type="ndarray")
    # Pairs of near points are the edges of a graph; its connected components are the places that meet.
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    group = connected_components(graph, directed=False)[1]
    first = np.unique(group, return_index=True)[1]
    return np.asarray(places[first[group]][place_of.reshape(-1)])
