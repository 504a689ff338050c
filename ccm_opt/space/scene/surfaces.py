"""All surfaces of a scene as one list of triangles, each of which may be rounded."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class SurfaceSoup:
    """Triangles in no order; a place is as far from one as from its points, less its rounding.

    Triangles may have no area: a point with rounding is a ball, a segment with rounding a capsule.

    Attributes:
        triangles: shape (m, 3, 3) [m].
        rounding: of each, shape (m,) [m].
        owner: to which of the names each belongs, shape (m,).
        names: of the bodies, and of the room where there is one.
    """

    triangles: FloatArray
    rounding: FloatArray
    owner: IntArray
    names: tuple[str, ...]

    @classmethod
    def joined(cls, named: Iterable[tuple[str, FloatArray, float]]) -> "SurfaceSoup":
        """The triangles of several things, each with its name, its triangles, shape (·, 3, 3), and its rounding."""
        parts = list(named)
        counts = [len(triangles) for _, triangles, _ in parts]
        triangles = [np.zeros((0, 3, 3)), *(triangles for _, triangles, _ in parts if len(triangles))]
        return cls(
            # Of a single large mesh no second copy is made.
            np.ascontiguousarray(triangles[1] if len(triangles) == 2 else np.concatenate(triangles)),
            np.repeat(np.array([rounding for _, _, rounding in parts], dtype=np.float64), counts),
            np.repeat(np.arange(len(parts), dtype=np.intp), counts),
            tuple(name for name, _, _ in parts),
        )

    def __len__(self) -> int:
        return len(self.triangles)


def box_about(places: FloatArray) -> FloatArray:
    """Lower and upper corner of the box about some places, shape (2, 3) [m].

    Args:
        places: at least one, shape (..., 3) [m].
    """
    # Column by column: of many rows of three numpy takes the least some ten times as slowly.
    columns = [places[..., axis] for axis in range(3)]
    return np.array([[column.min() for column in columns], [column.max() for column in columns]])
