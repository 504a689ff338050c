"""The smooth path of a motion under users' equations: a cubic spline through knots that lie on them.

As in the plane: a cubic spline through points of a smooth curve leaves it by O(h⁴), so halving the spans in which the
equations are missed brings it back onto them quickly. The base is fixed, so that configurations are linear in the
unknowns, and a spline in these is one in those.
"""

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.motion.settings.search_settings import SmoothPathSettings
from ccm_opt.space.motion.onto_terms import moved_onto_terms
from ccm_opt.space.motion.space_user_limit import SpaceUserLimit
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask

DEGREE = 3


def path_on_equations(
    task: SpaceTask, motion: SpaceMotion, settings: SmoothPathSettings | None = None
) -> BSpline | None:
    """The certified path through knots that keep the user's constraints; None where there is none.

    Args:
        task: with the constraints.
        motion: certified, its keyframes on the equations.
        settings: how it is refined; those of the plane when None.
    """
    user = task.user
    numbers = settings or SmoothPathSettings()
    if user is None:
        return None
    u = np.linspace(0.0, 1.0, len(motion.unknowns)) if motion.u is None else motion.u
    if len(u) <= DEGREE or np.any(np.diff(u) <= 0.0):
        return None
    # Smooth in itself; and less smooth, but nearer to what is certified.
    knots = np.concatenate((np.zeros(DEGREE + 1), u[2:-2], np.ones(DEGREE + 1)))
    for base in (BSpline(knots, motion.unknowns, DEGREE), make_interp_spline(u, motion.unknowns, k=DEGREE)):
        spline = _on_equations(task, user, motion, base, numbers)
        if spline is not None and _safe(task, spline):
            return spline
    return None


def _on_equations(
    task: SpaceTask, user: SpaceUserLimit, motion: SpaceMotion, base: BSpline, settings: SmoothPathSettings
) -> BSpline | None:
    """A spline through points of the base that are moved onto the constraints, refined until it keeps them."""
    stepper = task.stepper(motion.curve, 0.0)
    knots = np.union1d(np.linspace(0.0, 1.0, settings.first_spans + 1), user.breaks)
    values: dict[float, FloatArray] = {0.0: motion.unknowns[0], 1.0: motion.unknowns[-1]}
    for _ in range(settings.rounds):
        for place in knots:
            # Knots stay from round to round, so each is moved only once.
            if float(place) not in values:
                pose = moved_onto_terms(stepper, user.placed(float(place)), stepper.pose(np.asarray(base(place))))
                if pose is None:
                    return None
                values[float(place)] = pose.v
        of_unknowns = make_interp_spline(knots, np.array([values[float(place)] for place in knots]), k=DEGREE)
        control = motion.curve.configurations(of_unknowns.c)
        spline = BSpline(of_unknowns.t, control, DEGREE)
        missed = _missed_spans(user, spline, knots, settings.equation_samples)
        if not len(missed):
            return spline
        if len(knots) + len(missed) > settings.most_spans or task.deadline.passed():
            return None
        # A spline is shaped by its neighbours too; halving one span alone would leave uneven spans that ripple.
        around = np.unique(np.clip(np.add.outer(missed, (-1, 0, 1)), 0, len(knots) - 2))
        knots = np.union1d(knots, 0.5 * (knots[around] + knots[around + 1]))
    return None


def _missed_spans(user: SpaceUserLimit, spline: BSpline, knots: FloatArray, samples: int) -> IntArray:
    """Spans in which a constraint is missed, sorted."""
    places = np.interp(np.arange(samples * (len(knots) - 1) + 1) / samples, np.arange(len(knots)), knots)
    missed = np.flatnonzero(user.missed_on_path(np.asarray(spline(places)), places))
    return np.unique(np.minimum(missed // samples, len(knots) - 2))


def _safe(task: SpaceTask, spline: BSpline) -> bool:
    """Whether a path keeps the limits of coordinates and is certified, linear between its samples."""
    knots = np.unique(np.clip(spline.t, 0.0, 1.0))
    count = max(2 * task.settings.smooth_path.samples, -(-task.settings.smooth_path.most_control // (len(knots) - 1)))
    places = np.interp(np.arange(count * (len(knots) - 1) + 1) / count, np.arange(len(knots)), knots)
    q = np.asarray(spline(places))
    slack = task.settings.smooth_path.limit_slack
    within = np.all(q >= task.arm.lower_limits - slack) and np.all(q <= task.arm.upper_limits + slack)
    return bool(within) and len(task.certificate.failures(q)) == 0
