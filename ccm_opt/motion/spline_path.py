"""A C² path through joint space: a clamped cubic B-spline with the keyframes as control points, certified."""

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.motion.clamped_spline import DEGREE, clamped_spline
from ccm_opt.motion.limits.motion_certificate import IntervalCertificate
from ccm_opt.motion.settings.search_settings import SmoothPathSettings

SMOOTH_PATH = SmoothPathSettings()
"""The settings unless others are given."""


def certified_spline(
    keyframes: FloatArray, certificate: IntervalCertificate, settings: SmoothPathSettings = SMOOTH_PATH
) -> BSpline | None:
    """A spline near certified keyframes, itself certified on a fine grid; None when refinement does not help.

    A cubic B-spline leaves its control polygon by at most a sixth of the second difference, so halving the legs of
    the control polygon where a span fails draws the spline onto the polygon, which is certified.

    Args:
        keyframes: link headings, shape (K, links) [rad].
        certificate: of the arm among the walls.
        settings: samples and refinements.
    """
    control = _at_least_four(keyframes)
    for _ in range(settings.refinements):
        spline = clamped_spline(control)
        counts = _samples_a_span(spline, certificate, settings)
        # Sample i lies in the span k with ends[k] ≤ i < ends[k + 1]; that is undone below to name the spans that fail.
        ends = np.concatenate(([0], np.cumsum(counts)))
        samples = np.interp(np.arange(ends[-1] + 1), ends, np.linspace(0.0, 1.0, len(ends)))
        failing = np.unique(np.searchsorted(ends, certificate.failures(spline(samples)), side="right") - 1)
        if len(failing) == 0:
            return spline
        # Not the insertion of a knot, which would leave the curve as it is: the polygon stays, and its second
        # differences, by which the curve leaves it, become smaller.
        control = _halve_legs(control, failing)
    return None


def spare_kept(spline: BSpline, certificate: IntervalCertificate, settings: SmoothPathSettings = SMOOTH_PATH) -> float:
    """Gap beyond contact that a certified spline keeps: what is spared, less the error of linear interpolation [m]."""
    errors = _interpolation_errors(spline, certificate) / _samples_a_span(spline, certificate, settings) ** 2
    return max(0.0, certificate.spare - float(np.max(errors)))


def _samples_a_span(spline: BSpline, certificate: IntervalCertificate, settings: SmoothPathSettings) -> IntArray:
    """Samples of each span that bring linear interpolation within its share of the gap that the certificate spares."""
    allowed = max(settings.spare_share * certificate.spare, settings.least_error * certificate.arm.length)
    # The error falls with the square of the number of samples.
    wanted = np.ceil(np.sqrt(_interpolation_errors(spline, certificate) / allowed))
    return np.clip(wanted, settings.least_samples, settings.most_samples).astype(np.intp)


def _interpolation_errors(spline: BSpline, certificate: IntervalCertificate) -> FloatArray:
    """How far each span, interpolated linearly between its ends, may be off, shape (spans,) [m].

    It errs by ⅛ h² max|φ''| in a heading, so by Σ l of that in a position; φ'' is linear on a span, its control points
    are its values at the knots.
    """
    spans = len(spline.c) - DEGREE
    # |φ″| summed over links bounds what the tip may be off by; spans are 1 / spans long.
    turning = np.abs(spline.derivative(2).c).sum(axis=1)[: spans + 1]
    return np.asarray(certificate.arm.link_length * np.maximum(turning[:-1], turning[1:]) / (8.0 * spans**2))


def _at_least_four(control: FloatArray) -> FloatArray:
    while len(control) < DEGREE + 1:
        control = _halve_legs(control, np.arange(len(control)))
    return control


def _halve_legs(control: FloatArray, spans: IntArray) -> FloatArray:
    """Insert the middles of the legs that shape given spans (span k is shaped by control points k to k + 3)."""
    legs = np.unique(np.clip(np.add.outer(spans, np.arange(DEGREE)).ravel(), 0, len(control) - 2))
    return np.insert(control, legs + 1, 0.5 * (control[legs] + control[legs + 1]), axis=0)
