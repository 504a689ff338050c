"""Tests of points against bodies in space, and nearest points of two segments."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from scipy import sparse
from scipy.sparse import csgraph

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.length_words import place
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.distances.insides import depth_inside, depths_in_rounded, encloses
from ccm_opt.scene.surfaces import box_about
from ccm_opt.scene.workspace import Workspace


@dataclass(frozen=True)
class Enclosure:
    """A point that lies inside a body, or outside the room.

    Attributes:
        name: name of the body; empty for a point outside the room.
        number: index of the point among those that were tested.
        place: the point, shape (3,) [m].
        depth: distance from the surface [m].
    """

    name: str
    number: int
    place: FloatArray
    depth: float


def deepest_enclosure(workspace: Workspace, places: FloatArray, *, entering: float = math.inf) -> Enclosure | None:
    """Return the point that lies deepest inside a body or farthest outside the room; None if all points are free.

    An arm that touches no surface is inside a closed body with all its points or with none, so testing one point is
    enough.

    Args:
        workspace: a workspace in space.
        places: points to test, shape (k, 3) [m].
        entering: radius of an arm that may reach the points from outside [m]; open shells with an opening wide enough
            for the arm are ignored.
    """
    return max(_enclosures(workspace, places, entering), key=lambda found: found.depth, default=None)


@lru_cache(maxsize=64)
def widest_opening(body: MeshBody) -> float:
    """Return an upper bound on the diameter of a ball that fits through the widest opening of a mesh [m]; 0 if closed.

    The bound is the second largest extent of the edges around the opening along their principal axes.
    """
    edges = body.shells.open_edges
    if not len(edges):
        return 0.0
    corners, numbers = np.unique(edges.reshape(-1, 3), axis=0, return_inverse=True)
    first, second = numbers.reshape(-1, 2).T
    graph = sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(len(corners), len(corners)))
    opening = csgraph.connected_components(graph, directed=False)[1]
    order = np.argsort(opening, kind="stable")
    begins = np.flatnonzero(np.diff(opening[order], prepend=-1))
    rims = corners[order]
    spans = np.linalg.norm(np.maximum.reduceat(rims, begins) - np.minimum.reduceat(rims, begins), axis=1)
    widest = 0.0
    ends = np.append(begins[1:], len(rims))
    # No opening is wider than the diagonal of its box, so that the greatest boxes decide.
    for number in np.argsort(-spans):
        if spans[number] <= widest:
            break
        rim = rims[begins[number] : ends[number]]
        axes = np.linalg.svd(rim - rim.mean(axis=0), full_matrices=False)[2]
        widest = max(widest, float(np.sort(np.ptp(rim @ axes.T, axis=0))[-2]))
    return widest


def enclosure_advice(workspace: Workspace, name: str, what: str) -> tuple[str, ...]:
    """Return lines of advice for an object that lies inside a body.

    Args:
        workspace: a workspace in space.
        name: name of the body.
        what: description of the object that lies inside.
    """
    body = next((each.body for each in workspace.obstacles if each.name == name), None)
    out = f"move {what} out of it"
    if body is None or body.kind != "mesh":
        return (out,)
    opened = "" if body.closed else f", which {open_edge_words(body)}"
    return out, f"set solid = false for '{name}'{opened}, if its surface alone is meant"


def open_edge_words(body: MeshBody) -> str:
    """Return text on the number of open edges of a mesh and the position of one of them."""
    edges = body.shells.open_edges
    count = "1 open edge" if len(edges) == 1 else f"{len(edges)} open edges, one"
    return f"has {count} near {place(edges[0].mean(axis=0))}"


def _enclosures(workspace: Workspace, places: FloatArray, entering: float = math.inf) -> Iterator[Enclosure]:
    rounded = [obstacle for obstacle in workspace.obstacles if obstacle.body.kind in {"sphere", "capsule"}]
    if rounded:
        depths = depths_in_rounded([obstacle.body for obstacle in rounded], places)
        for number, k in np.argwhere(depths > 0.0):
            yield Enclosure(rounded[k].name, int(number), places[number], float(depths[number, k]))
    for obstacle in workspace.obstacles:
        body = obstacle.body
        if not (body.has_inside and body.solid):
            continue
        low, high = box_about(body.triangles)
        within = (places >= low) & (places <= high)
        numbers = np.flatnonzero(np.all(within, axis=1))
        # Openings matter only to an arm that may enter, and take long to measure.
        may_enter = len(numbers) > 0 and entering < math.inf and body.kind == "mesh"
        closed_only = may_enter and widest_opening(body) > 2.0 * entering
        for number in numbers:
            # The depth takes longer to find than whether a point is inside.
            if encloses(body, places[number], closed_only=closed_only):
                depth = depth_inside(body, places[number], closed_only=closed_only)
                if depth > 0.0:
                    yield Enclosure(obstacle.name, int(number), places[number], depth)
    yield from _outside_workspace(workspace, places)


def _outside_workspace(workspace: Workspace, places: FloatArray) -> Iterator[Enclosure]:
    if workspace.bounds is None:
        return
    beyond = np.maximum(np.maximum(workspace.bounds[0] - places, places - workspace.bounds[1]), 0.0)
    for number in np.flatnonzero(np.any(beyond > 0.0, axis=1)):
        yield Enclosure("", int(number), places[number], float(np.linalg.norm(beyond[number])))


def enclosed(workspace: Workspace, places: FloatArray, entering: float) -> IntArray:
    """Return the increasing indices of the points that lie inside bodies or outside the room.

    Args:
        workspace: the workspace.
        places: k points to test, shape (k, d) [m].
        entering: radius of the arm [m]; used in space only, as in `deepest_enclosure`.
    """
    if workspace.dimension == 2:
        hidden = ~shapely.intersects_xy(workspace.boundary, *places.T)
        for obstacle in workspace.obstacles:
            hidden |= shapely.intersects_xy(obstacle.core, *places.T)
        return np.flatnonzero(hidden)
    return np.unique([found.number for found in _enclosures(workspace, places, entering)]).astype(np.intp)


def segment_distances(
    a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the nearest points of k segments ab and k segments cd, given by their end points, shape (k, d) [m].

    The nearest points are those of the two lines if these lie inside both segments; otherwise, one of them is an end of
    a segment.

    Returns:
        Positions of the points as fractions of the first and second segment, their distances [m], each of shape (k,),
        and unit vectors from the second segment to the first, shape (k, d).
    """
    tiny = 1e-300
    u = b - a
    w = d - c
    start = a - c
    uu = np.einsum("kd,kd->k", u, u)
    uw = np.einsum("kd,kd->k", u, w)
    ww = np.einsum("kd,kd->k", w, w)
    pu = np.einsum("kd,kd->k", start, u)
    pw = np.einsum("kd,kd->k", start, w)
    det = uu * ww - uw * uw
    skew = det > 1e-14 * uu * ww
    safe = np.where(skew, det, 1.0)
    inner_s = np.where(skew, (uw * pw - ww * pu) / safe, -1.0)
    inner_t = np.where(skew, (uu * pw - uw * pu) / safe, -1.0)
    inside = (inner_s > 0.0) & (inner_s < 1.0) & (inner_t > 0.0) & (inner_t < 1.0)
    zero = np.zeros_like(uu)
    one = np.ones_like(uu)
    candidates = (
        (zero, np.clip(pw / np.maximum(ww, tiny), 0.0, 1.0)),
        (one, np.clip((pw + uw) / np.maximum(ww, tiny), 0.0, 1.0)),
        (np.clip(-pu / np.maximum(uu, tiny), 0.0, 1.0), zero),
        (np.clip((uw - pu) / np.maximum(uu, tiny), 0.0, 1.0), one),
        (np.where(inside, inner_s, 0.0), np.where(inside, inner_t, np.clip(pw / np.maximum(ww, tiny), 0.0, 1.0))),
    )
    s = np.stack([share for share, _ in candidates])
    t = np.stack([share for _, share in candidates])
    lines = a + s[..., None] * u - c - t[..., None] * w
    squares = np.einsum("ckd,ckd->ck", lines, lines)
    best = np.argmin(squares, axis=0)
    columns = np.arange(len(uu))
    line = lines[best, columns]
    distance = np.sqrt(squares[best, columns])
    return s[best, columns], t[best, columns], distance, line / np.maximum(distance, 1e-12)[:, None]
