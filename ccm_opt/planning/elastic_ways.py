"""Paths in space that a fed arm can follow with all its links, as elastic bands.

A path through a grid is divided so that m pieces make a link. An arm that slides along the path has its links on chords
x_i, x_{i+m}, so the points x minimise, with lengths in nominal links (twenty-fourths of the arm's length),

    ∫ κ² ds + ∫ |x'|² ds + Σ (lacking gap of a chord)² + Σ (excess of |x_{i-m} − 2 x_i + x_{i+m}|)²,

where the last sum is over the bends of joints at x_i in excess of the bend permitted there, which is small near the
guide tube (S. Quinlan and O. Khatib, Elastic bands: connecting path planning and control, 1993). Each round solves the
linearised problem. Chords begin short, as the path through the grid may pass a bend on its inside, where a whole link
would cross the wall.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solveh_banded

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray, IntArray
from ccm_opt.core.polyline import arc_lengths, points_at
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import bend_shares
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_PIECE = 0.25
"""Maximum length of the pieces of a path, in nominal links."""
_BENDING = (0.02, 0.3)
"""Weights on the bends between consecutive pieces and between consecutive links of a path."""
_TENSION = 0.02
"""Weight on the length of a path."""
_EVEN = 8.0
"""Weight on the differences in length of consecutive pieces, which keeps the points evenly spaced."""
_HARD = 600.0
"""Weight on the shortfall of a chord's gap from the required gap, and on bends beyond the limit."""
_WANTED = 5.0
"""Weight on the shortfall of a chord's gap from the preferred gap."""
_SPARE = 0.03
"""Gap beyond the required one below which the weight ``_HARD`` applies, in nominal links."""
_BENT = 0.9
"""Fraction of the largest permitted bend above which the weight ``_HARD`` applies."""
_SHARPER = 2.0
"""Largest curvature of a path between joints, as a multiple of the curvature of the circle through joints bent to their
limits."""
_GENTLE = 0.7
"""Fraction of the largest permitted bend above which the soft weight on bends applies."""
_STIFFNESS = 1.1
"""Weight on the displacements of points in a relaxation round, which damps the round."""
_LONGEST = 0.3
"""Largest displacement of a point in a round, in nominal links."""
_ROUNDS = 60
"""Maximum number of relaxation rounds."""
_ROUNDS_A_PIECE = 3
"""Number of relaxation rounds after which the chords, which begin shorter than links, become longer by a piece."""
_DIVIDED = (8, 20, 35)
"""Indices of the rounds before which the path is divided into pieces anew, since its length has changed."""
_GIVEN = 1e9
"""Stiffness of given points, which keeps them from moving."""
_STILL = 0.005
"""Largest displacement of a point in a round at which a path counts as converged, in nominal links."""


@dataclass(frozen=True, eq=False)
class ElasticWay:
    """Path for the joints of a fed arm, with measures of how well the arm can follow the path.

    Attributes:
        places: points on the path, from its beginning, shape (k, 3) [m].
        gap: least gap of a link on the path beyond the required distance [m].
        bend: largest bend of a joint on the path, as a fraction of the bend permitted at its position.
        worst: point at which the path is hardest to follow, shape (3,) [m].
    """

    places: FloatArray
    gap: float
    bend: float
    worst: FloatArray

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(arc_lengths(self.places)[-1])


@dataclass(frozen=True, eq=False)
class ElasticBand:
    """Smoother that turns paths through a grid into paths that a fed arm can follow with all its links.

    Attributes:
        arm: the arm.
        tree: tree of the surfaces.
        unit: length u of a nominal link [m].
        kept: required distance of the links' centre lines from surfaces [m].
        wanted: preferred additional distance, kept where possible [m].
    """

    arm: Arm
    tree: SurfaceTree
    unit: float
    kept: float
    wanted: float

    @property
    def pieces(self) -> int:
        """Number of pieces of a path per link."""
        return max(1, round(self.arm.link_length / (_PIECE * self.unit)))

    @property
    def piece(self) -> float:
        """Length of a piece of a path [m]."""
        return self.arm.link_length / self.pieces

    def along(
        self,
        behind: FloatArray,
        way: FloatArray,
        out: float,
        direction: FloatArray | None,
        via: Sequence[FloatArray] = (),
    ) -> ElasticWay | None:
        """Return a smooth path for the joints of the arm near a given tip path, or None if that is too short.

        Args:
            behind: points on the arm's centre line before the beginning of the tip path, spaced by one piece, shape (m,
                3) [m], for m pieces per link.
            way: vertices of the tip path, shape (k, 3) [m].
            out: arc length from the end of the guide tube to the beginning of the tip path [m].
            direction: unit vector from the last joint to the end of the path, shape (3,); None for any direction.
            via: via points to be passed in this order, each of shape (3,) [m].
        """
        m = self.pieces
        band = self._divided(behind, way, out, direction, via)
        for number in range(_ROUNDS):
            if band is None:
                return None
            if number in _DIVIDED:
                band = self._divided(behind, band.places[m:] * self.unit, out, direction, via)
                if band is None:
                    return None
            chord = min(m, 1 + number // _ROUNDS_A_PIECE)
            motion = self._round(band, chord)
            band.places += motion
            if chord == m and number > _DIVIDED[-1] and np.max(np.abs(motion)) < _STILL:
                break
        return None if band is None else self._judged(band)

    def _divided(
        self, behind: FloatArray, way: FloatArray, out: float, direction: FloatArray | None, via: Sequence[FloatArray]
    ) -> "_Band | None":
        """Return a tip path divided into pieces, or None if it is too short; arguments are those of ``along``."""
        m, piece = self.pieces, self.piece
        arcs = arc_lengths(way)
        count = round(float(arcs[-1]) / piece)
        if count < m + 2:
            return None
        places = np.vstack((behind, points_at(way, arcs, np.linspace(0.0, float(arcs[-1]), count + 1))))
        fixed = np.zeros(len(places), dtype=bool)
        fixed[: m + 1] = True
        fixed[-1] = True
        if direction is not None:
            places[-m - 1 :] = way[-1] - piece * np.arange(m, -1, -1.0)[:, None] * direction
            fixed[-m - 1] = True
        for place in via:
            nearest = int(np.argmin(np.linalg.norm(places - place, axis=1)))
            places[nearest] = place
            fixed[nearest] = True
        arcs_out = np.asarray(out + piece * np.arange(-m, count + 1), dtype=np.float64)
        straight = 2.0 * self.arm.link_length * np.sin(0.5 * min(self.arm.joint_limit, 0.5 * np.pi)) / self.unit
        return _Band(places / self.unit, fixed, straight * bend_shares(self.arm, arcs_out), m, piece / self.unit)

    def _round(self, band: "_Band", chord: int) -> FloatArray:
        """Return the displacements of the points of a path in one round of relaxation, (k, 3) [nominal links].

        Args:
            band: the path.
            chord: number of pieces spanned by each of the chords that are kept away from surfaces.
        """
        places = band.places
        system = band.equations()
        # Bends beyond the limits.
        for stride in {1, band.m}:
            change, bend, most = band.bends(stride)
            for begin, heavy in ((_BENT, _HARD), (_GENTLE, _WANTED)):
                over = np.flatnonzero(bend > begin * most)
                at = over[:, None] + stride * np.arange(3)
                normals = change[over] / bend[over, None]
                excess = begin * most[over] - bend[over]
                system.add(at, np.array([1.0, -2.0, 1.0]), normals, heavy * band.piece, excess)
        # Chords too near to surfaces.
        kept, wide = (self.kept + gap for gap in (_SPARE * self.unit, max(self.wanted, 2.0 * _SPARE * self.unit)))
        seen = self.tree.nearest(band.chords(chord) * self.unit, wide)
        near = np.flatnonzero(seen.gap < wide)
        gap = seen.gap[near]
        share = seen.share[near]
        hard = gap < kept
        shortfall = (np.where(hard, kept, wide) - gap) / self.unit
        at = np.stack((near, near + chord), axis=1)
        weight = np.where(hard, _HARD, _WANTED) * band.piece
        system.add(at, np.stack((1.0 - share, share), axis=1), seen.normal[near], weight, shortfall)
        # Pieces of even length.
        along = np.diff(places, axis=0)
        long = np.linalg.norm(along, axis=1)
        at = np.arange(len(along))[:, None] + np.arange(2)
        system.add(at, np.array([-1.0, 1.0]), along / long[:, None], _EVEN, float(np.mean(long)) - long)
        motion = system.solved(band.fixed)
        far = np.linalg.norm(motion, axis=1)
        return np.asarray(motion * np.minimum(1.0, _LONGEST / np.maximum(far, TINY))[:, None])

    def _judged(self, band: "_Band") -> ElasticWay:
        """Return a relaxed path in metres, with its least gap, largest relative bend and worst point."""
        m = band.m
        count = len(band.places)
        share = np.zeros(count)
        for stride in {1, m}:
            _, bend, most = band.bends(stride)
            # What is given at both ends is not the path's fault.
            given = band.fixed[stride:-stride] & band.fixed[: -2 * stride] & band.fixed[2 * stride :]
            inner = share[stride:-stride]
            inner[:] = np.maximum(inner, np.where(given, 0.0, bend / most))
        gaps = self.tree.distances(band.chords(m) * self.unit, self.kept + self.wanted) - self.kept
        gaps = np.where(band.fixed[:-m] & band.fixed[m:], self.wanted, gaps)
        # The places at both ends are on every path.
        ends = min(m + round(1.0 / band.piece), (count - 1) // 2)
        about = slice(ends, count - ends)
        shortfall = np.zeros(count)
        shortfall[m // 2 : m // 2 + len(gaps)] = -gaps
        worst = ends + int(np.argmax(share[about] if np.max(share) > 1.0 or np.min(gaps) > 0.0 else shortfall[about]))
        places = band.places * self.unit
        return ElasticWay(places[m:], float(np.min(gaps)), float(np.max(share)), places[worst])


@dataclass(eq=False)
class _Band:
    """Path divided into pieces, in the relaxation of an elastic band; all lengths are in nominal links.

    Attributes:
        places: points spaced by one piece, those on the arm first, shape (k, 3).
        fixed: mask of the given points, which do not move, shape (k,).
        most: second difference of the points over a link's length for a joint at its largest permitted bend, at each
            point, shape (k,).
        m: number of pieces per link.
        piece: length of a piece.
        stiffness: main and lower diagonals of the terms that do not change between rounds, shape (2 m + 1, k).
    """

    places: FloatArray
    fixed: BoolArray
    most: FloatArray
    m: int
    piece: float
    stiffness: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.places)
        self.stiffness = np.zeros((2 * self.m + 1, count))
        terms: list[tuple[int, tuple[float, ...], float]] = [(1, (-1.0, 1.0), _TENSION / self.piece)]
        for stride, weight in dict(zip((1, self.m), _BENDING, strict=True)).items():
            terms.append((stride, (1.0, -2.0, 1.0), weight * self.piece / (stride * self.piece) ** 4))
        for stride, stencil, weight in terms:
            inner = count - stride * (len(stencil) - 1)
            for a, first in enumerate(stencil):
                for b, second in enumerate(stencil[: a + 1]):
                    self.stiffness[(a - b) * stride, b * stride : b * stride + inner] += weight * first * second

    def equations(self) -> "_Equations":
        """Return normal equations with only those terms that are the same in all relaxation rounds."""
        target = -self.stiffness[0][:, None] * self.places
        for d in range(1, len(self.stiffness)):
            below = self.stiffness[d, :-d, None]
            target[d:] -= below * self.places[:-d]
            target[:-d] -= below * self.places[d:]
        matrix = np.zeros((3 * len(self.stiffness), target.size))
        matrix[::3] = np.repeat(self.stiffness, 3, axis=1)
        matrix[0] += _STIFFNESS * self.piece
        return _Equations(matrix, target.ravel())

    def bends(self, stride: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return second differences of the points over ``stride`` pieces, their norms, and the largest permitted norms.

        Args:
            stride: number of pieces, m for a whole link; with fewer, the path may bend slightly more sharply.

        Returns:
            Shapes (k − 2 stride, 3), (k − 2 stride,) and (k − 2 stride,).
        """
        places = self.places
        change = places[: -2 * stride] - 2.0 * places[stride:-stride] + places[2 * stride :]
        most = self.most[stride:-stride]
        if stride < self.m:
            most = _SHARPER * (stride / self.m) ** 2 * (most + _SPARE)
        return change, np.maximum(np.linalg.norm(change, axis=1), TINY), np.maximum(most, TINY)

    def chords(self, pieces: int) -> FloatArray:
        """Return both ends of the chords over a number of pieces, shape (k − pieces, 2, 3) [nominal links]."""
        return np.stack((self.places[:-pieces], self.places[pieces:]), axis=1)


@dataclass(eq=False)
class _Equations:
    """Normal equations for the displacements of k points, with a banded symmetric matrix.

    Attributes:
        matrix: main and lower diagonals of the matrix, shape (d, 3 k).
        target: right-hand side, shape (3 k,).
    """

    matrix: FloatArray
    target: FloatArray

    def add(
        self, at: IntArray, stencil: FloatArray, normals: FloatArray, weight: float | FloatArray, value: FloatArray
    ) -> None:
        """Add the least-squares terms weight · (Σ_a stencil_a · normal · displacement_a − value)² to the equations.

        Args:
            at: indices of the a points that occur in each of the r terms, shape (r, a).
            stencil: coefficients of these points, shape (a,) or (r, a).
            normals: unit vectors, shape (r, 3).
            weight: weights, shape (r,) or one for all.
            value: values, shape (r,).
        """
        rows = (np.broadcast_to(stencil, at.shape)[:, :, None] * normals[:, None]).reshape(len(at), 3 * at.shape[1])
        columns = (3 * at[:, :, None] + np.arange(3)).reshape(rows.shape)
        weighted = rows * np.broadcast_to(weight, len(at))[:, None]
        self.target += np.bincount(columns.ravel(), (weighted * value[:, None]).ravel(), self.target.size)
        below = columns[:, :, None] - columns[:, None]
        lower = below >= 0
        flat = below * self.target.size + columns[:, None]
        products = weighted[:, :, None] * rows[:, None]
        self.matrix += np.bincount(flat[lower], products[lower], self.matrix.size).reshape(self.matrix.shape)

    def solved(self, fixed: BoolArray) -> FloatArray:
        """Return the displacements of the points that solve the equations, (k, 3); those masked by ``fixed`` are 0."""
        held = np.repeat(fixed, 3)
        self.matrix[0, held] = _GIVEN
        self.target[held] = 0.0
        motion = solveh_banded(self.matrix, self.target, lower=True)
        motion[held] = 0.0
        return motion.reshape(-1, 3)
