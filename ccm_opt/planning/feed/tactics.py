"""Tactics of the feed planner."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import long_length
from ccm_opt.errors import NoPlanFound
from ccm_opt.planning.curve_planner import CurvePlanner
from ccm_opt.planning.feed.member_problems import PartBeyond
from ccm_opt.planning.feed.proposed_motion import ProposedMotion, StraightenedEnd, pinned
from ccm_opt.planning.feed.query import FeedQuery
from ccm_opt.planning.following.leader import LeaderPath, joined_keyframes, pose_on, slide
from ccm_opt.planning.planner_settings import DEFAULT_FEED, FeedPlannerSettings
from ccm_opt.planning.search import find_motion
from ccm_opt.problem import JointPose, Problem, TipGoal

_SAME_POSE = 1e-7
"""Bends that differ by less are the same [rad]. Taste; far above the rounding of chords, far below anything that
shows."""
_BENDS_MOVED_OUT = 0.25
"""How far beyond the first place where joints may bend those bends are moved to that are too near to the hole, in link
lengths. Taste."""
_BENDS_MOVED_SHARE = 0.5
"""Share of its limit that a joint takes over of such bends. Taste."""
_SEPARATION = 2
"""Further keyframes where a change of shape ends. Derived: with two more of the same pose no span of the cubic spline,
which four control points shape, mixes the change with a moving feed."""


@dataclass(frozen=True)
class Reshaping:
    """Plans motions of the part of the arm that is beyond the hole.

    Attributes:
        problem: of the whole arm, with a feed axis.
        deadline: when to stop.
        settings: of the planner.
    """

    problem: Problem
    deadline: Deadline
    settings: FeedPlannerSettings = DEFAULT_FEED

    def keyframes(self, start: JointPose, goal: FloatArray | TipGoal, outside: float) -> FloatArray | None:
        """Keyframes from a pose to other bends, or to a goal of the tip, at the feed of the pose.

        Args:
            start: where the motion begins.
            goal: bends of the whole arm, shape (links,) [rad], or a goal of the tip.
            outside: arc length from which on joints may bend [m].

        Returns:
            Shape (K, links + 1), or None when no motion was found.
        """
        part = PartBeyond.of(self.problem, start, goal, outside)
        if part is None:
            return None
        planner = CurvePlanner(settings=self.settings.curve)
        try:
            motion = find_motion(planner.motion_task(part.problem, part.ends(self.settings), self.deadline))
        except NoPlanFound:
            return None
        return self._whole(start, part.problem.arm.bends(motion.headings), clamped=part.clamped)

    def _whole(self, start: JointPose, bends: FloatArray, *, clamped: bool) -> FloatArray:
        """Keyframes of the whole arm, the part before straight."""
        links = self.problem.arm.links
        first = links - bends.shape[1]
        whole = np.zeros((len(bends), links + 1))
        whole[:, first:links] = bends
        if clamped:
            whole[:, first] = 0.0
        whole[:, -1] = start.feed
        return whole


def following(query: FeedQuery, path: LeaderPath) -> Iterator[ProposedMotion]:
    """Motions that follow a leader all the time: ahead from the start, or first back along the start's shape."""
    end = query.end_on(path)
    if end is None:
        return
    arm = query.arm
    start = query.start
    start_path = query.start_path

    lies_on_path = np.max(np.abs(pose_on(arm, path, start.feed) - start.bends)) < _SAME_POSE
    if lies_on_path:
        leaders = [path.points]
        # Drawn back it lies on the path that it came by, which behind the tip is not the leader's.
        if start_path is not None and end < start.feed:
            leaders.insert(0, start_path.points)
        keyframes = slide(arm, path, start.feed, end)
        yield ProposedMotion(pinned(query, keyframes), tuple(leaders), f"follow the leader, {path.name}")

    if start_path is None:
        return
    # Where the arm has been drawn back far enough it lies on the axis, which is common to both paths.
    back = min(query.fully_drawn_back(path), query.fully_drawn_back(start_path), start.feed, end)
    if back >= query.feed.low:
        out = slide(arm, start_path, start.feed, back)
        in_again = slide(arm, path, back, end)
        name = f"draw back, then follow the leader, {path.name}"
        keyframes = pinned(query, joined_keyframes(out, in_again))
        yield ProposedMotion(keyframes, (start_path.points, path.points), name, draws_back=True)


def straightened(query: FeedQuery, end: JointPose, path: LeaderPath | None) -> Iterator[StraightenedEnd]:
    """Poses near an end from which the arm can be drawn back; the end itself when it can.

    Args:
        query: what is asked.
        end: the start, or the goal of the whole arm.
        path: along which the end lies, or None when it bends too near to the hole.
    """
    if path is not None:
        yield StraightenedEnd(end.configuration(query.arm)[None], end)
        return
    for bends in (_bent_further_out(query, end), np.zeros(query.arm.links)):
        pose = JointPose(bends, end.feed)
        if query.path_of(pose) is None:
            continue
        keyframes = _reshaper(query, query.settings.reshaping_share).keyframes(end, bends, query.feed.hole)
        if keyframes is not None:
            rest = np.tile(pose.configuration(query.arm), (1 + _SEPARATION, 1))
            yield StraightenedEnd(np.concatenate((keyframes[:-1], rest)), pose)


def _bent_further_out(query: FeedQuery, end: JointPose) -> FloatArray:
    """Bends of a pose, those too near to the hole moved on to the next joints that may bend, shape (links,) [rad]."""
    arm = query.arm
    places = end.feed + arm.link_length * np.arange(arm.links)
    first = int(np.searchsorted(places, query.outside + _BENDS_MOVED_OUT * arm.link_length))
    if first >= arm.links:
        return np.zeros(arm.links)

    bends = end.bends.copy()
    left = float(bends[:first].sum())
    bends[:first] = 0.0
    # Each joint takes as much of what is left as it may, so that the arm beyond points where it did.
    for joint in range(first, arm.links):
        limit = max(_BENDS_MOVED_SHARE * float(arm.bend_limits[joint]), abs(float(bends[joint])))
        wanted = bends[joint] + left
        bends[joint] = float(np.clip(wanted, -limit, limit))
        left = wanted - bends[joint]
    return bends


def reshaping_at_once(query: FeedQuery, share: float) -> Iterator[ProposedMotion]:
    """Motions without any feed, for goals that are reached from where the base is.

    Args:
        query: what is asked.
        share: of the time limit that looking for one may use.
    """
    if query.goal is not None and query.goal.feed != query.start.feed:
        return
    goal = query.problem.goal if query.goal is None else query.goal.bends
    if not isinstance(goal, TipGoal | np.ndarray):
        return
    keyframes = _reshaper(query, share).keyframes(query.start, goal, query.feed.hole)
    if keyframes is not None:
        yield ProposedMotion(pinned(query, keyframes), (), "change shape at the start's feed")


def reshaping(query: FeedQuery, path: LeaderPath, share: float) -> Iterator[ProposedMotion]:
    """Motions along the start's shape to some feed, there a change to the shape of a path, and on along that.

    Args:
        query: what is asked.
        path: to whose shape the arm changes.
        share: of the time limit that one change of shape may use.
    """
    end = query.end_on(path)
    if end is None:
        return
    arm = query.arm
    for feed in _feeds_to_reshape_at(query, end):
        there = _to_feed(query, feed)
        if there is None:
            continue
        before = JointPose(there[-1, :-1], feed)
        # Where the feed does not move before the change, joints may bend right up to the hole.
        outside = query.feed.hole if len(there) == 1 else query.outside
        changed = _reshaper(query, share).keyframes(before, pose_on(arm, path, feed), outside)
        if changed is not None:
            onward = slide(arm, path, feed, end)
            keyframes = joined_keyframes(there, changed, onward)
            yield ProposedMotion(
                pinned(query, keyframes), (), f"change shape at a feed of {long_length(feed)}, {path.name}"
            )


def _feeds_to_reshape_at(query: FeedQuery, end: float) -> list[float]:
    """Feeds at which to change shape, the start's first, then farther back."""
    start = query.start.feed
    low = query.feed.low
    first = min(start, end)
    in_order = (first, low, 0.5 * (first + low))
    return list(dict.fromkeys(in_order))


def _to_feed(query: FeedQuery, feed: float) -> FloatArray | None:
    """Keyframes along the start's own shape to a feed, or None when the shape bends too near to the hole."""
    if feed == query.start.feed:
        return query.start.configuration(query.arm)[None]
    if query.start_path is None:
        return None
    return slide(query.arm, query.start_path, query.start.feed, feed)


def _reshaper(query: FeedQuery, share: float) -> Reshaping:
    """Changes of shape, none of which may use more than a share of the time limit."""
    deadline = query.deadline.within(share * query.problem.planner.time_limit)
    return Reshaping(query.problem, deadline, query.settings)
