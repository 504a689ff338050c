"""The smooth path along a motion: a spline near its keyframes, or through knots projected onto user constraints.

The knots are tried first if a user constraint is an equation, or if a user constraint or cost depends on the path
parameter; otherwise the spline near the keyframes is tried first. If the first alternative yields no certified path,
the other is tried; without user constraints and costs, the knots are not tried at all.
"""

from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound
from ccm_opt.planning.limits.limit import restored_keyframes
from ccm_opt.planning.motion import CurveMotion
from ccm_opt.planning.path_on_limits import certified_samples, spline_on_limits
from ccm_opt.planning.pose import CurveUnknowns
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.spline_path import (
    DEGREE,
    certified_spare,
    certified_spline,
    clamped_spline,
    parameter_spans,
    spline_near,
    uncertified_spans,
)
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bad_pose import clearance_advice

PATH_SAMPLES = 4
"""Number of samples of a span of a path between which configurations are checked as linear."""
_LOOKS = 5
"""Number of samples per keyframe of the motion at which the clearance of the path is measured."""

_USER_SAMPLES = 32
"""Number of samples of a span at which user constraints are checked; they are not proved in between. Heuristic."""
_LOST_ROOM = 0.02
"""Largest amount by which a path may lack more of the preferred clearance than its motion does, as a fraction of the
preferred clearance. Heuristic."""
_ROOMY_REFINEMENTS = 2
"""Number of first refinements of the control polygon in which the preferred clearance is required as well; later it is
not, since each refinement adds sharp bends to the path."""
_LIMIT_SLACK = 1e-8
"""Largest excess of coordinates over their limits by rounding [rad, m]."""


CurveType = TypeVar("CurveType", bound=CurveUnknowns)
"""Type of the map from unknowns to configurations of a motion."""


@dataclass(frozen=True)
class SmoothPath:
    """A certified C² path through joint space.

    Attributes:
        spline: configurations over the path parameter in [0, 1], values (c,).
        spare: certified gap beyond contact, by which timing may let the arm deviate from the path [m].
    """

    spline: BSpline
    spare: float


def joint_path(task: SearchTask, *motions: CurveMotion[CurveType], legs: bool = False) -> JointPath:
    """Return the smooth, certified path through joint space along the first motion that has one.

    Args:
        task: the search task.
        motions: certified motions, in order of preference.
        legs: whether timing will use straight legs between the keyframes instead of the path.

    Raises:
        MotionNotFound: no smooth path near a motion can be certified.
    """
    missed = None
    for motion in motions:
        path = smooth_path(motion, task)
        missed = None if path is None else task.violated_place(path.spline)
        if path is not None and missed is None:
            keyframes, spline, curves = task.keyframes_along(motion.configurations, path.spline, legs=legs)
            return JointPath(spline, keyframes, curves, motion.candidate, spare=path.spare)
    raise MotionNotFound(missed or _no_path(task))


def _no_path(task: SearchTask) -> Diagnosis:
    """Return the diagnosis for a task in which a motion is found, but no smooth path along it can be certified."""
    advice = clearance_advice(task.arm.tip_radius, task.kept - task.arm.tip_radius, key=task.arm.key("radius"))
    if not task.constraints:
        return Diagnosis(
            "a motion was found, but no smooth path along it keeps the required clearance", "motion", advice
        )
    names = " and ".join(map(repr, task.constraints))
    reason = f"a motion was found, but no smooth path near it keeps constraint {names} between its keyframes"
    fed = "leave arm.feed out: equations that are not linear hold for arms with a fixed base"
    equations = task.arm.base_axes and any(limit.has_equations for limit in task.user_limits)
    width = "give the constraint some width between its bounds, or make it soft"
    return Diagnosis(reason, "constraints", (width, *((fed,) if equations else ()), *advice))


def smooth_path(motion: CurveMotion[CurveType], task: SearchTask) -> SmoothPath | None:
    """Return the certified path through joint space along a motion; None if there is none.

    A path near the keyframes is short and smooth, but violates user constraints that are equations, and may violate
    the others between keyframes. A path through knots projected onto the constraints satisfies them, but leaves no
    spare gap for timing. The module's docstring says which one is tried first.

    Args:
        motion: certified motion; its keyframes meet the equations of the limits.
        task: task with the limits that the path has to keep.
    """
    limits = task.user_limits
    shaped = any(limit.shapes_path for limit in limits)
    spline = _through_knots(motion, task) if shaped else None
    if spline is None:
        near = _near_keyframes(motion, task)
        if near is not None:
            # Where constraints are kept exactly, timing may not use the spare gap.
            exact = any(limit.names for limit in limits)
            return SmoothPath(near, 0.0 if exact else certified_spare(near, task.certificate))
        spline = _through_knots(motion, task) if limits and not shaped else None
    return None if spline is None else SmoothPath(spline, 0.0)


# ------------------------------------------------------------ through knots on the limits
def _through_knots(motion: CurveMotion[CurveType], task: SearchTask) -> BSpline | None:
    """Return a certified path through knots projected onto the user's constraints; None if no path is certified.

    Args:
        motion: the motion; the result is None unless its configurations are affine in its unknowns.
        task: task with the limits.
    """
    if not motion.curve.affine:
        return None
    u = motion.path_parameters
    if len(u) <= DEGREE or np.any(np.diff(u) <= 0.0):
        return None
    keyframes = motion.configurations
    parametric = any(limit.parametric for limit in task.user_limits)
    near = None if parametric else certified_spline(keyframes, task.certificate)
    # The first base is smooth in itself; the second less so, but nearer to the certified motion.
    bases = (near or clamped_spline(keyframes, parameter_spans(u)), make_interp_spline(u, keyframes, k=DEGREE))
    for base in bases:
        spline = spline_on_limits(base, task.user_limits, task.arm.bend_limits, task.free)
        if spline is not None and _is_safe(spline, task):
            return spline
    return None


def _is_safe(spline: BSpline, task: SearchTask) -> bool:
    """Return whether a path respects the joint limits and is certified; it counts as linear between its samples."""
    q = np.asarray(spline(certified_samples(spline)))
    limits = task.arm.bend_limits
    bends = np.abs(q[:, : len(limits)])
    # The problem gives the ends; a bend there may exceed its limit by a rounding error.
    most = np.maximum(limits, np.max(bends[[0, -1]], axis=0)) + _LIMIT_SLACK
    return bool(np.all(bends <= most)) and len(task.certificate.failures(q)) == 0


# ------------------------------------------------------------ near the keyframes
def _near_keyframes(motion: CurveMotion[CurveType], task: SearchTask) -> BSpline | None:
    """Return a spline near a certified motion whose chords between samples are certified; None if there is none.

    The spline is in the unknowns. With the keyframes as control points, it deviates from them by a sixth of the second
    differences, which makes motions of arms on fixed bases faster. A fed arm, which moves far from keyframe to keyframe
    in narrow passages, would lose clearance, so its control points are shifted to halve that deviation. If such a
    spline is not certified, or lacks more of the preferred clearance than the motion does, the control polygon is
    refined towards the motion, and if that fails, too, certified configurations are the control points.

    Args:
        motion: the motion.
        task: task with the limits that the path has to keep.
    """
    curve = motion.curve
    # A follow-the-leader motion has such close keyframes that its spline loses no notable clearance.
    sought = task.wanted_gap > 0.0 and not motion.follows
    room = _Room.for_task(task, motion.configurations) if sought else None
    failing = partial(_failing_places, task, room, tube=not curve.affine)
    nearest = None
    if not curve.affine and len(motion.unknowns) > DEGREE and motion.u is None:
        nearest = curve.along(clamped_spline(_halfway_onto(motion.unknowns)))
        if len(failing(nearest, _ROOMY_REFINEMENTS)) > 0:
            nearest = None
        elif room is None or len(room.lost_places(nearest)) == 0:
            return nearest
    # A leg may violate a gap that both its ends keep.
    mended = partial(restored_keyframes, task.user_limits, curve) if task.user_limits else None
    near = spline_near(motion.unknowns, curve.along, failing, task.deadline, u=motion.u, mended=mended)
    if nearest is not None and (
        near is None or (room is not None and room.worst_shortfall(near) >= room.worst_shortfall(nearest))
    ):
        return nearest
    if near is not None or curve.affine or motion.u is not None:
        return near
    return path_near_configurations(motion.configurations, task)


def path_near_configurations(keyframes: FloatArray, task: SearchTask) -> BSpline | None:
    """Return a certified path with configurations as control points, refined if needed; None if that fails.

    Args:
        keyframes: configurations of a certified motion, shape (K, c) [rad, m].
        task: task with the certificate.
    """
    failing = partial(_failing_places, task, None, tube=task.arm.feed is not None)
    return spline_near(keyframes, lambda spline: spline, failing, task.deadline)


@dataclass(frozen=True, eq=False)
class _Room:
    """Comparison of the clearance of a path with the clearance of the motion near which it runs.

    Attributes:
        task: task with the preferred clearance.
        keyframes: number of keyframes of the motion.
        motion_shortfall: largest shortfall of the motion itself from the preferred clearance [m].
    """

    task: SearchTask
    keyframes: int
    motion_shortfall: float

    @classmethod
    def for_task(cls, task: SearchTask, configurations: FloatArray) -> "_Room":
        """Return the comparison with a motion, given by configurations (K, c) [rad, m]."""
        return cls(task, len(configurations), float(np.max(task.clearance_shortfall(configurations))))

    @property
    def _looks(self) -> FloatArray:
        """Path parameters at which clearance is measured, shape (m,)."""
        return np.linspace(0.0, 1.0, _LOOKS * self.keyframes + 1)

    def lost_places(self, spline: BSpline) -> FloatArray:
        """Return parameters (m,) at which a path lacks notably more of the preferred clearance than its motion."""
        shortfall = self.task.clearance_shortfall(np.asarray(spline(self._looks)))
        return self._looks[shortfall > self.motion_shortfall + _LOST_ROOM * self.task.wanted_gap]

    def worst_shortfall(self, spline: BSpline) -> float:
        """Return the largest shortfall of a path from the preferred clearance [m]."""
        return float(np.max(self.task.clearance_shortfall(np.asarray(spline(self._looks)))))


def _halfway_onto(keyframes: FloatArray) -> FloatArray:
    """Return control points (K, p) whose spline deviates from keyframes half as far as theirs would."""
    control = keyframes.copy()
    control[1:-1] -= np.diff(keyframes, 2, axis=0) / 12.0
    return control


def _failing_places(
    task: SearchTask, room: _Room | None, spline: BSpline, refinement: int, *, tube: bool
) -> FloatArray:
    """Return the parameters at which a path violates a limit, or the midpoints of spans that are not certified, (m,).

    Args:
        task: task with the limits that the path has to keep.
        room: clearance that is also required in the first refinements, or None.
        spline: the path, checked as linear between samples of each span.
        refinement: number of refinements so far.
        tube: whether to check that no joint inside the guide tube bends.
    """
    knots = spline.t[DEGREE:-DEGREE]
    middles = 0.5 * (knots[:-1] + knots[1:])
    # Cheap, so checked first.
    bent = _bent_inside(task.arm, spline) if tube else ()
    if len(bent) > 0:
        return np.asarray(middles[bent])
    failing = [middles[uncertified_spans(spline, task.certificate)]]
    if task.user_limits:
        finer = (knots[:-1, None] + np.arange(_USER_SAMPLES) / _USER_SAMPLES * np.diff(knots)[:, None]).ravel()
        # A constraint that begins between two of these samples is violated most where it begins.
        finer = np.union1d(finer, [u for limit in task.user_limits for u in limit.breaks])
        q = np.asarray(spline(finer))
        failing += [finer[limit.misses_path(q, finer)] for limit in task.user_limits]
    if room is not None and refinement < _ROOMY_REFINEMENTS:
        failing.append(room.lost_places(spline))
    return np.concatenate(failing)


def _bent_inside(arm: Arm, spline: BSpline) -> IntArray:
    """Return the indices of the spans on which a joint may bend inside the guide tube.

    A joint counts as bent on a whole span if one of the span's four control points bends it; the feed between samples
    is assumed to be less than at the samples by at most half of their difference.

    Args:
        arm: arm on a feed axis.
        spline: cubic spline of configurations.
    """
    control = np.asarray(spline.c)
    spans = len(control) - DEGREE
    links = arm.links
    bent = np.any(control[:, : arm.bends_a_joint * links].reshape(-1, links, arm.bends_a_joint) != 0.0, axis=2)
    bent_on_span = np.any([bent[k : k + spans] for k in range(DEGREE + 1)], axis=0)
    knots = spline.t[DEGREE:-DEGREE]
    share = np.arange(PATH_SAMPLES) / PATH_SAMPLES
    places = np.append((knots[:-1, None] + share * np.diff(knots)[:, None]).ravel(), 1.0)
    feed = arm.coordinates.advance(np.asarray(spline(places)))
    of_span = np.lib.stride_tricks.sliding_window_view(feed, PATH_SAMPLES + 1)[::PATH_SAMPLES]
    way = np.max(np.abs(np.diff(of_span, axis=1)), axis=1)
    least = np.min(of_span, axis=1) - 0.5 * way
    outside = least[:, None] + arm.bending_places - arm.hole
    return np.flatnonzero(np.any(bent_on_span & (outside < 0.0), axis=1))
