"""What motions in the plane know more than others: by how much joints leave their chords, and how rows are curved."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.optimisation.interval_rows import IntervalRows, RowCurvature, Sweep


@dataclass(frozen=True, eq=False)
class PlanarSweep(Sweep):
    """A piecewise-linear motion with what the rows need of it; K intervals, n links, p coordinates.

    Attributes:
        space: the link space.
        unknowns: coordinates at the keyframes, shape (K + 1, p).
    """

    space: LinkSpace
    unknowns: FloatArray

    @cached_property
    def headings(self) -> FloatArray:
        """Link headings, shape (K + 1, links) [rad]."""
        return self.space.arm.headings(self.configurations)

    @property
    def turn_metrics(self) -> FloatArray:
        """Squared turns of the links by the coordinates, the same everywhere, shape (K + 1, p, p)."""
        metric = self.space.heading_metric
        return np.broadcast_to(metric, (len(self.unknowns), *metric.shape))

    @cached_property
    def turns(self) -> FloatArray:
        """Turns of the links over the intervals Δφ, shape (K, links) [rad]."""
        return np.diff(self.headings, axis=0)

    @cached_property
    def sag(self) -> FloatArray:
        """How far joint j may leave its chord, shape (K, n + 1) [m]."""
        # ⅛ Σ_{i<j} l Δφ_i² for joint j, while links turn evenly.
        squares = 0.125 * self.space.arm.link_length * self.turns**2
        return np.pad(np.cumsum(squares, axis=-1), ((0, 0), (1, 0)))

    @cached_property
    def sag_slopes(self) -> FloatArray:
        """Derivative of the sag by the change of coordinates over the interval, shape (K, n + 1, p) [m per unit]."""
        # d(⅛ l Δφ²) = ¼ l Δφ dΔφ, and dΔφ = A dΔv.
        steps = (0.25 * self.space.arm.link_length * self.turns)[..., None] * self.space.turns[: self.space.arm.links]
        slopes = np.zeros((self.intervals, self.space.arm.links + 1, self.space.dimension))
        np.cumsum(steps, axis=-2, out=slopes[:, 1:])
        return slopes

    # ------------------------------------------------------------ what rows need
    def deviation(self, rows: IntervalRows) -> FloatArray:
        """Return how far the points of rows may leave their chord, shape (m,) [m]."""
        return np.asarray(self.sag[rows.interval, rows.high] - self.sag[rows.interval, rows.low])

    def deviation_slopes(self, rows: IntervalRows) -> FloatArray:
        """Return derivatives of that by the change of the coordinates over the interval, shape (m, p) [m per unit]."""
        return np.asarray(self.sag_slopes[rows.interval, rows.high] - self.sag_slopes[rows.interval, rows.low])

    def lost(self, rows: IntervalRows) -> FloatArray:
        """Return nothing: the deviation bounds it."""
        return np.zeros(len(rows))

    def curvature(self, rows: IntervalRows, multipliers: FloatArray, pull: FloatArray) -> RowCurvature:
        """Return the convex part of the second derivatives of Σ λ g + pull·tip, for rows at the ends of intervals.

        Args:
            rows: g.
            multipliers: λ of the rows, shape (m,).
            pull: multipliers of the last keyframe's tip position, shape (2,).
        """
        # Headings are affine in v, so a curvature that is diagonal in headings becomes Aᵀ diag(c) A. Dropping negative
        # entries of the diagonal is the exact projection onto convex ones.
        matrix = self.space.turns[: self.space.arm.links]
        of_headings, of_turns = self.heading_curvature(rows, multipliers, pull)
        diagonal = matrix.T @ (np.maximum(of_headings, 0.0)[:, :, None] * matrix)
        return RowCurvature(diagonal, matrix.T @ (np.maximum(of_turns, 0.0)[:, :, None] * matrix))

    def heading_curvature(
        self, rows: IntervalRows, multipliers: FloatArray, pull: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the second derivatives of Σ λ g + pull·tip, which are diagonal in headings and in their turns.

        Returns:
            Of the positions by the headings, shape (K + 1, links), any sign; of the sag by the turns, shape (K, links).
        """
        space = self.space
        keyframes = len(self.headings)
        links = space.arm.links

        # The sums are read as −Σ f·x with forces f on a chain: −λn acts on the point that counts positively and λn on
        # the other. The pull at the base balances one at the tip.
        forces = np.zeros((keyframes, links + 3, 2))
        forces[-1, 0] = pull
        weighted = multipliers[:, None] * rows.normal
        keyframe = rows.interval + rows.share.astype(np.intp)
        np.add.at(forces, (keyframe, rows.minus), weighted)
        np.add.at(forces, (keyframe, rows.plus), -weighted)

        # The mount's end is no joint: what acts on it is shared out between the joints of its link, as by the law of
        # the lever.
        link, share = space.arm.mount_end
        forces[:, link] += (1.0 - share) * forces[:, links + 1]
        forces[:, link + 1] += share * forces[:, links + 1]
        # What stands still, the last of all points, bears its forces through the base.
        forces[:, 0] += forces[:, -1]

        sag = np.zeros((keyframes - 1, links + 1))
        np.add.at(sag, (rows.interval, rows.low), multipliers)
        np.add.at(sag, (rows.interval, rows.high), -multipliers)

        # ∂²x_j/∂φ_i² = −l (cos φ_i, sin φ_i) for every joint j beyond link i; mixed derivatives vanish, since every
        # link adds a term of its own heading alone. The forces sum to 0: those beyond link i are minus those up to it,
        # and so do the weights of the sag.
        l = space.arm.link_length
        carried = np.cumsum(forces[:, :links], axis=1)
        bent = np.cos(self.headings) * carried[..., 0] + np.sin(self.headings) * carried[..., 1]
        return -l * bent, 0.25 * l * np.cumsum(sag, axis=1)[:, :links]
