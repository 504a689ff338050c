"""Mass and inertia of the links of an arm."""

import numpy as np

from ccm_opt.core.arrays import FloatArray

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
