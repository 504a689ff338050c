"""Chains that must keep away from straight targets over stretches of time, and the gap that errors leave them.

A link and an edge of a wall, or two links, that are apart come to cross only after an end of one has touched the
other, for errors grow from nothing without a jump. So four things are asked of every such pair: that either end of
the one keeps away from the other. Seen from the target each of these ends is the end of a chain: of the arm from its
base for a joint that comes near an edge, and of the arm backwards and on to the corner for a corner that comes near a
link. A target of straight edge is convex, so one direction that parts it from where the chain's end may be is proof.

Over a stretch of time headings and lengths are linear; the chain's end then leaves its chord by the sag
⅛ Σ (a Δα² + 2 |Δa| |Δα|), whatever errors it has, since those do not change how fast anything turns.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.verification.tolerance.chain_support import chain_support

_SHORTEST = 1e-12
"""Distances below this have no direction [m]."""


@dataclass(frozen=True)
class ChainCases:
    """Chains with their targets in stretches of time; in the frame of the target, the chain's start at the origin.

    Attributes:
        lengths: of the vectors at both ends of the stretch, shape (m, 2, k) [m].
        angles: of the vectors, linear in between, shape (m, 2, k) [rad].
        turns: error of every turn, shape (m, k) [rad a unit].
        stretches: error of every length, shape (m, k) [m a unit].
        shift: by how much chain and target may be off beside, shape (m,) [m a unit].
        target: the ends of the target, shape (m, 2, 2) [m].
        growth: error of the target's length, at its second end, shape (m,) [m a unit].
        apart: distance to keep, shape (m,) [m].
        stray: how far the chain's end may be from where linear angles and lengths bring it, shape (m,) [m].
        joints: joint of every turn, 0 for the base; −1 for none, shape (m, k).
        sense: 1 when turns count as the joints do, −1 when the chain runs towards the base, shape (m,).
        interval: number of the interval between samples, shape (m,).
        stretch: where the stretch begins and ends in it, from 0 to 1, shape (m, 2).
        link: number of the link, shape (m,).
        other: number of the edge, or of the other link, shape (m,).
        with_link: whether it is a link, shape (m,).
    """

    lengths: FloatArray
    angles: FloatArray
    turns: FloatArray
    stretches: FloatArray
    shift: FloatArray
    target: FloatArray
    growth: FloatArray
    apart: FloatArray
    stray: FloatArray
    joints: IntArray
    sense: FloatArray
    interval: IntArray
    stretch: FloatArray
    link: IntArray
    other: IntArray
    with_link: BoolArray

    def __len__(self) -> int:
        return len(self.interval)

    def take(self, chosen: BoolArray | IntArray | slice) -> "ChainCases":
        """The cases that a mask, numbers or a slice select."""
        return ChainCases(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def halves(self) -> "ChainCases":
        """Every case twice, on either half of its stretch."""
        return joined_cases([self._part(0.0, 0.5), self._part(0.5, 1.0)])

    def still(self, share: float) -> "ChainCases":
        """Every case at the pose after a share of its stretch, where it stands still."""
        part = self._part(share, share)
        return replace(part, stray=np.zeros(len(part)))

    def middles(self) -> "ChainCases":
        """Every case at the middle of its stretch, where it stands still."""
        return self.still(0.5)

    def _part(self, start: float, end: float) -> "ChainCases":
        shares = np.array([[1.0 - start, start], [1.0 - end, end]])
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        values["lengths"] = np.einsum("ab,mbk->mak", shares, self.lengths)
        values["angles"] = np.einsum("ab,mbk->mak", shares, self.angles)
        values["stretch"] = np.einsum("ab,mb->ma", shares, self.stretch)
        return ChainCases(**values)

    def ends(self) -> FloatArray:
        """Ends of the chains without errors at the start of their stretches, shape (m, 2) [m]."""
        length = self.lengths[:, 0]
        angle = self.angles[:, 0]
        return np.stack((np.sum(length * np.cos(angle), axis=1), np.sum(length * np.sin(angle), axis=1)), axis=1)

    def shortest_directions(self) -> tuple[FloatArray, FloatArray]:
        """Distances of the chains' ends from their targets, and the angles of the shortest lines, shape (m,)."""
        place = self.ends()
        start = self.target[:, 0]
        along = self.target[:, 1] - start
        square = np.maximum(np.einsum("md,md->m", along, along), _SHORTEST**2)
        share = np.clip(np.einsum("md,md->m", place - start, along) / square, 0.0, 1.0)
        line = start + share[:, None] * along - place
        return np.hypot(line[:, 0], line[:, 1]), np.arctan2(line[:, 1], line[:, 0])

    def gaps(self, error: FloatArray | float, directions: FloatArray) -> FloatArray:
        """Gap that is proved between chains and targets under errors, along directions, shape (m, f) [m].

        Args:
            error: how large it may be, one for all or one a case [unit].
            directions: from the chain to the target, f for each case, shape (m, f) [rad].
        """
        error = np.broadcast_to(error, len(self))
        widths = error[:, None] * self.turns
        stretches = error[:, None] * self.stretches
        come = chain_support(self.lengths[:, 0], self.angles[:, 0], widths, stretches, directions)
        moving = np.any(self.stretch[:, 0] != self.stretch[:, 1])
        if moving:
            at_end = chain_support(self.lengths[:, 1], self.angles[:, 1], widths, stretches, directions)
            come = np.maximum(come, at_end) + self._sag(stretches)[:, None]

        normal = np.stack((np.cos(directions), np.sin(directions)), axis=-1)
        start = np.einsum("mfd,md->mf", normal, self.target[:, 0])
        end = np.einsum("mfd,md->mf", normal, self.target[:, 1])
        # The second end may be farther along the target by the error of its length.
        end = end - np.abs(end - start) * (error * self.growth / self._target_lengths)[:, None]
        margin = self.apart + self.stray + error * self.shift
        return np.asarray(np.minimum(start, end) - come - margin[:, None])

    def linear_errors(self) -> FloatArray:
        """The errors that would just close the gaps at the start of the stretches by a linearisation, shape (m,)."""
        distance, angle = self.shortest_directions()
        beta = self.angles[:, 0] - angle[:, None]
        levers = np.cumsum((self.lengths[:, 0] * np.sin(beta))[:, ::-1], axis=1)[:, ::-1]
        stretched = np.sum(self.stretches * np.abs(np.cos(beta)), axis=1)
        growth = np.sum(self.turns * np.abs(levers), axis=1) + stretched + self.shift
        return np.asarray(np.maximum(distance - self.apart, 0.0) / np.maximum(growth, _SHORTEST))

    @property
    def _target_lengths(self) -> FloatArray:
        length = np.linalg.norm(self.target[:, 1] - self.target[:, 0], axis=1)
        return np.asarray(np.maximum(length, _SHORTEST))

    def _sag(self, stretches: FloatArray) -> FloatArray:
        turned = np.diff(self.angles, axis=1)[:, 0]
        grown = np.abs(np.diff(self.lengths, axis=1)[:, 0])
        longest = np.abs(self.lengths).max(axis=1) + stretches
        return np.asarray(0.125 * np.sum(longest * turned**2 + 2.0 * grown * np.abs(turned), axis=1))


def joined_cases(parts: list[ChainCases]) -> ChainCases:
    """All cases of several lists."""
    return ChainCases(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(ChainCases)))
