"""The smooth path of a motion under the user's equations: a C² cubic spline through knots that lie on them.

A cubic spline through points of a smooth curve leaves it by O(h⁴) (de Boor, A Practical Guide to Splines, ch. V), so
halving the spans in which the equations are missed brings the path back onto them quickly.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.collision.certificate import Certificate
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.constrained.certificate import ALLOWED
from ccm_opt.motion.constrained.rows import overbent, slope_norms
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.optimisation.own_optimise import path_parameters
from ccm_opt.motion.spline_path import certified_spline

if TYPE_CHECKING:
    from ccm_opt.user_terms.row_set import RowSet, RowValues

MISSED = 0.2 * ALLOWED
"""By which the path may miss a row between its knots."""
SAMPLES = 8
"""Samples of a span at which rows are looked at."""
FIRST_SPANS, MOST_SPANS = 48, 1200
ROUNDS = 10
_NEWTON_STEPS = 12
_MET = 1e-10
_CERTIFIED = 12
"""Samples of a span between which the certificate takes the headings to be linear, where there are few spans."""
_MOST_SAMPLES = 6000


def own_path(motion: Motion, task: MotionTask) -> BSpline | None:
    """The certified path through joint space that keeps the user's constraints; None when there is none.

    Args:
        motion: certified, its keyframes on the user's equations.
        task: with the user's terms.
    """
    terms = task.terms
    if terms is None or not on_equations(task):
        return certified_spline(motion.headings, task.certificate)
    for base in _bases(motion, task):
        spline = _on_equations(base, terms.path_rows, task)
        if spline is not None and _within_limits(spline, task.arm) and not len(_uncertified(spline, task.certificate)):
            return spline
    return None


def on_equations(task: MotionTask) -> bool:
    """Whether the path has to lie on equations, or to know its parameter, so that it is laid through dense knots."""
    return task.terms is not None and bool(task.terms.path_rows.equal.any() or task.terms.parametric)


def _bases(motion: Motion, task: MotionTask) -> list[BSpline]:
    """Smooth paths near the motion that know its path parameter, smoothest first."""
    u = path_parameters(motion)
    bases = [make_interp_spline(u, motion.headings, k=3)] if len(u) > 3 else []
    if task.terms is not None and not task.terms.parametric:
        near = certified_spline(motion.headings, task.certificate)
        bases = [*([near] if near is not None else []), *bases]
    return bases


def _on_equations(base: BSpline, rows: "RowSet", task: MotionTask) -> BSpline | None:
    """A spline through points of the base that are moved onto the rows, refined until it keeps them throughout."""
    free = np.ones(task.arm.links)
    free[0] = 0.0 if task.clamped else 1.0
    knots = _first_knots(base, task.terms.breaks.tolist() if task.terms is not None else [])
    values: dict[float, FloatArray] = {0.0: np.asarray(base(0.0)), 1.0: np.asarray(base(1.0))}
    for _ in range(ROUNDS):
        for u in knots:
            if float(u) not in values:
                moved = moved_onto(rows, task.arm, np.asarray(base(u)), float(u), free)
                if moved is None:
                    return None
                values[float(u)] = moved
        spline = make_interp_spline(knots, np.array([values[float(u)] for u in knots]), k=3)
        missed = _missed_spans(spline, knots, rows)
        if not len(missed):
            return spline
        if len(knots) + len(missed) > MOST_SPANS:
            return None
        around = np.unique(np.clip(np.add.outer(missed, (-1, 0, 1)), 0, len(knots) - 2))
        knots = np.union1d(knots, 0.5 * (knots[around] + knots[around + 1]))
    return None


def _first_knots(base: BSpline, breaks: Sequence[float]) -> FloatArray:
    knots = np.union1d(np.clip(base.t, 0.0, 1.0), breaks)
    while len(knots) - 1 < FIRST_SPANS:
        knots = np.union1d(knots, 0.5 * (knots[1:] + knots[:-1]))
    return knots


def moved_onto(rows: "RowSet", arm: Arm, headings: FloatArray, u: float, free: FloatArray) -> FloatArray | None:
    """Link headings moved onto the equations, out of broken gaps and within joint limits, by least change.

    Args:
        rows: of the constraints.
        arm: whose bends are limited.
        headings: shape (links,) [rad].
        u: path parameter.
        free: 1 for links that may turn, 0 for others, shape (links,).

    Returns:
        None when that does not converge.
    """
    held = np.zeros(arm.links)
    for _ in range(_NEWTON_STEPS):
        slopes, change = _wanted(rows.at(headings, u))
        turned, back = overbent(arm, headings, held)
        slopes, change = np.vstack((slopes, turned)), np.append(change, back)
        if not np.isfinite(change).all():
            return None
        if np.max(np.abs(change), initial=0.0) <= _MET:
            return headings
        scale = slope_norms(slopes)
        headings = headings + np.linalg.lstsq(slopes * free / scale[:, None], change / scale, rcond=1e-9)[0]
    return None


def _wanted(values: "RowValues") -> tuple[FloatArray, FloatArray]:
    """Slopes of what is missed, and by how much it has to change."""
    broken = values.gaps < 0.0
    slopes = np.vstack((values.equation_slopes, values.gap_slopes[broken]))
    return slopes, np.append(-values.equations, -values.gaps[broken])


def _missed_spans(spline: BSpline, knots: FloatArray, rows: "RowSet") -> IntArray:
    """Spans in which a row is missed, sorted."""
    places = np.interp(np.arange(SAMPLES * (len(knots) - 1) + 1) / SAMPLES, np.arange(len(knots)), knots)
    table = rows.table(spline(places), places)
    miss = np.where(rows.equal, np.abs(table), -table)
    bad = np.flatnonzero(np.any(miss > MISSED, axis=1))
    return np.unique(np.minimum(bad // SAMPLES, len(knots) - 2))


def _within_limits(spline: BSpline, arm: Arm) -> bool:
    """Whether the bends keep their limits at samples of the path."""
    bends = np.abs(arm.bends(spline(_samples(spline))))
    return bool(np.all(bends <= np.maximum(arm.bend_limits, bends[[0, -1]].max(axis=0))))


def _uncertified(spline: BSpline, certificate: Certificate) -> IntArray:
    """Intervals between samples of a path that are not certified."""
    return certificate.failures(spline(_samples(spline)))


def _samples(spline: BSpline) -> FloatArray:
    """Places along a path, evenly spread in every span."""
    knots = np.unique(np.clip(spline.t, 0.0, 1.0))
    count = max(2, min(_CERTIFIED, _MOST_SAMPLES // (len(knots) - 1)))
    return np.interp(np.arange(count * (len(knots) - 1) + 1) / count, np.arange(len(knots)), knots)
