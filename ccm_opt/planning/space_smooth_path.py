"""The smooth path through the keyframes of a motion in space.

As in the plane: a cubic spline through points of a smooth curve leaves it by O(h⁴), so halving the spans in which the
equations are missed brings it back onto them quickly. The base is fixed, so that configurations are linear in the
unknowns, and a spline in these is one in those.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.path_on_limits import KnotJoints, certified_samples, spline_on_limits
from ccm_opt.planning.room_lacking import distance_lacking
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.space_tracking import moved_onto_terms
from ccm_opt.planning.spline_path import DEGREE, at_least_four, clamped_spline, halved, legs_of_spans, uncertified_spans
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.robot.arm import Arm

_REFINEMENTS = 16
"""How often legs of the control polygon are halved."""

PATH_SAMPLES = 4
"""Of a span between which the path is proved as if it were linear."""
_FEED = 0.12
"""Of the base over a span, at most; less than half of what joints stay straight beyond the guide tube, so that none is
bent on a span on which the tube holds it [u]."""

_LOOKS = 5
"""Places for every keyframe of the motion at which the room of the path is looked at."""

_USER_SAMPLES = 32
"""Of a span at which users' constraints are looked at, which are not proved between; taste."""
_LOST_ROOM = 0.02
"""Share of the wanted gap by which a path may lack more of it than its motion does; taste."""
_ROOMY_REFINEMENTS = 2
"""How often legs of the control polygon are halved to keep room; a path has ever more corners."""
_MOST_CONTROL = 400
"""Control points beyond which none are added."""
_LIMIT_SLACK = 1e-8
"""By how much rounding may carry coordinates beyond their limits [rad, m]."""


def path_on_equations(task: SpaceTask, motion: SpaceMotion, user: UserLimit) -> BSpline | None:
    """The certified path through knots that keep the user's constraints; None where there is none.

    Args:
        task: of an arm whose base is fixed, so that configurations are linear in the unknowns.
        motion: certified, its keyframes on the equations.
        user: the constraints.
    """
    arm = task.arm
    u = np.linspace(0.0, 1.0, len(motion.unknowns)) if motion.u is None else motion.u
    if len(u) <= DEGREE or np.any(np.diff(u) <= 0.0):
        return None
    free = (np.arange(len(task.start)) >= 2 * arm.clamped_joints).astype(np.float64)
    joints = KnotJoints(np.eye(len(free)), lambda q: q, arm.upper_limits, lambda _: free)
    # Smooth in itself; and less smooth, but nearer to what is certified.
    through = motion.curve.configurations(motion.unknowns)
    near = clamped_spline(through, np.concatenate(([0.0], u[2:-2], [1.0])))
    for base in (near, make_interp_spline(u, through, k=DEGREE)):
        spline = spline_on_limits(base, (user,), joints)
        if spline is not None and _safe(task, spline):
            return spline
    return None


def _safe(task: SpaceTask, spline: BSpline) -> bool:
    """Whether a path keeps the limits of coordinates and is certified, linear between its samples."""
    q = np.asarray(spline(certified_samples(spline)))
    slack = _LIMIT_SLACK
    within = np.all(q >= task.arm.lower_limits - slack) and np.all(q <= task.arm.upper_limits + slack)
    return bool(within) and len(task.certificate.failures(q)) == 0


def certified_path(task: SpaceTask, motion: SpaceMotion) -> BSpline | None:
    """A spline near a certified motion, itself certified at samples and linear between them; None where none is.

    It is a spline in the unknowns, in which a fed arm follows its own shape. With the keyframes as control points it
    cuts their corners by a sixth of the second differences. That makes motions of fixed arms quicker. A fed one, which
    moves far from keyframe to keyframe in narrow places, would lose room, and so it is drawn half-way onto the
    keyframes, and leaves neither them nor the legs between them by more than a twelfth. Where that is refused, or keeps
    less of the wanted room than the motion does, it is drawn onto the legs, and where that does not help either, the
    configurations that were certified are the control points.

    Args:
        task: with the certificate.
        motion: certified.
    """
    if task.user is not None and task.user.has_equations and not task.arm.base_axes:
        on_equations = path_on_equations(task, motion, task.user)
        if on_equations is not None:
            return on_equations
    path = partial(_through_curve, task, motion.curve)
    room = _Room.of(task, motion)
    nearest = None
    if task.arm.base_axes and len(motion.unknowns) > DEGREE and motion.u is None:
        control = _halfway_onto(motion.unknowns)
        nearest = path(control, np.linspace(0.0, 1.0, len(control) - DEGREE + 1))
        if len(_failing_places(task, nearest)) > 0:
            nearest = None
        elif len(room.lost_places(nearest)) == 0:
            return nearest
    near = _drawn_near(task, motion.unknowns, motion.u, path, motion.curve, room)
    if nearest is not None and (near is None or room.lacking(near) >= room.lacking(nearest)):
        return nearest
    if near is not None or not task.arm.base_axes or motion.u is not None:
        return near
    return certified_spline(task, motion.configurations)


def certified_spline(task: SpaceTask, keyframes: FloatArray) -> BSpline | None:
    """The same near certified configurations that no curve shows, which are its control points.

    Args:
        task: with the certificate.
        keyframes: shape (K, c) [rad, m].
    """
    return _drawn_near(task, keyframes, None, clamped_spline)


def _drawn_near(
    task: SpaceTask,
    keyframes: FloatArray,
    u: FloatArray | None,
    path: Callable[[FloatArray, FloatArray], BSpline],
    curve: CurveMap | None = None,
    room: "_Room | None" = None,
) -> BSpline | None:
    """The spline of control points, drawn onto their polygon until it is certified.

    A cubic B-spline leaves its control polygon by at most a sixth of the second difference: halving the legs of the
    polygon where a span fails draws the spline onto the polygon.

    Args:
        task: with the certificate.
        keyframes: shape (K, p).
        u: path parameters near which the path has to pass them, shape (K,); even ones when None.
        path: from control points and knots to a path through joint space.
        curve: whose unknowns the keyframes are; None where they are configurations.
        room: what the spline is asked to keep as well, in its first refinements; None for nothing.
    """
    even = np.linspace(0.0, 1.0, len(keyframes))
    # The last column is the path parameter, which is halved with the rest.
    control = np.column_stack((keyframes, even if u is None else u))
    control = at_least_four(control)
    for refinement in range(_REFINEMENTS):
        ends = _span_ends(control, even=u is None)
        spline = path(control[:, :-1], ends)
        places = _failing_places(task, spline)
        if room is not None and refinement < _ROOMY_REFINEMENTS:
            places = np.append(places, room.lost_places(spline))
        failing = np.unique(np.searchsorted(ends, places, side="right") - 1)
        if len(failing) == 0:
            return spline
        if len(control) > _MOST_CONTROL or task.deadline.passed():
            return None
        legs = legs_of_spans(control, failing)
        control = halved(control, legs)
        if task.user is not None and curve is not None:
            # A leg may break a gap that both its ends keep. What was inserted after others is as many places behind.
            _mend(task.stepper(curve, 0.0), task.user, control, legs + 1 + np.arange(len(legs)))
    return None


def _span_ends(control: FloatArray, *, even: bool) -> FloatArray:
    """Where the spans of a path begin and end, shape (spans + 1,), for control points with their path parameters."""
    spans = len(control) - DEGREE
    if even:
        return np.linspace(0.0, 1.0, spans + 1)
    # A control point counts most at the middle one of the three knots behind its first.
    return np.concatenate(([0.0], control[2:-2, -1], [1.0]))


def _mend(stepper: SpaceStepper, user: UserLimit, control: FloatArray, chosen: IntArray) -> None:
    """Move some control points, unknowns with their path parameters, to where they keep the user's constraints."""
    for k in chosen:
        moved = moved_onto_terms(stepper, user.placed(float(control[k, -1])), stepper.pose(control[k, :-1]))
        if moved is not None:
            control[k, :-1] = moved.v


@dataclass(frozen=True, eq=False)
class _Room:
    """What a path keeps of the room that its motion keeps.

    Attributes:
        task: with the wanted room.
        keyframes: of the motion, their number.
        lack: what the motion itself lacks of it at most [m].
    """

    task: SpaceTask
    keyframes: int
    lack: float

    @classmethod
    def of(cls, task: SpaceTask, motion: SpaceMotion) -> "_Room":
        """That of a motion."""
        return cls(task, len(motion.unknowns), float(np.max(_lacking(task, motion.configurations))))

    @property
    def _looks(self) -> FloatArray:
        """Places of a path at which is looked: a fed arm's has many more spans than its motion has keyframes."""
        return np.linspace(0.0, 1.0, _LOOKS * self.keyframes + 1)

    def lost_places(self, spline: BSpline) -> FloatArray:
        """Where a path lacks more, but for a small share of the wanted room."""
        lacking = _lacking(self.task, np.asarray(spline(self._looks)))
        return self._looks[lacking > self.lack + _LOST_ROOM * self.task.wanted_gap]

    def lacking(self, spline: BSpline) -> float:
        """What a path lacks of the wanted room at most [m]."""
        return float(np.max(_lacking(self.task, np.asarray(spline(self._looks)))))


def _lacking(task: SpaceTask, q: FloatArray) -> FloatArray:
    """By how much configurations, shape (k, c), lack the wanted room, shape (k,) [m]."""
    kept = task.arm.radius + task.clearance + task.wanted_gap
    return distance_lacking(task.arm, task.tree, task.arm.joint_positions_at(q), kept)


def _samples(spline: BSpline, of_span: int) -> FloatArray:
    """Even places of a path, some of every span."""
    knots = spline.t[DEGREE:-DEGREE]
    share = np.arange(of_span) / of_span
    return np.append((knots[:-1, None] + share * np.diff(knots)[:, None]).ravel(), 1.0)


def _halfway_onto(keyframes: FloatArray) -> FloatArray:
    """Control points whose spline lies half as far from keyframes, shape (K, p), as it would with these themselves."""
    control = keyframes.copy()
    control[1:-1] -= np.diff(keyframes, 2, axis=0) / 12.0
    return control


def _through_curve(task: SpaceTask, curve: CurveMap, control: FloatArray, ends: FloatArray) -> BSpline:
    """The path along a spline in the unknowns of a curve, shape (m, p), whose spans have given ends.

    Configurations of an arm whose base is fixed are linear in the unknowns. Those of a fed arm are taken at Greville's
    places of knots so near each other that a joint which bends on one span is outside the guide tube on all that its
    control points shape. A joint that slides over where the curve bends more than it can, between keyframes that know
    nothing of it, is bent as far as it can be.
    """
    unknowns = clamped_spline(control, ends)
    limits = (task.arm.lower_limits, task.arm.upper_limits)
    if not task.arm.base_axes:
        return BSpline(unknowns.t, np.clip(curve.configurations(np.asarray(control)), *limits), DEGREE)
    fed = np.asarray(unknowns(ends))[:, curve.feed_column] * curve.scale[curve.feed_column]
    most = _FEED * task.unit
    parts = np.maximum(np.ceil(np.abs(np.diff(fed)) / most), 1.0).astype(np.intp)
    inner = np.concatenate([np.linspace(ends[k], ends[k + 1], part + 1)[1:] for k, part in enumerate(parts)])
    knots = np.concatenate((np.zeros(DEGREE + 1), inner, np.ones(DEGREE)))
    places = np.mean([knots[1 + k : len(knots) - DEGREE + k] for k in range(DEGREE)], axis=0)
    return BSpline(knots, np.clip(curve.configurations(np.asarray(unknowns(places))), *limits), DEGREE)


def _failing_places(task: SpaceTask, spline: BSpline) -> FloatArray:
    """Middles of spans on which the path, linear between samples, is not proved safe, or bends a joint that is held."""
    knots = spline.t[DEGREE:-DEGREE]
    middles = 0.5 * (knots[:-1] + knots[1:])
    if task.arm.base_axes:
        # Cheap to see, and asked first.
        q = np.asarray(spline(_samples(spline, PATH_SAMPLES)))
        bent = _bent_inside(task.arm, spline, q, PATH_SAMPLES)
        if len(bent) > 0:
            return middles[bent]
    failing = middles[uncertified_spans(spline, task.certificate)]
    if task.user is None:
        return failing
    user_samples = _USER_SAMPLES
    finer = (knots[:-1, None] + np.arange(user_samples) / user_samples * np.diff(knots)[:, None]).ravel()
    return np.concatenate((failing, finer[task.user.misses_path(np.asarray(spline(finer)), finer)]))


def _bent_inside(arm: Arm, spline: BSpline, q: FloatArray, samples: int) -> IntArray:
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
