"""The certificate of motions that a user's gaps have to keep too: sampled within every interval, with a reserve.

Equations are not looked at here: between keyframes a motion leaves them by the square of the step, and the path that
is laid through the keyframes in the end is brought back onto them.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.collision.certificate import MAX_DEPTH, Certificate
from ccm_opt.motion.constrained.rows import KEEP_SHARE, MARGIN, slope_norms

if TYPE_CHECKING:
    from ccm_opt.user_terms.row_set import RowSet

RESERVE = 0.02
"""Share of the margin that a gap keeps between keyframes, for what lies between samples."""
SAMPLES = 4
"""Samples of an interval."""
ALLOWED = 1e-6
"""By which a gap may be missed, in the user's unit."""
NEAR_END = 0.1
"""Share of the intervals at either end at which a gap may be as narrow as at that end."""


@dataclass(frozen=True)
class OwnCertificate(Certificate):
    """Certifies that nothing touches and that a user's gaps are kept.

    Attributes:
        rows: of the constraints on the way.
    """

    rows: "RowSet | None" = field(default=None)

    @classmethod
    def around(cls, certificate: Certificate, rows: "RowSet") -> "OwnCertificate":
        """The same certificate with gaps to keep."""
        return cls(certificate.arm, certificate.workspace, certificate.spare, rows)

    def failures(self, headings: FloatArray, depth: int = MAX_DEPTH) -> IntArray:
        """Intervals that cannot be certified; arguments as for ``Certificate.failures``."""
        return np.union1d(super().failures(headings, depth), self.broken(headings))

    def broken(self, headings: FloatArray) -> IntArray:
        """Intervals of a piecewise-linear motion in which a gap is less than its reserve, sorted.

        Args:
            headings: link headings at the keyframes, shape (K, links) [rad].
        """
        if self.rows is None or not self.lasting.any():
            return np.zeros(0, dtype=np.intp)
        intervals = len(headings) - 1
        share = np.arange(SAMPLES * intervals + 1) / SAMPLES
        k = np.minimum(share.astype(np.intp), intervals - 1)
        between = headings[k] + (share - k)[:, None] * (headings[k + 1] - headings[k])
        gaps = self.rows.table(between)[:, self.lasting]
        short = ~(gaps >= self._reserve(gaps, headings[[0, -1]])).all(axis=1)
        beside = np.concatenate((k[short], np.maximum(np.ceil(share[short]).astype(np.intp) - 1, 0)))
        return np.unique(beside)

    @property
    def lasting(self) -> BoolArray:
        """Which rows are gaps that hold over the whole motion."""
        rows = self.rows
        if rows is None:
            return np.zeros(0, dtype=bool)
        kept: BoolArray = ~rows.equal & (rows.first <= 0.0) & (rows.last >= 1.0) & ~rows.parametric
        return kept

    def _reserve(self, gaps: FloatArray, ends: FloatArray) -> FloatArray:
        """Least gap at every sample, shape (N, rows): the reserve, but near an end no more than that end has."""
        rows = self.rows
        if rows is None:
            return np.zeros_like(gaps)
        slopes = np.stack([slope_norms(np.asarray(rows.slopes(end, 0.0, 0.0)[1])) for end in ends])[:, self.lasting]
        reserve = np.broadcast_to(RESERVE * KEEP_SHARE * MARGIN * slopes.max(axis=0), gaps.shape).copy()
        near = max(1, round(NEAR_END * len(gaps)))
        reserve[:near] = np.minimum(reserve[:near], np.maximum(gaps[0], -ALLOWED))
        reserve[-near:] = np.minimum(reserve[-near:], np.maximum(gaps[-1], -ALLOWED))
        return reserve
