"""Whether joints are straight for as long as the guide holds them."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.arrays import BoolArray, IntArray
from ccm_opt.jointed.arm import HELD_TOLERANCE, Arm
from ccm_opt.problem import Limits

SAMPLE_STEP = 5e-3
"""Longest time between two samples of a trajectory, between which all joints move linearly [s]."""
LINKS_A_SAMPLE = 0.25
"""Part of a link that the base passes at most between two samples."""
_SAMPLES_A_SPAN = 12


def travel_between_samples(arm: Arm, limits: Limits) -> float:
    """How far the base can move between two samples of a trajectory [m], given that it is timed by ``feed_limits``."""
    return SAMPLE_STEP * (feed_limits(arm, limits).feed_velocity or 0.0)


def feed_limits(arm: Arm, limits: Limits) -> Limits:
    """Limits under which a fed arm is timed: its base passes at most a part of a link between two samples.

    Joints may bend only once they are out of the guide by what the base can travel from one sample to the next, so a
    base that is allowed to be very fast is held back rather than its joints.
    """
    if arm.feed is None or limits.feed_velocity is None:
        return limits
    return replace(limits, feed_velocity=min(limits.feed_velocity, LINKS_A_SAMPLE * arm.link_length / SAMPLE_STEP))


def straight_while_held(arm: Arm, spline: BSpline, travel: float) -> bool:
    """Whether every joint is exactly straight while it is held, and for some travel of the base before and after.

    A joint is taken as bent on a whole span of the spline when one of the span's control points bends it. Where the
    path comes to rest (three control points are one) the base needs no room to travel on.

    Args:
        arm: with a feed axis.
        spline: of bends and feed, over [0, 1].
        travel: of the base, around a joint's bending, in which the joint must be outside the guide too [m].
    """
    feed = arm.feed
    if feed is None:
        return True
    samples = np.asarray(spline(np.linspace(0.0, 1.0, _SAMPLES_A_SPAN * _spans(spline) + 1)))[:, -1]
    covered = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(samples)))))
    rests, bent = _SAMPLES_A_SPAN * _rests(spline), _bent_spans(spline)
    for joint in np.flatnonzero(bent.any(axis=0)):
        begin = _SAMPLES_A_SPAN * np.flatnonzero(bent[:, joint])
        end = begin + _SAMPLES_A_SPAN
        first = np.searchsorted(covered, covered[begin] - travel, side="left") - 1
        last = np.searchsorted(covered, covered[end] + travel, side="right")
        first = np.maximum(first, rests[np.searchsorted(rests, begin, side="right") - 1])
        last = np.minimum(last, rests[np.searchsorted(rests, end, side="left")])
        least = min(float(samples[a : b + 1].min()) for a, b in zip(first, last, strict=True))
        if least + joint * arm.link_length < feed.hole - 0.5 * HELD_TOLERANCE:
            return False
    return True


def _rests(spline: BSpline) -> IntArray:
    """Spans at whose beginning the path rests, the number of spans last, increasing."""
    control = np.asarray(spline.c)
    same = np.all(control[1:] == control[:-1], axis=1)
    inner = np.flatnonzero(same[:-1] & same[1:])
    return np.unique(np.concatenate(([0], inner[inner <= _spans(spline)], [_spans(spline)])))


def _spans(spline: BSpline) -> int:
    return len(spline.c) - spline.k


def _bent_spans(spline: BSpline) -> BoolArray:
    """Which joints a control point bends on which span, shape (spans, links), boolean."""
    bent = np.asarray(spline.c)[:, :-1] != 0.0
    on_span: BoolArray = np.any([bent[k : k + _spans(spline)] for k in range(spline.k + 1)], axis=0)
    return on_span
