"""Planar motions between keyframes, with joints' chord deviation and second derivatives of contact constraints."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.optimisation.interval_rows import IntervalRows, RowCurvature, Sweep


@dataclass(frozen=True, eq=False)
class PlanarSweep(Sweep):
    """Planar motion whose coordinates are linear over K intervals, with what its contact constraints (rows) need.

    The arm has n links, the curve p coordinates.

    Attributes:
        space: map from coordinates to configurations.
        unknowns: coordinates at the keyframes, shape (K + 1, p).
    """

    space: LinkSpace
    unknowns: FloatArray

    parts: ClassVar[int] = 1

    @cached_property
    def headings(self) -> FloatArray:
        """Link headings at the keyframes, shape (K + 1, links) [rad]."""
        return self.space.arm.headings(self.configurations)

    @property
    def turn_metrics(self) -> FloatArray:
        """Matrices M with vᵀ M v = Σ of squared link turns for a change v of coordinates, all equal, (K + 1, p, p)."""
        metric = self.space.heading_metric
        return np.broadcast_to(metric, (len(self.unknowns), *metric.shape))

    @cached_property
    def turns(self) -> FloatArray:
        """Turns Δφ of the links over the intervals, shape (K, links) [rad]."""
        return np.diff(self.headings, axis=0)

    @cached_property
    def chord_deviation(self) -> FloatArray:
        """Upper bounds on the distance of base, joints and tip from their chords over each interval, (K, n + 1) [m]."""
        # ⅛ Σ_{i<j} l_i Δφ_i² for joint j, while links turn evenly.
        squares = 0.125 * self.space.arm.lengths * self.turns**2
        return np.pad(np.cumsum(squares, axis=-1), ((0, 0), (1, 0)))

    @cached_property
    def sag_slopes(self) -> FloatArray:
        """Derivatives of ``chord_deviation`` with respect to the coordinates' change in an interval, (K, n + 1, p)."""
        # d(⅛ l Δφ²) = ¼ l Δφ dΔφ, and dΔφ = A dΔv.
        steps = (0.25 * self.space.arm.lengths * self.turns)[..., None] * self.space.turns[: self.space.arm.links]
        slopes = np.zeros((self.intervals, self.space.arm.links + 1, self.space.dimension))
        np.cumsum(steps, axis=-2, out=slopes[:, 1:])
        return slopes

    # ------------------------------------------------------------ what rows need
    def deviation(self, rows: IntervalRows) -> FloatArray:
        """Return upper bounds on how far the points that m rows constrain deviate from their chords, (m,) [m]."""
        return np.asarray(
            self.chord_deviation[rows.interval, rows.high] - self.chord_deviation[rows.interval, rows.low]
        )

    def deviation_slopes(self, rows: IntervalRows) -> FloatArray:
        """Return the derivatives of ``deviation`` with respect to the coordinates' change over the interval, (m, p)."""
        return np.asarray(self.sag_slopes[rows.interval, rows.high] - self.sag_slopes[rows.interval, rows.low])

    def lost(self, rows: IntervalRows) -> FloatArray:
        """Return the clearance that m rows lose within intervals beyond ``deviation``: always 0, shape (m,) [m]."""
        return np.zeros(len(rows))

    def curvature(self, rows: IntervalRows, multipliers: FloatArray, pull: FloatArray) -> RowCurvature:
        """Return the convex part of the Hessian of Σ λ g + pull·tip with respect to the coordinates.

        ``RowCurvature`` holds one part for keyframes and one for the changes over intervals.

        Args:
            rows: contact rows g at the ends of intervals.
            multipliers: multipliers λ of the rows, shape (m,).
            pull: multipliers of the tip position at the last keyframe, shape (2,).
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
        """Return the diagonals of the Hessians of Σ λ g + pull·tip in link headings and in link turns.

        Args:
            rows: contact rows g at the ends of intervals.
            multipliers: multipliers λ of the rows, shape (m,).
            pull: multipliers of the tip position at the last keyframe, shape (2,).

        Returns:
            Second derivatives of the positions with respect to headings, shape (K + 1, links), of any sign, and of the
            chord deviation with respect to turns, shape (K, links).
        """
        space = self.space
        keyframes = len(self.headings)
        links = space.arm.links

        # The sums are taken as −Σ f·x with forces f on a chain: −λn acts on the point that counts positively and λn on
        # the other. The pull at the base balances the one at the tip.
        forces = np.zeros((keyframes, links + 3, 2))
        forces[-1, 0] = pull
        weighted = multipliers[:, None] * rows.normal
        keyframe = rows.interval + rows.share.astype(np.intp)
        np.add.at(forces, (keyframe, rows.minus), weighted)
        np.add.at(forces, (keyframe, rows.plus), -weighted)

        # The mount's end is no joint: a force on it is shared between the joints of its link by the law of the lever.
        link, share = space.arm.mount_end
        forces[:, link] += (1.0 - share) * forces[:, links + 1]
        forces[:, link + 1] += share * forces[:, links + 1]
        # Forces on the fixed point, the last of all, act through the base.
        forces[:, 0] += forces[:, -1]

        chord_deviation = np.zeros((keyframes - 1, links + 1))
        np.add.at(chord_deviation, (rows.interval, rows.low), multipliers)
        np.add.at(chord_deviation, (rows.interval, rows.high), -multipliers)

        # ∂²x_j/∂φ_i² = −l_i (cos φ_i, sin φ_i) for every joint j beyond link i; mixed derivatives vanish, since every
        # link adds a term of its own heading alone. The forces sum to 0: those beyond link i are minus those up to it,
        # and so do the weights of the chord deviation.
        l = space.arm.lengths
        carried = np.cumsum(forces[:, :links], axis=1)
        bent = np.cos(self.headings) * carried[..., 0] + np.sin(self.headings) * carried[..., 1]
        return -l * bent, 0.25 * l * np.cumsum(chord_deviation, axis=1)[:, :links]
