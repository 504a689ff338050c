"""Certified cubic splines near the keyframes of a motion."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.limits.motion_certificate import IntervalCertificate

_LEAST_SAMPLES = 4
"""Minimum number of samples of a span, between which the certificate assumes linear motion. Heuristic."""
_MOST_SAMPLES = 96
"""Maximum number of samples of a span. Heuristic."""
_SPARE_SHARE = 0.5
"""Largest error of linear interpolation between samples, as a fraction of the gap that the certificate proves; the rest
of the gap is proved for the spline itself. Heuristic."""
_LEAST_ERROR = 2e-06
"""Error of linear interpolation that is allowed however small the gap is, as a fraction of the arm's length. Derived: a
few times the penetration that still counts as contact."""
_REFINEMENTS = 5
"""Maximum number of rounds in which legs of the control polygon are halved where a span fails. Heuristic."""
_MOST_REFINEMENTS = 16
"""Maximum number of rounds in which legs are halved if user limits or the preferred clearance are required too.
Heuristic."""
_MOST_CONTROL = 400
"""Number of control points above which none are added. Heuristic."""
_MOST_GROWTH = 8
"""Number of control points per keyframe above which none are added, where that allows more than ``_MOST_CONTROL``.
Heuristic."""

DEGREE = 3
"""Degree of the splines: the least with a continuous second derivative."""


def clamped_spline(control: FloatArray, ends: FloatArray | None = None) -> BSpline:
    """Return the clamped cubic B-spline over [0, 1] with given control points.

    Args:
        control: control points, shape (m ≥ 4, c).
        ends: boundaries of the spans, increasing from 0 to 1, shape (m − 2,); evenly spaced if None.
    """
    if ends is None:
        ends = np.linspace(0.0, 1.0, len(control) - DEGREE + 1)
    # End knots of multiplicity four: the curve begins and ends at its first and last control point.
    return BSpline(np.concatenate((np.zeros(DEGREE), ends, np.ones(DEGREE))), control, DEGREE)


@lru_cache(maxsize=64)
def smoothing_matrix(keyframes: int) -> FloatArray:
    """Return the matrix that maps the control points of a clamped cubic spline to one spline value near each of them.

    Row k gives the value of the spline at the Greville abscissa of control point k, the mean of the three knots inside
    its support (de Boor, *A Practical Guide to Splines*, chapter IX). For fewer than four control points, which give
    straight legs that the spline follows, the matrix is the identity.

    Args:
        keyframes: number of control points.

    Returns:
        Shape (keyframes, keyframes).
    """
    if keyframes < DEGREE + 1:
        return np.eye(keyframes)
    return np.asarray(clamped_spline(np.eye(keyframes))(_beside(keyframes)), dtype=np.float64)


def places_along(keyframes: int, samples: int) -> FloatArray:
    """Return parameters at which to sample a clamped cubic spline, equally many for each leg of its control polygon.

    Equal steps of the parameter would give long distances near the ends, where the spline moves along the legs faster.

    Args:
        keyframes: number of control points.
        samples: number of samples per leg.

    Returns:
        Increasing parameters, shape (samples (keyframes − 1) + 1,).
    """
    legs = keyframes - 1
    return np.interp(np.arange(samples * legs + 1) / samples, np.arange(keyframes), _beside(keyframes))


@lru_cache(maxsize=64)
def _beside(keyframes: int) -> FloatArray:
    """Return the Greville abscissae of a clamped cubic spline with at least four control points, shape (keyframes,)."""
    knots = clamped_spline(np.eye(keyframes)).t
    return np.array([knots[k + 1 : k + DEGREE + 1].mean() for k in range(keyframes)])


def certified_spline(
    keyframes: FloatArray, certificate: IntervalCertificate, refinements: int = _REFINEMENTS
) -> BSpline | None:
    """Return a certified spline of configurations near certified keyframes, or None if refinement does not suffice.

    Args:
        keyframes: configurations, shape (K, c) [rad, m].
        certificate: certificate of contact.
        refinements: maximum number of rounds of halving legs of the control polygon.
    """

    def failing(spline: BSpline, _: int) -> FloatArray:
        knots = spline.t[DEGREE:-DEGREE]
        return np.asarray((0.5 * (knots[:-1] + knots[1:]))[uncertified_spans(spline, certificate)])

    return spline_near(keyframes, lambda spline: spline, failing, refinements=refinements)


def spline_near(
    keyframes: FloatArray,
    path: Callable[[BSpline], BSpline],
    failing: Callable[[BSpline, int], FloatArray],
    deadline: Deadline | None = None,
    u: FloatArray | None = None,
    mended: Callable[[FloatArray, FloatArray], FloatArray] | None = None,
    refinements: int = _MOST_REFINEMENTS,
) -> BSpline | None:
    """Return a smooth path near keyframes that no check refuses, or None if refining its control polygon does not help.

    A cubic B-spline deviates from its control polygon by at most a sixth of the second difference, so halving the legs
    of the polygon where a span fails brings the spline closer to the polygon, which is certified.

    Args:
        keyframes: first control points, shape (K, p).
        path: function from a spline of the unknowns to the path.
        failing: function of the path and of the number of refinements so far that returns the parameters at which the
            path is refused, shape (m,).
        deadline: time after which the attempt ends, or None.
        u: path parameters near which the path has to pass the keyframes, shape (K,); evenly spaced if None.
        mended: function that moves control points, shape (m, p), onto the limits at their parameters, shape (m,).
        refinements: maximum number of rounds of halving legs.
    """
    # The last column is the path parameter, which is halved with the rest.
    control = np.column_stack((keyframes, np.linspace(0.0, 1.0, len(keyframes)) if u is None else u))
    control = at_least_four(control)
    most = max(_MOST_CONTROL, _MOST_GROWTH * len(keyframes))
    for refinement in range(refinements):
        ends = np.linspace(0.0, 1.0, len(control) - DEGREE + 1) if u is None else parameter_spans(control[:, -1])
        spline = path(clamped_spline(control[:, :-1], ends))
        spans = np.unique(np.searchsorted(ends, failing(spline, refinement), side="right") - 1)
        if len(spans) == 0:
            return spline
        if len(control) > most or (deadline is not None and deadline.passed()):
            return None
        # Unlike knot insertion, which would leave the curve unchanged, this keeps the polygon and reduces its second
        # differences, which bound the deviation of the curve from the polygon.
        control = halved(control, span_legs(control, spans))
        if mended is not None:
            control[:, :-1] = mended(control[:, :-1], control[:, -1])
    return None


def parameter_spans(u: FloatArray) -> FloatArray:
    """Return the span boundaries with which a cubic spline passes its m control points near given parameters, (m − 2,).

    Args:
        u: path parameters of the control points, shape (m,).
    """
    # A control point has most weight at the middle one of the three knots inside its support.
    return np.concatenate(([0.0], u[2:-2], [1.0]))


def uncertified_spans(spline: BSpline, certificate: IntervalCertificate) -> IntArray:
    """Return the sorted indices of the spans of a clamped spline that cannot be certified.

    The certificate applies to the piecewise-linear motion through enough samples of the spline.
    """
    counts = _samples_a_span(spline, certificate)
    # Sample i lies in the span k with ends[k] ≤ i < ends[k + 1]; inverted below to find the spans that fail.
    ends = np.concatenate(([0], np.cumsum(counts)))
    samples = np.interp(np.arange(ends[-1] + 1), ends, spline.t[DEGREE:-DEGREE])
    return np.unique(np.searchsorted(ends, certificate.failures(np.asarray(spline(samples))), side="right") - 1)


def certified_spare(spline: BSpline, certificate: IntervalCertificate) -> float:
    """Return a lower bound on the gap of a certified spline beyond contact, at least 0 [m].

    It is the gap of the certificate minus the error of linear interpolation between samples.
    """
    errors = _interpolation_errors(spline, certificate) / _samples_a_span(spline, certificate) ** 2
    return max(0.0, certificate.spare - float(np.max(errors)))


def _samples_a_span(spline: BSpline, certificate: IntervalCertificate) -> IntArray:
    """Return for each span the number of samples that makes the linear interpolation error small enough, (spans,).

    The number is capped; beyond the cap the error may be larger.
    """
    allowed = max(_SPARE_SHARE * certificate.spare, _LEAST_ERROR * certificate.arm.length)
    # The error falls with the square of the number of samples.
    wanted = np.ceil(np.sqrt(_interpolation_errors(spline, certificate) / allowed))
    return np.clip(wanted, _LEAST_SAMPLES, _MOST_SAMPLES).astype(np.intp)


def _interpolation_errors(spline: BSpline, certificate: IntervalCertificate) -> FloatArray:
    """Return upper bounds on the error of positions if each span of a spline is replaced by its chord, (spans,) [m].

    The error in a coordinate is at most ⅛ h² max|q''|, and in a position the travel of the arm for such a change; q''
    is linear on a span, and its control points are its values at the knots.
    """
    ends = spline.t[DEGREE:-DEGREE]
    moving = certificate.arm.coordinates.travel(spline.derivative(2).c[: len(ends)], certificate.arm.lengths)
    return np.asarray(np.maximum(moving[:-1], moving[1:]) * np.diff(ends) ** 2 / 8.0)


def at_least_four(control: FloatArray) -> FloatArray:
    """Return a control polygon (m, p) refined by halving legs to the four or more points that a cubic spline needs.

    A single point is first doubled into a leg of length 0.
    """
    if len(control) == 1:
        control = np.repeat(control, 2, axis=0)
    while len(control) < DEGREE + 1:
        control = halved(control, np.arange(len(control) - 1))
    return control


def span_legs(control: FloatArray, spans: IntArray) -> IntArray:
    """Return the indices of the legs of a control polygon on which given spans of its cubic spline depend.

    Span k depends on control points k to k + 3.
    """
    return np.unique(np.clip(np.add.outer(spans, np.arange(DEGREE)).ravel(), 0, len(control) - 2))


def halved(control: FloatArray, legs: IntArray) -> FloatArray:
    """Return a control polygon (m, p) with the midpoints of given legs inserted as control points."""
    return np.insert(control, legs + 1, 0.5 * (control[legs] + control[legs + 1]), axis=0)
