"""The planner of arms on a feed axis: follow the leader into the room beyond the hole, change shape where need be."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain, product

from scipy.interpolate import BSpline

from ccm_opt.errors import Diagnosis, MotionNotFound, NoPlanFound, ProblemError, TimeLimitReached, UnreachableGoal
from ccm_opt.motion.continuation import Deadline
from ccm_opt.motion.link_space import nearest_curve
from ccm_opt.planners.feed.leader_paths import LeaderPaths, Reach
from ccm_opt.planners.feed.query import FeedQuery
from ccm_opt.planners.feed.tactics import Way, following, reshaping, reshaping_at_once, straightened
from ccm_opt.planners.following.leader import LeaderPath
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.solution import JointPath
from ccm_opt.stages import Stages

PLANNING_SHARE = 0.9
"""Share of the time limit that planning may use."""
FOLLOWING_SHARE = 0.4
"""Share of the time limit that following alone may use."""
CURVES_TO_TRY, MOST_CURVES = 5, 60
"""Curves asked for where others may do as well, and at most."""
PATHS_RESHAPED_TO = 3
"""Leaders' paths to which a change of shape is tried."""


@dataclass(frozen=True)
class FeedPlanner:
    """Plans motions of an arm on a feed axis; satisfies the ``Planner`` protocol.

    Attributes:
        stages: names and times the stages.
    """

    stages: Stages = field(default_factory=Stages)

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion of bends and feed.

        Raises:
            ProblemError: the arm has no feed axis.
            NoPlanFound: with the reason and what would help.
        """
        if problem.arm.feed is None:
            raise ProblemError("the feed planner needs an arm with arm.feed, got one whose base is fixed")
        deadline = Deadline(time.monotonic() + PLANNING_SHARE * problem.planner.time_limit)
        with self.stages("mapping"):
            query = FeedQuery.of(problem, problem.arm.feed, deadline)
        with self.stages("motion"):
            return _Search(query).answer()


@dataclass
class _Search:
    """The search for one motion, and what it has seen on the way.

    Attributes:
        query: what is asked.
        paths: leaders' paths found so far.
        finder: finds more of them for a goal of the tip.
        refused: why ways were refused.
    """

    query: FeedQuery

    def __post_init__(self) -> None:
        goal, limit = self.query.problem.goal, self.query.problem.planner.time_limit
        until = Deadline(min(self.query.deadline.at, time.monotonic() + FOLLOWING_SHARE * limit))
        self.finder = LeaderPaths(self.query.problem, goal, until) if isinstance(goal, TipGoal) else None
        self.paths: list[LeaderPath] = []
        self.refused: list[str] = []

    def answer(self) -> JointPath:
        """The first way that is certified.

        Raises:
            NoPlanFound: when none is.
        """
        for way in self._ways():
            found = self.query.motions.path(way.keyframes)
            if found is not None:
                return self._joint_path(way, *found)
            self.refused.append(f"{way.name}: not certified")
            if self.query.deadline.passed():
                break
        raise self._nothing_found()

    def _ways(self) -> Iterator[Way]:
        """All ways, those that follow a leader all the time first."""
        query = self.query
        at_once = query.goal is not None and (query.start_path is None or query.goal_path is None)
        if at_once:
            yield from reshaping_at_once(query)
        ends = [straightened(query, query.start, query.start_path)]
        if query.goal is not None:
            ends.append(straightened(query, query.goal, query.goal_path))
        for head, *tail in product(*ends):
            goal = tail[0].pose if tail else None
            for way in self._between(query.between(head.pose, goal)):
                yield way.from_to(head, *tail)
        if not at_once:
            yield from reshaping_at_once(query)

    def _between(self, query: FeedQuery) -> Iterator[Way]:
        """Ways between ends from which the arm can be drawn back.

        When the first paths cannot be followed all the way, others hardly can: shapes are changed to them first.
        """
        aside = list[LeaderPath]()
        for path in self._leaders(query):
            self.paths.append(path)
            ways = list(following(query, path))
            yield from ways
            if not ways and query.end_on(path) is not None:
                aside.append(path)
                if len(aside) == PATHS_RESHAPED_TO:
                    yield from chain.from_iterable(reshaping(query, each) for each in aside)
        if len(aside) < PATHS_RESHAPED_TO:
            others = [path for path in self.paths if path not in aside]
            for path in (aside + others)[:PATHS_RESHAPED_TO]:
                yield from reshaping(query, path)

    def _leaders(self, query: FeedQuery) -> Iterator[LeaderPath]:
        """Leaders' paths, most promising first."""
        if query.goal_path is not None:
            yield query.goal_path
        if self.finder is not None:
            reach = Reach.of(query.arm, query.feed)
            straights = _straights(query)
            for straight, _ in straights:
                yield from self.finder.bands(straight, reach)
            for straight, most in straights:
                yield from self.finder.curves(straight, reach, most)

    def _joint_path(self, way: Way, spline: BSpline, spare: float) -> JointPath:
        arm = self.query.arm
        curves = tuple(nearest_curve(arm, headings) for headings in arm.headings(way.keyframes[:, :-1]))
        return JointPath(spline, way.keyframes, curves, way.name, way.leaders, spare)

    def _nothing_found(self) -> NoPlanFound:
        if self.finder is not None and not self.paths:
            necessary = _unreachable(self.query, self.finder.shortest)
            if necessary is not None:
                return UnreachableGoal(necessary)
        refused = self.refused + list(self.finder.refusals if self.finder is not None else ())
        reason = (
            f"no motion found along {len(self.paths)} leaders' paths, {len(self.refused)} ways could not be certified"
        )
        evidence: dict[str, object] = {"refused": refused[:20]}
        if self.query.deadline.passed():
            slow = Diagnosis(f"time limit reached: {reason}", "motion", ("raise planner.time_limit",), evidence)
            return TimeLimitReached(slow)
        advice = ("raise planner.routes", "use a smaller radius or clearance", "widen arm.feed.range")
        return MotionNotFound(Diagnosis(reason, "motion", advice, evidence))


def _straights(query: FeedQuery) -> list[tuple[float, int]]:
    """Arc lengths up to which leaders' paths follow the feed axis [m], and how many curves to ask for at each.

    A straight start lies on a path that is straight up to its tip; else it is drawn back as far as it must.
    """
    least = query.least_straight
    lengths = [(least, MOST_CURVES)]
    if query.feed.low + query.arm.length > least:
        lengths.insert(0, (query.feed.low + query.arm.length, CURVES_TO_TRY))
    if not query.start.bends.any() and query.start.feed + query.arm.length > least:
        lengths.insert(0, (query.start.feed + query.arm.length, CURVES_TO_TRY))
    if query.feed.high > least:
        lengths.append((query.feed.high + 2.0 * query.motions.travel, MOST_CURVES))
    return lengths


def _unreachable(query: FeedQuery, shortest: float) -> Diagnosis | None:
    """Why no path to the goal can exist, given the shortest way seen [m]; None when one might."""
    arm, most = query.arm, Reach.of(query.arm, query.feed).most
    if shortest == float("inf"):
        reason = (
            f"no way from the hole to the goal is wide enough for the arm: diameter {2e3 * arm.radius:.1f} mm, "
            f"clearance {1e3 * query.problem.workspace.clearance:.1f} mm"
        )
        return Diagnosis(
            reason, "free space", ("use a smaller arm.radius or workspace.clearance", "remove an obstacle")
        )
    if shortest > most:
        reason = (
            f"the shortest way along the feed axis to the goal is {shortest:.3f} m long from arm.base, "
            f"but the tip comes {most:.3f} m far at most"
        )
        return Diagnosis(reason, "free space", ("widen arm.feed.range", "use a longer arm"), {"way_length": shortest})
    return None
