"""Collapsing edges without compiled code, as edge_collapse.c does and some thousand times slower."""

from collections import defaultdict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ccm_opt.files.scene_import.mesh_settings import SimplifyingSettings
from ccm_opt.files.scene_import.raw_mesh import RawMesh
from ccm_opt.ground.arrays import FloatArray, IntArray

_WIDEST = 24
"""Triangles of a fan that is looked at, as in edge_collapse.c."""
_SLIP = 1e-9
"""Share of a triangle or an edge beyond which a place is no longer on it, as in edge_collapse.c."""


@dataclass(frozen=True)
class CollapsedFaces:
    """What is left of a mesh.

    Attributes:
        faces: among the vertices of the mesh, shape (m, 3).
        off: what the old surface is off the new one at most, in the unit of the mesh.
    """

    faces: IntArray
    off: float


class _Fan(NamedTuple):
    """The triangles about a vertex; triangle i is between ring i and ring i + 1.

    Attributes:
        vertex: in the middle.
        ring: vertices of the outline, in their order.
        faces: the triangles.
    """

    vertex: int
    ring: list[int]
    faces: list[int]


class _Flat(NamedTuple):
    """A fan seen along its mean normal, about its vertex.

    Attributes:
        places: of the ring, shape (k, 2).
        heights: likewise, shape (k,).
        normal: shape (3,).
    """

    places: FloatArray
    heights: FloatArray
    normal: FloatArray


def collapsed_faces(mesh: RawMesh, allowed: float, settings: SimplifyingSettings) -> CollapsedFaces:
    """Collapse edges of a mesh while its surface is off by no more than what is allowed.

    Args:
        mesh: its vertices are different places.
        allowed: above 0, in the unit of the mesh.
        settings: how edges are collapsed.
    """
    left = _Faces(mesh, settings)
    # What changes nothing comes first, then more and more.
    for level in range(settings.levels):
        limit = allowed * 2.0 ** (level + 1 - settings.levels)
        for _ in range(settings.sweeps):
            if 64 * left.sweep(limit) <= len(left.about):
                break
    faces = sorted(left.corners)
    corners = np.array([left.corners[face] for face in faces], dtype=np.intp).reshape(-1, 3)
    return CollapsedFaces(corners, max((left.off[face] for face in faces), default=0.0))


class _Faces:
    """The triangles that are left of a mesh.

    Args:
        mesh: all of them.
        settings: how edges are collapsed.
    """

    def __init__(self, mesh: RawMesh, settings: SimplifyingSettings) -> None:
        self.places = mesh.vertices
        self.settings = settings
        self.corners = {face: [int(v) for v in corners] for face, corners in enumerate(mesh.faces)}
        self.off = dict.fromkeys(self.corners, 0.0)
        self.about: dict[int, list[int]] = defaultdict(list)
        for face, corners in self.corners.items():
            for vertex in corners:
                self.about[vertex].append(face)

    def sweep(self, limit: float) -> int:
        """Try every vertex once but for those beside one that was taken away; how many went."""
        moved: set[int] = set()
        taken = 0
        for vertex in sorted(self.about):
            if vertex in moved:
                continue
            fan = self._fan(vertex)
            if fan is None:
                continue
            chosen = self._best_end(fan, limit)
            if chosen is None:
                continue
            end, off = chosen
            self._collapse(fan, end, off)
            moved.update(fan.ring)
            taken += 1
        return taken

    def _fan(self, vertex: int) -> _Fan | None:
        """The triangles about a vertex in their order; None where they are no closed ring, or too many."""
        faces = self.about[vertex]
        if not 3 <= len(faces) <= _WIDEST:
            return None
        sides = {}
        for face in faces:
            corners = self.corners[face]
            place = corners.index(vertex)
            sides[face] = (corners[(place + 1) % 3], corners[(place + 2) % 3])
        at = sides[faces[0]][0]
        ring: list[int] = []
        order: list[int] = []
        while sides:
            beside = [face for face, side in sides.items() if at in side]
            if not beside or at in ring:
                return None
            # The first triangle begins the ring; then those that are turned alike, where there are any.
            alike = [face for face in beside if sides[face][0] == at]
            found = (alike or beside)[0]
            first, second = sides.pop(found)
            ring.append(at)
            order.append(found)
            at = second if first == at else first
        return _Fan(vertex, ring, order) if at == ring[0] else None

    def _best_end(self, fan: _Fan, limit: float) -> tuple[int, float] | None:
        """The place in the ring that the vertex goes to, and what the new triangles are off then."""
        before = max(self.off[face] for face in fan.faces)
        flat = self._laid_flat(fan) if before <= limit else None
        if flat is None:
            return None
        best = -1.0
        chosen = None
        for end in range(len(fan.ring)):
            off = self._off_from(fan, flat, end)
            if off is None or before + off > limit:
                continue
            worth = self._worst_shape(fan, end) * (1.0 - 0.5 * off / limit)
            if worth > best and self._stays_a_surface(fan, end):
                best = worth
                chosen = (end, before + off)
        return chosen

    def _laid_flat(self, fan: _Fan) -> _Flat | None:
        """The fan as heights over a plane; None where it is none."""
        away = self.places[fan.ring] - self.places[fan.vertex]
        normals = np.cross(away, np.roll(away, -1, axis=0))
        total = normals.sum(axis=0)
        size = float(np.linalg.norm(total))
        if not size > 0.0:
            return None
        normal = total / size
        if not np.all(normals @ normal > self.settings.steepest * np.linalg.norm(normals, axis=1)):
            return None
        first = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
        first /= np.linalg.norm(first)
        places = np.stack((away @ first, away @ np.cross(normal, first)), axis=1)
        after = np.roll(places, -1, axis=0)
        around = np.sum(np.arctan2(_turns(places, after), np.sum(places * after, axis=1)))
        # A fan that goes round twice covers its outline twice.
        return _Flat(places, away @ normal, normal) if around < 2.0 * np.pi + 0.2 else None

    def _new_faces(self, fan: _Fan, end: int) -> IntArray:
        """Places in the ring between which and ``end`` there are new triangles: the first corner of each."""
        count = len(fan.ring)
        return np.array([i for i in range(count) if i != end and (i + 1) % count != end], dtype=np.intp)

    def _off_from(self, fan: _Fan, flat: _Flat, end: int) -> float | None:
        """What the fan is off the new triangles along the normal at most; None where they turn over."""
        ring = self.places[fan.ring]
        first = self._new_faces(fan, end)
        after = (first + 1) % len(ring)
        normals = np.cross(ring[first] - ring[end], ring[after] - ring[end])
        up = normals @ flat.normal
        if not np.all(up > self.settings.steepest * np.linalg.norm(normals, axis=1)):
            return None
        v = flat.places[end]
        if not np.all(_turns(flat.places[first] - v, flat.places[after] - v) > 0.0):
            return None
        return max(_off_at_vertex(flat, end, first, after), _off_at_crossings(flat, end))

    def _worst_shape(self, fan: _Fan, end: int) -> float:
        """How near the worst of the new triangles is to an equilateral one, from 0 to 1."""
        ring = self.places[fan.ring]
        first = self._new_faces(fan, end)
        a = ring[first] - ring[end]
        b = ring[(first + 1) % len(ring)] - ring[end]
        sides = np.sum(a**2, axis=1) + np.sum(b**2, axis=1) + np.sum((b - a) ** 2, axis=1)
        return float(np.min(2.0 * np.sqrt(3.0) * np.linalg.norm(np.cross(a, b), axis=1) / sides, initial=1.0))

    def _stays_a_surface(self, fan: _Fan, end: int) -> bool:
        """Whether the vertex and its end share no neighbours but the two beside the end in the ring."""
        count = len(fan.ring)
        beside = {fan.ring[(end - 1) % count], fan.ring[(end + 1) % count]}
        faces = self.about[fan.ring[end]]
        if len(faces) > _WIDEST:
            return False
        for face in faces:
            others = set(self.corners[face]) - {fan.ring[end]}
            shared = others & set(fan.ring)
            if fan.vertex not in others and (shared - beside or len(shared) == 2):
                return False
        return len(faces) + count - 4 <= _WIDEST

    def _collapse(self, fan: _Fan, end: int, off: float) -> None:
        kept = fan.ring[end]
        for face in fan.faces:
            corners = self.corners[face]
            if kept in corners:
                for vertex in corners:
                    self.about[vertex].remove(face)
                del self.corners[face], self.off[face]
            else:
                corners[corners.index(fan.vertex)] = kept
                self.off[face] = off
                self.about[kept].append(face)
        del self.about[fan.vertex]


def _turns(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of plane vectors, shape (…, 2) each."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _off_at_vertex(flat: _Flat, end: int, first: IntArray, after: IntArray) -> float:
    """Height of the new triangles, by their corners in the ring, at the vertex, whose own is 0."""
    v = np.broadcast_to(flat.places[end], (len(first), 2))
    a = flat.places[first]
    b = flat.places[after]
    shares = np.stack((_turns(a, b), _turns(b, v), _turns(v, a))) / _turns(a - v, b - v)
    heights = shares[0] * flat.heights[end] + shares[1] * flat.heights[first] + shares[2] * flat.heights[after]
    below = np.all(shares >= -_SLIP, axis=0)
    return float(np.max(np.abs(heights[below]), initial=0.0))


def _off_at_crossings(flat: _Flat, end: int) -> float:
    """How far new edges, from a place in the ring, are above or below the old ones that they cross, at most."""
    count = len(flat.heights)
    # Old edges go from the origin to all of the ring, new ones from its end to all that are not beside that.
    far = np.array([i for i in range(count) if (i - end) % count not in {0, 1, count - 1}], dtype=np.intp)
    v = flat.places[end]
    new = flat.places[far][:, None] - v
    old = flat.places[None]
    down = _turns(old, new)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = _turns(np.broadcast_to(v, new.shape), new) / down
        across = _turns(np.broadcast_to(v, old.shape), old) / down
        rise = flat.heights[far][:, None] - flat.heights[end]
        apart = along * flat.heights - (flat.heights[end] + across * rise)
        on_both = (np.minimum(along, across) >= -_SLIP) & (np.maximum(along, across) <= 1.0 + _SLIP)
    # Parallel edges cross at ends, if at all, and those are seen to.
    crossing = (down != 0.0) & on_both
    crossing[:, end] = False
    crossing[np.arange(len(far)), far] = False
    return float(np.max(np.abs(apart[crossing]), initial=0.0))
