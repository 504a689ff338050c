"""Smooth paths through knots that are moved onto limits that have equations or depend on the path parameter.

A cubic spline through points of a smooth curve leaves it by O(h⁴) (de Boor, *A Practical Guide to Splines*, chapter V),
so halving the spans in which equations are violated brings the path back onto them quickly.
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
"""Samples of a span at which the limits that the path is fitted to are checked. Taste."""
_FIRST_SPANS = 48
"""Number of spans of the first such path. Taste."""
_MOST_SPANS = 1200
"""Number of spans above which refinement is given up. Taste."""
_ROUNDS = 10
"""Rounds of halving spans. Taste."""
_NEWTON_STEPS = 12
"""Most steps of Newton's method that bring a knot onto the limits. Taste."""
_MET = 1e-10
"""Largest violation of the limits at a knot, in their units. Derived: four orders of magnitude below what the
verifier allows."""
_RANK = 1e-09
"""Share of the largest singular value below which singular values count as zero. Taste."""
_JOINT_SHARE = 0.995
"""Share of a joint limit to which larger bends are reduced. Taste."""

_CERTIFIED_SAMPLES = 12
"""Samples of a span through knots, between which the certificate takes the path to be linear. Taste."""
_MOST_CERTIFIED = 6000
"""Most samples of the whole path. Taste: the certificate's cost."""


Free: TypeAlias = Callable[[FloatArray], FloatArray]
"""Returns 1 for each coordinate that a knot may move about a configuration, 0 for the rest, both of shape (c,)."""


def spline_on_limits(base: BSpline, limits: tuple[UserLimit, ...], bends: FloatArray, free: Free) -> BSpline | None:
    """Return a spline through points of a base that are moved onto limits, refined until it keeps them throughout.

    Args:
        base: a smooth path near a certified motion with a path parameter.
        limits: limits that the path has to keep.
        bends: limits of the joints' bends, shape (b,) [rad].
        free: coordinates that knots may move.

    Returns:
        None when that does not converge.
    """
    # A constraint that begins inside a span would only be met on one side of its beginning.
    knots = _first_knots(base, [u for limit in limits for u in limit.breaks], _FIRST_SPANS)
    values: dict[float, FloatArray] = {0.0: np.asarray(base(0.0)), 1.0: np.asarray(base(1.0))}
    for _ in range(_ROUNDS):
        for u in knots:
            # Knots stay from round to round, so each is moved only once.
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

        # A spline is shaped by its neighbours as well; halving one span alone would leave uneven spans that ripple.
        around = np.unique(np.clip(np.add.outer(missed, (-1, 0, 1)), 0, len(knots) - 2))
        knots = np.union1d(knots, 0.5 * (knots[around] + knots[around + 1]))
    return None


def _first_knots(base: BSpline, breaks: list[float], least: int) -> FloatArray:
    """Return the knots of the base and the breaks, halved until there are at least ``least`` spans."""
    knots = np.union1d(np.clip(base.t, 0.0, 1.0), breaks)
    while len(knots) - 1 < least:
        knots = np.union1d(knots, 0.5 * (knots[1:] + knots[:-1]))
    return knots


def moved_onto(
    limits: tuple[UserLimit, ...], bends: FloatArray, free: Free, q: FloatArray, u: float
) -> FloatArray | None:
    """Return the pose moved by the least change that meets the equations, the violated gaps and the joint limits.

    Args:
        limits: limits that the path has to meet.
        bends: limits of the joints' bends, shape (b,) [rad].
        free: coordinates that may move.
        q: configuration, shape (c,).
        u: path parameter.

    Returns:
        None when that does not converge.
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
        # Rows are scaled to norm 1: units differ, and rounding must not affect the rank.
        scale = slope_norms(slopes)
        q = q + np.linalg.lstsq(slopes * moving / scale[:, None], change / scale, rcond=_RANK)[0]
    return None


def _violated_spans(spline: BSpline, knots: FloatArray, limits: tuple[UserLimit, ...], samples: int) -> IntArray:
    """Return, sorted, the spans in which a limit is violated at any of ``samples`` samples."""
    # Even samples in every span, however long the spans are.
    places = np.interp(np.arange(samples * (len(knots) - 1) + 1) / samples, np.arange(len(knots)), knots)
    q = np.asarray(spline(places))
    missed = np.zeros(len(places), dtype=bool)
    for limit in limits:
        missed |= limit.misses_path(q, places)
    return np.unique(np.minimum(np.flatnonzero(missed) // samples, len(knots) - 2))


def _short_spans(spline: BSpline, knots: FloatArray, limits: tuple[UserLimit, ...]) -> IntArray:
    """Return, sorted, the spans in which a limit holds, but with less clearance than its certificate requires."""
    places = certified_samples(spline)
    # Sample i to i + 1 lies in the span whose first knot is the last at or before it.
    failing = places[failed_intervals(limits, np.asarray(spline(places)))]
    return np.unique(np.clip(np.searchsorted(knots, failing, side="right") - 1, 0, len(knots) - 2))


def certified_samples(spline: BSpline) -> FloatArray:
    """Return path parameters along a path through knots, evenly spread in every span."""
    knots = np.unique(np.clip(spline.t, 0.0, 1.0))
    count = max(2, min(_CERTIFIED_SAMPLES, _MOST_CERTIFIED // (len(knots) - 1)))
    return np.interp(np.arange(count * (len(knots) - 1) + 1) / count, np.arange(len(knots)), knots)
