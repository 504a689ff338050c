"""Where the tip of an arm in space can be, and where it can point there: a map over a grid of places."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.space.problem import SpaceProblem


@dataclass(frozen=True, eq=False)
class SpaceReachMap:
    """For each cell of a grid whether a pose was found with the tip in its middle, and with which directions.

    Attributes:
        problem: arm and scene.
        step: width of a cell [m].
        x: middles of the cells along x, shape (nx,) [m].
        y: likewise, shape (ny,) [m].
        z: likewise, shape (nz,) [m].
        directions: of the last link that were tried, unit vectors, shape (K, 3).
        reachable: whether a pose was found, with any direction, shape (nx, ny, nz).
        taken: whether one was found with each direction, shape (nx, ny, nz, K).
        gap: largest room beyond radius and clearance of any pose found in the cell, as far as it was looked at, shape
            (nx, ny, nz) [m]; NaN where there is none.
        proved: whether it is proved that no pose exists, likewise; elsewhere nothing is known where none was found.
        seen: room above which gaps are not told apart [m].
        timings: CPU time by stage [s].
    """

    problem: SpaceProblem
    step: float
    x: FloatArray
    y: FloatArray
    z: FloatArray
    directions: FloatArray
    reachable: BoolArray
    taken: BoolArray
    gap: FloatArray
    proved: BoolArray
    seen: float
    timings: Mapping[str, float]

    @property
    def volume(self) -> float:
        """Of the cells in which a pose was found [m³]."""
        return float(self.reachable.sum()) * self.step**3

    @property
    def places(self) -> FloatArray:
        """Middles of all cells, shape (nx, ny, nz, 3) [m]."""
        return np.stack(np.meshgrid(self.x, self.y, self.z, indexing="ij"), axis=-1)


def even_directions(count: int) -> FloatArray:
    """Unit vectors spread evenly over the sphere, on a spiral of the golden angle, shape (count, 3)."""
    number = np.arange(count) + 0.5
    up = 1.0 - 2.0 * number / max(count, 1)
    across = np.sqrt(1.0 - up**2)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * number
    return np.stack((across * np.cos(angle), across * np.sin(angle), up), axis=1)
