"""Joins open pieces of a drawing end to end: chains between junctions, and closed loops."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
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
        pieces: open pieces.
        gap: ends no farther apart than this meet; a short leg then bridges them.

    Returns:
        Chains in the order of their first pieces; a loop is a closed piece.
    """
    if not pieces:
        return []
    # Piece k has the ends 2k and 2k + 1, so that end ^ 1 is the other end of the same piece.
    places = _clusters(np.array([piece.points[[0, -1]] for piece in pieces]).reshape(-1, 2), gap)
    ends: dict[int, list[int]] = {}
    for end, place in enumerate(places):
        ends.setdefault(int(place), []).append(end)
    partner: dict[int, int] = {}
    for meeting in ends.values():
        if len(meeting) == 2:
            one, other = meeting
            partner[one] = other
            partner[other] = one

    chains: dict[int, Piece] = {}
    left = set(range(len(pieces)))
    free = [end for end in range(2 * len(pieces)) if end not in partner]
    # Chains start at their free ends; what is left after that are loops, which may start anywhere.
    for start in [*free, *range(0, 2 * len(pieces), 2)]:
        if start // 2 in left:
            steps, closed = _walk(start, partner)
            left -= {end // 2 for end in steps}
            chains[min(steps) // 2] = _chain([pieces[end // 2] for end in steps], steps, closed)
    return [chains[key] for key in sorted(chains)]


def _clusters(points: FloatArray, gap: float) -> np.ndarray:
    """A number for each point, the same for points that are joined by steps of at most ``gap``."""
    # Equal points are one place, however many there are; pairs are sought among different ones only.
    places, place_of = np.unique(points, axis=0, return_inverse=True)
    tree = cKDTree(places)
    if tree.count_neighbors(tree, gap) > IMPORT.most_meeting * len(places):
        raise ProblemError("open lines end in crowds too dense to tell which of them meet; join them, or simplify")
    pairs = tree.query_pairs(gap, output_type="ndarray")
    # Pairs of near points are the edges of a graph; its connected components are the places that meet.
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    return np.asarray(connected_components(graph, directed=False)[1])[place_of.reshape(-1)]


def _walk(start: int, partner: dict[int, int]) -> tuple[list[int], bool]:
    """The ends at which a chain from the end ``start`` enters its pieces, and whether it comes back to it."""
    steps = [start]
    # Through the piece to its other end, and over to the end that meets it.
    end = start ^ 1
    while end in partner and partner[end] != start:
        steps.append(partner[end])
        end = partner[end] ^ 1
    return steps, end in partner


def _chain(pieces: Sequence[Piece], entries: Sequence[int], closed: bool) -> Piece:
    """Pieces in the order of a chain as one; points that meet are kept once."""
    runs = []
    for piece, entry in zip(pieces, entries, strict=True):
        entered_at_its_end = entry % 2 == 1
        runs.append(piece.points[::-1] if entered_at_its_end else piece.points)
    points = np.concatenate(runs)
    # Pieces that meet exactly would leave a leg of no length between them.
    different = np.concatenate(([True], np.any(np.diff(points, axis=0) != 0.0, axis=1)))
    points = points[different]
    if closed and len(points) > 1 and np.all(points[0] == points[-1]):
        points = points[:-1]
    first = pieces[int(np.argmin(entries))]
    return Piece(points, closed, any(p.curved for p in pieces), max(p.half_width for p in pieces), first.name)
