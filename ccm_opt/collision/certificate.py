"""The certificate of a motion on the links: continuous in time and along the arm.

Between two keyframes link headings are linear in u. A joint then leaves the chord of its two end positions by at
most ⅛ Σ l Δφ² over the links before it, since |∂²P/∂u²| ≤ Σ l Δφ² and linear interpolation errs by ⅛ max|f''|
(links are straight: no curvature term). So link j stays within the hull of its four end positions, grown by that much.
What fails is bisected, link by link and pair by pair: the sag falls four-fold a level.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.collision.collision_settings import DEFAULT_CERTIFICATE, CertificateSettings
from ccm_opt.collision.neighbour_pairs import closest_on_segments
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.jointed.arm import Arm

_Links: TypeAlias = tuple[IntArray, IntArray]  # stretch and link
_Pairs: TypeAlias = tuple[IntArray, IntArray, IntArray]  # stretch and two links


@dataclass(frozen=True)
class _Spans:
    """Stretches of a motion under test, with positions and sag bounds.

    Attributes:
        start: link headings at the start, shape (m, links) [rad].
        end: at the end.
        owner: interval of the motion that each stretch belongs to, shape (m,).
        a: joint positions at the start, shape (m, links + 1, 2) [m].
        b: at the end.
        sag: how far the joint at the end of each link may leave its chord, shape (m, links) [m].
    """

    start: FloatArray
    end: FloatArray
    owner: IntArray
    a: FloatArray
    b: FloatArray
    sag: FloatArray

    @classmethod
    def between(cls, arm: Arm, start: FloatArray, end: FloatArray, owner: IntArray) -> "_Spans":
        # The base runs straight, so only the turning of the links adds to the sag.
        turned = end[:, : arm.links] - start[:, : arm.links]
        sag = np.cumsum(arm.link_length * turned**2, axis=1) / 8.0
        return cls(start, end, owner, arm.points(start), arm.points(end), sag)


@dataclass(frozen=True)
class Certificate:
    """Certifies motions of one arm in one workspace.

    Attributes:
        arm: the arm.
        workspace: the workspace.
        spare: gap beyond contact that is asked for [m].
        settings: bisections and rounding.
    """

    arm: Arm
    workspace: Workspace
    spare: float = 0.0
    settings: CertificateSettings = DEFAULT_CERTIFICATE

    @classmethod
    def allowing_contact(
        cls, arm: Arm, workspace: Workspace, settings: CertificateSettings = DEFAULT_CERTIFICATE
    ) -> "Certificate":
        """The certificate that lets an arm with some width touch."""
        return cls(arm, workspace, -allowed_contact(arm, workspace, settings), settings)

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(np.concatenate(self._parts))

    @cached_property
    def _rounding(self) -> FloatArray:
        counts = [len(parts) for parts in self._parts]
        return np.repeat([wall.rounding for wall in self.workspace.walls], counts)

    @cached_property
    def _parts(self) -> list[npt.NDArray[np.object_]]:
        """Every wall's core, lines taken apart into edges so that a query meets few of them."""
        return [_edges(wall.core) for wall in self.workspace.walls]

    @cached_property
    def _mount(self) -> tuple[int, float]:
        """Link on which the mount ends, and where on it in [0, 1]."""
        links = self.arm.mount_length / self.arm.link_length
        whole = min(int(links + 1e-9), self.arm.links)
        return whole, max(0.0, links - whole) if whole < self.arm.links else 0.0

    def failures(self, headings: FloatArray, depth: int | None = None) -> IntArray:
        """Intervals of a piecewise-linear motion that cannot be certified.

        Args:
            headings: link headings at the keyframes, shape (K, links) [rad].
            depth: bisections that are allowed; as many as the settings say when None.

        Returns:
            Sorted indices of intervals k (from keyframe k to k + 1); empty when the motion is safe.
        """
        depth = self.settings.depth if depth is None else depth
        start = headings[:-1]
        end = headings[1:]
        owner = np.arange(len(headings) - 1)
        spans = _Spans.between(self.arm, start, end, owner)

        links = self._all_links(spans)
        pairs = self._all_pairs(spans)
        failed: list[IntArray] = []
        for level in range(depth + 1):
            links, touching_links = self._unsafe_links(spans, *links)
            pairs, touching_pairs = self._unsafe_pairs(spans, *pairs)
            # What touches half-way is lost at once; what is merely unproved is lost after the last bisection.
            last = level == depth
            bad = np.concatenate((touching_links, touching_pairs, links[0] if last else [], pairs[0] if last else []))
            failed.append(np.unique(spans.owner[bad.astype(int)]))
            if last or (len(links[0]) == 0 and len(pairs[0]) == 0):
                break
            spans, links, pairs = self._halved(spans, links, pairs, failed[-1])
        return np.unique(np.concatenate(failed))

    def _halved(self, spans: _Spans, links: _Links, pairs: _Pairs, failed: IntArray) -> tuple[_Spans, _Links, _Pairs]:
        """Both halves of every stretch with something unsafe, and what is to be tested on them again."""
        # An interval that has failed need not be looked at further: the caller only learns that it failed.
        alive = ~np.isin(spans.owner, failed)
        keep_link = alive[links[0]]
        keep_pair = alive[pairs[0]]
        links = (links[0][keep_link], links[1][keep_link])
        pairs = (pairs[0][keep_pair], pairs[1][keep_pair], pairs[2][keep_pair])

        # Only stretches that still have something to test are halved; ``place`` leads from a test to its stretch.
        kept, place = np.unique(np.concatenate((links[0], pairs[0])), return_inverse=True)
        start = spans.start[kept]
        end = spans.end[kept]
        middle = 0.5 * (start + end)
        halves = _Spans.between(
            self.arm, np.concatenate((start, middle)), np.concatenate((middle, end)), np.tile(spans.owner[kept], 2)
        )

        # First halves come first, second halves len(kept) later; every open test is repeated on both.
        on_link = place[: len(links[0])]
        on_pair = place[len(links[0]) :]
        twice_links = (np.concatenate((on_link, on_link + len(kept))), np.tile(links[1], 2))
        twice_pairs = (np.concatenate((on_pair, on_pair + len(kept))), np.tile(pairs[1], 2), np.tile(pairs[2], 2))
        return halves, twice_links, twice_pairs

    def _all_links(self, spans: _Spans) -> _Links:
        """Every stretch with every link beyond the mount."""
        span, link = np.meshgrid(np.arange(len(spans.owner)), np.arange(self._mount[0], self.arm.links), indexing="ij")
        return span.ravel(), link.ravel()

    def _all_pairs(self, spans: _Spans) -> _Pairs:
        """Every stretch with every pair of distant links that come anywhere near each other."""
        if not self.arm.self_collision:
            return (np.zeros(0, int),) * 3
        middle = 0.25 * (spans.a[:, :-1] + spans.a[:, 1:] + spans.b[:, :-1] + spans.b[:, 1:])
        x = np.ascontiguousarray(middle[..., 0])
        y = np.ascontiguousarray(middle[..., 1])

        # A bound for the broad phase: a link's middle strays from its mean place by at most half of the chord and the
        # sag, and any point of the link lies within half a link of it.
        moved = 0.5 * np.linalg.norm(spans.b - spans.a, axis=2).max(axis=1) + spans.sag[:, -1]
        reach = 2.0 * self.arm.radius + self.spare + self.arm.link_length + 2.0 * moved + self.settings.touch
        found = [(np.zeros(0, int),) * 3]
        # Diagonal by diagonal: all pairs (i, i + apart) at once without an index array of links².
        for apart in range(self.arm.first_self_pair, self.arm.links):
            dx = x[:, apart:] - x[:, :-apart]
            dy = y[:, apart:] - y[:, :-apart]
            limit = reach + self.arm.room_for_errors(np.array([apart]))
            span, i = np.nonzero(dx * dx + dy * dy < (limit**2)[:, None])
            found.append((span, i, i + apart))
        span, i, j = (np.concatenate(column) for column in zip(*found, strict=True))
        return span, i, j

    def _unsafe_links(self, spans: _Spans, span: IntArray, link: IntArray) -> tuple[_Links, IntArray]:
        """Of (stretch, link): those whose grown hull meets a wall, and the stretches that touch one half-way."""
        need = self._apart(link) + spans.sag[span, link]

        # A disc about the hull first: hulls are costly to build, and few links are near a wall.
        corners = self._corners(spans, span, link)
        centre = corners.mean(axis=1)
        extent = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
        near = np.unique(self._near(np.asarray(shapely.points(centre)), need + extent)[0])

        hulls: Any = shapely.convex_hull(_lines(corners[near]))
        hit = near[np.unique(self._near(hulls, need[near])[0])]
        return (span[hit], link[hit]), self._touching(spans, span[hit], link[hit])

    def _touching(self, spans: _Spans, span: IntArray, link: IntArray) -> IntArray:
        """Stretches whose links truly touch a wall half-way, so that no bisection can help."""
        # Half-way the arm really stands so: what touches there touches whatever is proved elsewhere.
        headings = 0.5 * (spans.start + spans.end)
        places = self.arm.points(headings)
        held = _Spans(headings, headings, spans.owner, places, places, spans.sag)
        lines = _lines(self._corners(held, span, link)[:, :2])
        return span[np.unique(self._near(lines, self._apart(link))[0])]

    def _apart(self, link: IntArray) -> FloatArray:
        """Distance that the axes of links keep from walls, shape (k,) [m]."""
        room = self.arm.room_for_errors(link + 1)
        return self.arm.radius + self.workspace.clearance + self.spare + room

    def _corners(self, spans: _Spans, span: IntArray, link: IntArray) -> FloatArray:
        """End positions of links at both ends of stretches, the mount cut off, shape (k, 4, 2) [m]."""
        corners = np.stack(
            (spans.a[span, link], spans.a[span, link + 1], spans.b[span, link], spans.b[span, link + 1]), axis=1
        )
        mount, share = self._mount
        cut = link == mount
        # Corners 0 and 2 are the near end of the link at both times, 1 and 3 its far end.
        corners[cut, 0::2] += share * (corners[cut, 1::2] - corners[cut, 0::2])
        return corners

    def _near(self, shapes: npt.NDArray[np.object_], distance: FloatArray) -> tuple[IntArray, IntArray]:
        """Pairs (shape, wall) no farther apart than given distances, shape (k,) [m]."""
        # The tree knows only the walls' cores; the largest rounding finds all candidates, and the next lines weigh each
        # by its own.
        reach = distance + self._rounding.max() + self.settings.touch
        shape, wall = self._tree.query(shapes, predicate="dwithin", distance=reach)
        if self._rounding.any():
            gap = shapely.distance(shapes[shape], self._tree.geometries[wall]) - self._rounding[wall]
            close = gap <= distance[shape] + self.settings.touch
            shape = shape[close]
            wall = wall[close]
        return shape, wall

    def _unsafe_pairs(self, spans: _Spans, span: IntArray, i: IntArray, j: IntArray) -> tuple[_Pairs, IntArray]:
        """Of (stretch, link, link): those not proved apart, and the stretches in which a pair touches half-way.

        A pair is apart when all eight corner differences keep their distance along the direction that is closest
        half-way; only the links between the two add to the sag of their difference.
        """
        if len(span) == 0:
            return (span, i, j), span
        middle = self.arm.points(0.5 * (spans.start + spans.end))
        _, _, apart = closest_on_segments(middle[span, i], middle[span, i + 1], middle[span, j], middle[span, j + 1])
        distance = np.hypot(apart[:, 0], apart[:, 1])
        direction = apart / np.maximum(distance, 1e-12)[:, None]

        # A difference of two points, one on each link, is a mean of corner differences at each end of the stretch, and
        # along the stretch leaves its chord by the sag of the links between.
        corners = np.min(
            [
                np.einsum("md,md->m", p[span, i + s] - p[span, j + t], direction)
                for p in (spans.a, spans.b)
                for s in (0, 1)
                for t in (0, 1)
            ],
            axis=0,
        )

        # sag[j] is that of the far end of link j; what the links before i turn moves both alike and cancels.
        before = np.where(i > 0, spans.sag[span, np.maximum(i - 1, 0)], 0.0)
        least = 2.0 * self.arm.radius + self.spare + self.settings.touch + self.arm.room_for_errors(j - i)
        unsafe: BoolArray = corners <= least + spans.sag[span, j] - before
        touching = unsafe & (distance <= least)
        return (span[unsafe], i[unsafe], j[unsafe]), span[touching]


def allowed_contact(arm: Arm, workspace: Workspace, settings: CertificateSettings = DEFAULT_CERTIFICATE) -> float:
    """Depth below contact that may be [m]: none for axes that would then touch walls or each other."""
    widths = [arm.radius + workspace.clearance, *([arm.radius] if arm.self_collision else [])]
    # Rounding must not refuse an arm that begins in contact, but an axis without width would be on the other side of
    # the wall.
    return settings.contact if min(widths) > 2.0 * settings.contact else 0.0


def _edges(core: shapely.Geometry) -> npt.NDArray[np.object_]:
    """The edges of a line, or what is no line itself."""
    if not isinstance(core, shapely.LineString):
        return np.array([core], dtype=np.object_)
    points = shapely.get_coordinates(core)
    return _lines(np.stack((points[:-1], points[1:]), axis=1))


def _lines(points: FloatArray) -> npt.NDArray[np.object_]:
    """Polylines from their vertices, shape (k, m, 2)."""
    return np.asarray(shapely.linestrings(points), dtype=np.object_)
