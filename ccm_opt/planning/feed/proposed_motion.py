"""Motions that are proposed for a fed arm.

Where the straight line between the start and the end leads into a wall or through the arm itself, both are drawn back
along their own paths first, no farther than need be: what is left to change is less, and so is what is in its way.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.fed_space import FedSpace
from ccm_opt.planning.feed.query import FeedQuery
from ccm_opt.planning.following.leader import LeaderPath, joined_keyframes, slide
from ccm_opt.planning.guides import Interpolation
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.step import Stepper
from ccm_opt.problem import JointPose

_DRAWN_BACK_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of the way that it takes to draw both ends back onto the axis, from which the arm is led straight to the goal's path,
in the order in which they are tried. Taste."""


@dataclass(frozen=True)
class StraightenedEnd:
    """An end that bends too near to the hole, and a pose like it that does not.

    Attributes:
        keyframes: from the end to that pose, shape (K, links + 1) [rad, m].
        pose: the pose that the motion goes on from.
    """

    keyframes: FloatArray
    pose: JointPose


@dataclass(frozen=True)
class ProposedMotion:
    """Keyframes from start to goal that nobody has certified yet, and what they came from.

    Attributes:
        keyframes: bends and feed, shape (K, links + 1) [rad, m].
        leaders: paths followed, each of shape (m, 2) [m]; none when the arm does not follow all the way.
        name: of the tactic.
        draws_back: whether the arm is drawn back first as far as it came.
    """

    keyframes: FloatArray
    leaders: tuple[FloatArray, ...]
    name: str
    draws_back: bool = False

    def between(self, start: StraightenedEnd, goal: StraightenedEnd | None = None) -> "ProposedMotion":
        """The motion with what straightens its ends before and after it."""
        pieces = [start.keyframes, self.keyframes]
        straightens = len(start.keyframes) > 1
        if goal is not None:
            pieces.append(goal.keyframes[::-1])
            straightens = straightens or len(goal.keyframes) > 1
        keyframes = joined_keyframes(*pieces)
        if straightens:
            return ProposedMotion(keyframes, (), f"straighten, {self.name}")
        return ProposedMotion(keyframes, self.leaders, self.name)


def pinned(query: FeedQuery, keyframes: FloatArray) -> FloatArray:
    """Keyframes whose ends are the start, and the goal of the whole arm when there is one, without rounding."""
    pinned = keyframes.copy()
    pinned[0] = query.start.configuration(query.arm)
    if query.goal is not None:
        pinned[-1] = query.goal.configuration(query.arm)
    return pinned


def straight_to_goal(query: FeedQuery, task: MotionTask, space: FedSpace) -> Iterator[ProposedMotion]:
    """Motions straight to the goal of the whole arm, wherever the ends bend."""
    if query.goal is None:
        return
    start = query.start.configuration(query.arm)
    keyframes = led_between(start, query.goal.configuration(query.arm), task, space)
    if keyframes is not None:
        yield ProposedMotion(keyframes, (), "straight")


def drawn_back_a_little(
    query: FeedQuery, path: LeaderPath, task: MotionTask, space: FedSpace
) -> Iterator[ProposedMotion]:
    """Motions to the end of a path, drawn back along the start's path as far as need be, and in along the other."""
    end = query.end_on(path)
    if end is None:
        return
    arm = query.arm
    for share in _DRAWN_BACK_SHARES:
        ways = _drawn_back(query, path, end, share)
        if ways is None:
            continue
        there = slide(arm, ways[0], query.start.feed, ways[1]) if ways[0] is not None else _start(query)
        onward = slide(arm, path, ways[2], end)
        between = led_between(there[-1], onward[0], task, space)
        if between is not None:
            keyframes = joined_keyframes(there, between, onward)
            name = "straight" if share == 0.0 else f"drawn back by {100 * share:.0f} % of the way"
            yield ProposedMotion(pinned(query, keyframes), (), f"{name}, {path.name}")
            return


def led_between(start: FloatArray, end: FloatArray, task: MotionTask, space: FedSpace) -> FloatArray | None:
    """Keyframes from one configuration to another, shape (K, c); None when the arm cannot be led there.

    Args:
        start: shape (c,) [rad, m].
        end: likewise.
        task: with the limits to keep on the way.
        space: of the steps.
    """
    arm = space.arm
    first = space.coordinates(arm.poses(start))
    last = space.coordinates(arm.poses(end))
    for links in task.settings.search.margins:
        finder = task.planning_finder(links * space.nominal_length, space.nominal_length)
        stepper = Stepper(space, finder, task.limits(finder), task.settings)
        guide = Interpolation(space, first, last, settings=task.settings.guides.interpolation)
        try:
            poses = follow(stepper, guide, stepper.pose(first), task.deadline)
        except Stalled:
            continue
        keyframes = arm.configurations(np.array([*(pose.headings for pose in poses), arm.poses(end)]))
        keyframes[0] = start
        keyframes[-1] = end
        return np.asarray(keyframes)
    return None


def _start(query: FeedQuery) -> FloatArray:
    return query.start.configuration(query.arm)[None]


def _drawn_back(
    query: FeedQuery, path: LeaderPath, end: float, share: float
) -> tuple[LeaderPath | None, float, float] | None:
    """The start's path, and the feeds to which both ends are drawn back [m]; None where the start cannot be."""
    if share == 0.0:
        return None, query.start.feed, end
    if query.start_path is None:
        return None
    low = query.feed.low
    back_from_start = max(min(query.fully_drawn_back(query.start_path), query.start.feed), low)
    back_from_end = max(min(query.fully_drawn_back(path), end), low)
    return (
        query.start_path,
        query.start.feed - share * (query.start.feed - back_from_start),
        end - share * (end - back_from_end),
    )
