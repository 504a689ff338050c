"""Rigid bodies on the links of an arm, and tools: those on its last link, with the frame that goals are for."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from typing import Self

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray

BARE = 1e3
"""Depth below the axis, in arm lengths, at which a link without a body counts as having its surface, so that it touches
nothing. Heuristic: farther than any obstacle."""

TOOL = "the tool"
"""Name of a tool in messages."""
PARALLEL = 1e-3
"""Sine of the angle between an up direction and the direction it belongs to below which the two count as parallel."""
INERTIA_ROUNDING = 1e-9
"""Share of moments of inertia by which rounding may make them impossible."""


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
class RigidBody:
    """A rigid body on a link, in the frame of that link: x along the link, from its end.

    Attributes:
        bodies: capsules that contain it.
        mass: its mass [kg].
        centre: its centre of mass, shape (d,) [m]; None at the end of the link.
        inertia: its moments of inertia about the centre, in the axes of the frame in space, where a planar frame (x, y)
            is x-z, shape (3, 3) [kg m²]; None for a point mass.
        link: index of the link, from 0 or, if negative, from behind the last.
        notes: remarks for the user on how capsules cover a polygon or a mesh.
    """

    bodies: tuple[ToolBody, ...] = ()
    mass: float = 0.0
    centre: FloatArray | None = None
    inertia: FloatArray | None = None
    link: int = -1
    notes: tuple[str, ...] = ()

    @property
    def centre_in_space(self) -> FloatArray:
        """Its centre of mass in the frame in space, shape (3,) [m]."""
        return np.zeros(3) if self.centre is None else in_link(self.centre)

    @property
    def moments(self) -> FloatArray:
        """Its moments of inertia (xx, yy, zz, xy, xz, yz) about the centre in the frame in space, (6,) [kg m²]."""
        about = np.zeros((3, 3)) if self.inertia is None else self.inertia
        return about[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    def scaled(self, factor: float) -> Self:
        """Return the body with its mass and moments of inertia times a factor."""
        return replace(self, mass=factor * self.mass, inertia=None if self.inertia is None else factor * self.inertia)


@dataclass(frozen=True, eq=False, kw_only=True)
class Tool(RigidBody):
    """A rigid body on the last link with the frame that goals are for.

    Attributes:
        tip: point that goals are for, shape (d,) [m].
        direction: direction in which the tool points, a unit vector, shape (d,).
        up: direction that is up for the tool, shape (3,), not parallel to ``direction``; None for z. What counts is its
            part perpendicular to ``direction``. Without effect in the plane.
    """

    tip: FloatArray
    direction: FloatArray
    up: FloatArray | None = None

    @property
    def up_axis(self) -> FloatArray:
        """Unit vector perpendicular to ``direction`` that is up for the tool, shape (3,).

        It is NaN where ``up`` is parallel to ``direction``.
        """
        return across(np.eye(3)[2] if self.up is None else self.up, self.direction)


def across(vector: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the unit vector along the part of a vector that is perpendicular to a unit vector, both (3,).

    It is NaN where the two are parallel.
    """
    part = vector - (vector @ direction) * direction
    size = float(np.linalg.norm(part))
    return np.asarray(part / size if size > PARALLEL else np.full(3, np.nan))


def in_link(place: FloatArray) -> FloatArray:
    """Return a vector of the frame of a link, shape (d,), in the frame in space, shape (3,): planar ones are in x-z."""
    return place if len(place) == 3 else np.array([place[0], 0.0, place[1]])


def second_moments(inertia: FloatArray) -> FloatArray:
    """Return the second moments ∫ r rᵀ dm of a body, which are not negative, from its moments of inertia, both (3, 3).

    They are ½ tr I − I.
    """
    return np.asarray(0.5 * np.trace(inertia) * np.eye(3) - inertia)


def attached_inertia(bodies: Sequence[RigidBody], links: int) -> FloatArray | None:
    """Return mass, first and second moments of what is fixed to each link, about its end; None if nothing weighs.

    Args:
        bodies: the bodies.
        links: number of links.

    Returns:
        Rows (m, m c_x, m c_y, m c_z, I_xx, I_xy, I_xz, I_yy, I_yz, I_zz) with the moments of inertia I about the end of
        the link, in its frame in space, shape (links, 10) [kg, kg m, kg m²].
    """
    if not any(body.mass for body in bodies):
        return None
    rows = np.zeros((links, 10))
    for body in bodies:
        c = body.centre_in_space
        about_end = body.mass * ((c @ c) * np.eye(3) - np.outer(c, c))
        about_end = about_end + (0.0 if body.inertia is None else body.inertia)
        rows[body.link] += np.concatenate(([body.mass], body.mass * c, about_end[np.triu_indices(3)]))
    return rows


@dataclass(frozen=True, eq=False)
class ToolLinks:
    """What is particular to an arm some of whose links stand for rigid bodies on others: rotations, pairs, and more.

    Attributes:
        carriers: index of the link, without those that stand for bodies, that each link is or is fixed to, (links,).
        names: name of the body for which each link stands, for messages; empty for the arm's own links.
        turns: constant rotation of each link of the arm relative to the link before it, in the plane angles (links,)
            [rad], in space matrices (links, 3, 3).
        bare: mask of the links that have no body, shape (links,).
        distant: mask of the pairs of links i < j that could collide, shape (links, links).
        near_starts: places along the arm where links start that give no pair of links a greater distance than it has
            when the arm is straight, over the mean length of links, shape (links,).
        near_ends: likewise places where links end, shape (links,).
        direction: direction in which the tool points, in the frame of the last link without tool links, shape (d,).
        up: direction that is up for the tool, in that frame, a unit vector perpendicular to ``direction``, shape (3,).
    """

    carriers: IntArray
    names: tuple[str, ...]
    turns: FloatArray
    bare: BoolArray
    distant: BoolArray
    near_starts: FloatArray
    near_ends: FloatArray
    direction: FloatArray
    up: FloatArray

    @cached_property
    def own(self) -> BoolArray:
        """Mask of the arm's own links, shape (links,)."""
        return np.append(True, np.diff(self.carriers) > 0)

    @cached_property
    def leads_on(self) -> BoolArray:
        """Mask of the links that lead on to the tip: the arm's own and those of its tool, shape (links,)."""
        return np.asarray(self.own | np.array([name == TOOL for name in self.names]))

    @cached_property
    def along(self) -> FloatArray:
        """Directions of the links in the frame of the link that carries them, which is the link itself, (links, d)."""
        if self.turns.ndim == 1:
            turned = np.cumsum(self.turns)
            found = np.column_stack((np.cos(turned), np.sin(turned)))
        else:
            found = np.array(list(accumulate(self.turns, np.matmul)))[:, :, 0]
        found[self.own] = np.eye(found.shape[1])[0]
        return found
