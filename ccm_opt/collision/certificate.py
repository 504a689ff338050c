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
from ccm_opt.collision.compiled_proofs import compiled_proofs
from ccm_opt.collision.pair_proofs import InterpretedProofs, PairProofs, Pairs
from ccm_opt.collision.stretches import Stretches
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.arm import Arm

_Links: TypeAlias = tuple[IntArray, IntArray]  # stretch and link


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
        spans = Stretches(self.arm, start, end, owner)

        links = self._all_links(spans)
        pairs: Pairs | None = None
        failed: list[IntArray] = []
        for level in range(depth + 1):
            links, touching_links = self._unsafe_links(spans, *links)
            pairs, touching_pairs = self._unproved_pairs(spans, pairs)
            # What touches half-way is lost at once; what is merely unproved is lost after the last bisection.
            last = level == depth
            bad = np.concatenate((touching_links, touching_pairs, links[0] if last else [], pairs[0] if last else []))
            failed.append(np.unique(spans.owner[bad.astype(int)]))
            if last or (len(links[0]) == 0 and len(pairs[0]) == 0):
                break
            spans, links, pairs = self._halved(spans, links, pairs, failed[-1])
        return np.unique(np.concatenate(failed))

    def _halved(
        self, spans: Stretches, links: _Links, pairs: Pairs, failed: IntArray
    ) -> tuple[Stretches, _Links, Pairs]:
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
        halves = Stretches(
            self.arm, np.concatenate((start, middle)), np.concatenate((middle, end)), np.tile(spans.owner[kept], 2)
        )

        # First halves come first, second halves len(kept) later; every open test is repeated on both.
        on_link = place[: len(links[0])]
        on_pair = place[len(links[0]) :]
        twice_links = (np.concatenate((on_link, on_link + len(kept))), np.tile(links[1], 2))
        twice_pairs = (np.concatenate((on_pair, on_pair + len(kept))), np.tile(pairs[1], 2), np.tile(pairs[2], 2))
        return halves, twice_links, twice_pairs

    def _all_links(self, spans: Stretches) -> _Links:
        """Every stretch with every link beyond the mount."""
        span, link = np.meshgrid(np.arange(len(spans.owner)), np.arange(self._mount[0], self.arm.links), indexing="ij")
        return span.ravel(), link.ravel()

    def _unsafe_links(self, spans: Stretches, span: IntArray, link: IntArray) -> tuple[_Links, IntArray]:
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

    def _touching(self, spans: Stretches, span: IntArray, link: IntArray) -> IntArray:
        """Stretches whose links truly touch a wall half-way, so that no bisection can help."""
        # Half-way the arm really stands so: what touches there touches whatever is proved elsewhere.
        lines = _lines(self._ends(spans.middle, span, link))
        return span[np.unique(self._near(lines, self._apart(link))[0])]

    def _apart(self, link: IntArray) -> FloatArray:
        """Distance that the axes of links keep from walls, shape (k,) [m]."""
        room = self.arm.room_for_errors(link + 1)
        return self.arm.radius + self.workspace.clearance + self.spare + room

    def _corners(self, spans: Stretches, span: IntArray, link: IntArray) -> FloatArray:
        """End positions of links at both ends of stretches, the mount cut off, shape (k, 4, 2) [m]."""
        return np.concatenate((self._ends(spans.a, span, link), self._ends(spans.b, span, link)), axis=1)

    def _ends(self, joints: FloatArray, span: IntArray, link: IntArray) -> FloatArray:
        """End positions of links, the mount cut off, of joints (m, links + 1, 2), shape (k, 2, 2) [m]."""
        ends = np.stack((joints[span, link], joints[span, link + 1]), axis=1)
        mount, share = self._mount
        cut = link == mount
        ends[cut, 0] += share * (ends[cut, 1] - ends[cut, 0])
        return ends

    def _unproved_pairs(self, spans: Stretches, pairs: Pairs | None) -> tuple[Pairs, IntArray]:
        """Pairs of links not proved apart, of those given or of all, and the stretches in which a pair touches."""
        if not self.arm.self_collision:
            none = np.zeros(0, dtype=np.intp)
            return (none, none, none), none
        return self._pair_proofs.unproved(spans, pairs)

    @cached_property
    def _pair_proofs(self) -> PairProofs:
        arm = self.arm
        apart = 2.0 * arm.radius + self.spare + self.settings.touch + arm.room_for_errors(np.arange(arm.links))
        return compiled_proofs(arm.first_self_pair, apart) or InterpretedProofs(arm.first_self_pair, apart)

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
