"""Bodies of links, and numbers of the arm."""

from ccm_opt.core.arrays import FloatArray

DEFAULT_LINK_MASS = 0.1
"""Mass of a link when nothing else is given [kg]: the paper's swan's neck (section 5)."""
THIN_ROD_RADIUS = 0.01
"""Radius, in link lengths, of the cylinders that stand for the links of an arm of zero radius in its inertia."""
SPACE_ROD_RADIUS = 0.05
"""Likewise of thinner links in space, whose roll is moved by the bends of the others and held by a drive: with less
inertia about the axis the simulated drive overshoots within a step of a millisecond."""


def cylinder_inertia(masses: FloatArray, radius: float, link_length: float) -> tuple[FloatArray, FloatArray]:
    """Return moments of inertia of solid cylinders about their centres: axial m r² / 2, transverse m (3 r² + l²) / 12.

    Args:
        masses: of the links, shape (links,) [kg].
        radius: of the links [m]; thin rods stand for links without one.
        link_length: of a link [m].

    Returns:
        About the links' axes, and across them, each of shape (links,) [kg m²].
    """
    r = radius or THIN_ROD_RADIUS * link_length
    return masses * r**2 / 2.0, masses * (3.0 * r**2 + link_length**2) / 12.0
