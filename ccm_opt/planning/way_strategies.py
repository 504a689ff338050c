"""Strategies of the search for a motion in space that lead the tip along paths, with certified steps."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import islice

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import MotionNotFound, ProblemError, TimeLimitReached
from ccm_opt.planning.continuation import Guide, follow, settle
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.followable_ways import feeds_to_end, fitted_slide, placed_slide, slid_along
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.guides import ArmTrack, TipLed, TrackLed
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.sampled_run import SampledRun
from ccm_opt.planning.search import Failure
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.tip_ways import SpaceTipWays, TipWay
from ccm_opt.planning.via_places import passings
from ccm_opt.planning.withdrawals import turned_over, withdrawal_poses
from ccm_opt.robot.biarc import free_before

_SLIDE_ROOM = 0.5
"""Fraction of the preferred clearance that a slide of all joints along a tip path has to keep; if no slide does, any
collision-free slide is used."""

_SLIDE_STEP = 0.25
"""Feed between keyframes of a slide of all joints along a tip path, in nominal links. Measured in a wing box: with
twice as much, joints that slide round sharp bends lose 2 mm of a gap of 3 mm between keyframes."""

_KNOTS = (11, 16, 22)
"""Numbers of knots of the curve, tried in turn: more knots represent sharp bends better, but the optimisation takes
longer (measured in pipes: 16 knots suffice for 8 to 16 links, 22 for 24 links)."""
_GRAZING = 0.1
"""Fraction of the preferred clearance below which a motion that leads the tip is replaced, if possible, by a slide of
all joints along the tip path: the optimisation seldom restores the clearance of such a motion."""
_TURNS_OFF = 0.5
"""Length beyond that of a link, in links or in nominal links where these are shorter, for which the tip stays on its
straight path out of the guide tube. Without it the joint at the end of the tube would have to bend as it comes out
(measured between ribs); half of a long link is more than that joint needs, and more than some pipes have."""
_TURN = 1.0
"""Largest turn of a link onto the tip's track at which one step aims [rad]. Heuristic."""
_WITHDRAWN_SHARE = 0.5
"""Fraction of the remaining time that the search from the guide tube may use after a retraction. Heuristic."""


@dataclass(frozen=True, eq=False)
class SpaceRun(SampledRun):
    """Search for a motion in space by tip paths, by poses at the goal and by trees, in the unknowns of one curve."""

    # ------------------------------------------------------------ led by the tip
    def find_along_first_ways(self, failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion along the first of the paths of ``first_ways`` that succeeds, or None if all fail.

        Failures are appended to ``failures``.
        """
        return self.follow_ways(self.first_ways(), failures)

    def begins_bent(self) -> bool:
        """Return whether a fed arm has bent joints at the start, so that it has to move back along its own shape."""
        return self.task.arm.feed is not None and bool(np.any(self.start.q[:-1]))

    def begins_straight(self) -> bool:
        """Return whether a fed arm is straight at the start, so that it may move on without being retracted."""
        return self.task.arm.feed is not None and not self.begins_bent()

    def find_straight(self, failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion that leads the tip straight to the goal, or None if that fails."""
        return self.follow_ways(islice(self.ways().first(), 1), failures)

    def first_ways(self) -> Iterator[TipWay]:
        """Yield tip paths that are straight until a joint has left the guide tube, then those that bend earlier.

        A passage may bend so near to the end of the tube that only the latter exist for an arm of few links.
        """
        ways = self.ways()
        yield from ways.first()
        arm = self.task.arm
        earlier = max(self._first_bending + free_before(arm) - ways.out, 0.0)
        if earlier < ways.straight:
            yield from replace(ways, straight=earlier).first()

    @property
    def _first_bending(self) -> float:
        """Length of the part of the arm at its tip that bends first as the arm leaves the guide tube [m]."""
        space = self.stepper.space
        if space.arm.drives is None:
            return space.arm.link_length
        return space.arm.length - float(np.max(space.bending_places))

    def find_along_other_ways(self, failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion along one of the tip paths not tried first, or None if all fail."""
        return self.follow_ways(self._other_ways.others(), failures)

    def find_along_finest_ways(self, failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion along a tip path through the finest grid, which is costly to search, or None if all fail."""
        return self.follow_ways(self._other_ways.finest(), failures)

    def find_by_withdrawing(
        self, find: Callable[[SpaceTask], SpaceMotion], failures: list[Failure]
    ) -> SpaceMotion | None:
        """Return a motion back into the guide tube, and from there to the goal by any strategy, or None.

        If the arm cannot be retracted along its own shape, a motion from the tube to the start is used in reverse. If
        that fails too, the tip is led to the goal from where the retraction ended, or a motion from the tube is sought
        again in the curve of the other.

        Args:
            find: function that finds a motion from the tube to the goal, or to the start; raises ``NoPlanFound``.
            failures: list to which failures of candidates are appended.
        """
        task = self.task
        home = np.zeros(len(self.start.q))
        home[-1] = task.arm.base_range[0]
        if self.start.q[-1] - home[-1] < task.unit:
            return None
        # The stages of a longer motion are in one curve, which another search would not keep.
        if task.stage is not None or not self.stepper.safe(home, home):
            return self._led_on_from_retraction(failures)
        from_tube = partial(self._found_from, home, find)
        found = from_tube(task)
        if found is None:
            return self._led_on_from_retraction(failures)
        whole = self._retracted_before(found)
        if whole is not None:
            return whole
        entered = from_tube(self._entering)
        return (
            self._led_back_before(found, entered)
            or self._led_on_from_retraction(failures)
            or self._led_back_in_one_curve(found, entered, from_tube)
        )

    def _led_on_from_retraction(self, failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion back along the arm's own shape as far as it goes, then with the tip led to the goal, or None.

        Failures are appended to ``failures``.
        """
        task = self.task
        if task.deadline.passed():
            return None
        poses = withdrawal_poses(task.stepper(self.stepper.space, 0.0), self.start.v, task.deadline)
        if len(poses) < 2:
            return None
        back = replace(self, start=poses[-1])
        found = back.follow_ways(back.first_ways(), failures, slides=False)
        if found is None:
            return None
        unknowns = np.vstack(([pose.v for pose in poses[:-1]], found.unknowns))
        return replace(found.through(unknowns), candidate=f"back, then {found.candidate}")

    def _found_from(
        self, home: FloatArray, find: Callable[[SpaceTask], SpaceMotion], task: SpaceTask
    ) -> SpaceMotion | None:
        """Return a motion of a task from the arm in the guide tube, or None if none is found in a fraction of the time.

        Args:
            home: configuration with the arm in the tube, shape (c,).
            find: function that finds a motion; raises ``NoPlanFound``.
            task: task, whose start is replaced.
        """
        share = task.deadline.within(_WITHDRAWN_SHARE * task.deadline.left)
        try:
            return find(replace(task, start=home, stage=None, deadline=share))
        except (MotionNotFound, TimeLimitReached):
            return None

    def _retracted_before(self, found: SpaceMotion) -> SpaceMotion | None:
        """Return a certified motion back along the arm's own shape, then along ``found``; None if none is certified."""
        curve, start = found.curve.blended_to(self.start.q)
        stepper = self.task.stepper(curve, 0.0)
        poses = withdrawal_poses(stepper, start, self.task.deadline)
        onward = found.without_blending(curve)
        return self._turned_over(onward, np.stack([pose.v for pose in poses]))

    @property
    def _entering(self) -> SpaceTask:
        """Task of moving from the guide tube to the start of the search."""
        goal = GoalPose(self.start.tip, self.start.tip_direction)
        return replace(self.task, goal=goal, goal_pose=self.start.q, via=(), refuse=lambda: None)

    def _led_back_before(self, found: SpaceMotion, entered: SpaceMotion | None) -> SpaceMotion | None:
        """Return a certified motion back along a motion from the tube to the start in reverse, then along ``found``.

        Args:
            found: motion from the guide tube to the goal.
            entered: motion from the guide tube to the start; None for none. Both need the same number of knots.
        """
        if entered is None or entered.curve.knots != found.curve.knots:
            return None
        curve, onward, back = found.curve.with_blends_of(entered.curve, found.unknowns, entered.unknowns[::-1])
        return self._turned_over(replace(found, curve=curve).through(onward), back)

    def _led_back_in_one_curve(
        self, found: SpaceMotion, entered: SpaceMotion | None, from_tube: Callable[[SpaceTask], SpaceMotion | None]
    ) -> SpaceMotion | None:
        """Return the motion of ``_led_back_before`` if its parts differ in their knots; the one with fewer is replaced.

        Args:
            found: motion from the guide tube to the goal.
            entered: motion from the guide tube to the start, or None.
            from_tube: function that finds a motion of a task from the tube.
        """
        if entered is None or entered.curve.knots == found.curve.knots:
            return None
        if entered.curve.knots < found.curve.knots:
            return self._led_back_before(found, from_tube(replace(self._entering, knots=found.curve.knots)))
        again = from_tube(replace(self.task, knots=entered.curve.knots))
        return None if again is None else self._led_back_before(again, entered)

    def _turned_over(self, onward: SpaceMotion, back: FloatArray) -> SpaceMotion | None:
        """Return a retraction, unknowns (K, p), and an onward motion joined to a certified motion, or None."""
        stepper = self.task.stepper(onward.curve, 0.0)
        unknowns = turned_over(stepper, back, onward.unknowns, wholly=bool(self.task.via))
        if unknowns is None:
            return None
        return replace(onward.through(unknowns), candidate=f"back, then {onward.candidate}")

    @cached_property
    def _other_ways(self) -> SpaceTipWays:
        return self.ways()

    def ways(self) -> SpaceTipWays:
        """Return the generator of tip paths from the start of the search."""
        arm = self.task.arm
        start = self.start
        ways = partial(SpaceTipWays, self.task, start.tip, self.goal.position, self.goal.direction)
        if arm.feed is None:
            return ways(start.tip_direction)
        feed = float(start.q[-1])
        out = feed + arm.length - arm.hole
        straight = max(self._first_bending + _TURNS_OFF * min(arm.link_length, self.task.unit) - out, 0.0)
        return ways(start.tip_direction, arm.base_range[1] - feed, straight, start.points, out)

    def follow_ways(
        self, ways: Iterator[TipWay], failures: list[Failure], *, slides: bool = True
    ) -> SpaceMotion | None:
        """Return a motion along the first tip path that succeeds, or None.

        Args:
            ways: tip paths.
            failures: list to which failures of candidates are appended.
            slides: whether the motion begins at the start of the task, so that all joints can slide along the tip path.
        """
        task = self.task
        slides = slides and task.stage is None and task.arm.feed is not None and task.arm.drives is None
        for way in ways:
            slid = self._slid(way, failures) if slides and way.followed else None
            found = slid
            if slid is None or not self._has_room(slid):
                run = self.with_margin(way.margin)
                found = run.attempt(way.name, partial(run.along, way), failures)
                if slid is not None and (found is None or not self._has_room(found)):
                    found = slid
            if found is not None or task.deadline.passed():
                return found
        return None

    def with_margin(self, share: float) -> "SpaceRun":
        """Return a copy of the search whose steps keep only a fraction (``share``) of the planning margin."""
        return replace(self, stepper=self.task.stepper(self.stepper.space, share))

    def _has_room(self, motion: SpaceMotion) -> bool:
        """Return whether a motion has enough clearance for the optimisation to reach the preferred clearance."""
        return self._keeps(_GRAZING * self.task.wanted_gap, motion.curve, motion.unknowns)

    def _keeps(self, gap: float, curve: CurveMap, unknowns: FloatArray) -> bool:
        """Return whether a motion, unknowns of shape (K, p), is certified with a gap [m] beyond the required clearance.

        The gaps at the keyframes are checked first, as they are cheaper than the certificate.
        """
        task = self.task
        if task.least_gap(curve.configurations(unknowns)) < gap:
            return False
        roomy = replace(task, clearance=task.clearance + gap)
        return len(roomy.stepper(curve, 0.0).failing_edges(unknowns)) == 0

    def _slid(self, way: TipWay, failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion in which all joints of a fed arm slide along a tip path, or None if none is certified.

        The curve has the fewest knots with which the motion keeps half of the preferred clearance or, if no number of
        knots does, is collision-free.
        """
        task = self.task
        corners = np.vstack([part for part, _ in self._legs(way)])
        track = ArmTrack.behind(task.arm.joint_positions_at(task.start), corners)
        try:
            feeds = feeds_to_end(task.arm, track, float(task.start[-1]), _SLIDE_STEP * task.unit)
            fitted = self._fitted_slide(slid_along(task.arm, track, feeds))
        except ProblemError:
            return None  # links that stand for bodies, with constant turns, do not lie on the track
        if fitted is None:
            return None
        run = fitted[0].with_margin(way.margin)
        poses = [run.stepper.pose(v) for v in fitted[1]]
        return run.attempt("on the track of the tip", partial(run.arrived, poses), failures)

    def _fitted_slide(self, configurations: FloatArray) -> "tuple[SpaceRun, FloatArray] | None":
        """Return a search in a curve that represents configurations (K, c), and certified unknowns (K, p), or None."""
        task = self.task

        @cache
        def fit(knots: int) -> tuple[SpaceRun, FloatArray]:
            run = SpaceRun.from_task(task, knots)
            curve = run.stepper.space
            return run, placed_slide(curve, fitted_slide(curve, run.start.v, configurations), configurations)

        for room in (_SLIDE_ROOM * task.wanted_gap, 0.0):
            for knots in _KNOTS if task.knots is None else (task.knots,):
                run, unknowns = fit(knots)
                if self._keeps(room, run.stepper.space, unknowns):
                    return run, unknowns
        return None

    def along(self, way: TipWay) -> list[Pose]:
        """Return the poses of a motion with the tip led along a tip path and onto the goal.

        Raises:
            Stalled: the arm makes no progress.
        """
        stepper = self.stepper
        task = self.task
        poses = [self.start]
        for corners, place in self._legs(way):
            track = ArmTrack.behind(poses[-1].points, corners)
            guide: Guide = TipLed(stepper.space, track, track.start, still=False, largest_turn=_TURN, at_once=True)
            if way.followed:
                guide = TrackLed(stepper.space, track, weight=way.followed)
            poses += follow(stepper, guide, poses[-1], task.deadline)[1:]
            if place is not None:
                poses += settle(stepper, place, poses[-1], task.deadline)[1:]
        return self.arrived(poses)

    def _legs(self, way: TipWay) -> Iterator[tuple[FloatArray, GoalPose | None]]:
        """Yield the parts of a tip path between via points: vertices (m, 3), and the via point at the end or None.

        With user terms, which would wrongly apply to stops at via points, the only part is the whole path.
        """
        task = self.task
        before = way.corners[:0]
        first = 0
        # With user terms there are no stops at via places: terms for the goal would also be applied there.
        if task.via and task.user is None:
            legs = passings(way.corners, np.stack(task.via)).leg
            for leg, place in zip(legs, self._places(), strict=True):
                yield np.vstack((before, way.corners[first : leg + 1], place.position)), place
                before = place.position[None]
                first = int(leg) + 1
        yield np.vstack((before, way.corners[first:])), None

    def _places(self) -> list[GoalPose]:
        """Return the via points as goals of the tip."""
        task = self.task
        near_enough = (0.5 * task.via_reach, 0.0)
        return [GoalPose(place, near_enough=near_enough, settings=task.settings.goal) for place in task.via]

    # ------------------------------------------------------------ from place to place
    def find_by_stages(self, find: Callable[[SpaceTask], SpaceMotion], failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion through the via points to the goal, planned from one to the next, or None if a stage fails.

        Args:
            find: function that finds the motion of one stage; raises ``MotionNotFound``.
            failures: unused.
        """
        del failures
        now = self.start.v
        parts: list[SpaceMotion] = []
        for goal in (*self._places(), self.task.goal):
            stage = (self.stepper.space, now)
            asked = replace(self.task, via=(), goal=goal, refuse=lambda: None, stage=stage)
            try:
                parts.append(find(asked))
            except MotionNotFound:
                return None
            now = parts[-1].unknowns[-1]
        unknowns = np.vstack((parts[0].unknowns, *(part.unknowns[1:] for part in parts[1:])))
        configurations = np.vstack((parts[0].configurations, *(part.configurations[1:] for part in parts[1:])))
        return SpaceMotion(parts[0].curve, unknowns, configurations, "from place to place")
