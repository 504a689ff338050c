"""Tools: rigid bodies fixed to the last link of an arm, with the frame that goals are for."""

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray

BARE = 1e3
"""Depth below the axis, in arm lengths, at which a link without a body counts as having its surface, so that it touches
nothing. Heuristic: farther than any obstacle."""


@dataclass(frozen=True, eq=False)
class ToolBody:
    """A capsule of a tool, in the frame of the last link: x along the link, from its end.

    Attributes:
        start: one end of the axis, shape (d,) [m].
        end: other end of the axis, which may equal the first, shape (d,) [m].
        radius: radius [m].
    """

    start: FloatArray
    end: FloatArray
    radius: float


@dataclass(frozen=True, eq=False)
class Tool:
    """A rigid tool on the last link, in the frame of that link: x along the link, from its end.

    Attributes:
        tip: point that goals are for, shape (d,) [m].
        direction: direction in which the tool points, a unit vector, shape (d,).
        bodies: capsules that contain the tool.
        mass: mass of the tool [kg].
        centre: centre of mass, shape (d,) [m].
        inertia: moments of inertia about the centre in the axes of the frame in space, shape (3, 3) [kg m²].
    """

    tip: FloatArray
    direction: FloatArray
    bodies: tuple[ToolBody, ...] = ()
    mass: float = 0.0
    centre: FloatArray | None = None
    inertia: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class ToolLinks:
    """What is particular to an arm whose last links are a tool: rotations, bare links, pairs that may collide.

    Attributes:
        count: number of tool links, the last of the arm's.
        turns: constant rotation of each link of the arm relative to the link before it, in the plane angles (links,)
            [rad], in space matrices (links, 3, 3).
        bare: mask of the links that have no body, shape (links,).
        distant: mask of the pairs of links i < j that could collide, shape (links, links).
        near_shares: arc lengths of joints and tip over the mean length of links; those of tool links give no link
            a greater distance than it has when the arm is straight, shape (links + 1,).
        direction: direction in which the tool points, in the frame of the last link without tool links, shape (d,).
    """

    count: int
    turns: FloatArray
    bare: BoolArray
    distant: BoolArray
    near_shares: FloatArray
    direction: FloatArray

    @cached_property
    def along(self) -> FloatArray:
        """Directions of the links in the frame of the link that carries them, which is the link itself, (links, d)."""
        if self.turns.ndim == 1:
            turned = np.cumsum(self.turns)
            return np.column_stack((np.cos(turned), np.sin(turned)))
        return np.array(list(accumulate(self.turns, np.matmul)))[:, :, 0]
