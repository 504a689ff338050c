"""Task of a planar curve: reach a goal inside a corridor of convex regions, within a curvature limit."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.scene.corridor import Corridor

END_TOLERANCE = 1e-6
"""Distance from its region up to which a base or goal counts as inside [m], for an arm of about a metre. Heuristic."""


@dataclass(frozen=True, eq=False)
class ConfigurationTask:
    """Task of finding a planar curve of given length from a base to a goal inside a corridor of convex regions.

    Attributes:
        base: position of the base, shape (2,) [m].
        base_heading_range: lower and upper bound on the heading at the base [rad]; equal if the heading is fixed.
        length: length of the whole arm [m].
        curvature_limit: bound on the absolute curvature [1/m].
        goal: required position of the tip, shape (2,) [m].
        goal_heading: required heading of the tip up to whole turns [rad], or None for any heading.
        corridor: convex regions in order; the first contains the base, the last the goal.
        mount_length: arm length from the base that may lie outside the first region [m]. If the base lies outside that
            region, the arm starts with a straight stub of this length; otherwise it has no effect.
        bending_weight: weight of the arm's bending in the objective.
        clearance_weight: weight of closeness to walls in the objective.
        side_gaps: for each region, the distance from each side to the wall behind the side, shape (sides,) [m]; needed
            with a clearance weight.
    """

    base: FloatArray
    base_heading_range: tuple[float, float]
    length: float
    curvature_limit: float
    goal: FloatArray
    goal_heading: float | None
    corridor: Corridor
    mount_length: float = 0.0
    bending_weight: float = 1.0
    clearance_weight: float = 0.0
    side_gaps: tuple[FloatArray, ...] = ()

    def __post_init__(self) -> None:
        low, high = self.base_heading_range
        if not low <= high:
            raise ProblemError(f"the base heading range must not be empty, got {low} .. {high} rad")
        if not (self.length > 0.0 and self.curvature_limit > 0.0):
            raise ProblemError(
                f"length and curvature limit must be positive, got {self.length} m and {self.curvature_limit} 1/m"
            )
        if not self.corridor.regions:
            raise ProblemError("at least one region is needed, got none")
        if np.shape(self.base) != (2,) or np.shape(self.goal) != (2,):
            raise ProblemError(f"base and goal are points, got shapes {np.shape(self.base)} and {np.shape(self.goal)}")

    @property
    def stub(self) -> float:
        """Length of the straight stub at the base [m]: the mount length if the base is outside its region, else 0."""
        region = self.corridor.regions[0]
        outside = bool(np.any(region.normals @ self.base > region.offsets + END_TOLERANCE))
        return self.mount_length if outside else 0.0
