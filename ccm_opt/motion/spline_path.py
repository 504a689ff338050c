"""A C² path through joint space: a clamped cubic B-spline with the keyframes as control points, certified."""

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.motion.certificate import Certificate

LEAST_SAMPLES, MOST_SAMPLES = 4, 24
"""Samples of a span between which the certificate takes the headings to be linear."""
_LEAST_SPARE = 2e-6
"""Share of the arm's length that linear interpolation between samples may err by, whatever the certificate spares."""
_REFINEMENTS = 5
DEGREE = 3


def certified_spline(keyframes: FloatArray, certificate: Certificate) -> BSpline | None:
    """A spline near certified keyframes, itself certified on a fine grid; None when refinement does not help.

    A cubic B-spline leaves its control polygon by at most a sixth of the second difference, so halving the legs of
    the control polygon where a span fails draws the spline onto the polygon, which is certified.

    Args:
        keyframes: link headings, shape (K, links) [rad].
        certificate: of the arm among the walls.
    """
    control = _at_least_four(keyframes)
    for _ in range(_REFINEMENTS):
        spline = clamped_spline(control)
        count = _samples_a_span(spline, certificate)
        samples = np.linspace(0.0, 1.0, count * (len(control) - DEGREE) + 1)
        failing = np.unique(certificate.failures(spline(samples)) // count)
        if len(failing) == 0:
            return spline
        control = _halve_legs(control, failing)
    return None


def clamped_spline(control: FloatArray) -> BSpline:
    """Clamped uniform cubic B-spline over [0, 1] with given control points, shape (m ≥ 4, links)."""
    spans = len(control) - DEGREE
    knots = np.concatenate((np.zeros(DEGREE), np.linspace(0.0, 1.0, spans + 1), np.ones(DEGREE)))
    return BSpline(knots, control, DEGREE)


def _samples_a_span(spline: BSpline, certificate: Certificate) -> int:
    """Samples that bring linear interpolation within the gap that the certificate spares.

    It errs by ⅛ h² max|φ''| in a heading, so by Σ l of that in a position; the control points of φ'' bound φ''.
    """
    arm, spans = certificate.arm, len(spline.c) - DEGREE
    bound = arm.link_length * float(np.abs(spline.derivative(2).c).sum(axis=1).max()) / (8.0 * spans**2)
    allowed = max(certificate.spare, _LEAST_SPARE * arm.length)
    return int(np.clip(np.ceil(np.sqrt(bound / allowed)), LEAST_SAMPLES, MOST_SAMPLES))


def _at_least_four(control: FloatArray) -> FloatArray:
    while len(control) < DEGREE + 1:
        control = _halve_legs(control, np.arange(len(control)))
    return control


def _halve_legs(control: FloatArray, spans: IntArray) -> FloatArray:
    """Insert the middles of the legs that shape given spans (span k is shaped by control points k to k + 3)."""
    legs = np.unique(np.clip(np.add.outer(spans, np.arange(DEGREE)).ravel(), 0, len(control) - 2))
    return np.insert(control, legs + 1, 0.5 * (control[legs] + control[legs + 1]), axis=0)
