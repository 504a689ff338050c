"""Cases of a chain of links under errors.

A chain is a sum of vectors a_k (cos α_k, sin α_k); an error Δ_i at its i-th turn turns all vectors from the i-th on, so
vector k by θ_k = Σ_{i≤k} Δ_i. Along a direction at the angle ν, with β_k = α_k − ν, its end lies at

    Σ a_k cos(β_k + θ_k).

Every cosine lies below a straight line of any slope, cos(β + θ) ≤ c − s θ for |θ| ≤ h, where the least such c is a
maximum over an interval that is known in closed form. With |Δ_i| ≤ w_i and h_k = Σ_{i≤k} w_i therefore

    Σ a_k cos(β_k + θ_k)  ≤  Σ a_k c_k  −  Σ_i Δ_i Σ_{k≥i} a_k s_k  ≤  Σ a_k c_k  +  Σ_i w_i |Σ_{k≥i} a_k s_k|.

With the slopes s_k = sin β_k the last sum is what a linearisation says, Σ w_i |n × (p − P_i)|, and the first one holds
everything that it leaves out: the bound is rigorous for errors of any size, and exact as they become small.

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

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray

_FAR_TURN = 0.25
"""Turn of a vector beyond which a linearisation does not find the worst errors well [rad]. Measured on random chains of
24 vectors: the bound grows loose from there on."""
_FAR_STEPS = 12
"""Steps that find them then. Taste."""

_TURN = 2.0 * np.pi
_TINY = 1e-300


def chain_support(
    lengths: FloatArray,
    angles: FloatArray,
    widths: FloatArray,
    stretches: FloatArray,
    directions: FloatArray,
) -> FloatArray:
    """Bound on how far the ends of chains come along directions, shape (m, f) [m].

    Args:
        lengths: of the vectors, of any sign, shape (m, k) [m].
        angles: of the vectors, shape (m, k) [rad].
        widths: largest error at every turn, shape (m, k) [rad].
        stretches: largest error of every length, shape (m, k) [m].
        directions: angles of the directions, f for each chain, shape (m, f) [rad].
    """
    # A vector of negative length is one of positive length the other way.
    beta = np.where(lengths < 0.0, angles + np.pi, angles)[:, None, :] - directions[:, :, None]
    a = np.abs(lengths)[:, None, :]
    w = widths[:, None, :]
    h = np.cumsum(w, axis=2)

    # Two choices of slopes, and the lower bound of both. Those of chords are right where errors all go one way;
    # tangents at the worst errors are right where they do not, but only where the cosine is concave.
    chords = np.sin(beta) * np.sinc(h / np.pi)
    least = _bound(a, beta, w, h, chords)
    if np.any(w):
        there = beta + np.cumsum(_far_errors(a, beta, w, _steps(h)), axis=2)
        least = np.minimum(least, _bound(a, beta, w, h, np.where(np.cos(there) < 0.0, chords, np.sin(there))))

    # A length that is off moves the end along its vector, which itself may have turned.
    if not np.any(stretches):
        return least
    along = np.minimum(np.abs(np.cos(beta)) + h, 1.0)
    return np.asarray(least + np.sum(stretches[:, None, :] * along, axis=2))


def worst_errors(
    lengths: FloatArray,
    angles: FloatArray,
    widths: FloatArray,
    direction: FloatArray,
) -> FloatArray:
    """Errors at the turns of chains that bring their ends far along a direction each, shape (m, k) [rad].

    Args:
        lengths: as for ``chain_support``; likewise the angles and widths.
        angles: of the vectors.
        widths: largest error at every turn.
        direction: angle of the direction of each chain, shape (m,) [rad].
    """
    beta = np.where(lengths < 0.0, angles + np.pi, angles) - direction[:, None]
    return _far_errors(np.abs(lengths), beta, widths, _FAR_STEPS)


def _bound(a: FloatArray, beta: FloatArray, w: FloatArray, h: FloatArray, slopes: FloatArray) -> FloatArray:
    levers = _sums_to_end(a * slopes)
    value: FloatArray = np.sum(a * _intercepts(beta, slopes, h) + w * np.abs(levers), axis=2)
    return value


def _far_errors(a: FloatArray, beta: FloatArray, w: FloatArray, steps: int) -> FloatArray:
    """Errors that bring the ends of chains far, by steps towards what a linearisation says (Frank and Wolfe, 1956).

    Where a lever is so short that the reach is longest for an error within its width, a linearisation would jump from
    one end of the width to the other; there the step is that of a reach that is bent at most as a stretched chain's.
    """
    errors = np.zeros(np.broadcast_shapes(beta.shape, w.shape))
    stretched = np.maximum(_sums_to_end(a), _TINY)
    for k in range(steps):
        there = beta + np.cumsum(errors, axis=-1)
        wanted = np.clip(-_sums_to_end(a * np.sin(there)) / stretched, -w, w)
        errors = errors + 2.0 / (k + 2.0) * (wanted - errors)
    return errors


def _steps(h: FloatArray) -> int:
    """One step does where no vector turns far."""
    return 1 if h.size == 0 or float(h.max()) < _FAR_TURN else _FAR_STEPS


def _sums_to_end(values: FloatArray) -> FloatArray:
    sums: FloatArray = np.cumsum(values[..., ::-1], axis=-1)[..., ::-1]
    return sums


def _intercepts(beta: FloatArray, slopes: FloatArray, h: FloatArray) -> FloatArray:
    """Least c with cos(β + θ) ≤ c − s θ for all |θ| ≤ h: the maximum of cos(β + θ) + s θ there."""
    ends = np.maximum(np.cos(beta + h) + slopes * h, np.cos(beta - h) - slopes * h)
    # Inside, it has its maxima where sin(β + θ) = s with a positive cosine, a turn apart; the slope says which is best.
    arc = np.arcsin(slopes)
    first = arc - beta
    turns = np.where(slopes > 0.0, np.floor((h - first) / _TURN), np.ceil((-h - first) / _TURN))
    inside = first + _TURN * turns
    value = np.cos(arc) + slopes * inside
    best: FloatArray = np.where(np.abs(inside) <= h, np.maximum(ends, value), ends)
    return best


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
