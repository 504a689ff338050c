"""Finds a motion: one tactic after the other, the cheap ones first; every step of each is certified as it is taken."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import islice

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import MotionNotFound
from ccm_opt.planning.continuation import Guide, Stalled, follow, settle
from ccm_opt.planning.curve_map import KNOTS, CurveMap
from ccm_opt.planning.followable_ways import feeds_to_end, fitted_slide, slid_along
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.guides import TipLed
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.passed_places import passings
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.search import Failure, StrategyInVain, in_turn, nothing_found, tell_tried
from ccm_opt.planning.space_candidates import SpaceTipWays, TipWay
from ccm_opt.planning.space_goal_poses import CurveDraws, goal_poses, swung, withdrawn
from ccm_opt.planning.space_guides import PoseLed, SpaceTipTrack, SpaceTrackLed
from ccm_opt.planning.space_sweep import edge_is_safe, failing_edges, pieces
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper

_WANTED_POSES = 8
"""Poses that are moved to in turn before the sampler is tried."""

_SLIDE_ROOM = 0.5
"""Share of the wanted gap that the first fit of these leaves; where none does, any that touches nothing."""

_SLIDE_STEP = 0.5
"""Of the feed from keyframe to keyframe [u]."""

_KNOTS = (11, 16, 22)
"""Of the curve, tried in turn: the more, the better it shows sharp bends, and the longer the optimisation takes
(measured in pipes: with 8 to 16 links 16 show what chords leave, with 24 links 22 do)."""
_GRAZING = 0.1
"""A motion led by the tip that keeps less than this share of the wanted gap is slid instead if it can be; the
optimisation seldom makes room for such a one."""
_ROUNDS = 4
"""How often it begins with other draws and poses, as long as there is time; the first half of them before the finest
grid is searched. Measured among 320 bodies."""
_EXTENSIONS = 8000
"""Of trees that are the last resort, at most, each time that it begins."""
_TURN = 1.0
"""Largest turn of a link onto the track of the tip that is asked for in one step [rad]. Taste."""
_GOALS = 8
"""Poses at the goal that the second tree grows from."""

_FIRST_WAYS = "first ways of the tip"
_WITHDRAWAL = "withdrawal"


def find_motion(task: SpaceTask, stage: "_Stage | None" = None) -> SpaceMotion:
    """A certified motion from the start to the goal: the first that a tactic finds.

    Args:
        task: what is asked.
        stage: where a longer motion has come to; None for one that begins at the task's start.

    Raises:
        MotionNotFound: no tactic reached the goal; with how far the best came, and what was in its way.
        UnreachableGoal: it is proved that none could.
        TimeLimitReached: the deadline passed first.
    """
    search = _Search(task, stage)
    in_vain: list[StrategyInVain] = []
    for attempt in in_turn(search.attempts(), task.sought, search.failures, task.refuse, in_vain):
        motion = attempt.find()
        if motion is not None:
            return motion
    raise nothing_found(task.sought, search.failures, in_vain)


@dataclass(frozen=True)
class _Tactic:
    """One way to look for a motion: its name, what finds one, or None, and whether it may take long."""

    name: str
    find: Callable[[], SpaceMotion | None]
    costly: bool = False


@dataclass(frozen=True, eq=False)
class _Stage:
    """Where the search for a part of a motion begins.

    Attributes:
        curve: of the whole motion.
        start: unknowns, shape (p,).
    """

    curve: CurveMap
    start: FloatArray


@dataclass(eq=False)
class _Search:
    """One search, with what has failed so far.

    Attributes:
        task: what is asked.
        stage: where a longer motion has come to; None for one that begins at the task's start.
        failures: of the tactics so far.
    """

    task: SpaceTask
    stage: "_Stage | None" = None
    failures: list[Failure] = field(default_factory=list)
    _other_ways: SpaceTipWays | None = None
    _goal_poses: list[Pose] = field(default_factory=list)  # those to which no straight way leads
    _goal_reached: bool = False  # whether a pose at the goal is known that touches nothing

    def attempts(self) -> Iterator["_Tactic"]:
        """What is tried, in this order, as long as there is time."""
        for name, tactic in self._tactics():
            if self.failures and self.task.deadline.passed():
                yield _Tactic(name, lambda: None)
            else:
                yield _Tactic(name, tactic, costly=name not in {_FIRST_WAYS, _WITHDRAWAL})

    def _tactics(self) -> list[tuple[str, Callable[[], SpaceMotion | None]]]:
        """Names and what they stand for, the cheap ones first."""
        first = [(_FIRST_WAYS, self._by_first_ways), (_WITHDRAWAL, self._by_withdrawing)]
        others = [("other ways of the tip", self._by_other_ways)]
        finest = ("ways of the tip through the finest grid", self._by_finest_ways)
        if self.task.via:
            # What is not led by the tip passes no place on its way.
            return [*first, *others, finest, ("from place to place", self._by_stages)]
        to_poses = [("poses at the goal", self._to_poses), ("swinging", self._by_swinging)]
        rounds = [("RRT-Connect", partial(self._by_connecting, k)) for k in range(_ROUNDS)]
        half = len(rounds) // 2
        # A pose of the whole arm is known, and need not be drawn; other ways of the tip mostly lead to other poses.
        middle = [*to_poses, *others] if self.task.goal_pose is not None else [*others, *to_poses]
        return [*first, *middle, *rounds[:half], finest, *rounds[half:]]

    # ------------------------------------------------------------ led by the tip
    def _by_first_ways(self) -> SpaceMotion | None:
        """Along the ways of the tip that are tried first."""
        curve, start, end = self._spaces()
        return self._by_ways(self._ways(curve, start, end).first(), curve, start, end)

    def _by_other_ways(self) -> SpaceMotion | None:
        """Along all other ways of the tip."""
        curve, start, end = self._spaces()
        self._other_ways = self._ways(curve, start, end)
        return self._by_ways(self._other_ways.others(), curve, start, end)

    def _by_finest_ways(self) -> SpaceMotion | None:
        """Along ways of the tip through the finest grid, which are dear to find."""
        curve, start, end = self._spaces()
        ways = self._other_ways or self._ways(curve, start, end)
        return self._by_ways(ways.finest(), curve, start, end)

    def _by_withdrawing(self) -> SpaceMotion | None:
        """Back along the arm's own shape into its guide tube, and in anew."""
        task = self.task
        curve, start, end = self._spaces()
        if not task.arm.base_axes or curve.configuration(start)[-1] - task.arm.base_range[0] < task.unit:
            return None
        poses = withdrawn(task.stepper(curve, 0.0), start, task.deadline)
        if len(poses) < 2:
            return None
        ways = self._ways(curve, poses[-1].v, end).first()
        found = self._by_ways(ways, curve, poses[-1].v, end, slides=False)
        if found is None:
            return None
        unknowns = np.vstack(([pose.v for pose in poses[:-1]], found.unknowns))
        configurations = np.vstack(([pose.q for pose in poses[:-1]], found.configurations))
        return SpaceMotion(curve, unknowns, configurations, f"back, then {found.candidate}")

    def _ways(self, curve: CurveMap, start: FloatArray, end: Pose | None) -> SpaceTipWays:
        """Makes ways of the tip from some unknowns."""
        task = self.task
        stepper = task.stepper(curve)
        goal = self._goal(end)
        pose = stepper.pose(start)
        fed = task.arm.base_range[1] - float(pose.q[-1]) if task.arm.base_axes else None
        return SpaceTipWays(task, pose.tip, goal.position, goal.direction, pose.tip_direction, fed)

    def _by_ways(
        self,
        ways: Iterator[TipWay],
        curve: CurveMap,
        start: FloatArray,
        end: Pose | None,
        *,
        slides: bool = True,
    ) -> SpaceMotion | None:
        """Along one way after the other.

        Args:
            ways: of the tip.
            curve: of the motion.
            start: unknowns, shape (p,).
            end: the pose at the goal where a whole pose is asked.
            slides: whether the motion begins at the task's start, so that the arm lies on the track of its tip.
        """
        task = self.task
        goal = self._goal(end)
        slides = slides and self.stage is None and bool(task.arm.base_axes)
        for way in ways:
            found = self._attempt(way.name, task.stepper(curve, way.margin), start, self._along(way, goal, end))
            if slides and way.followed and (found is None or not self._has_room(found)):
                found = self._slid(way) or found
            if found is not None or task.deadline.passed():
                return found
        return None

    def _has_room(self, motion: SpaceMotion) -> bool:
        """Whether a motion keeps so much of the wanted gap that the optimisation can be expected to make the rest."""
        task = self.task
        roomy = replace(task, clearance=task.clearance + _GRAZING * task.wanted_gap)
        return len(failing_edges(roomy.stepper(motion.curve, 0.0), motion.unknowns)) == 0

    def _slid(self, way: TipWay) -> SpaceMotion | None:
        """From the start with all joints on a way, in a curve of the fewest knots that leave it half of its room."""
        task = self.task
        arm = task.arm
        corners = np.vstack([part for part, _ in self._legs(way)])
        track = SpaceTipTrack.along(arm.joint_positions_at(task.start), corners)
        feeds = feeds_to_end(arm, track, float(task.start[-1]), _SLIDE_STEP * task.unit)
        fitted = self._fitted_slide(slid_along(arm, track, feeds))
        if fitted is None:
            return None
        curve, end, unknowns = fitted
        stepper = task.stepper(curve, way.margin)
        poses = [stepper.pose(v) for v in unknowns]
        ended = partial(self._ended, poses, self._goal(end), end)
        return self._attempt("on the track of the tip", stepper, unknowns[0], lambda led, _: ended(led))

    def _fitted_slide(self, configurations: FloatArray) -> tuple[CurveMap, Pose | None, FloatArray] | None:
        """The curve that shows configurations, the pose at the goal where one is asked, and unknowns, all certified."""
        task = self.task

        @cache
        def fit(knots: int) -> tuple[CurveMap, Pose | None, FloatArray]:
            curve, start, end = self._spaces(knots)
            return curve, end, fitted_slide(curve, start, configurations)

        for room in (_SLIDE_ROOM * task.wanted_gap, 0.0):
            certified = replace(task, clearance=task.clearance + room)
            for knots in _KNOTS:
                curve, end, unknowns = fit(knots)
                if len(failing_edges(certified.stepper(curve, 0.0), unknowns)) == 0:
                    return curve, end, unknowns
        return None

    def _goal(self, end: Pose | None) -> GoalPose:
        """Where the tip has to be: the goal, or where it is in the pose that is asked."""
        goal = self.task.limited_goal
        if goal is not None:
            return goal
        if end is None:
            raise ValueError("a task has a goal for the tip or a pose of the whole arm")
        return self.task.limited(GoalPose(end.tip, end.tip_direction))

    def _along(self, way: TipWay, goal: GoalPose, end: Pose | None) -> Callable[[SpaceStepper, Pose], list[Pose]]:
        """Follows a way of the tip, then settles on the goal, or moves on to a pose of the whole arm."""
        task = self.task

        def lead(stepper: SpaceStepper, pose: Pose) -> list[Pose]:
            poses = [pose]
            for corners, place in self._legs(way):
                track = SpaceTipTrack.along(poses[-1].points, corners)
                guide: Guide = TipLed(stepper.space, track, track.start, still=False, largest_turn=_TURN, at_once=True)
                if way.followed:
                    guide = SpaceTrackLed(track, track.length, task.unit, task.settings.guide, way.followed)
                poses += follow(stepper, guide, poses[-1], task.deadline)[1:]
                if place is not None:
                    poses += settle(stepper, place, poses[-1], task.deadline)[1:]
            return self._ended(poses, goal, end, stepper)

        return lead

    def _ended(self, poses: list[Pose], goal: GoalPose, end: Pose | None, stepper: SpaceStepper) -> list[Pose]:
        """Poses that have come near the goal, and others onto it, or on to a pose of the whole arm."""
        if end is None:
            return [*poses, *settle(stepper, goal, poses[-1], self.task.deadline)[1:]]
        return [*poses, *self._moved_to(end, stepper, poses[-1])[1:]]

    def _legs(self, way: TipWay) -> Iterator[tuple[FloatArray, GoalPose | None]]:
        """A way from place to place that the tip passes, each with the place at its end, and from the last on."""
        task = self.task
        before = way.corners[:0]
        first = 0
        # What the user asks for at the goal would be asked for at a place too.
        if task.via and task.user is None:
            legs = passings(way.corners, np.stack(task.via)).leg
            for leg, place in zip(legs, task.via, strict=True):
                corners = np.vstack((before, way.corners[first : leg + 1], place))
                yield corners, GoalPose(place, near_enough=(0.5 * task.via_reach, 0.0), settings=task.settings.goal)
                before = place[None]
                first = int(leg) + 1
        yield np.vstack((before, way.corners[first:])), None

    # ------------------------------------------------------------ led to poses of the whole arm
    def _to_poses(self) -> SpaceMotion | None:
        """To poses at the goal, along the straight way in the unknowns as far as there is one."""
        task = self.task
        curve, start, end = self._spaces()
        stepper = task.stepper(curve)
        if end is not None:
            return self._attempt("straight to the pose", stepper, start, partial(self._moved_to, end))
        for number, pose in enumerate(goal_poses(task, stepper, self._draws()), start=1):
            self._goal_poses.append(pose)
            found = self._attempt("straight to a pose at the goal", stepper, start, partial(self._moved_to, pose))
            if found is not None or number >= _WANTED_POSES or task.deadline.passed():
                return found
        return None

    def _by_swinging(self) -> SpaceMotion | None:
        """To poses at the goal by way of straighter ones; a fed arm is drawn back into its tube instead."""
        task = self.task
        if task.arm.base_axes:
            return None
        curve, start, end = self._spaces()
        stepper = task.stepper(curve)
        goals = [end] if end is not None else self._goal_poses
        if not goals:
            return None
        first = stepper.pose(start)
        tell_tried("unbent and swung", self.failures)
        poses = swung(stepper, first, goals, self._draws(), task.deadline)
        if poses is None:
            self._failed("unbent and swung", "no tree met the other", stepper, first)
            return None
        return SpaceMotion.of(curve, poses, "unbent and swung")

    def _moved_to(self, end: Pose, stepper: SpaceStepper, pose: Pose) -> list[Pose]:
        """Poses from one to another.

        Raises:
            Stalled: when there is no straight way.
        """
        task = self.task
        guide = PoseLed(pose.v, end.v, self.task.settings.guide.pose_step, task.settings.guide)
        try:
            poses = follow(stepper, guide, pose, task.deadline)
        except Stalled as stalled:
            # Unknowns that hardly turn a joint may be the last that differ.
            poses = stalled.poses
        if not edge_is_safe(stepper, poses[-1].v, end.v):
            raise Stalled(guide.describe(poses[-1]), poses)
        return [*poses, *(stepper.pose(v) for v in pieces(stepper, poses[-1].v, end.v)[1:])]

    # ------------------------------------------------------------ drawn
    def _by_connecting(self, number: int) -> SpaceMotion | None:
        """By trees that grow from the start and from poses at the goal.

        Args:
            number: how many times that was tried before, with other draws and other poses.
        """
        task = self.task
        if number and not self._goal_reached:
            return None
        curve, start, end = self._spaces()
        stepper = task.stepper(curve)
        rng = self._draws(number)
        goals = [end] if end is not None else list(islice(goal_poses(task, stepper, rng), _GOALS))
        self._goal_reached = bool(goals)
        if not goals:
            return None
        first = stepper.pose(start)
        tell_tried("a sampler", self.failures)
        poses = CurveDraws(stepper, first, goals).way(rng, _EXTENSIONS, task.deadline)
        if poses is None:
            self._failed("a sampler", "no tree met the other", stepper, first)
            return None
        return SpaceMotion.of(curve, poses, "a sampler")

    # ------------------------------------------------------------ from place to place
    def _by_stages(self) -> SpaceMotion | None:
        """To each place on the way as a goal of its own, by whatever tactic leads there, and then to the goal."""
        task = self.task
        # The user's terms of a motion are written for the whole of it.
        if task.user is not None:
            return None
        curve, now, _ = self._spaces()
        places = (GoalPose(place, near_enough=(0.5 * task.via_reach, 0.0)) for place in task.via)
        parts: list[SpaceMotion] = []
        for goal in (*places, task.goal):
            asked = replace(task, via=(), goal=goal, refuse=lambda: None)
            try:
                parts.append(find_motion(asked, _Stage(curve, now)))
            except MotionNotFound:
                return None
            now = parts[-1].unknowns[-1]
        unknowns = np.vstack((parts[0].unknowns, *(part.unknowns[1:] for part in parts[1:])))
        configurations = np.vstack((parts[0].configurations, *(part.configurations[1:] for part in parts[1:])))
        return SpaceMotion(curve, unknowns, configurations, "from place to place")

    # ------------------------------------------------------------ what all share
    def _spaces(self, knots: int = KNOTS) -> tuple[CurveMap, FloatArray, Pose | None]:
        """The curve's map, the unknowns of the start, and the pose at the goal where a whole pose is asked."""
        if self.stage is not None:
            return self.stage.curve, self.stage.start, None
        task = self.task
        curve, start = CurveMap.through(task.arm, task.start, knots)
        if task.goal_pose is None:
            return curve, start, None
        curve, end = curve.blended_to(task.goal_pose)
        stepper = task.stepper(curve)
        return curve, np.append(start, 0.0), stepper.pose(end)

    def _attempt(
        self,
        name: str,
        stepper: SpaceStepper,
        start: FloatArray,
        lead: Callable[[SpaceStepper, Pose], list[Pose]],
    ) -> SpaceMotion | None:
        """What comes of one tactic; its failure is kept."""
        first = stepper.pose(start)
        tell_tried(name, self.failures)
        try:
            return SpaceMotion.of(stepper.space, lead(stepper, first), name)
        except Stalled as stalled:
            self._failed(name, str(stalled), stepper, stalled.poses[-1])
            return None

    def _failed(self, candidate: str, message: str, stepper: SpaceStepper, pose: Pose) -> None:
        """Keep why a candidate failed that ended in a pose."""
        task = self.task
        first, segments = task.arm.exposed_links(pose.points)
        near = task.tree.nearest(segments, stepper.kept + 0.5 * task.arm.length)
        k = int(np.argmin(near.gap))
        owner = int(near.owner[k])
        name = f"'{task.names[owner]}'" if 0 <= owner < len(task.names) else "a wall"
        gap = float(near.gap[k]) - task.arm.radius
        if task.goal_pose is None:
            apart = pose.tip - self._goal(None).position
        else:
            apart = pose.points - task.arm.joint_positions_at(task.goal_pose)
        remaining = float(np.max(np.linalg.norm(np.atleast_2d(apart), axis=1)))
        limit = "" if task.user is None else task.user.placed_at_goal().describe(pose.q)
        tightest = None if owner < 0 else (first + k + 1, name, gap)
        bends = task.arm.bend_pairs(pose.q)
        self.failures.append(Failure(candidate, message, remaining, tightest, pose.q, bends, limit))

    def _draws(self, number: int = 0) -> np.random.Generator:
        """The draws of a tactic, others for every time that it is tried."""
        return np.random.default_rng((self.task.seed, number) if number else self.task.seed)
