"""A hard limit is one class: what a class below asks is kept by steps, by the optimisation and between keyframes."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, LimitOf, LimitRows
from ccm_opt.planning.optimisation.optimise import optimise as shortened
from ccm_opt.planning.pose import CurveUnknowns, Pose
from ccm_opt.planning.smooth_path import smooth_path
from ccm_opt.planning.strategies import CONNECT, WAYS, find_by_ways, find_motion
from ccm_opt.robot.arm import Arm

from .scenes import clutter, motion_task
from .snakes_in_space import boxes, snake
from .snakes_in_space import task_of as space_task_of

RESERVE = 2e-3


@dataclass(frozen=True)
class TipBelow(LimitOf[CurveUnknowns]):
    """Keeps the tip below a height.

    Attributes:
        arm: the arm.
        height: along the last axis [m].
    """

    arm: Arm
    height: float

    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """The tip may use half of its room in a step."""
        del space, turn
        room = np.array([0.5 * (self.height - pose.tip[-1])])
        return LimitRows(pose.moving[-1, -1:], -np.full(1, UNBOUNDED), room, keeps=lambda trial: self._below(trial.q))

    def keeps_at_goal(self, space: CurveUnknowns, near: Pose, final: Pose) -> bool:
        """Whether the pose on the goal is below."""
        del space, near
        return self._below(final.q)

    def keyframe_rows(self, sweep: Any, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """The tip stays below at every keyframe by a little that the path may use, or does not rise."""
        del u
        keyframe = np.arange(1, len(sweep.unknowns))
        room = np.maximum(self.height - RESERVE - sweep.points[keyframe, self.arm.links, -1], 0.0)
        slopes = sweep.moving[keyframe, self.arm.links, -1]
        return (KeyframeRows(keyframe, slopes, np.full(len(room), -UNBOUNDED), room),)

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Intervals in which the tip is not below; at samples will do for a toy."""
        del depth
        share = np.linspace(0.0, 1.0, 9)[:, None]
        between = q[:-1, None] + share * np.diff(q, axis=0)[:, None]
        return np.flatnonzero([not self._below(some) for some in between])

    def _below(self, q: FloatArray) -> bool:
        tips = self.arm.joint_positions_at(np.atleast_2d(q))[:, -1]
        return bool(np.all(tips[:, -1] <= self.height + 1e-9))


def highest(arm: Arm, q: FloatArray) -> float:
    """Height of the tip at dense samples of a path through configurations, shape (K, c) [m]."""
    places = np.linspace(0.0, len(q) - 1.0, 40 * len(q))
    dense = np.column_stack([np.interp(places, np.arange(len(q)), column) for column in q.T])
    return float(np.max(arm.joint_positions_at(dense)[:, -1, -1]))


def test_a_new_limit_is_kept_in_the_plane() -> None:
    """The tip, which would rise to 0.81 m, stays below 0.77 m in the motion, once it is optimised, and on its path."""
    free = motion_task(clutter(0, 4, 24).problem())
    assert highest(free.arm, shortened(find_motion(free), free).configurations) > 0.8
    task = replace(free, held=(TipBelow(free.arm, 0.77),))
    found = find_motion(task)
    better = shortened(found, task)
    path = smooth_path(better, task)
    assert path is not None
    for q in (found.configurations, better.configurations, path.spline(np.linspace(0.0, 1.0, 200))):
        assert highest(task.arm, np.asarray(q)) <= 0.77 + 1e-4


@pytest.mark.drawn(6, of="whole plans")
def test_a_new_limit_is_kept_in_space() -> None:
    """The same past a block, over which the tip would rise to 0.14 m, below 0.07 m."""
    arm = snake(10)
    block = boxes([([0.45, 0.15, -0.5], [0.55, 0.25, 0.1])])
    free = space_task_of(arm, block, GoalPose(np.array([0.3, 0.6, 0.0])))
    led = tuple(each for each in WAYS if CONNECT not in each.name and "chains" not in each.name)
    assert highest(arm, shortened(find_by_ways(free, led), free).configurations) > 0.14
    task = replace(free, held=(TipBelow(arm, 0.07),))
    found = find_by_ways(task, led)
    better = shortened(found, task)
    path = smooth_path(better, task)
    assert path is not None
    for q in (found.configurations, better.configurations, path.spline(np.linspace(0.0, 1.0, 200))):
        assert highest(arm, np.asarray(q)) <= 0.07 + 1e-4
    assert highest(arm, find_by_ways(task).configurations) <= 0.07 + 1e-4
