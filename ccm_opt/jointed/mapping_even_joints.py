"""The paper's mapping: even joints equidistant on the curve, odd joints where two circles meet (section 5.3)."""

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.angles import vector_headings, wrap
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polygons import cross
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.jointed.jointed_settings import DEFAULT_MAPPING, MappingSettings


def even_joint_headings(
    points: FloatArray, near: FloatArray, link_length: float, settings: MappingSettings = DEFAULT_MAPPING
) -> FloatArray:
    """Link headings with every second joint on the curve.

    The odd joint of a pair lies at distance l from both even joints, on the side to which the curve bulges: the side
    of its point half-way between them. Where the bulge changes side the mapping jumps.

    Args:
        points: of the curve at the arc length of every joint, shape (links + 1, 2) [m].
        near: mean headings of the curve per link; the result takes the nearest turn, shape (links,) [rad].
        link_length: l [m].
        settings: by how much two links' chord may be too long.

    Returns:
        Shape (links,) [rad].

    Raises:
        ProblemError: the number of links is odd, or two even joints coincide or are farther apart than two links.
    """
    if len(near) % 2:
        raise ProblemError(f"the even-joint mapping needs an even number of links, got {len(near)}")
    chords, directions = _chords(points, link_length, settings.length_tolerance)
    # Both links of a pair make the same angle with its chord: an isosceles triangle.
    lift = np.arccos(np.clip(0.5 * chords / link_length, 0.0, 1.0)) * _bulge_side(points)
    headings = np.column_stack((directions + lift, directions - lift)).ravel()
    nearest: FloatArray = near + wrap(headings - near)
    return nearest


def _chords(points: FloatArray, link_length: float, slack: float) -> tuple[FloatArray, FloatArray]:
    """Lengths and directions of the chords between even joints, each of shape (links / 2,) [m], [rad]."""
    steps = np.diff(points[::2], axis=0)
    chords = np.linalg.norm(steps, axis=1)
    for pair in np.flatnonzero(chords > (2.0 + slack) * link_length):
        raise ProblemError(
            f"even joints {2 * pair} and {2 * pair + 2} are {chords[pair]:.9g} m apart, two links reach only "
            f"{2.0 * link_length:.9g} m; make curve and arm equally long"
        )
    for pair in np.flatnonzero(chords < ROUNDING * link_length):
        raise ProblemError(
            f"even joints {2 * pair} and {2 * pair + 2} coincide, so joint {2 * pair + 1} has no place of its own; "
            "bend the curve less or use more links"
        )
    return chords, vector_headings(steps)


def _bulge_side(points: FloatArray) -> FloatArray:
    """+1 where the curve between two even joints lies left of their chord, else -1."""
    chord = np.diff(points[::2], axis=0)
    half_way = points[1::2] - points[:-1:2]
    return np.where(cross(chord, half_way) >= 0.0, 1.0, -1.0)
