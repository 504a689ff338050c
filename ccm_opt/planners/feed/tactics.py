"""Ways from the start to the end of a leader's path: by following alone, or with a change of shape on the way."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.motion.continuation import Deadline
from ccm_opt.planners.feed.fed_poses import FedPose
from ccm_opt.planners.feed.query import FeedQuery
from ccm_opt.planners.feed.reshaping import Reshaping
from ccm_opt.planners.following.leader import LeaderPath
from ccm_opt.planners.following.path_of_shape import own_path
from ccm_opt.planners.following.slide import joined, pose_on, slide
from ccm_opt.problem import TipGoal

SAME_POSE = 1e-7
"""Bends that differ by less are the same [rad]."""
OUT, OUT_SHARE = 0.25, 0.5
"""Where bends are moved on to, in link lengths beyond where joints may bend; share of its limit that a joint takes."""
RESHAPING_SHARE = 0.25
"""Share of the time limit that one change of shape may use."""
SEPARATION = 2
"""Further keyframes where a change of shape ends, so that no span of the smooth path mixes it with moving feed."""


@dataclass(frozen=True)
class Straightened:
    """An end that bends too near to the hole, and a pose like it that does not.

    Attributes:
        keyframes: from the end to that pose, shape (K, links + 1) [rad, m].
        pose: the pose that the motion goes on from.
    """

    keyframes: FloatArray
    pose: FedPose


@dataclass(frozen=True)
class Way:
    """Keyframes from start to goal, and what they came from.

    Attributes:
        keyframes: bends and feed, shape (K, links + 1) [rad, m].
        leaders: paths followed, each of shape (m, 2) [m]; none when the arm does not follow all the way.
        name: of the tactic.
    """

    keyframes: FloatArray
    leaders: tuple[FloatArray, ...]
    name: str

    def from_to(self, start: Straightened, goal: Straightened | None = None) -> "Way":
        """The way with what straightens its ends before and after it."""
        after = () if goal is None else (goal.keyframes[::-1],)
        bent = len(start.keyframes) > 1 or any(len(keyframes) > 1 for keyframes in after)
        keyframes = joined(start.keyframes, self.keyframes, *after)
        return Way(keyframes, () if bent else self.leaders, f"straighten, {self.name}" if bent else self.name)


def following(query: FeedQuery, path: LeaderPath) -> Iterator[Way]:
    """Ways that follow a leader all the time: ahead from the start, or back along the start's own shape first."""
    end = query.end_on(path)
    if end is None:
        return
    arm, start, own = query.arm, query.start, query.start_path
    if np.max(np.abs(pose_on(arm, path, start.feed) - start.bends)) < SAME_POSE:
        before = () if own is None or end >= start.feed else (own.points,)
        name = f"follow the leader, {path.name}"
        yield Way(_pinned(query, slide(arm, path, start.feed, end)), (*before, path.points), name)
    if own is None:
        return
    back = min(query.fully_drawn_back(path), query.fully_drawn_back(own), start.feed, end)
    if back >= query.feed.low:
        keyframes = joined(slide(arm, own, start.feed, back), slide(arm, path, back, end))
        name = f"draw back, then follow the leader, {path.name}"
        yield Way(_pinned(query, keyframes), (own.points, path.points), name)


def straightened(query: FeedQuery, end: FedPose, path: LeaderPath | None) -> Iterator[Straightened]:
    """Poses near an end from which the arm can be drawn back; the end itself when it can.

    Args:
        query: what is asked.
        end: the start, or the goal of the whole arm.
        path: along which the end lies, or None when it bends too near to the hole.
    """
    if path is not None:
        yield Straightened(end.row[None], end)
        return
    for bends in (_bent_further_out(query, end), np.zeros(query.arm.links)):
        if own_path(query.arm, bends, end.feed, query.least_straight) is not None:
            keyframes = _reshaper(query).keyframes(end, bends, query.feed.hole)
            if keyframes is not None:
                pose = FedPose(bends, end.feed)
                rest = np.tile(pose.row, (1 + SEPARATION, 1))
                yield Straightened(np.concatenate((keyframes[:-1], rest)), pose)


def _bent_further_out(query: FeedQuery, end: FedPose) -> FloatArray:
    """Bends of a pose, those too near to the hole moved on to the next joints that may bend, shape (links,) [rad]."""
    arm, bends = query.arm, end.bends.copy()
    places = end.feed + arm.link_length * np.arange(arm.links)
    first = int(np.searchsorted(places, query.outside + OUT * arm.link_length))
    if first >= arm.links:
        return np.zeros(arm.links)
    left = float(bends[:first].sum())
    bends[:first] = 0.0
    for joint in range(first, arm.links):
        limit = max(OUT_SHARE * float(arm.bend_limits[joint]), abs(float(bends[joint])))
        wanted = bends[joint] + left
        bends[joint] = float(np.clip(wanted, -limit, limit))
        left = wanted - bends[joint]
    return bends


def reshaping_at_once(query: FeedQuery) -> Iterator[Way]:
    """Ways without any feed, for goals that are reached from where the base is."""
    goal = query.problem.goal if query.goal is None else query.goal.bends
    if query.goal is not None and query.goal.feed != query.start.feed:
        return
    if not isinstance(goal, TipGoal | np.ndarray):
        return
    keyframes = _reshaper(query).keyframes(query.start, goal, query.feed.hole)
    if keyframes is not None:
        yield Way(_pinned(query, keyframes), (), "change shape at the start's feed")


def reshaping(query: FeedQuery, path: LeaderPath) -> Iterator[Way]:
    """Ways that go along the start's own shape to some feed, change there to the shape of a path, and follow it."""
    end = query.end_on(path)
    if end is None:
        return
    for turn in _turns(query, end):
        arm = query.arm
        own = _to_feed(query, turn)
        if own is None:
            continue
        before = FedPose(own[-1, :-1], turn)
        wanted = pose_on(arm, path, turn)
        outside = query.feed.hole if len(own) == 1 else query.outside
        changed = _reshaper(query).keyframes(before, wanted, outside)
        if changed is not None:
            keyframes = joined(own, changed, slide(arm, path, turn, end))
            yield Way(_pinned(query, keyframes), (), f"change shape at a feed of {turn:.3f} m, {path.name}")


def _turns(query: FeedQuery, end: float) -> list[float]:
    """Feeds at which to change shape, the start's first, then farther back."""
    start, low = query.start.feed, query.feed.low
    first = min(start, end)
    feeds = [first, low, 0.5 * (first + low)]
    return [feed for k, feed in enumerate(feeds) if feed not in feeds[:k]]


def _to_feed(query: FeedQuery, turn: float) -> FloatArray | None:
    """Keyframes along the start's own shape to a feed, or None when the shape bends too near to the hole."""
    if turn == query.start.feed:
        return query.start.row[None]
    if query.start_path is None:
        return None
    return slide(query.arm, query.start_path, query.start.feed, turn)


def _reshaper(query: FeedQuery) -> Reshaping:
    """Changes of shape, none of which may use up all the time."""
    until = time.monotonic() + RESHAPING_SHARE * query.problem.planner.time_limit
    return Reshaping(query.problem, Deadline(min(query.deadline.at, until)))


def _pinned(query: FeedQuery, keyframes: FloatArray) -> FloatArray:
    """Keyframes whose ends are the start, and the goal of the whole arm when there is one, without rounding."""
    pinned = keyframes.copy()
    pinned[0] = query.start.row
    if query.goal is not None:
        pinned[-1] = query.goal.row
    return pinned
