"""Certificates that a piecewise-linear motion of a planar arm is free of collisions.

Between two keyframes the link headings φ are linear in the path parameter u. A joint then deviates from the chord
between its end positions by at most ⅛ Σ l Δφ² over the links (of length l) before it, since |∂²P/∂u²| ≤ Σ l Δφ² and
linear interpolation errs by ⅛ max|f''| (links are straight: no curvature term). So a link stays within the convex hull
of the four end positions of its joints, grown by that chord deviation.

A link is clear if this grown hull meets no wall. Two links are apart if a fixed direction separates them: that of their
shortest connection half-way. Along it, all eight differences of their joint positions at both ends must exceed the
required distance by the chord deviation of these differences, to which only the links between the two add.

Whatever is not proved is bisected in u, link by link and pair by pair: each bisection quarters the chord deviation.

The verifier computes its own bounds, so that it is independent of this certificate.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.link_layout import NextPairs
from ccm_opt.scene.contact_finder import DEFAULT_CERTIFICATE, CertificateSettings
from ccm_opt.scene.workspace import Workspace


@dataclass(frozen=True)
class MotionParts:
    """Parts of a motion that are to be proved free of collisions; the coordinates change linearly over each part.

    Attributes:
        arm: the moving arm.
        start: configurations at the starts of the m parts, shape (m, c) [rad, m].
        end: configurations at the ends, shape (m, c) [rad, m].
        owner: index of the interval between keyframes to which each part belongs, shape (m,).
    """

    arm: Arm
    start: FloatArray
    end: FloatArray
    owner: IntArray

    def __post_init__(self) -> None:
        c = len(self.arm.coordinates)
        if self.start.shape[1:] != (c,) or self.end.shape != self.start.shape:
            raise ValueError(f"motion parts have the shapes {self.start.shape} and {self.end.shape}; expected (m, {c})")

    @cached_property
    def a(self) -> FloatArray:
        """Joint positions at the start of each part, shape (m, links + 1, 2) [m]."""
        return self.arm.joint_positions_at(self.start)

    @cached_property
    def b(self) -> FloatArray:
        """Joint positions at the end of each part, shape (m, links + 1, 2) [m]."""
        return self.arm.joint_positions_at(self.end)

    @cached_property
    def middle(self) -> FloatArray:
        """Joint positions half-way through each part, shape (m, links + 1, 2) [m]."""
        return self.arm.joint_positions_at(0.5 * (self.start + self.end))

    @cached_property
    def chord_deviation(self) -> FloatArray:
        """Bounds on the deviation of the distal joint of each link from its chord, shape (m, links) [m]."""
        # The base moves straight, so only turning links contribute to the chord deviation.
        turned = np.cumsum((self.end - self.start)[:, : self.arm.links], axis=1)
        return np.asarray(np.cumsum(self.arm.lengths * turned**2, axis=1) / 8.0)

    @cached_property
    def moved(self) -> FloatArray:
        """Bounds on the distance of any point of the arm from the midpoint of its chord in a part, shape (m,) [m].

        Each bound is half the longest chord plus the largest chord deviation.
        """
        return np.asarray(0.5 * np.linalg.norm(self.b - self.a, axis=2).max(axis=1) + self.chord_deviation[:, -1])


Pairs: TypeAlias = tuple[IntArray, IntArray, IntArray]
"""Pairs of links in motion parts: indices of motion part, link, and a later link, each of shape (k,)."""


@dataclass(frozen=True, eq=False)
class PairProofs:
    """A proof method for pairs of links that must stay apart.

    Attributes:
        next_pair: as ``Arm.next_self_pairs``, shape (links, links + 1).
        least: contribution of each link to the required distance between the axes of two links, which is the sum of
            theirs, shape (links,) [m].
    """

    next_pair: NextPairs
    least: FloatArray

    def unproved(self, parts: MotionParts, pairs: Pairs | None) -> tuple[Pairs, IntArray]:
        """Return the pairs of links not proved apart, and the motion parts in which such a pair is too close half-way.

        Args:
            parts: parts of a motion.
            pairs: pairs to test; None for all links far apart along the arm that come near each other.
        """
        arm = parts.arm
        call = NativeCall(
            "pair_proofs",
            stretches=len(parts.owner), links=arm.links, next_pair=self.next_pair,
            longest=float(np.max(arm.lengths)), least=self.least, start=parts.a, end=parts.b,
            middle=parts.middle, sag=parts.chord_deviation, moved=parts.moved,
            asked=-1 if pairs is None else len(pairs[0]),
            **dict(zip(("asked_stretch", "asked_first", "asked_second"), pairs or (), strict=False)),
        )  # fmt: skip
        capacity = 1024 if pairs is None else len(pairs[0])
        found, touching = _called(call, capacity)
        if call.fields.count > capacity:
            found, touching = _called(call, call.fields.count)
        part, i, j = found[:, : call.fields.count]
        return (part, i, j), part[touching[: call.fields.count]]


def _called(call: NativeCall, capacity: int) -> tuple[IntArray, BoolArray]:
    """Run the C code on pairs of links, and return its results.

    They are the motion part and links of each pair not proved apart, shape (3, capacity), and a mask of the pairs in
    contact half-way, shape (capacity,). Only the first ``call.fields.count`` are set.
    """
    found = np.empty((3, capacity), dtype=np.int64)
    touching = np.empty(capacity, dtype=np.bool_)
    call.set(capacity=capacity, stretch=found[0], first=found[1], second=found[2], touching=touching)
    call()
    return found, touching


Links: TypeAlias = tuple[IntArray, IntArray]
"""Links in motion parts: indices of motion part and link, each of shape (k,)."""


@dataclass(frozen=True, eq=False)
class WallProofs:
    """A proof method for links that must stay clear of walls.

    Attributes:
        workspace: the workspace with the walls.
        least: least distance of the axis of each link from walls, rounding included, shape (links,) [m].
        mount: index of the link on which the mount ends, and the fraction of that link in the mount, in [0, 1]; the
            mount may touch walls.
    """

    workspace: Workspace
    least: FloatArray
    mount: tuple[int, float]

    def unproved(self, parts: MotionParts, links: Links | None) -> tuple[Links, IntArray]:
        """Return the links not proved clear of walls, and the motion parts in which such a link is too close half-way.

        Args:
            parts: parts of a motion.
            links: links to test; None for all links beyond the mount, part by part.
        """
        mount, share = self.mount
        of_arm = parts.arm.links
        most = len(parts.owner) * max(0, of_arm - mount) if links is None else len(links[0])
        found = np.empty((2, most), dtype=np.int64)
        touching = np.empty(most, dtype=np.bool_)
        call = NativeCall(
            "wall_proofs",
            stretches=len(parts.owner), links=of_arm, mount_link=mount, mount_share=share,
            start=parts.a, end=parts.b, middle=parts.middle, sag=parts.chord_deviation,
            asked=-1 if links is None else len(links[0]),
            stretch=found[0], link=found[1], touching=touching,
            **self._walls, **dict(zip(("asked_stretch", "asked_link"), links or (), strict=False)),
        )  # fmt: skip
        call()
        part, link = found[:, : call.fields.count]
        return (part, link), part[touching[: call.fields.count]]

    @cached_property
    def _walls(self) -> dict[str, Any]:
        """Walls as named arguments of the C code."""
        walls = self.workspace.wall_segments
        return {
            "least": self.least,
            "segments": walls.ends,
            "rounding": walls.rounding,
            "largest_rounding": float(walls.rounding.max()),
            "tree": walls.boxes.for_c(),
            "solids": walls.solid_boxes.for_c(),
            "first_segment": np.ascontiguousarray(walls.solids[:, 0], dtype=np.int64),
            "past_segments": np.ascontiguousarray(walls.solids[:, 1], dtype=np.int64),
        }


UNIT = 2.0**-53
"""Unit roundoff of double precision, 2⁻⁵³: half the distance from 1 to the next larger number."""


def proof_rounding(arm: Arm, workspace: Workspace, depth: int) -> float:
    """Return a bound on the rounding error of a computed distance of a link from a wall, less its chord deviation [m].

    The rounding error of the distance between two links is at most twice this bound.

    Args:
        arm: the arm; its headings, sums of bends, are at most those of joints that all bend by half a turn.
        workspace: the workspace with the walls.
        depth: number of bisections of the motion.
    """
    links = arm.links
    headings = abs(arm.base_heading) + np.pi * links
    # Headings are sums and are halved, sines are off by four units in the last place, and cumulative sums of lengths
    # lose digits.
    along = (depth + links + 2) * UNIT * headings + 8.0 * UNIT + 1.01 * (links + 2) * UNIT
    # The chord deviation is a sum as well; the turns of one interval are below a whole one, and an eighth of its square
    # is below five.
    of_chord_deviation = 1.01 * (links + 4) * UNIT * 5.0
    reach = float(np.max(np.abs(arm.base))) + arm.length
    size = max(2.0 * reach, float(np.max(np.abs(workspace.boundary.bounds))))
    return float(
        np.sqrt(2.0) * arm.length * along + arm.length * of_chord_deviation + 4.0 * UNIT * reach + 64.0 * UNIT * size
    )


@dataclass(frozen=True)
class Certificate:
    """Certifies that motions of one arm in one workspace are free of collisions.

    Attributes:
        arm: the arm.
        workspace: a planar workspace.
        spare: gap beyond the required clearance that motions must keep [m]; negative to allow slight contact.
        settings: number of bisections, and tolerances.
    """

    arm: Arm
    workspace: Workspace
    spare: float = 0.0
    settings: CertificateSettings = DEFAULT_CERTIFICATE

    @classmethod
    def allowing_contact(cls, arm: Arm, workspace: Workspace) -> "Certificate":
        """Return a certificate that tolerates slight contact if the arm has non-zero width."""
        return cls(arm, workspace, -allowed_contact(arm, workspace, DEFAULT_CERTIFICATE))

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the intervals of a piecewise-linear motion that are not certified.

        Args:
            q: configurations at the K keyframes, shape (K, c) [rad, m].
            depth: number of bisections; that of the settings if None.

        Returns:
            Sorted indices k of intervals from keyframe k to k + 1; empty if the motion is free of collisions.
        """
        depth = self.settings.depth if depth is None else depth
        parts = MotionParts(self.arm, q[:-1], q[1:], np.arange(len(q) - 1))

        links: Links | None = None
        pairs: Pairs | None = None
        failed: list[IntArray] = []
        for level in range(depth + 1):
            links, touching_links = self._wall_proofs.unproved(parts, links)
            pairs, touching_pairs = self._pair_proofs.unproved(parts, pairs)
            # Tests with contact half-way have failed; tests that are merely unproved fail after the last bisection.
            last = level == depth
            bad = np.concatenate((touching_links, touching_pairs, links[0] if last else [], pairs[0] if last else []))
            failed.append(np.unique(parts.owner[bad.astype(int)]))
            if last or (len(links[0]) == 0 and len(pairs[0]) == 0):
                break
            parts, links, pairs = self._halved(parts, links, pairs, failed[-1])
        return np.unique(np.concatenate(failed))

    def _halved(
        self, parts: MotionParts, links: Links, pairs: Pairs, failed: IntArray
    ) -> tuple[MotionParts, Links, Pairs]:
        """Return both halves of all motion parts with unproved links or pairs, and these links and pairs in each half.

        Parts of intervals in `failed`, which need no further tests, are left out.
        """
        # An interval that has failed needs no further tests: the caller only learns that it failed.
        alive = ~np.isin(parts.owner, failed)
        keep_link = alive[links[0]]
        keep_pair = alive[pairs[0]]
        links = (links[0][keep_link], links[1][keep_link])
        pairs = (pairs[0][keep_pair], pairs[1][keep_pair], pairs[2][keep_pair])

        # Only motion parts with open tests are halved; ``place`` maps a test to its part.
        kept, place = np.unique(np.concatenate((links[0], pairs[0])), return_inverse=True)
        start = parts.start[kept]
        end = parts.end[kept]
        middle = 0.5 * (start + end)
        halves = MotionParts(
            self.arm, np.concatenate((start, middle)), np.concatenate((middle, end)), np.tile(parts.owner[kept], 2)
        )

        # First halves come first, second halves len(kept) later; every open test is repeated on both.
        on_link = place[: len(links[0])]
        on_pair = place[len(links[0]) :]
        twice_links = (np.concatenate((on_link, on_link + len(kept))), np.tile(links[1], 2))
        twice_pairs = (np.concatenate((on_pair, on_pair + len(kept))), np.tile(pairs[1], 2), np.tile(pairs[2], 2))
        return halves, twice_links, twice_pairs

    @cached_property
    def _rounding(self) -> float:
        """Distance added to required distances so that rounding errors cannot make proofs false [m]."""
        return proof_rounding(self.arm, self.workspace, self.settings.depth)

    @cached_property
    def _pair_proofs(self) -> PairProofs:
        arm = self.arm
        touch = max(self.settings.touch, 2.0 * self._rounding)
        return PairProofs(arm.next_self_pairs, 0.5 * (2.0 * arm.radii + self.spare + touch))

    @cached_property
    def _wall_proofs(self) -> WallProofs:
        arm = self.arm
        least = arm.radii + self.workspace.clearance + self.spare + max(self.settings.touch, self._rounding)
        return WallProofs(self.workspace, least, self._mount)

    @cached_property
    def _mount(self) -> tuple[int, float]:
        """Index of the link on which the mount ends, and the fraction of that link in the mount, in [0, 1].

        The index is the number of links if the mount is the whole arm.
        """
        whole = self.arm.whole_mount_links
        return whole, float(self.arm.free_shares[whole]) if whole < self.arm.links else 0.0


def allowed_contact(arm: Arm, workspace: Workspace, settings: CertificateSettings = DEFAULT_CERTIFICATE) -> float:
    """Return the depth of contact that certificates tolerate [m]; 0 if link axes could then touch walls or links."""
    thinnest = arm.thinnest
    widths = [thinnest + workspace.clearance, *([thinnest] if arm.self_collision else [])]
    # Rounding must not refuse an arm that starts in contact, but an axis without width would end up on the other side
    # of the wall.
    return settings.contact if min(widths) > 2.0 * settings.contact else 0.0
