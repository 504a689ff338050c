"""A motion of an arm on its feed axis that nobody has certified yet."""

from dataclasses import dataclass

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.planners.feed.query import FeedQuery
from ccm_opt.planners.following.slide import joined_keyframes
from ccm_opt.problem import JointPose


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
