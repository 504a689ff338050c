"""The smooth path of a motion, in one of two ways: a spline near its keyframes, or one through knots on equations."""

from dataclasses import dataclass
from typing import Protocol

from scipy.interpolate import BSpline

from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.path_on_equations import path_through_knots
from ccm_opt.motion.spline_path import certified_spline, spare_kept


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
