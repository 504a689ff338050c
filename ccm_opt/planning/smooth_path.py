"""The smooth path through the keyframes of a motion.

A cubic spline through points of a smooth curve leaves it by O(h⁴) (de Boor, A Practical Guide to Splines, ch. V), so
halving the spans in which the equations are missed brings the path back onto them quickly.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit import Limit
from ccm_opt.planning.limits.limit_stack import overbent
from ccm_opt.planning.limits.motion_certificate import failed_intervals
from ccm_opt.planning.limits.user_motion_rows import slope_norms
from ccm_opt.planning.motion_task import Motion, MotionTask
from ccm_opt.planning.optimisation.optimise import path_parameters
from ccm_opt.planning.settings import SmoothPathSettings
from ccm_opt.planning.spline_path import certified_spline, spare_kept
from ccm_opt.robot.arm import Arm

_CERTIFIED_SAMPLES = 12
"""Samples of a span between which the certificate takes the headings to be linear. Taste."""
_MOST_CERTIFIED = 6000
"""Samples of the whole path at most. Taste: the certificate's cost."""


def path_through_knots(motion: Motion, task: MotionTask) -> BSpline | None:
    """The certified path through knots that meet the task's limits; None when there is none.

    Args:
        motion: certified, its keyframes on the equations.
        task: with the limits.
    """
    for base in _bases(motion, task):
        spline = _on_equations(base, task)
        if spline is not None and _within_limits(spline, task) and not len(_uncertified(spline, task)):
            return spline
    return None


def _bases(motion: Motion, task: MotionTask) -> list[BSpline]:
    """Smooth paths near the motion that know its path parameter, smoothest first."""
    bases = []
    if not task.parametric:
        near = certified_spline(motion.headings, task.certificate, task.settings.smooth_path)
        if near is not None:
            bases.append(near)

    # The second try passes through the keyframes, which lie on the equations: less smooth, but nearer to what is
    # certified.
    u = path_parameters(motion)
    if len(u) > 3:
        bases.append(make_interp_spline(u, motion.headings, k=3))
    return bases


def _on_equations(base: BSpline, task: MotionTask) -> BSpline | None:
    """A spline through points of the base that are moved onto the limits, refined until it keeps them throughout."""
    settings = task.settings.smooth_path
    limits = task.user_limits
    # A constraint that begins inside a span would be met on one side of its beginning only.
    breaks = [u for limit in limits for u in limit.breaks]
    knots = _first_knots(base, breaks, settings.first_spans)
    values: dict[float, FloatArray] = {0.0: np.asarray(base(0.0)), 1.0: np.asarray(base(1.0))}
    for _ in range(settings.rounds):
        for u in knots:
            # Knots stay from round to round, so each is moved only once.
            if float(u) not in values:
                beside = np.asarray(base(u))
                moved = moved_onto(limits, task.arm, beside, float(u), _free(task, beside), settings)
                if moved is None:
                    return None
                values[float(u)] = moved

        spline = make_interp_spline(knots, np.array([values[float(u)] for u in knots]), k=3)
        missed = _missed_spans(spline, knots, limits, settings.equation_samples)
        if not len(missed):
            missed = _short_spans(spline, knots, limits)
        if not len(missed):
            return spline
        if len(knots) + len(missed) > settings.most_spans:
            return None

        # A spline is shaped by its neighbours as well; halving one span alone would leave uneven spans that ripple.
        around = np.unique(np.clip(np.add.outer(missed, (-1, 0, 1)), 0, len(knots) - 2))
        knots = np.union1d(knots, 0.5 * (knots[around] + knots[around + 1]))
    return None


def _free(task: MotionTask, pose: FloatArray) -> FloatArray:
    """1 for what a knot may turn, 0 for a clamped base, links in a guide tube and the base's own way, shape (c,)."""
    arm = task.arm
    free = np.zeros(len(pose))
    # Links up to the first joint outside the tube keep the heading of the tube.
    feed = arm.link_length * float(pose[arm.links :].sum())
    free[: arm.links] = ~arm.held(feed)
    # A clamped base may not be turned, not even by the little that a knot is moved.
    free[0] *= 0.0 if task.clamped else 1.0
    return free


def _first_knots(base: BSpline, breaks: list[float], least: int) -> FloatArray:
    """The knots of the base and the breaks, halved until there are at least so many spans."""
    knots = np.union1d(np.clip(base.t, 0.0, 1.0), breaks)
    while len(knots) - 1 < least:
        knots = np.union1d(knots, 0.5 * (knots[1:] + knots[:-1]))
    return knots


def moved_onto(
    limits: tuple[Limit, ...],
    arm: Arm,
    headings: FloatArray,
    u: float,
    free: FloatArray,
    settings: SmoothPathSettings,
) -> FloatArray | None:
    """Link headings moved onto the equations, out of broken gaps and within joint limits, by least change.

    Args:
        limits: that the path has to meet.
        arm: whose bends are limited.
        headings: and what carries the base, shape (links,) or (c,) [rad, link lengths].
        u: path parameter.
        free: 1 for links that may turn, 0 for others, of the same shape.
        settings: of Newton's method.

    Returns:
        None when that does not converge.
    """
    held = np.zeros(arm.links)
    bounds = settings.joint_share * arm.bend_limits
    for _ in range(settings.newton_steps):
        turned, change = overbent(bounds, arm.bends(headings[: arm.links]), held, settings.met)
        slopes = np.pad(turned, ((0, 0), (0, len(headings) - arm.links)))
        for limit in limits:
            missed, by = limit.missed_on_path(headings, u)
            slopes = np.vstack((missed, slopes))
            change = np.append(by, change)
        if not np.isfinite(change).all():
            return None
        if np.max(np.abs(change), initial=0.0) <= settings.met:
            return headings
        # Rows of norm 1: units differ, and the rank has to be told from rounding.
        scale = slope_norms(slopes)
        step = np.linalg.lstsq(slopes * free / scale[:, None], change / scale, rcond=settings.rank)[0]
        headings = headings + step
    return None


def _missed_spans(spline: BSpline, knots: FloatArray, limits: tuple[Limit, ...], samples: int) -> IntArray:
    """Spans in which a limit is missed, sorted; each is looked at in so many samples."""
    # Even samples in every span, however long the spans are.
    places = np.interp(np.arange(samples * (len(knots) - 1) + 1) / samples, np.arange(len(knots)), knots)
    headings = spline(places)
    missed = np.zeros(len(places), dtype=bool)
    for limit in limits:
        missed |= limit.misses_path(headings, places)
    return np.unique(np.minimum(np.flatnonzero(missed) // samples, len(knots) - 2))


def _short_spans(spline: BSpline, knots: FloatArray, limits: tuple[Limit, ...]) -> IntArray:
    """Spans in which a limit holds, but with less room than its certificate asks for, sorted."""
    places = _samples(spline)
    # Sample i to i + 1 lies in the span whose first knot is the last at or before it.
    failing = places[failed_intervals(limits, spline(places))]
    return np.unique(np.clip(np.searchsorted(knots, failing, side="right") - 1, 0, len(knots) - 2))


def _within_limits(spline: BSpline, task: MotionTask) -> bool:
    """Whether the bends keep their limits at samples of the path."""
    arm = task.arm
    bends = np.abs(arm.bends(spline(_samples(spline))[:, : arm.links]))
    # Ends are as the problem gives them; a bend there may stand at its limit but for rounding.
    return bool(np.all(bends <= np.maximum(arm.bend_limits, bends[[0, -1]].max(axis=0))))


def _uncertified(spline: BSpline, task: MotionTask) -> IntArray:
    """Intervals between samples of a path that are not certified."""
    return task.certificate.failures(spline(_samples(spline)))


def _samples(spline: BSpline) -> FloatArray:
    """Places along a path, evenly spread in every span."""
    knots = np.unique(np.clip(spline.t, 0.0, 1.0))
    count = max(2, min(_CERTIFIED_SAMPLES, _MOST_CERTIFIED // (len(knots) - 1)))
    return np.interp(np.arange(count * (len(knots) - 1) + 1) / count, np.arange(len(knots)), knots)


@dataclass(frozen=True)
class SmoothPath:
    """A certified C² path through joint space.

    Attributes:
        spline: link headings over the path parameter in [0, 1], values (links,) [rad].
        spare: gap beyond contact that timing may use up [m].
    """

    spline: BSpline
    spare: float


class PathStrategy(Protocol):
    """One way to lay a smooth path."""

    def applies(self, task: MotionTask) -> bool:
        """Whether a path laid this way meets the task's limits."""
        ...

    def path(self, motion: Motion, task: MotionTask) -> SmoothPath | None:
        """The path along a certified motion; None when there is none."""
        ...


@dataclass(frozen=True)
class SplineNearKeyframes:
    """A B-spline with the keyframes as control points: short, and smooth by itself."""

    def applies(self, task: MotionTask) -> bool:
        """A path beside the keyframes keeps gaps, but leaves equations."""
        return not any(limit.shapes_path for limit in task.user_limits)

    def path(self, motion: Motion, task: MotionTask) -> SmoothPath | None:
        """The spline, refined until it is certified."""
        settings = task.settings.smooth_path
        spline = certified_spline(motion.headings, task.certificate, settings)
        return None if spline is None else SmoothPath(spline, spare_kept(spline, task.certificate, settings))


@dataclass(frozen=True)
class SplineThroughKnots:
    """A spline through dense knots that are moved onto the limits; nothing of its gap is left to timing."""

    def applies(self, task: MotionTask) -> bool:
        """Always, but it costs more."""
        del task
        return True

    def path(self, motion: Motion, task: MotionTask) -> SmoothPath | None:
        """The spline, its knots halved until it meets the limits between them."""
        spline = path_through_knots(motion, task)
        return None if spline is None else SmoothPath(spline, 0.0)


PATH_STRATEGIES: tuple[PathStrategy, ...] = (SplineNearKeyframes(), SplineThroughKnots())
"""Those that apply are tried in turn; the first that lays a path decides."""


def smooth_path(motion: Motion, task: MotionTask) -> SmoothPath | None:
    """The certified path through joint space along a motion; None when there is none.

    Args:
        motion: certified.
        task: with the limits that the path has to meet.
    """
    for strategy in PATH_STRATEGIES:
        path = strategy.path(motion, task) if strategy.applies(task) else None
        # A user's gap may dip between the keyframes of a motion, by more than its samples show; a path through knots
        # that are moved out of it may be laid where none beside the keyframes is. Nothing else would be moved.
        if path is not None or not task.user_limits:
            return path
    return None
