"""Rigid motions, and the integration of frames along a curve in space.

A frame is carried by T' = T ξ̂(s), with the twist ξ = (ω, u) in the frame's own axes. Its motion over a step is the
exponential of the Magnus series, here to sixth order from three Gauss points (Blanes, Casas, Oteo and Ros, "The Magnus
expansion and some of its applications", 2009, section 5.4). Turns about a common axis commute, and are then exact up to
quadrature.
"""

import numpy as np

from ccm_opt.core.arrays import FloatArray

_SMALL = 1e-3
"""Angle below which the exponential uses its series [rad]; the truncation error is below rounding."""


def exponential(twists: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the exponentials of twists (ω, u), shape (..., 6): rotations (..., 3, 3) and translations (..., 3)."""
    turn = twists[..., :3]
    along = twists[..., 3:]
    angle = np.linalg.norm(turn, axis=-1)
    small = angle < _SMALL
    safe = np.where(small, 1.0, angle)
    square = angle**2
    first = np.where(small, 1.0 - square / 6.0 + square**2 / 120.0, np.sin(safe) / safe)
    second = np.where(small, 0.5 - square / 24.0 + square**2 / 720.0, (1.0 - np.cos(safe)) / safe**2)
    third = np.where(small, 1.0 / 6.0 - square / 120.0, (safe - np.sin(safe)) / safe**3)
    hat = _hat(turn)
    twice = hat @ hat
    unit = np.eye(3)
    rotation = unit + first[..., None, None] * hat + second[..., None, None] * twice
    left = unit + second[..., None, None] * hat + third[..., None, None] * twice
    return rotation, (left @ along[..., None])[..., 0]


def carried(twists: FloatArray, widths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rigid motions of a frame over m integration steps, by the sixth-order Magnus expansion.

    Args:
        twists: twists (ω, u) per unit of arc length, in the frame's own axes, at the three Gauss points of each step,
            shape (m, 3, 6).
        widths: arc lengths of the steps, shape (m,).

    Returns:
        Rotations (m, 3, 3) and translations (m, 3), in the axes of the frame at the start of the step.
    """
    h = widths[:, None]
    one = twists[:, 0]
    two = twists[:, 1]
    three = twists[:, 2]
    value = h * two
    slope = h * (np.sqrt(15.0) / 3.0) * (three - one)
    bend = h * (10.0 / 3.0) * (three - 2.0 * two + one)
    # For T' = T ξ̂ the brackets are negated compared with T' = ξ̂ T.
    inner = -_bracket(value, slope)
    outer = _bracket(value, 2.0 * bend + inner) / 60.0
    correction = -_bracket(inner - 20.0 * value - bend, slope + outer) / 240.0
    return exponential(value + bend / 12.0 + correction)


def chained(rotation: FloatArray, rotations: FloatArray, translations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the frames reached by m rigid motions one after the other, from a first frame at the origin.

    Args:
        rotation: rotation of the first frame, shape (3, 3).
        rotations: rotation of each step in the axes of the frame before, shape (m, 3, 3).
        translations: translation of each step in these axes, shape (m, 3).

    Returns:
        Rotations, shape (m + 1, 3, 3), and positions, shape (m + 1, 3), of the first frame and those after each step.
    """
    frames = np.empty((len(rotations) + 1, 3, 3))
    places = np.zeros((len(rotations) + 1, 3))
    frames[0] = rotation
    for step in range(len(rotations)):
        frames[step + 1] = frames[step] @ rotations[step]
    np.cumsum(np.einsum("mij,mj->mi", frames[:-1], translations), axis=0, out=places[1:])
    return frames, places


def _bracket(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the Lie brackets of pairs of twists (ω, u), all of shape (..., 6)."""
    turn = np.cross(first[..., :3], second[..., :3])
    along = np.cross(first[..., :3], second[..., 3:]) - np.cross(second[..., :3], first[..., 3:])
    return np.concatenate((turn, along), axis=-1)


def _hat(turn: FloatArray) -> FloatArray:
    """Return the cross-product matrices of vectors ω, shape (..., 3, 3) for ω of shape (..., 3)."""
    hat = np.zeros((*turn.shape[:-1], 3, 3))
    hat[..., 2, 1] = turn[..., 0]
    hat[..., 0, 2] = turn[..., 1]
    hat[..., 1, 0] = turn[..., 2]
    return hat - np.swapaxes(hat, -1, -2)


def turn_towards(side: FloatArray, angle: float) -> FloatArray:
    """Return the rotation by an angle in the plane of the x axis and a direction perpendicular to x, shape (3, 3).

    Args:
        side: direction towards which x turns, a unit vector in the y-z plane, shape (2,).
        angle: angle of the turn [rad].
    """
    t = np.array([np.cos(angle), *(np.sin(angle) * side)])
    c, s = side
    cos = np.cos(angle)
    n1 = np.array([-c * np.sin(angle), s * s + c * c * cos, c * s * (cos - 1.0)])
    n2 = np.array([-s * np.sin(angle), c * s * (cos - 1.0), c * c + s * s * cos])
    return np.column_stack((t, n1, n2))


NOMINAL_LINKS = 24
"""Number of nominal links in the length of an arm. The nominal link, a twenty-fourth of the arm, is the unit of length
of all weights in planning."""


def bend_rotations(bends: FloatArray) -> FloatArray:
    """Return the rotations Rz(a) Ry(b), shape (..., 3, 3), of pairs of joint bends (a, b), shape (..., 2) [rad]."""
    cos = np.cos(bends)
    sin = np.sin(bends)
    ca = cos[..., 0]
    cb = cos[..., 1]
    sa = sin[..., 0]
    sb = sin[..., 1]
    turns = np.empty((*bends.shape[:-1], 3, 3))
    turns[..., 0, :] = np.stack((ca * cb, -sa, ca * sb), axis=-1)
    turns[..., 1, :] = np.stack((sa * cb, ca, sa * sb), axis=-1)
    turns[..., 2, :] = np.stack((-sb, np.zeros_like(sb), cb), axis=-1)
    return turns
