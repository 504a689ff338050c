"""A C² path through joint space: a clamped cubic B-spline with the keyframes as control points, certified."""

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.motion.task import SpaceTask

DEGREE = 3


def certified_spline(task: SpaceTask, keyframes: FloatArray) -> BSpline | None:
    """A spline near certified keyframes, itself certified at samples and linear between them; None where none is.

    A cubic B-spline leaves its control polygon by at most a sixth of the second difference: halving the legs of the
    polygon where a span fails draws the spline onto the polygon, which is certified.

    Args:
        task: with the certificate.
        keyframes: configurations, shape (K, c) [rad, m].
    """
    settings = task.settings.smooth_path
    control = keyframes
    while len(control) < DEGREE + 1:
        control = _halved(control, np.arange(len(control) - 1))
    # A spline lies in the hull of its control points, and so do the limits of coordinates.
    slack = settings.limit_slack
    if np.any(control < task.arm.lower_limits - slack) or np.any(control > task.arm.upper_limits + slack):
        return None
    for _ in range(settings.refinements):
        spline = clamped_spline(control)
        failing = _failing_spans(task, spline)
        if len(failing) == 0:
            return spline
        if len(control) > settings.most_control or task.deadline.passed():
            return None
        # A span k is shaped by the control points k to k + 3.
        legs = np.unique(np.clip(np.add.outer(failing, np.arange(DEGREE)).ravel(), 0, len(control) - 2))
        control = _halved(control, legs)
    return None


def clamped_spline(control: FloatArray) -> BSpline:
    """The clamped uniform cubic B-spline over [0, 1] with given control points, shape (m ≥ 4, c)."""
    spans = len(control) - DEGREE
    knots = np.concatenate((np.zeros(DEGREE), np.linspace(0.0, 1.0, spans + 1), np.ones(DEGREE)))
    return BSpline(knots, control, DEGREE)


def _failing_spans(task: SpaceTask, spline: BSpline) -> IntArray:
    """Spans on which the path, linear between samples, is not proved to be safe, or bends a joint that is held."""
    samples = task.settings.smooth_path.samples
    spans = len(spline.c) - DEGREE
    q = np.asarray(spline(np.linspace(0.0, 1.0, samples * spans + 1)))
    if task.arm.base_axes:
        # Cheap to see, and asked first.
        bent = _bent_inside(task.arm, spline, q, samples)
        if len(bent) > 0:
            return bent
    return np.unique(task.certificate.failures(q) // samples).astype(np.intp)


def _bent_inside(arm: SpaceArm, spline: BSpline, q: FloatArray, samples: int) -> IntArray:
    """Spans on which a joint may be bent while the guide tube holds it.

    A joint bends on the whole of a span when one of the span's four control points bends it; the feed is within half of
    the way between samples of what they have.

    Args:
        arm: with a feed axis.
        spline: of configurations.
        q: at even samples of it, shape (N, c).
        samples: of a span.
    """
    control = np.asarray(spline.c)
    spans = len(control) - DEGREE
    links = arm.links
    bent = np.any(control[:, : 2 * links].reshape(-1, links, 2) != 0.0, axis=2)
    bent_on_span = np.any([bent[k : k + spans] for k in range(DEGREE + 1)], axis=0)
    feed = arm.coordinates.advance(q)
    of_span = np.stack([feed[k : k + samples * spans : samples] for k in range(samples)] + [feed[samples::samples]])
    way = np.max(np.abs(np.diff(of_span, axis=0)), axis=0)
    least = np.min(of_span, axis=0) - 0.5 * way
    outside = least[:, None] + arm.link_length * np.arange(links) - arm.hole
    return np.flatnonzero(np.any(bent_on_span & (outside < 0.0), axis=1))


def _halved(control: FloatArray, legs: IntArray) -> FloatArray:
    """The control polygon with some of its legs halved."""
    return np.insert(control, legs + 1, 0.5 * (control[legs] + control[legs + 1]), axis=0)
