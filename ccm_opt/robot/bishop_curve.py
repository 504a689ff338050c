"""Curves in space: segments of curvature about two axes, and where they lead.

The curve is t' = κ1 n1 + κ2 n2, n_i' = −κ_i t in the frame (t, n1, n2) that does not turn about the curve (Bishop,
"There is more than one way to frame a curve", 1975). It has no singularity where the curve is straight, where that of
Frenet has one, and the plane of t and n1 is κ2 = 0: there the segment is the paper's (section 2.1).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.configuration import Curve
from ccm_opt.robot.rigid_motions import carried, chained
from ccm_opt.robot.segment import EVEN_KNOTS, CurvatureSegment, Knots

_NODES = np.polynomial.legendre.leggauss(3)[0]
_LINK_NODES, _LINK_WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Gauss points over a link; the direction is a smooth function but for knots, where its third derivative jumps."""
MOST_TURN = 0.05
"""Most that a curve turns in one step of its integration [rad]; the sixth order then errs by less than 1e-12."""
LEAST_STEPS = 40
"""Steps to a segment at least, so that its curvature changes little within one."""
_PROBES = 5
"""Places between two knots at which the curvature is looked at for the size of steps."""


@dataclass(frozen=True)
class SpaceSegment:
    """The triple (L, start direction, C) of the paper with two curvatures on the same knots.

    Attributes:
        length: L, positive [m].
        frame: (t, n1, n2) at s = 0 as columns, a rotation, shape (3, 3).
        curvature: κ1 and κ2 at the five knots, shape (5, 2) [1/m].
        knots: S_b, S_c, S_d with 0 < S_b < S_c < S_d < 1.
    """

    length: float
    frame: FloatArray
    curvature: FloatArray
    knots: Knots = EVEN_KNOTS

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
        columns = np.asarray(self.curvature, dtype=np.float64).T
        first, second = (CurvatureSegment(self.length, 0.0, values, self.knots) for values in columns)
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


@dataclass(frozen=True)
class SpaceConfiguration(Curve):
    """Curvature segments end to end; place and frame are continuous across them.

    Attributes:
        base: position of the base, shape (3,) [m].
        segments: at least one; each starts with the frame with which the one before ends.
    """

    segments: tuple[SpaceSegment, ...]

    @classmethod
    def chain(
        cls,
        base: FloatArray,
        frame: FloatArray,
        lengths: Sequence[float],
        curvatures: Sequence[FloatArray],
        knots: Sequence[Knots] | None = None,
    ) -> "SpaceConfiguration":
        """Join segments end to end from a base frame; the frames of the others follow.

        Args:
            base: shape (3,) [m].
            frame: (t, n1, n2) at the base as columns, shape (3, 3).
            lengths: of the segments [m].
            curvatures: five pairs a segment, each of shape (5, 2) [1/m].
            knots: three a segment; even knots when None.
        """
        segments: list[SpaceSegment] = []
        for k, (length, curvature) in enumerate(zip(lengths, curvatures, strict=True)):
            inner = knots[k] if knots else EVEN_KNOTS
            segment = SpaceSegment(float(length), frame, np.asarray(curvature, dtype=np.float64), inner)
            segments.append(segment)
            frame = segment.end[0]
        return cls(np.asarray(base, dtype=np.float64), tuple(segments))

    @property
    def base_frame(self) -> FloatArray:
        """(t, n1, n2) at the base as columns, shape (3, 3)."""
        return self.segments[0].frame

    def curvature_at(self, arc: FloatArray) -> FloatArray:
        """κ1 and κ2 at increasing arc lengths in [0, L], shape (m,) to (m, 2) [1/m]."""
        return np.concatenate([part.curvature_at(inside) for part, inside in self._parts(arc)])

    def frames_at(self, arc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frames and positions at increasing arc lengths in [0, L], of shape (m,) [m].

        Returns:
            Rotations with columns t, n1, n2, shape (m, 3, 3), and positions, shape (m, 3) [m].
        """
        found = [part.frames_at(inside) for part, inside in self._parts(arc)]
        places = [start + place for start, (_, place) in zip(self._starts, found, strict=True)]
        return np.concatenate([frames for frames, _ in found]), np.concatenate(places)

    def positions_at(self, arc: FloatArray) -> FloatArray:
        """Positions at increasing arc lengths in [0, L], shape (m, 3) [m]."""
        return self.frames_at(arc)[1]

    def mean_directions(self, links: int) -> FloatArray:
        """Mean direction over each of ``links`` equal lengths, shape (links, 3).

        The mean is that of the turns from the frame in the middle: in the plane that of the headings.
        """
        length = self.length / links
        middles = length * (np.arange(links) + 0.5)
        arcs = middles[:, None] + 0.5 * length * np.append(_LINK_NODES, 0.0)
        order = np.argsort(arcs.ravel())
        frames = np.empty((links * arcs.shape[1], 3, 3))
        frames[order] = self.frames_at(arcs.ravel()[order])[0]
        frames = frames.reshape(links, -1, 3, 3)
        middle = frames[:, -1]
        local = np.einsum("nij,nki->nkj", middle, frames[:, :-1, :, 0])
        sideways = np.linalg.norm(local[..., 1:], axis=-1)
        angle = np.arctan2(sideways, local[..., 0])
        turns = local[..., 1:] * (angle / np.maximum(sideways, np.finfo(np.float64).tiny))[..., None]
        mean = 0.5 * np.einsum("k,nkd->nd", _LINK_WEIGHTS, turns)
        size = np.linalg.norm(mean, axis=1)
        ahead = np.concatenate((np.cos(size)[:, None], np.sinc(size / np.pi)[:, None] * mean), axis=1)
        return np.asarray(np.einsum("nij,nj->ni", middle, ahead))

    @cached_property
    def tip(self) -> tuple[FloatArray, FloatArray]:
        """Position (3,) [m] and direction (3,) of the tip."""
        last = self.segments[-1]
        return self._starts[-1] + last.end[1], last.end[0][:, 0]

    @cached_property
    def _starts(self) -> FloatArray:
        """Where every segment begins, shape (segments, 3) [m]."""
        moved = np.array([segment.end[1] for segment in self.segments[:-1]]).reshape(-1, 3)
        return np.asarray(self.base + np.concatenate((np.zeros((1, 3)), np.cumsum(moved, axis=0))))

    def _parts(self, arc: FloatArray) -> list[tuple[SpaceSegment, FloatArray]]:
        """Every segment with the arc lengths that lie on it, from its own beginning."""
        arc = np.asarray(arc, dtype=np.float64)
        cuts = np.searchsorted(arc, self.boundaries[1:-1])
        inside = np.split(arc, cuts)
        return [
            (segment, np.clip(part - start, 0.0, segment.length))
            for segment, part, start in zip(self.segments, inside, self.boundaries[:-1], strict=True)
        ]
