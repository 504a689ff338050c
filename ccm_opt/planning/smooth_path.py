"""The smooth path through the keyframes of a motion in the plane."""

from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.optimise import path_parameters
from ccm_opt.planning.path_on_limits import KnotJoints, certified_samples, spline_on_limits
from ccm_opt.planning.spline_path import certified_spline, spare_kept

_EQUATION_SAMPLES = 200
"""Places of a path beside keyframes at which equations are looked at. Taste."""


def path_through_knots(motion: Motion, task: MotionTask) -> BSpline | None:
    """The certified path through knots that meet the task's limits; None when there is none.

    Args:
        motion: certified, its keyframes on the equations.
        task: with the limits.
    """
    arm = task.arm
    # Bend i is φ_i − φ_{i−1}, and that of the first joint is φ_0 less the mount, which is fixed.
    rows = np.diff(np.eye(arm.links, motion.configurations.shape[1]), axis=0, prepend=0.0)
    joints = KnotJoints(rows, lambda q: arm.bends(q[: arm.links]), arm.bend_limits, partial(_free, task))
    for base in _bases(motion, task):
        spline = spline_on_limits(base, task.user_limits, joints)
        if spline is not None and _within_limits(spline, task) and not len(_uncertified(spline, task)):
            return spline
    return None


def _bases(motion: Motion, task: MotionTask) -> list[BSpline]:
    """Smooth paths near the motion that know its path parameter, smoothest first."""
    bases = []
    if not task.parametric:
        near = certified_spline(motion.configurations, task.certificate)
        if near is not None:
            bases.append(near)

    # The second try passes through the keyframes, which lie on the equations: less smooth, but nearer to what is
    # certified.
    u = path_parameters(motion)
    if len(u) > 3:
        bases.append(make_interp_spline(u, motion.configurations, k=3))
    return bases


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


def _within_limits(spline: BSpline, task: MotionTask) -> bool:
    """Whether the bends keep their limits at samples of the path."""
    arm = task.arm
    bends = np.abs(arm.bends(spline(certified_samples(spline))[:, : arm.links]))
    # Ends are as the problem gives them; a bend there may stand at its limit but for rounding.
    return bool(np.all(bends <= np.maximum(arm.bend_limits, bends[[0, -1]].max(axis=0))))


def _uncertified(spline: BSpline, task: MotionTask) -> IntArray:
    """Intervals between samples of a path that are not certified."""
    return task.certificate.failures(spline(certified_samples(spline)))


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
        spline = certified_spline(motion.configurations, task.certificate)
        return None if spline is None else SmoothPath(spline, spare_kept(spline, task.certificate))


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


@dataclass(frozen=True)
class SplineNearEquations:
    """A B-spline beside keyframes that meets equations all the same, as those that are linear in a pose.

    One through knots on them swings a little everywhere, and so in a guide tube, which holds joints straight.
    """

    def applies(self, task: MotionTask) -> bool:
        """Where no spline beside the keyframes has been tried yet."""
        return any(limit.shapes_path for limit in task.user_limits)

    def path(self, motion: Motion, task: MotionTask) -> SmoothPath | None:
        """The spline, where no sample of it misses an equation."""
        path = SplineNearKeyframes().path(motion, task)
        if path is None:
            return None
        u = np.linspace(0.0, 1.0, _EQUATION_SAMPLES)
        missed = any(limit.misses_path(path.spline(u), u).any() for limit in task.user_limits)
        return None if missed else path


PATH_STRATEGIES: tuple[PathStrategy, ...] = (SplineNearKeyframes(), SplineThroughKnots(), SplineNearEquations())
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
