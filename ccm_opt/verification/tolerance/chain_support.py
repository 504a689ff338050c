"""How far the end of a chain may come in a direction when its joints, or its lengths, are a little off.

A chain is a sum of vectors a_k (cos α_k, sin α_k); an error Δ_i at its i-th turn turns all vectors from the i-th on, so
vector k by θ_k = Σ_{i≤k} Δ_i. Along a direction at the angle ν, with β_k = α_k − ν, its end lies at

    Σ a_k cos(β_k + θ_k).

Every cosine lies below a straight line of any slope, cos(β + θ) ≤ c − s θ for |θ| ≤ h, where the least such c is a
maximum over an interval that is known in closed form. With |Δ_i| ≤ w_i and h_k = Σ_{i≤k} w_i therefore

    Σ a_k cos(β_k + θ_k)  ≤  Σ a_k c_k  −  Σ_i Δ_i Σ_{k≥i} a_k s_k  ≤  Σ a_k c_k  +  Σ_i w_i |Σ_{k≥i} a_k s_k|.

With the slopes s_k = sin β_k the last sum is what a linearisation says, Σ w_i |n × (p − P_i)|, and the first one holds
everything that it leaves out: the bound is rigorous for errors of any size, and exact as they become small.
"""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.verification.tolerance.tolerance_settings import DEFAULT_TOLERANCE, ToleranceSettings

_TURN = 2.0 * np.pi
_TINY = 1e-300


def chain_support(
    lengths: FloatArray,
    angles: FloatArray,
    widths: FloatArray,
    stretches: FloatArray,
    directions: FloatArray,
    settings: ToleranceSettings = DEFAULT_TOLERANCE,
) -> FloatArray:
    """Bound on how far the ends of chains come along directions, shape (m, f) [m].

    Args:
        lengths: of the vectors, of any sign, shape (m, k) [m].
        angles: of the vectors, shape (m, k) [rad].
        widths: largest error at every turn, shape (m, k) [rad].
        stretches: largest error of every length, shape (m, k) [m].
        directions: angles of the directions, f for each chain, shape (m, f) [rad].
        settings: how the worst errors are sought.
    """
    # A vector of negative length is one of positive length the other way.
    beta = np.where(lengths < 0.0, angles + np.pi, angles)[:, None, :] - directions[:, :, None]
    a = np.abs(lengths)[:, None, :]
    w = widths[:, None, :]
    h = np.cumsum(w, axis=2)

    # Two choices of slopes, and the lower bound of both. Those of chords are right where errors all go one way;
    # tangents at the worst errors are right where they do not, but only where the cosine is concave.
    chords = np.sin(beta) * np.sinc(h / np.pi)
    least = _bound(a, beta, w, h, chords)
    if np.any(w):
        there = beta + np.cumsum(_far_errors(a, beta, w, _steps(h, settings)), axis=2)
        least = np.minimum(least, _bound(a, beta, w, h, np.where(np.cos(there) < 0.0, chords, np.sin(there))))

    # A length that is off moves the end along its vector, which itself may have turned.
    if not np.any(stretches):
        return least
    along = np.minimum(np.abs(np.cos(beta)) + h, 1.0)
    return np.asarray(least + np.sum(stretches[:, None, :] * along, axis=2))


def worst_errors(
    lengths: FloatArray,
    angles: FloatArray,
    widths: FloatArray,
    direction: FloatArray,
    settings: ToleranceSettings = DEFAULT_TOLERANCE,
) -> FloatArray:
    """Errors at the turns of chains that bring their ends far along a direction each, shape (m, k) [rad].

    Args:
        lengths: as for ``chain_support``; likewise the angles and widths.
        angles: of the vectors.
        widths: largest error at every turn.
        direction: angle of the direction of each chain, shape (m,) [rad].
        settings: how they are sought.
    """
    beta = np.where(lengths < 0.0, angles + np.pi, angles) - direction[:, None]
    return _far_errors(np.abs(lengths), beta, widths, settings.far_steps)


def _bound(a: FloatArray, beta: FloatArray, w: FloatArray, h: FloatArray, slopes: FloatArray) -> FloatArray:
    levers = _sums_to_end(a * slopes)
    value: FloatArray = np.sum(a * _intercepts(beta, slopes, h) + w * np.abs(levers), axis=2)
    return value


def _far_errors(a: FloatArray, beta: FloatArray, w: FloatArray, steps: int) -> FloatArray:
    """Errors that bring the ends of chains far, by steps towards what a linearisation says (Frank and Wolfe, 1956).

    Where a lever is so short that the reach is longest for an error within its width, a linearisation would jump from
    one end of the width to the other; there the step is that of a reach that is bent at most as a stretched chain's.
    """
    errors = np.zeros(np.broadcast_shapes(beta.shape, w.shape))
    stretched = np.maximum(_sums_to_end(a), _TINY)
    for k in range(steps):
        there = beta + np.cumsum(errors, axis=-1)
        wanted = np.clip(-_sums_to_end(a * np.sin(there)) / stretched, -w, w)
        errors = errors + 2.0 / (k + 2.0) * (wanted - errors)
    return errors


def _steps(h: FloatArray, settings: ToleranceSettings) -> int:
    """One step does where no vector turns far."""
    return 1 if h.size == 0 or float(h.max()) < settings.far_turn else settings.far_steps


def _sums_to_end(values: FloatArray) -> FloatArray:
    sums: FloatArray = np.cumsum(values[..., ::-1], axis=-1)[..., ::-1]
    return sums


def _intercepts(beta: FloatArray, slopes: FloatArray, h: FloatArray) -> FloatArray:
    """Least c with cos(β + θ) ≤ c − s θ for all |θ| ≤ h: the maximum of cos(β + θ) + s θ there."""
    ends = np.maximum(np.cos(beta + h) + slopes * h, np.cos(beta - h) - slopes * h)
    # Inside, it has its maxima where sin(β + θ) = s with a positive cosine, a turn apart; the slope says which is best.
    arc = np.arcsin(slopes)
    first = arc - beta
    turns = np.where(slopes > 0.0, np.floor((h - first) / _TURN), np.ceil((-h - first) / _TURN))
    inside = first + _TURN * turns
    value = np.cos(arc) + slopes * inside
    best: FloatArray = np.where(np.abs(inside) <= h, np.maximum(ends, value), ends)
    return best
