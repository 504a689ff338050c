"""The planner of fed arms and its tactics."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice, product

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, NoPlanFound, ProblemError, TimeLimitReached, UnreachableGoal
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.progress import Stages
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.curve_planner import CurvePlanner
from ccm_opt.planning.feed.fed_task import fed_task
from ccm_opt.planning.feed.finishing import Finishing
from ccm_opt.planning.feed.leader import LeaderPath, joined_keyframes, pose_on, slide
from ccm_opt.planning.feed.leader_paths import LeaderPaths, Reach
from ccm_opt.planning.feed.member_problems import (
    PartBeyond,
    ProposedMotion,
    StraightenedEnd,
    drawn_back_a_little,
    ends_of_tight_places,
    member_problems,
    pinned,
    straight_to_goal,
)
from ccm_opt.planning.feed.query import FeedQuery
from ccm_opt.planning.limits.limit import Limit
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.own_units import in_own_units
from ccm_opt.planning.settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.planning.strategies import find_motion
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Feed
from ccm_opt.scene.bad_pose import room_advice

_PLANNING_SHARE = 0.9
"""Share of the time limit that planning may use; timing and verification need the rest. Taste."""
_RESHAPING_SHARE = 0.25
"""Share of the time limit that one change of shape may use. Taste."""
_COMPARED = 2
"""Others that a path which lasts long or grazes walls is compared with. Taste: each costs as much as the first."""

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


def reshaped(
    query: FeedQuery, share: float, start: JointPose, goal: FloatArray | TipGoal, outside: float
) -> FloatArray | None:
    """Keyframes from a pose to other bends, or to a goal of the tip, at the feed of the pose.

    Args:
        query: what is asked.
        share: of the time limit that looking for them may use.
        start: where the motion begins.
        goal: bends of the whole arm, shape (links,) [rad], or a goal of the tip.
        outside: arc length from which on joints may bend [m].

    Returns:
        Shape (K, links + 1), or None when no motion was found.
    """
    part = PartBeyond.of(query.problem, start, goal, outside)
    if part is None:
        return None
    settings = query.settings
    deadline = query.deadline.within(share * query.problem.planner.time_limit)
    try:
        motion = find_motion(CurvePlanner(settings=settings).motion_task(part.problem, part.ends(), deadline))
    except NoPlanFound:
        return None
    bends = part.problem.arm.bends(motion.configurations)
    keyframes = np.zeros((len(bends), query.arm.links + 1))
    keyframes[:, part.first : -1] = bends
    if part.clamped:
        keyframes[:, part.first] = 0.0
    keyframes[:, -1] = start.feed
    return keyframes


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
        keyframes = reshaped(query, _RESHAPING_SHARE, end, bends, query.feed.hole)
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
    keyframes = reshaped(query, share, query.start, goal, query.feed.hole)
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
        changed = reshaped(query, share, before, pose_on(arm, path, feed), outside)
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


_MOST_CURVES = 60
"""Curves that are asked for at most, of a leader's path that leaves the axis as early as it can. Taste."""
_FIRST_CURVES = 5
"""The same where other straight beginnings may do as well. Taste."""
_MEMBER_SHARE = 0.02
"""Share of the time limit that each member of a goal that is a set may use before any may use more. Taste."""
_FOLLOWING_SHARE = 0.4
"""Share of the time limit that paths for a leader may be looked for. Taste."""
_COMPARED_SECONDS = 0.8
"""CPU time of one that is only compared with what is at hand already [s]. Measured on bent starts: those that are found
take 0.1 to 0.4 s; a share of the time limit let one in vain take 3 s."""
_PATHS_RESHAPED_TO = 3
"""Leaders' paths to which a change of shape is tried. Taste."""
_LED_IN_VAIN = 2
"""Leaders' paths to which leading the arm straight may fail before others wait until shapes have been changed. Measured
in crowds of 50 polygons: ten paths in vain took 5 s, the change of shape 0.3 s."""
_REFUSALS_LISTED = 20
"""Of the reasons why motions were refused a diagnosis lists so many. Taste."""


@dataclass(frozen=True)
class FeedPlanner:
    """Plans motions of an arm on a feed axis; satisfies the ``Planner`` protocol.

    Attributes:
        stages: names and times the stages.
        settings: of the search and its stages.
        terms: the user's constraints and costs, or None.
    """

    stages: Stages = field(default_factory=Stages)
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
    terms: UserTerms | None = None

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion of bends and feed.

        Raises:
            ProblemError: the arm has no feed axis.
            NoPlanFound: with the reason and what would help.
        """
        if problem.arm.feed is None:
            raise ProblemError("the feed planner needs an arm with arm.feed, got one whose base is fixed")
        with in_own_units(problem) as units:
            own = units.scaled(problem)
            path = self._of_members(own, own.arm.feed or problem.arm.feed)
        return units.path_in_metres(path, problem.arm)

    def _of_members(self, problem: Problem, feed: Feed) -> JointPath:
        """Plan in units of the arm, to whichever member of the goal is reached."""
        deadline = Deadline.after(_PLANNING_SHARE * problem.planner.time_limit)
        members = member_problems(problem, feed, self.settings)
        if len(members) == 1:
            return self._planned(members[0], feed, deadline)
        # Members differ in how hard they are: all are tried in short before any may take long.
        for member in members:
            short = deadline.within(_MEMBER_SHARE * problem.planner.time_limit)
            with suppress(NoPlanFound):
                return self._planned(member, feed, short)
        failures: list[NoPlanFound] = []
        for number, member in enumerate(members):
            share = deadline.left / (len(members) - number)
            try:
                return self._planned(member, feed, deadline.within(share))
            except NoPlanFound as failure:
                failures.append(failure)
        raise failures[0]

    def _planned(self, problem: Problem, feed: Feed, deadline: Deadline) -> JointPath:
        """A motion to one member of the goal."""
        with self.stages("mapping"):
            query = FeedQuery.from_problem(problem, feed, deadline, self.settings)
            for limit in user_limits(self.terms):
                goal = None if query.goal is None else query.pose(query.goal)
                limit.refuse_ends(query.pose(query.start), goal)
        with self.stages("motion"):
            return _FeedSearch(query, self.terms).run()


def user_limits(terms: UserTerms | None) -> tuple[Limit, ...]:
    """The user's constraints and costs as limits of the motion; usually none."""
    return () if terms is None else (UserLimit(terms),)


@dataclass
class _FeedSearch:
    """The search for one motion, and what it has seen on the way.

    Attributes:
        query: what is asked.
        terms: the user's constraints and costs, or None.
        finishing: makes paths of motions.
        leader_paths: finds leaders' paths for a goal of the tip; None when the goal is the whole arm's.
        found: leaders' paths found so far.
        refused: why motions were refused.
        compared: whether a change of shape without any feed has been compared with other motions.
    """

    query: FeedQuery
    terms: UserTerms | None = None
    leader_paths: LeaderPaths | None = field(init=False)
    finishing: Finishing = field(init=False)
    found: list[LeaderPath] = field(init=False, default_factory=list)
    refused: list[str] = field(init=False, default_factory=list)
    compared: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        problem = self.query.problem
        settings = self.query.settings
        limits = user_limits(self.terms)
        task = fed_task(self.query, self.query.deadline, limits)
        self.finishing = Finishing(self.query, task, self.refused, self.terms)
        self.leader_paths = None
        if isinstance(problem.goal, TipGoal):
            # What following may use up leaves time for changes of shape.
            deadline = self.query.deadline.within(_FOLLOWING_SHARE * problem.planner.time_limit)
            self.leader_paths = LeaderPaths(problem, problem.goal, deadline, settings)

    def run(self) -> JointPath:
        """The path of the first motion that has one, or of the best of a few.

        Raises:
            NoPlanFound: when none is.
        """
        found: list[JointPath] = []
        for motion in self._motions():
            path = self.finishing.path(motion)
            if path is not None:
                found.append(path)
                # One that lasts long or grazes walls waits for a few others: perhaps one of them is better.
                if len(found) > _COMPARED or not (self.finishing.is_long(motion) or self.finishing.grazes(path)):
                    break
            if self.query.deadline.passed():
                break
        if not found:
            raise self._nothing_found()
        return found[0] if len(found) == 1 else min(found, key=self.finishing.time_for_room)

    def _motions(self) -> Iterator[ProposedMotion]:
        """All motions to try; those that follow a leader all the time first, but where an end cannot be drawn back."""
        query = self.query
        # An end that bends too near to the hole to be drawn back has to change its shape in any case: perhaps that is
        # all it takes.
        end_bends_at_hole = query.start_path is None or query.goal_path is None
        yield from straight_to_goal(query, self.finishing.task)
        at_once_first = query.goal is not None and end_bends_at_hole
        if at_once_first:
            yield from reshaping_at_once(query, _RESHAPING_SHARE)

        starts = straightened(query, query.start, query.start_path)
        if query.goal is None:
            for start in starts:
                for motion in self._between(query.between(start.pose, None)):
                    yield motion.between(start)
        else:
            for start, goal in product(starts, straightened(query, query.goal, query.goal_path)):
                for motion in self._between(query.between(start.pose, goal.pose)):
                    yield motion.between(start, goal)

        if not at_once_first:
            yield from reshaping_at_once(query, _RESHAPING_SHARE)

    def _between(self, query: FeedQuery) -> Iterator[ProposedMotion]:
        """Motions between ends from which the arm can be drawn back.

        When the first paths cannot be followed all the way, others hardly can: shapes are changed to them first.
        """
        not_followed: list[LeaderPath] = []
        not_led_to: list[LeaderPath] = []
        for path in self._leaders(query):
            self.found.append(path)
            motions = list(following(query, path))
            ahead = [motion for motion in motions if not motion.draws_back]
            yield from ahead
            back = [motion for motion in motions if motion.draws_back]
            if not ahead:
                # Where the arm stalls on its way to some paths it mostly does to all, and changes of shape help.
                asked = len(not_led_to) < _LED_IN_VAIN
                led = list(drawn_back_a_little(query, path, self.finishing.task)) if asked else []
                if not led:
                    not_led_to.append(path)
                back += [*led, *self._changing_shape(query, path)]
            yield from sorted(back, key=self.finishing.duration)
            if not motions and query.end_on(path) is not None:
                not_followed.append(path)
                if len(not_followed) == _PATHS_RESHAPED_TO:
                    yield from self._reshaping_to(query, not_followed)

        if len(not_followed) < _PATHS_RESHAPED_TO:
            others = [path for path in self.found if path not in not_followed]
            yield from self._reshaping_to(query, (not_followed + others)[:_PATHS_RESHAPED_TO])
        for path in not_led_to[_LED_IN_VAIN:]:
            yield from drawn_back_a_little(query, path, self.finishing.task)

    def _changing_shape(self, query: FeedQuery, path: LeaderPath) -> Iterator[ProposedMotion]:
        """Changes of shape that are found quickly, to compare with what is drawn back."""
        share = _COMPARED_SECONDS / query.problem.planner.time_limit
        yield from islice(reshaping(query, path, share), 1)
        if not self.compared:
            self.compared = True
            yield from reshaping_at_once(query, share)

    def _reshaping_to(self, query: FeedQuery, paths: list[LeaderPath]) -> Iterator[ProposedMotion]:
        """Motions that change shape to that of some paths."""
        for path in paths:
            yield from reshaping(query, path, _RESHAPING_SHARE)

    def _leaders(self, query: FeedQuery) -> Iterator[LeaderPath]:
        """Leaders' paths, most promising first."""
        if query.goal_path is not None:
            yield query.goal_path
        if self.leader_paths is None:
            return
        reach = Reach.from_feed(query.arm, query.feed)
        straights = _straights(query)
        # Bands cost little: all beginnings are tried with them before the NLP is asked for a curve.
        for straight, _ in straights:
            yield from self.leader_paths.bands(straight, reach)
        for straight, most in straights:
            yield from self.leader_paths.curves(straight, reach, most)

    def _nothing_found(self) -> NoPlanFound:
        # No path at all: the goal itself may be out of reach, which says more than how the search went.
        if self.leader_paths is not None and not self.found:
            necessary = _unreachable(self.query, self.leader_paths.shortest)
            if necessary is not None:
                return UnreachableGoal(necessary)

        refused = list(self.refused)
        if self.leader_paths is not None:
            refused.extend(self.leader_paths.refusals)
        found = len(self.found)
        reason = f"no motion found along {found} leaders' paths, {len(self.refused)} motions could not be certified"
        names = ", ".join(f"'{name}'" for limit in self.finishing.task.user_limits for name in limit.names)
        if names:
            # What a constraint refused says more than how many motions there were.
            broken = next((words for words in self.refused if "constraint" in words), None)
            reason = f"{reason} under {names}" + ("" if broken is None else f"; {broken}")
        evidence: dict[str, object] = {"refused": refused[:_REFUSALS_LISTED]}
        room = room_advice(self.query.arm.radius, self.query.problem.workspace.clearance)
        if self.query.deadline.passed():
            advice = (*room, "widen arm.feed.range", "raise planner.time_limit")
            return TimeLimitReached(
                Diagnosis(f"{self.query.deadline.what_passed()}: {reason}", "motion", advice, evidence)
            )
        advice = ("raise planner.routes", *room, "widen arm.feed.range")
        return MotionNotFound(Diagnosis(reason, "motion", advice, evidence))


def _straights(query: FeedQuery) -> list[tuple[float, int]]:
    """Arc lengths up to which leaders' paths follow the feed axis [m], and how many curves to ask for at each.

    A straight start lies on a path that is straight up to its tip; else it is drawn back as far as it must.
    """
    arm = query.arm
    least = query.least_straight
    tip_drawn_back = query.feed.low + query.arm.length
    tip_at_start = query.start.feed + query.arm.length

    straights: list[tuple[float, int]] = []
    # A straight arm need not be drawn back for a path that is straight up to its tip,
    if not query.start.bends.any() and tip_at_start > least:
        straights.append((tip_at_start, _FIRST_CURVES))
    # any arm can be drawn back as far as the feed's range allows,
    if tip_drawn_back > least:
        straights.append((tip_drawn_back, _FIRST_CURVES))
    # the earliest bend reaches most goals; but the base cannot leave the axis, so where its range goes farther a path
    # may have to be straight for as long.
    # Nor can it bend where a guide or a hole is hardly wider than it: no joint may before the place where it widens.
    tight = ends_of_tight_places(query.problem, query.feed.hole - arm.link_length)
    straights.extend((max(end + arm.link_length, least), _FIRST_CURVES) for end in tight)
    straights.append((least, _MOST_CURVES))
    if query.feed.high > least:
        straights.append((query.feed.high + 2.0 * query.travel, _MOST_CURVES))
    return straights


def _unreachable(query: FeedQuery, shortest: float) -> Diagnosis | None:
    """Why no path to the goal can exist, given the shortest route seen [m]; None when one might."""
    arm = query.arm
    most = Reach.from_feed(arm, query.feed).most
    if shortest == float("inf"):
        reason = (
            f"no way from the hole to the goal was found that is wide enough for the arm: diameter "
            f"{short_length(2.0 * arm.radius)}, clearance {short_length(query.problem.workspace.clearance)}"
        )
        advice = (*room_advice(arm.radius, query.problem.workspace.clearance), "remove an obstacle")
        return Diagnosis(reason, "free space", advice)
    if shortest > most:
        reason = (
            f"the shortest way found along the feed axis to the goal is {long_length(shortest)} long from arm.base; "
            f"the tip comes {long_length(most)} far at most"
        )
        return Diagnosis(reason, "free space", ("widen arm.feed.range", "use a longer arm"), {"way_length": shortest})
    return None
