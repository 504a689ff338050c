"""Check that the arm sees the required share of surfaces from the goals at which it rests.

The pieces of the surfaces and the lines of sight to them are the verifier's own: ``scene.surface_pieces`` divides
surfaces likewise, for planning; the verifier deliberately does not use it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.problem import Coverage, Problem
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.scene.workspace import BOUNDARY_NAME, ROOM_NAME, Workspace
from ccm_opt.verification.chain_motion import ChainMotion, pointing
from ccm_opt.verification.sight import SIGHT_HALF_ANGLE, free_half_angles
from ccm_opt.verification.wall_clearance import CheckedSurfaces, edges_of

_ROUNDING = 1e-9
"""Angle [rad], length relative to another, share, and distance from the side of a box [m] that count as rounding."""
_AT_ONCE = 400
"""Number of lines of sight that are checked at once. Heuristic: some ten megabytes."""


@dataclass(frozen=True, eq=False)
class SeenPieces:
    """Pieces of the surfaces that have to be seen.

    Attributes:
        corners: corners of the m pieces, shape (m, d, d) [m].
        sizes: lengths, in space areas, shape (m,) [m, m²].
        seen: mask of those that are seen, shape (m,).
    """

    corners: FloatArray
    sizes: FloatArray
    seen: BoolArray

    @property
    def share(self) -> float:
        """Fraction of the surfaces that is seen; 0 if there are none."""
        whole = float(np.sum(self.sizes))
        return float(np.sum(self.sizes[self.seen])) / whole if whole > 0.0 else 0.0


def check_coverage(problem: Problem, motion: ChainMotion, trajectory: JointTrajectory) -> list[Check]:
    """Check that the required share of surfaces is seen from the goals for the tip at which the arm rests.

    Args:
        problem: problem of the goals that are visited, in the order of the visits.
        motion: motion of the arm, with its tool.
        trajectory: the sampled motion.

    Returns:
        One check; none if nothing has to be seen.
    """
    coverage = problem.coverage
    if coverage is None:
        return []
    samples = viewing_samples(problem, trajectory)
    found = seen_pieces(problem.workspace, coverage, motion, samples)
    where = f"{int(np.sum(found.seen))} of {len(found.seen)} pieces from {len(samples)} views"
    passed = found.share >= coverage.share - _ROUNDING
    return [Check("surface seen", 100.0 * found.share, 100.0 * coverage.share, "%", where, passed=passed)]


def viewing_samples(problem: Problem, trajectory: JointTrajectory) -> list[int]:
    """Return the indices of the samples in which the arm rests at a goal for the tip."""
    samples = [*trajectory.stops, len(trajectory.time) - 1]
    return [k for k, stop in zip(samples, problem.goals, strict=True) if stop.goal.for_tip is not None]


def seen_pieces(workspace: Workspace, coverage: Coverage, motion: ChainMotion, samples: Sequence[int]) -> SeenPieces:
    """Return which pieces of surfaces the arm sees in any of several samples of its motion.

    Args:
        workspace: the obstacles.
        coverage: the surfaces, and how they have to be seen.
        motion: motion of the arm, with its tool.
        samples: indices of the samples.
    """
    corners, sizes, normals = _pieces(workspace, coverage)
    surfaces = CheckedSurfaces.from_workspace(workspace)
    seen = np.zeros(len(corners), dtype=bool)
    for sample in samples:
        left = np.flatnonzero(~seen)
        places = corners[left].mean(axis=1)
        seen[left] = seen_places(workspace, coverage, motion, places, normals[left], sample, surfaces)
    return SeenPieces(corners, sizes, seen)


def seen_places(
    workspace: Workspace,
    coverage: Coverage,
    motion: ChainMotion,
    places: FloatArray,
    normals: FloatArray,
    sample: int = 0,
    surfaces: CheckedSurfaces | None = None,
) -> BoolArray:
    """Return which places the arm sees in a sample of its motion, shape (m,).

    Args:
        workspace: the obstacles.
        coverage: distances, field of view, and angle.
        motion: motion of the arm, with its tool.
        places: the places, shape (m, d) [m].
        normals: unit normals of the surfaces there, to either side, shape (m, d).
        sample: index of the sample.
        surfaces: bounding-box tree of the obstacles; None to build it here.
    """
    surfaces = surfaces or CheckedSurfaces.from_workspace(workspace)
    sights = places - motion.points[sample, -1]
    away = np.linalg.norm(sights, axis=1)
    least, most = coverage.distance
    slack = _ROUNDING * most
    lines = sights / np.maximum(away, np.finfo(np.float64).tiny)[:, None]
    ahead = _angles(lines, pointing(motion, sample)) <= 0.5 * coverage.field_of_view + _ROUNDING
    square = np.minimum(_angles(lines, normals), _angles(lines, -normals)) <= coverage.angle + _ROUNDING
    seen = (away >= least - slack) & (away <= most + slack) & ahead & square
    maybe = np.flatnonzero(seen)
    for few in np.array_split(maybe, max(-(-len(maybe) // _AT_ONCE), 1)):
        free, _ = free_half_angles(surfaces, motion, sample, places[few], workspace.surface_errors)
        seen[few] = free >= SIGHT_HALF_ANGLE
    return np.asarray(seen)


def _angles(lines: FloatArray, others: FloatArray) -> FloatArray:
    """Return the angles between unit vectors (m, d) and others, accurate for small angles too, shape (m,) [rad]."""
    apart, along = np.linalg.norm(lines - others, axis=1), np.linalg.norm(lines + others, axis=1)
    return np.asarray(2.0 * np.arctan2(apart, along))


def _pieces(workspace: Workspace, coverage: Coverage) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return corners (m, d, d) [m], sizes (m,) [m, m²] and unit normals (m, d) of the pieces of surfaces."""
    flat = workspace.dimension == 2
    if flat:
        parts, _, owner, names = edges_of(workspace)
    else:
        soup = workspace.triangle_soup
        parts, owner, names = soup.triangles, soup.owner, soup.names
    wanted = {BOUNDARY_NAME if flat and name == ROOM_NAME else name for name in coverage.surfaces}
    mine = np.isin(owner, [k for k, name in enumerate(names) if name in wanted])
    pieces = [_divided(part, coverage.spacing) for part in parts[mine]]
    corners = np.concatenate([np.zeros((0, *parts.shape[1:])), *pieces])
    if coverage.within is not None:
        beyond = np.maximum(coverage.within[0] - corners.mean(axis=1), corners.mean(axis=1) - coverage.within[1])
        corners = corners[np.all(beyond <= _ROUNDING, axis=1)]
    line = corners[:, 1] - corners[:, 0]
    if flat:
        return corners, np.linalg.norm(line, axis=1), _unit(line[:, ::-1] * np.array([1.0, -1.0]))
    across = np.cross(line, corners[:, 2] - corners[:, 1])
    return corners, 0.5 * np.linalg.norm(across, axis=1), _unit(across)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), np.finfo(np.float64).tiny)[:, None])


def _divided(part: FloatArray, spacing: float) -> FloatArray:
    """Return the pieces of an edge or triangle (d, d), as few equal ones as have no edge longer than the spacing."""
    sides = [np.linalg.norm(part[k] - part[k - 1]) for k in range(len(part))]
    count = max(int(np.ceil(max(sides) / spacing - _ROUNDING)), 1)
    steps = (part[1:] - part[0]) / count
    if len(part) == 2:
        ends = part[0] + np.arange(count + 1)[:, None] * steps[0]
        return np.stack((ends[:-1], ends[1:]), axis=1)
    lattice: list[tuple[FloatArray, ...]] = []
    for row in range(count):
        for column in range(count - row):
            corner = part[0] + row * steps[0] + column * steps[1]
            lattice.append((corner, corner + steps[0], corner + steps[1]))
            if row + column < count - 1:
                lattice.append((corner + steps[0] + steps[1], corner + steps[1], corner + steps[0]))
    return np.array(lattice)
