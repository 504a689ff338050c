"""Smooth paths through knots that are projected onto the user's constraints.

They are for constraints that are equations or depend on the path parameter (user limits).

A cubic spline through points of a smooth curve deviates from it by O(h⁴) (de Boor, *A Practical Guide to Splines*,
chapter V), so halving the spans in which equations are violated quickly reduces the violation.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit_stack import overbent
from ccm_opt.planning.limits.motion_certificate import failed_intervals
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.limits.user_motion_rows import slope_norms
from ccm_opt.planning.spline_path import DEGREE

_EQUATION_SAMPLES = 8
"""Number of samples of each span at which the limits are checked. Heuristic."""
_FIRST_SPANS = 48
"""Minimum number of spans of the first path. Heuristic."""
_MOST_SPANS = 1200
"""Number of spans above which refinement is given up. Heuristic."""
_ROUNDS = 10
"""Maximum number of rounds, in each of which a path is computed and spans that violate limits are halved. Heuristic."""
_NEWTON_STEPS = 12
"""Maximum number of steps of Newton's method that project a knot onto the limits. Heuristic."""
_MET = 1e-10
"""Largest violation of the limits at a knot, in the limits' units. Derived: four orders of magnitude below what the
verifier permits."""
_RANK = 1e-09
"""Fraction of the largest singular value below which singular values count as zero. Heuristic."""
_JOINT_SHARE = 0.995
"""Fraction of a joint limit to which bends beyond that fraction are reduced. Heuristic."""

_CERTIFIED_SAMPLES = 12
"""Number of samples of a span between which the certificate assumes the path to be linear. Heuristic."""
_MOST_CERTIFIED = 6000
"""Approximate maximum number of the certificate's samples on the whole path. Heuristic: it bounds the computing
time."""


Free: TypeAlias = Callable[[FloatArray], FloatArray]
"""Function from a configuration (c,) to a mask (c,): 1 for coordinates that moving a knot may change, 0 for others."""


def spline_on_limits(base: BSpline, limits: tuple[UserLimit, ...], bends: FloatArray, free: Free) -> BSpline | None:
    """Return a spline through points of a path projected onto limits; refined until it respects the limits, or None.

    Args:
        base: a smooth path near a certified motion, over the path parameter in [0, 1], values (c,).
        limits: user limits that the path has to keep.
        bends: joint limits, shape (b,) [rad].
        free: function that returns the mask of the coordinates that may be changed.

    Returns:
        The spline, values (c,); None if the refinement does not converge.
    """
    # A constraint that begins inside a span could not be met throughout the span.
    knots = _first_knots(base, [u for limit in limits for u in limit.breaks], _FIRST_SPANS)
    values: dict[float, FloatArray] = {0.0: np.asarray(base(0.0)), 1.0: np.asarray(base(1.0))}
    for _ in range(_ROUNDS):
        for u in knots:
            # Knots are kept from round to round, so each is moved only once.
            if float(u) not in values:
                moved = moved_onto(limits, bends, free, np.asarray(base(u)), float(u))
                if moved is None:
                    return None
                values[float(u)] = moved

        spline = make_interp_spline(knots, np.array([values[float(u)] for u in knots]), k=DEGREE)
        missed = _violated_spans(spline, knots, limits, _EQUATION_SAMPLES)
        if not len(missed):
            missed = _short_spans(spline, knots, limits)
        if not len(missed):
            return spline
        if len(knots) + len(missed) > _MOST_SPANS:
            return None

        # Neighbouring spans are halved, too, as very uneven spans make the spline oscillate.
        around = np.unique(np.clip(np.add.outer(missed, (-1, 0, 1)), 0, len(knots) - 2))
        knots = np.union1d(knots, 0.5 * (knots[around] + knots[around + 1]))
    return None


def _first_knots(base: BSpline, breaks: list[float], least: int) -> FloatArray:
    """Return knots (m,): those of the base spline and the breaks, halved until there are ``least`` spans or more."""
    knots = np.union1d(np.clip(base.t, 0.0, 1.0), breaks)
    while len(knots) - 1 < least:
        knots = np.union1d(knots, 0.5 * (knots[1:] + knots[:-1]))
    return knots


def moved_onto(
    limits: tuple[UserLimit, ...], bends: FloatArray, free: Free, q: FloatArray, u: float
) -> FloatArray | None:
    """Return a configuration at which all limits are met, found by minimum-norm Newton steps, or None.

    Equations, violated inequalities and exceeded joint limits are corrected.

    Args:
        limits: user limits that the path has to keep.
        bends: joint limits, shape (b,) [rad].
        free: function that returns the mask of the coordinates that may be changed.
        q: configuration, shape (c,) [rad, m].
        u: path parameter.

    Returns:
        The configuration, shape (c,) [rad, m]; None if the method does not converge.
    """
    held = np.zeros(len(bends))
    moving = free(q)
    for _ in range(_NEWTON_STEPS):
        over, change = overbent(_JOINT_SHARE * bends, q[: len(bends)], held, _MET)
        slopes = np.eye(len(q))[over]
        for limit in limits:
            missed, by = limit.path_violations(q, u)
            slopes = np.vstack((missed, slopes))
            change = np.append(by, change)
        if not np.isfinite(change).all():
            return None
        if np.max(np.abs(change), initial=0.0) <= _MET:
            return q
        # Rows are scaled to norm 1: units differ, and rounding errors must not affect the rank.
        scale = slope_norms(slopes)
        q = q + np.linalg.lstsq(slopes * moving / scale[:, None], change / scale, rcond=_RANK)[0]
    return None


def _violated_spans(spline: BSpline, knots: FloatArray, limits: tuple[UserLimit, ...], samples: int) -> IntArray:
    """Return the sorted indices of the spans in which a limit is violated at any of ``samples`` samples."""
    # Each span has the same number of evenly spaced samples.
    places = np.interp(np.arange(samples * (len(knots) - 1) + 1) / samples, np.arange(len(knots)), knots)
    q = np.asarray(spline(places))
    missed = np.zeros(len(places), dtype=bool)
    for limit in limits:
        missed |= limit.misses_path(q, places)
    return np.unique(np.minimum(np.flatnonzero(missed) // samples, len(knots) - 2))


def _short_spans(spline: BSpline, knots: FloatArray, limits: tuple[UserLimit, ...]) -> IntArray:
    """Return the sorted indices of the spans in which the certificate of a limit fails."""
    places = certified_samples(spline)
    # The interval from sample i to i + 1 lies in the span that starts at the last knot at or before sample i.
    failing = places[failed_intervals(limits, np.asarray(spline(places)))]
    return np.unique(np.clip(np.searchsorted(knots, failing, side="right") - 1, 0, len(knots) - 2))


def certified_samples(spline: BSpline) -> FloatArray:
    """Return path parameters of the certificate's samples, evenly spaced in each span of a spline, shape (m,)."""
    knots = np.unique(np.clip(spline.t, 0.0, 1.0))
    count = max(2, min(_CERTIFIED_SAMPLES, _MOST_CERTIFIED // (len(knots) - 1)))
    return np.interp(np.arange(count * (len(knots) - 1) + 1) / count, np.arange(len(knots)), knots)
