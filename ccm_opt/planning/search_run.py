"""One run of the search."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.progress import tell_candidate
from ccm_opt.errors import UnreachableGoal
from ccm_opt.planning.backward import pose_at_goal
from ccm_opt.planning.continuation import Guide, GuideCandidate, GuideIntoSet, Stalled, follow, settle, without_pauses
from ccm_opt.planning.failures import Failure
from ccm_opt.planning.guides import Interpolation
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion_task import CachedItems, Motion, MotionTask
from ccm_opt.planning.passage_exit import mouth_of_gates
from ccm_opt.planning.portfolio import first_candidates, further_candidates
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.step import GoalPose, Stepper
from ccm_opt.planning.tracking import ReferenceMotion, follow_reference
from ccm_opt.planning.tree_search import TreeTask

_GATE_RIDGE = 1e-5
"""The same in gates, with their equations. Measured on an arm of 48 links in two doors: with the narrow ridge a step
took 1165 iterations, with this one 2."""
_MENDS = 3
"""Times that poses are put between those in gates between which the motion is not certified. Taste."""


def drawn_order(candidates: Iterable[GuideCandidate], seed: int, put_off: float) -> Iterator[GuideCandidate]:
    """All candidates, some of them later than their turn.

    The first candidate that arrives decides which motion is optimised, but another may end in a better one. A seed puts
    every candidate off with some probability until all others have been tried, so that early ones still come early.

    Args:
        candidates: the most promising first.
        seed: of what is drawn; 0 draws nothing.
        put_off: the probability.
    """
    if seed == 0:
        yield from candidates
        return
    rng = np.random.default_rng(seed)
    later: list[GuideCandidate] = []
    for candidate in candidates:
        if rng.random() < put_off:
            later.append(candidate)
        else:
            yield candidate
    yield from later


@dataclass(frozen=True)
class SearchRun:
    """One pass through the portfolio with one margin.

    Attributes:
        task: what is looked for.
        stepper: of the link space through the start, with all limits.
        start: pose at the start.
        goal: with the limits that hold there; for a whole-arm goal in the coordinates of the space.
        guesses: coordinates of poses at or near the goal, each of shape (p,).
    """

    task: MotionTask
    stepper: Stepper
    start: Pose
    goal: GoalPose
    guesses: Iterable[FloatArray]

    @classmethod
    def from_task(cls, task: MotionTask, margin_links: float, nominal_links: float) -> "SearchRun":
        """A pass in the link space through the task's start.

        Args:
            task: what is looked for.
            margin_links: planning margin, in nominal links.
            nominal_links: nominal links to the arm's length.
        """
        narrowed = task.settings.step.narrowed(margin_links)
        if task.gates is not None:
            narrowed = replace(narrowed, ridge=_GATE_RIDGE)
        if narrowed is not task.settings.step:
            task = replace(task, settings=replace(task.settings, step=narrowed))
        space, start = LinkSpace.through(task.arm, task.start, nominal_links, clamped=task.clamped)
        goal = task.limited_goal
        guesses: Iterable[FloatArray] = CachedItems(_nearest_coordinates(space, guess) for guess in task.guesses)
        if task.goal_headings is not None:
            # The first coordinates of the goal are fitted; the last, w, goes from 0 at the start to 1 there.
            space, end = space.blended_to(task.goal_headings)
            start = np.append(start, 0.0)
            goal = replace(goal, coordinates=end)
            guesses = (end,)

        finder = task.planning_finder(margin_links * space.nominal_length, space.nominal_length)
        stepper = Stepper(space, finder, task.limits(finder), task.settings)
        run = cls(task, stepper, stepper.pose(start), goal, guesses)
        # A motion drawn towards a guess that breaks a limit would be drawn away from what the limit allows.
        settled = any(limit.moves_keyframes for limit in task.user_limits) and goal.coordinates is None
        return replace(run, guesses=run.settled_guesses()) if settled else run

    def settled_guesses(self) -> Iterable[FloatArray]:
        """The guesses brought onto the goal and the limits there, those that can be."""
        poses = (pose_at_goal(self.task, self.stepper, guess) for guess in self.task.guesses)
        return CachedItems(pose.v for pose in poses if pose is not None)

    def direct(self) -> Iterator[GuideCandidate]:
        """Straight to a goal of the whole arm."""
        whole_arm = self.goal.coordinates
        if whole_arm is not None:
            yield from islice(first_candidates(self.stepper, self.start, self.guesses, (), whole_arm), 1)

    def first(self) -> Iterator[GuideCandidate]:
        """The candidates that solve most problems."""
        whole_arm = self.goal.coordinates
        return self._drawn(first_candidates(self.stepper, self.start, self.guesses, self.task.tip_paths, whole_arm))

    def lies_in_gates(self) -> bool:
        """Whether the arm lies in narrow gates at the start."""
        return any(mouth_of_gates(self.stepper, self.start, path) is not None for path in self.task.tip_paths)

    def further(self) -> Iterator[GuideCandidate]:
        """All other candidates."""
        whole_arm = self.goal.coordinates
        return self._drawn(further_candidates(self.stepper, self.start, self.guesses, self.task.tip_paths, whole_arm))

    def _drawn(self, candidates: Iterator[GuideCandidate]) -> Iterator[GuideCandidate]:
        """Candidates in the order that the seed draws."""
        return drawn_order(candidates, self.task.seed, self.task.settings.search.put_off)

    def run(self, tried: Iterator[GuideCandidate], failures: list[Failure]) -> Motion | None:
        """The finished motion of the first candidate that arrives and is certified, or None."""
        for candidate in tried:
            nearest = min((failure.remaining for failure in failures), default=np.inf)
            tell_candidate(len(failures) + 1, candidate.name, nearest)
            try:
                poses = self._led(candidate)
                arriving = self._arrive(poses[-1])[1:]
                return self.motion(candidate.name, self.certified_without_pauses(poses + arriving))
            except Stalled as stalled:
                failures.append(self.failure(candidate.name, stalled))
            if self.task.deadline.passed():
                return None
        return None

    def certified_without_pauses(self, poses: list[Pose]) -> list[Pose]:
        """The motion without pauses, certified.

        Raises:
            Stalled: when it cannot be certified.
        """
        # Dropping poses cuts corners a little: where that loses the certificate, fewer are dropped.
        for pause in self.task.settings.continuation.pauses:
            fewer = without_pauses(poses, pause)
            if self._certified(fewer):
                return fewer
        mended = self._mended(poses)
        if mended is not None:
            return mended
        raise Stalled("the motion arrived but could not be certified", poses)

    def _mended(self, poses: list[Pose]) -> list[Pose] | None:
        """Poses with others between them, put back onto gates' middles, where that certifies them; else None."""
        if self.task.gates is None:
            return None
        for _ in range(_MENDS):
            failing = self.task.certificate.failures(pose_headings(poses))
            if len(failing) == 0:
                return poses
            for k in reversed(failing):
                middle = 0.5 * (poses[k].v + poses[k + 1].v)
                for limit in self.stepper.limits:
                    middle = limit.restored(self.stepper.space, middle, self.task.settings.step.largest_turn)
                poses = [*poses[: k + 1], self.stepper.pose(middle), *poses[k + 1 :]]
        return poses if self._certified(poses) else None

    def _led(self, candidate: GuideCandidate) -> list[Pose]:
        """Follow the candidate's guide, then those that resume where it ends or stalls, until one of them arrives."""
        guide = _made(candidate.make_guide, self.start)
        try:
            poses = self._followed(guide, self.start)
        except Stalled as stalled:
            if not candidate.resume:
                raise
            # A guide that leads into a dead end may still have brought the arm near enough for the next.
            poses = stalled.poses
        for resume in candidate.resume:
            if self.goal.is_set and self.goal.met(poses[-1]):
                return poses
            try:
                return poses + self._followed(_made(partial(resume, guide, poses[-1]), poses[-1]), poses[-1])[1:]
            except Stalled as stalled:
                if resume is candidate.resume[-1]:
                    raise
                poses = poses + stalled.poses[1:]
        return poses

    def _followed(self, guide: Guide, pose: Pose) -> list[Pose]:
        """Follow a guide to its end; where the goal is a set, no farther than into it."""
        led = GuideIntoSet(guide, self.goal) if self.goal.is_set else guide
        return follow(self.stepper, led, pose, self.task.deadline)

    def _arrive(self, pose: Pose) -> list[Pose]:
        """Poses from near the goal onto it: settled, or for a whole-arm goal led straight into its coordinates."""
        if self.goal.coordinates is None:
            return settle(self.stepper, self.goal, pose, self.task.deadline)
        settings = self.stepper.settings.guides.interpolation
        guide = Interpolation(self.stepper.space, pose.v, self.goal.coordinates, settings=settings)
        poses = follow(self.stepper, guide, pose, self.task.deadline)
        return [*poses, self.stepper.pose(self.goal.coordinates)]

    def _certified(self, poses: list[Pose]) -> bool:
        return len(self.task.certificate.failures(pose_headings(poses))) == 0

    def tree_task(self, steppers: tuple[Stepper, ...]) -> TreeTask:
        """What trees of poses are to join, grown with several margins."""
        task = self.task
        return TreeTask(
            steppers,
            self.start,
            self.goal,
            self.goal_poses(),
            task.tip_paths,
            task.certificate,
            task.deadline,
            task.seed,
        )

    def goal_poses(self) -> Iterator[Pose]:
        """The goal of the whole arm, or poses of it that have the tip at the goal."""
        if self.goal.coordinates is not None:
            yield self.stepper.pose(self.goal.coordinates)
            return
        for guess in chain(self.task.guesses, self.task.further_guesses()):
            pose = pose_at_goal(self.task, self.stepper, guess)
            if pose is not None:
                yield pose

    def motion(self, name: str, poses: list[Pose]) -> Motion:
        """The poses as a motion found by a candidate."""
        return Motion(self.stepper.space, np.array([p.v for p in poses]), pose_headings(poses), name)

    def tracked(self, found: Motion, failures: list[Failure]) -> Motion | None:
        """A motion bent to the limits; None when that fails."""
        name = f"{found.candidate}, tracked"
        reference = ReferenceMotion.from_headings(found.headings)
        try:
            way = follow_reference(self.stepper, reference, self.goal, self.start, self.task.deadline)
        except Stalled as stalled:
            failures.append(self.failure(name, stalled))
            return None
        if not self._certified(way.poses):
            failures.append(self.failure(name, Stalled("the motion arrived but could not be certified", way.poses)))
            return None
        return replace(self.motion(name, way.poses), u=np.array(way.u))

    def failure(self, name: str, stalled: Stalled) -> Failure:
        """Why a candidate stalled, and what was near."""
        pose = stalled.poses[-1]
        finder = self.stepper.finder
        contacts = finder.find(pose.points)
        return Failure(
            candidate=name,
            message=str(stalled),
            obstacle=finder.describe(contacts),
            remaining=self._remaining(pose),
            limit=self.goal.describe_limits(pose),
            tightest=finder.tightest(contacts),
            headings=pose.headings,
        )

    def _remaining(self, pose: Pose) -> float:
        """How far the tip, or with a goal for the whole arm the farthest joint, still is from the goal [m]."""
        if self.goal.coordinates is None:
            return self.goal.errors(pose)[0]
        apart = self.stepper.space.positions(self.goal.coordinates) - pose.points
        return float(np.linalg.norm(apart, axis=1).max())


def _made(make: Callable[[], Guide], pose: Pose) -> Guide:
    """A guide that leads on from a pose.

    Raises:
        Stalled: when no way leads on from there. That says nothing of the problem: a tip in a wall's margin may
            have its nearest free place in a pocket.
    """
    try:
        return make()
    except UnreachableGoal as apart:
        raise Stalled(apart.diagnosis.reason, [pose]) from apart


def pose_headings(poses: list[Pose]) -> FloatArray:
    """Link headings of a motion, shape (K, links) [rad]."""
    return np.array([pose.headings for pose in poses])


def _nearest_coordinates(space: LinkSpace, headings: FloatArray) -> FloatArray:
    """Coordinates in the space nearest to given link headings."""
    # Only the curve's share: without the coordinate that would add what the curve cannot show.
    return space.blended_to(headings)[1][:-1]
