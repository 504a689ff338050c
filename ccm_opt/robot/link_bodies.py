"""Mass and inertia of the links of an arm, and of solids that are fixed to them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray

DEFAULT_LINK_MASS = 0.1
"""Mass of a link if none is given [kg]: that of the paper's swan neck (section 5)."""
THIN_ROD_RADIUS = 0.01
"""Radius, in link lengths, of the cylinders that give the links of a zero-radius arm their inertia."""
SPACE_ROD_RADIUS = 0.05
"""Minimum radius, in link lengths, of cylinders that give links in space their inertia. Bends of other joints act on
the roll of such a link, and a drive holds it; with less inertia about the link's axis the simulated drive overshoots
within one time step of a millisecond."""


def cylinder_inertia(
    masses: FloatArray, radius: FloatArray | float, link_length: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Return the axial and transverse moments of inertia of links that are solid cylinders, about their centres.

    The axial moment is m r² / 2, the transverse one m (3 r² + l²) / 12.

    Args:
        masses: link masses, shape (links,) [kg].
        radius: radius of all links, or of each, shape (links,) [m]; links of zero radius are treated as thin rods.
        link_length: length of all links, or of each, shape (links,) [m].

    Returns:
        Axial and transverse moments of inertia, each of shape (links,) [kg m²].
    """
    r = np.where(np.asarray(radius) > 0.0, radius, THIN_ROD_RADIUS * link_length)
    return masses * r**2 / 2.0, masses * (3.0 * r**2 + link_length**2) / 12.0


@dataclass(frozen=True, eq=False)
class SolidMoments:
    """Volume, centre and moments of inertia of a solid of density 1.

    Attributes:
        volume: volume [m³].
        centre: centre of volume, shape (3,) [m].
        inertia: moments of inertia about the centre, shape (3, 3) [m⁵].
    """

    volume: float
    centre: FloatArray
    inertia: FloatArray

    @classmethod
    def of_round_bar(cls, start: FloatArray, end: FloatArray, radius: float, *, round_ends: bool) -> "SolidMoments":
        """Return the moments of a cylinder, or of a capsule or ball if its ends are round, about an axis (3,), (3,)."""
        step = end - start
        length = float(np.linalg.norm(step))
        cylinder = np.pi * radius**2 * length
        ball = 4.0 / 3.0 * np.pi * radius**3 if round_ends else 0.0
        axial = cylinder * radius**2 / 2.0 + ball * 0.4 * radius**2
        across = cylinder * (length**2 / 12.0 + radius**2 / 4.0)
        across += ball * (0.4 * radius**2 + length**2 / 4.0 + 0.375 * length * radius)
        along = step / length if length > 0.0 else np.eye(3)[0]
        inertia = across * np.eye(3) + (axial - across) * np.outer(along, along)
        return cls(cylinder + ball, 0.5 * (start + end), inertia)

    @classmethod
    def of_box(cls, low: FloatArray, high: FloatArray) -> "SolidMoments":
        """Return the moments of a box with sides along the axes, from its lower and upper corner, shape (3,) [m]."""
        volume = float(np.prod(high - low))
        squares = volume / 12.0 * (high - low) ** 2
        return cls(volume, 0.5 * (low + high), np.diag(np.sum(squares) - squares))

    @classmethod
    def of_prism(cls, corners: FloatArray) -> "SolidMoments":
        """Return the moments of a simple polygon in x-z, shape (m, 2) [m], as deep as its area's square root."""
        x, z = (corners - corners.mean(axis=0)).T
        u, w = np.roll(x, -1), np.roll(z, -1)
        doubled = x * w - u * z
        area = 0.5 * float(np.sum(doubled))
        at = np.array([np.sum((x + u) * doubled), np.sum((z + w) * doubled)]) / (6.0 * area)
        xx = np.sum((x * x + x * u + u * u) * doubled) / (12.0 * area) - at[0] ** 2
        zz = np.sum((z * z + z * w + w * w) * doubled) / (12.0 * area) - at[1] ** 2
        xz = np.sum((x * w + 2.0 * x * z + 2.0 * u * w + u * z) * doubled) / (24.0 * area) - at[0] * at[1]
        deep = float(np.sqrt(abs(area)))
        second = np.array([[xx, 0.0, xz], [0.0, deep**2 / 12.0, 0.0], [xz, 0.0, zz]])
        middle = corners.mean(axis=0) + at
        volume = deep * abs(area)
        return cls(volume, np.array([middle[0], 0.0, middle[1]]), volume * (np.trace(second) * np.eye(3) - second))

    @classmethod
    def of_mesh(cls, vertices: FloatArray, faces: IntArray) -> "SolidMoments":
        """Return the moments of what a closed mesh encloses, by signed tetrahedra from its middle.

        Args:
            vertices: positions of the vertices, shape (v, 3) [m].
            faces: vertex indices of the triangles, all with one sense of rotation, shape (m, 3).
        """
        middle = vertices.mean(axis=0)
        corners = (vertices - middle)[faces]
        signed = np.linalg.det(corners) / 6.0
        volume = float(signed.sum())
        total = corners.sum(axis=1)
        at = (signed @ total) / (4.0 * volume)
        # ∫ r rᵀ over a tetrahedron of volume V with a corner at the origin: V / 20 (Σ r_i r_iᵀ + Σ r_i Σ r_iᵀ).
        second = np.einsum("f,fki,fkj->ij", signed, corners, corners) + np.einsum("f,fi,fj->ij", signed, total, total)
        about = second / 20.0 - volume * np.outer(at, at)
        inertia = np.trace(about) * np.eye(3) - about
        return cls(abs(volume), middle + at, np.sign(volume) * inertia)

    @classmethod
    def of_all(cls, parts: Sequence["SolidMoments"]) -> "SolidMoments":
        """Return the moments of several solids together; what they have in common counts for each of them."""
        volume = sum(part.volume for part in parts)
        centre = sum((part.volume * part.centre for part in parts), np.zeros(3)) / volume
        inertia = np.zeros((3, 3))
        for part in parts:
            away = part.centre - centre
            inertia += part.inertia + part.volume * ((away @ away) * np.eye(3) - np.outer(away, away))
        return cls(volume, centre, inertia)
