"""Whether joints are straight for as long as the guide tube holds them."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.ground.arrays import BoolArray, IntArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.jointed.link_chain import HELD_TOLERANCE
from ccm_opt.planners.following.following_settings import DEFAULT_FOLLOWING, FollowingSettings
from ccm_opt.problem import Limits


def travel_between_samples(arm: Arm, limits: Limits, settings: FollowingSettings = DEFAULT_FOLLOWING) -> float:
    """How far the base can move between two samples of a trajectory [m], given that it is timed by ``feed_limits``."""
    return settings.sample_period * (feed_limits(arm, limits, settings).feed_velocity or 0.0)


def feed_limits(arm: DrivenArm, limits: Limits, settings: FollowingSettings = DEFAULT_FOLLOWING) -> Limits:
    """Limits under which a fed arm is timed: its base passes at most a part of a link between two samples.

    Joints may bend only once they are out of the guide tube by what the base can travel from one sample to the next, so
    a base that is allowed to be very fast is held back rather than its joints.
    """
    if limits.feed_velocity is None:
        return limits
    fastest = settings.links_per_sample * arm.link_length / settings.sample_period
    return replace(limits, feed_velocity=min(limits.feed_velocity, fastest))


def straight_while_held(
    arm: Arm, spline: BSpline, travel: float, settings: FollowingSettings = DEFAULT_FOLLOWING
) -> bool:
    """Whether every joint is exactly straight while it is held, and for some travel of the base before and after.

    A joint is taken as bent on a whole span of the spline when one of the span's control points bends it. Where the
    path comes to rest (three control points are one) the base needs no room to travel on.

    Args:
        arm: with a feed axis.
        spline: of bends and feed, over [0, 1].
        travel: of the base, around a joint's bending, in which the joint must be outside the guide tube too [m].
        settings: of following.
    """
    per_span = settings.samples_per_span
    samples = np.asarray(spline(np.linspace(0.0, 1.0, per_span * _spans(spline) + 1)))[:, -1]
    travelled = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(samples)))))
    rests = per_span * _rests(spline)
    bent = _bent_spans(spline)

    for joint in np.flatnonzero(bent.any(axis=0)):
        # Samples of every span that bends the joint, and further those that the base reaches by its travel,
        begin = per_span * np.flatnonzero(bent[:, joint])
        end = begin + per_span
        first = np.searchsorted(travelled, travelled[begin] - travel, side="left") - 1
        last = np.searchsorted(travelled, travelled[end] + travel, side="right")
        # but not beyond where the path rests before and after.
        first = np.maximum(first, rests[np.searchsorted(rests, begin, side="right") - 1])
        last = np.minimum(last, rests[np.searchsorted(rests, end, side="left")])

        least_feed = min(float(samples[a : b + 1].min()) for a, b in zip(first, last, strict=True))
        if least_feed + joint * arm.link_length < arm.hole - 0.5 * HELD_TOLERANCE:
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
