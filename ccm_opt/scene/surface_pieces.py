"""Division of surfaces into pieces, each of which is seen or not: edges in the plane, triangles in space."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.scene.workspace import BOUNDARY_NAME, ROOM_NAME, Workspace

MOST_PIECES = 20_000
"""Largest number of pieces; finer divisions are refused. Derived: some minutes of work on lines of sight."""
_ROUNDING = 1e-9
"""Excess of a length over the spacing, and of a centre over the sides of a box, that counts as rounding."""


@dataclass(frozen=True, eq=False)
class SurfacePieces:
    """Pieces of surfaces.

    Attributes:
        corners: corners of the m pieces, shape (m, d, d) [m].
        owner: index of the obstacle to which each belongs, shape (m,).
    """

    corners: FloatArray
    owner: IntArray

    @cached_property
    def centres(self) -> FloatArray:
        """Centres of the pieces, shape (m, d) [m]."""
        return np.asarray(self.corners.mean(axis=1))

    @cached_property
    def sizes(self) -> FloatArray:
        """Lengths, in space areas, of the pieces, shape (m,) [m, m²]."""
        return np.asarray(np.linalg.norm(self._across, axis=1) / (self.corners.shape[1] - 1))

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals of the pieces, to either side, shape (m, d); zeros for pieces without extent."""
        lengths = np.linalg.norm(self._across, axis=1, keepdims=True)
        return np.asarray(self._across / np.where(lengths > 0.0, lengths, 1.0))

    @cached_property
    def _across(self) -> FloatArray:
        edges = self.corners[:, 1:] - self.corners[:, :1]
        if edges.shape[2] == 2:
            return np.stack((edges[:, 0, 1], -edges[:, 0, 0]), axis=1)
        return np.asarray(np.cross(edges[:, 0], edges[:, 1]))

    @classmethod
    def of(
        cls, workspace: Workspace, names: Collection[str], spacing: float, within: FloatArray | None
    ) -> "SurfacePieces":
        """Divide surfaces into pieces without an edge longer than a spacing.

        An edge is divided into equal parts, a triangle into triangles similar to it, as few as that takes.

        Args:
            workspace: the obstacles.
            names: names of the surfaces; "room" stands for the boundary of a planar workspace too.
            spacing: largest length of an edge of a piece [m].
            within: lower and upper corner of a box, shape (2, d) [m]; only pieces with their centres in it are kept.
                None keeps all.
        """
        parts, owner = _named_parts(workspace, names)
        counts = _divisions(parts, spacing)
        divided = [np.zeros((0, *parts.shape[1:])), *map(_divided, parts, counts.tolist())]
        pieces = cls(np.concatenate(divided), np.repeat(owner, counts ** (workspace.dimension - 1)))
        if within is None:
            return pieces
        low, high = within[0] - _ROUNDING, within[1] + _ROUNDING
        kept = np.all((pieces.centres >= low) & (pieces.centres <= high), axis=1)
        return cls(pieces.corners[kept], pieces.owner[kept])


def piece_count(workspace: Workspace, names: Collection[str], spacing: float) -> int:
    """Return the number of pieces into which surfaces are divided, without those that a box leaves out."""
    parts, _ = _named_parts(workspace, names)
    return int(np.sum(_divisions(parts, spacing).astype(np.float64) ** (workspace.dimension - 1)))


def surface_centre(workspace: Workspace, names: Collection[str]) -> FloatArray:
    """Return the centre of the bounding box of surfaces, shape (d,) [m]; zeros if there are none."""
    parts, _ = _named_parts(workspace, names)
    corners = parts.reshape(-1, workspace.dimension)
    return np.zeros(workspace.dimension) if len(corners) == 0 else 0.5 * (corners.min(axis=0) + corners.max(axis=0))


def without_flat_parts(workspace: Workspace, names: Collection[str]) -> list[str]:
    """Return those of the given names of surfaces that do not exist, or are round and have no pieces."""
    soup = workspace.triangle_soup
    every = np.array(soup.names)[soup.owner] if len(soup) else np.zeros(0, dtype=str)
    round_ones = soup.rounding > workspace.surface_errors[soup.owner] * (1.0 + _ROUNDING)
    scanned = np.all(soup.triangles == soup.triangles[:, :1], axis=(1, 2))
    missing = []
    for name in names:
        mine = every == _own_name(workspace, name)
        if not np.any(mine) or np.any(round_ones[mine] | scanned[mine]):
            missing.append(name)
    return missing


def _own_name(workspace: Workspace, name: str) -> str:
    return BOUNDARY_NAME if name == ROOM_NAME and workspace.dimension == 2 else name


def _named_parts(workspace: Workspace, names: Collection[str]) -> tuple[FloatArray, IntArray]:
    """Return the edges or triangles of surfaces, shape (k, d, d) [m], and their obstacles' indices, (k,)."""
    soup = workspace.triangle_soup
    wanted = {_own_name(workspace, name) for name in names}
    mine: BoolArray = np.isin(soup.owner, [k for k, name in enumerate(soup.names) if name in wanted])
    triangles = soup.triangles[mine]
    return (triangles[:, :2, :2] if workspace.dimension == 2 else triangles), soup.owner[mine]


def _divisions(parts: FloatArray, spacing: float) -> IntArray:
    """Return into how many parts each edge of edges or triangles (k, d, d) is divided, shape (k,)."""
    longest = np.max(np.linalg.norm(parts - np.roll(parts, 1, axis=1), axis=2), axis=1, initial=0.0)
    return np.asarray(np.maximum(np.ceil(longest / spacing - _ROUNDING), 1.0), dtype=np.intp)


def _divided(part: FloatArray, count: int) -> FloatArray:
    """Return the pieces of an edge or triangle (d, d) whose edges are divided into a number of parts each."""
    if len(part) == 2:
        points = part[0] + np.linspace(0.0, 1.0, count + 1)[:, None] * (part[1] - part[0])
        return np.stack((points[:-1], points[1:]), axis=1)
    row, column = (index.ravel() for index in np.indices((count, count)))
    upright = row + column < count
    turned = row + column < count - 1
    cells = [
        np.stack((row, column, row + 1, column, row, column + 1), axis=1)[upright],
        np.stack((row + 1, column + 1, row, column + 1, row + 1, column), axis=1)[turned],
    ]
    shares = np.concatenate(cells).reshape(-1, 3, 2) / count
    return np.asarray(part[0] + shares @ (part[1:] - part[0]))
