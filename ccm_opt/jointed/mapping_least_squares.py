"""A smooth mapping: all joints near their points of the curve, the tip exactly on it."""

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.jointed_settings import DEFAULT_MAPPING, MappingSettings


def least_squares_headings(
    points: FloatArray, mean: FloatArray, link_length: float, settings: MappingSettings = DEFAULT_MAPPING
) -> FloatArray:
    """Link headings φ = argmin Σ|P_j - p(s_j)|² + ε|φ - φ̄|² subject to the tip being exact.

    Gauss-Newton on the least-squares part, Newton on the two tip equations (Nocedal and Wright, Numerical
    Optimization, chapter 18); each step solves H δ + Jᵀλ = -g, J δ = -c by its 2×2 Schur complement.

    Args:
        points: of the curve at the arc length of every joint, shape (links + 1, 2) [m].
        mean: φ̄, mean headings of the curve per link, shape (links,) [rad].
        link_length: l [m].
        settings: ε, and when the iteration has settled.

    Returns:
        Shape (links,) [rad].

    Raises:
        ProblemError: the iteration does not settle.
    """
    headings = mean.copy()
    epsilon = settings.regularisation * link_length**2
    before = np.inf
    for _ in range(settings.most_steps):
        step, miss = _newton_step(points, headings, mean, link_length, epsilon)
        headings = headings + step
        length = float(np.abs(step).max())
        # The tip of an arm that is nearly straight hardly moves along itself, and rounding there is many times as much
        # in the headings: what small steps no longer lessen is that.
        if length < settings.settled or settings.rounding > length >= before:
            return headings
        before = length
    raise ProblemError(
        f"the least-squares mapping did not settle in {settings.most_steps} steps, the tip is still {miss:.3g} m off; "
        "use more links or a curve that bends less per link"
    )


def _newton_step(
    points: FloatArray, headings: FloatArray, mean: FloatArray, link_length: float, epsilon: float
) -> tuple[FloatArray, float]:
    """The step δ of the headings, shape (links,) [rad], and the tip's distance from the curve's tip [m]."""
    n = len(headings)
    unit = np.stack((np.cos(headings), np.sin(headings)))
    residual = points[0][:, None] + link_length * np.cumsum(unit, axis=1) - points[1:].T
    turn = link_length * np.stack((-unit[1], unit[0]))  # the derivative of one link's vector
    below = np.arange(n)[::-1, None]
    later = np.minimum(below, below.T).astype(np.float64)  # joints before the tip moved by both headings
    hessian = (turn.T @ turn) * later + epsilon * np.eye(n)
    gradient = (turn * _sums_of_later(residual)).sum(axis=0) + epsilon * (headings - mean)
    solved = np.linalg.solve(hessian, np.column_stack((gradient, turn.T)))
    schur = turn @ solved[:, 1:]
    # A straight arm cannot move its tip along itself: the pseudo-inverse drops that direction.
    multiplier = np.linalg.pinv(schur, rcond=1e-12) @ (residual[:, -1] - turn @ solved[:, 0])
    return -solved[:, 0] - solved[:, 1:] @ multiplier, float(np.hypot(*residual[:, -1]))


def _sums_of_later(residual: FloatArray) -> FloatArray:
    """Sum of the residuals of all joints beyond each link but the tip, shape (2, links)."""
    inner = residual.copy()
    inner[:, -1] = 0.0
    return np.cumsum(inner[:, ::-1], axis=1)[:, ::-1]
