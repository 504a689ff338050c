"""A curvature segment in space: a length, a start direction and five-point cubic splines of both curvatures.

The curve is t' = κ1 n1 + κ2 n2, n_i' = −κ_i t in the frame (t, n1, n2) that does not turn about the curve (Bishop,
"There is more than one way to frame a curve", 1975). It has no singularity where the curve is straight, where that of
Frenet has one, and the plane of t and n1 is κ2 = 0: there the segment is the paper's (section 2.1).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ccm_opt.continuum.segment import EVEN_KNOTS, CurvatureSegment, Knots
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.curve.rigid_motions import carried, chained

_NODES = np.polynomial.legendre.leggauss(3)[0]
MOST_TURN = 0.05
"""Most that a curve turns in one step of its integration [rad]; the sixth order then errs by less than 1e-12."""
LEAST_STEPS = 40
"""Steps to a segment at least, so that its curvature changes little within one."""
_PROBES = 5
"""Places between two knots at which the curvature is looked at for the size of steps."""
Moments: TypeAlias = tuple[tuple[float, float], tuple[float, float]]
"""Second derivatives of κ1 and of κ2 at both ends of a segment."""
NO_MOMENTS: Moments = ((0.0, 0.0), (0.0, 0.0))
"""Second derivatives of both curvatures at the ends of a natural spline."""


@dataclass(frozen=True)
class SpaceSegment:
    """The triple (L, start direction, C) of the paper with two curvatures on the same knots.

    Attributes:
        length: L, positive [m].
        frame: (t, n1, n2) at s = 0 as columns, a rotation, shape (3, 3).
        curvature: κ1 and κ2 at the five knots, shape (5, 2) [1/m].
        knots: S_b, S_c, S_d with 0 < S_b < S_c < S_d < 1.
        moments: second derivatives of κ1 and of κ2 at both ends [1/m³]; the paper's segments have none.
    """

    length: float
    frame: FloatArray
    curvature: FloatArray
    knots: Knots = EVEN_KNOTS
    moments: Moments = NO_MOMENTS

    def __post_init__(self) -> None:
        if np.shape(self.curvature) != (5, 2):
            raise ValueError(f"a segment in space has five pairs of curvatures, got shape {np.shape(self.curvature)}")
        if np.shape(self.frame) != (3, 3):
            raise ValueError(f"a segment in space starts with a frame of shape (3, 3), got {np.shape(self.frame)}")
        _ = self.planar  # which refuses lengths and knots that are none

    @property
    def direction(self) -> FloatArray:
        """Direction of the curve where the segment begins, shape (3,)."""
        return self.frame[:, 0]

    @cached_property
    def planar(self) -> tuple[CurvatureSegment, CurvatureSegment]:
        """The segments of the plane with one of both curvatures each; their headings are its turns ∫κ ds."""
        pairs = zip(np.asarray(self.curvature, dtype=np.float64).T, self.moments, strict=True)
        first, second = (CurvatureSegment(self.length, 0.0, values, self.knots, ends) for values, ends in pairs)
        return first, second

    @property
    def breakpoints(self) -> FloatArray:
        """Arc lengths of the five knots, shape (5,) [m]."""
        return self.planar[0].breakpoints

    def curvature_at(self, arc: FloatArray) -> FloatArray:
        """κ1 and κ2 at arc lengths in [0, L], shape (...) to (..., 2) [1/m]."""
        return np.stack([part.curvature_at(arc) for part in self.planar], axis=-1)

    def frames_at(self, arc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frames and places at increasing arc lengths in [0, L], of shape (m,) [m].

        Returns:
            Rotations with columns t, n1, n2, shape (m, 3, 3), and places from the segment's beginning, shape (m, 3).
        """
        edges = self._steps(np.unique(np.concatenate((self.breakpoints, arc))))
        half = 0.5 * np.diff(edges)
        curvature = self.curvature_at(edges[:-1, None] + half[:, None] * (_NODES + 1.0))
        twists = np.zeros((len(half), len(_NODES), 6))
        # κ1 turns t towards n1, that is about n2; κ2 turns t towards n2, that is about −n1. The frame goes along t.
        twists[..., 1] = -curvature[..., 1]
        twists[..., 2] = curvature[..., 0]
        twists[..., 3] = 1.0
        frames, places = chained(self.frame, *carried(twists, 2.0 * half))
        at = np.searchsorted(edges, arc)
        return frames[at], places[at]

    @cached_property
    def end(self) -> tuple[FloatArray, FloatArray]:
        """Frame (3, 3) at the segment's end, and its place from the beginning, (3,) [m]."""
        frames, places = self.frames_at(np.array([self.length]))
        return frames[0], places[0]

    def _steps(self, edges: FloatArray) -> FloatArray:
        """Arc lengths so near to each other, the edges among them, that the curve hardly turns between two."""
        probes = np.linspace(edges[:-1], edges[1:], _PROBES)
        sharpest = np.linalg.norm(self.curvature_at(probes), axis=-1).max(axis=0)
        # Where the curve is nearly straight its curvature may still change much on the way.
        per_step = np.maximum(sharpest / MOST_TURN, LEAST_STEPS / self.length)
        counts = np.maximum(1, np.ceil(np.diff(edges) * per_step)).astype(np.intp)
        first = np.repeat(np.cumsum(counts) - counts, counts)
        share = (np.arange(counts.sum()) - first) / np.repeat(counts, counts)
        return np.append(np.repeat(edges[:-1], counts) + share * np.repeat(np.diff(edges), counts), edges[-1])
