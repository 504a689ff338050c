"""The certificate of a motion on the links: continuous in time and along the arm.

Between two keyframes link headings are linear in u. A joint then leaves the chord of its two end positions by at
most ⅛ Σ l Δφ² over the links before it, since |∂²P/∂u²| ≤ Σ l Δφ² and linear interpolation errs by ⅛ max|f''|
(links are straight: no curvature term). So link j stays within the hull of its four end positions, grown by that much.
What fails is bisected, link by link and pair by pair: the sag falls four-fold a level.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.collision.collision_settings import DEFAULT_CERTIFICATE, CertificateSettings
from ccm_opt.collision.pair_proofs import PairProofs, Pairs
from ccm_opt.collision.proof_rounding import proof_rounding
from ccm_opt.collision.stretches import Stretches
from ccm_opt.collision.wall_proofs import Links, WallProofs, WallQuestion
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.arm import Arm


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

        links: Links | None = None
        pairs: Pairs | None = None
        failed: list[IntArray] = []
        for level in range(depth + 1):
            links, touching_links = self._wall_proofs.unproved(spans, links)
            pairs, touching_pairs = self._unproved_pairs(spans, pairs)
            # What touches half-way is lost at once; what is merely unproved is lost after the last bisection.
            last = level == depth
            bad = np.concatenate((touching_links, touching_pairs, links[0] if last else [], pairs[0] if last else []))
            failed.append(np.unique(spans.owner[bad.astype(int)]))
            if last or (len(links[0]) == 0 and len(pairs[0]) == 0):
                break
            spans, links, pairs = self._halved(spans, links, pairs, failed[-1])
        return np.unique(np.concatenate(failed))

    def _halved(self, spans: Stretches, links: Links, pairs: Pairs, failed: IntArray) -> tuple[Stretches, Links, Pairs]:
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

    def _unproved_pairs(self, spans: Stretches, pairs: Pairs | None) -> tuple[Pairs, IntArray]:
        """Pairs of links not proved apart, of those given or of all, and the stretches in which a pair touches."""
        if not self.arm.self_collision:
            none = np.zeros(0, dtype=np.intp)
            return (none, none, none), none
        return self._pair_proofs.unproved(spans, pairs)

    @cached_property
    def _rounding(self) -> float:
        """Distances are kept to this much more at least, so that rounding proves nothing that is not true."""
        return proof_rounding(self.arm, self.workspace, self.settings.depth)

    @cached_property
    def _pair_proofs(self) -> PairProofs:
        arm = self.arm
        touch = max(self.settings.touch, 2.0 * self._rounding)
        apart = 2.0 * arm.radius + self.spare + touch + arm.room_for_errors(np.arange(arm.links))
        return PairProofs(arm.first_self_pair, apart)

    @cached_property
    def _wall_proofs(self) -> WallProofs:
        arm = self.arm
        room = arm.room_for_errors(np.arange(1, arm.links + 1))
        least = arm.radius + self.workspace.clearance + self.spare + room + max(self.settings.touch, self._rounding)
        return WallProofs(WallQuestion(self.workspace, least, self._mount))

    @cached_property
    def _mount(self) -> tuple[int, float]:
        """Link on which the mount ends, and where on it in [0, 1]; past the last where it is the whole arm."""
        links = self.arm.mount_length / self.arm.link_length
        whole = min(int(links + 1e-9), self.arm.links)
        return whole, max(0.0, links - whole) if whole < self.arm.links else 0.0


def allowed_contact(arm: Arm, workspace: Workspace, settings: CertificateSettings = DEFAULT_CERTIFICATE) -> float:
    """Depth below contact that may be [m]: none for axes that would then touch walls or each other."""
    widths = [arm.radius + workspace.clearance, *([arm.radius] if arm.self_collision else [])]
    # Rounding must not refuse an arm that begins in contact, but an axis without width would be on the other side of
    # the wall.
    return settings.contact if min(widths) > 2.0 * settings.contact else 0.0
