"""The search for a motion: every candidate in turn until one is certified, then the optimisation of the whole."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import TypeAlias

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.collision.certificate import Certificate
from ccm_opt.collision.contacts import ContactFinder
from ccm_opt.collision.walls import Walls
from ccm_opt.motion.backward import backward_tasks, pose_at_goal, reversed_motion
from ccm_opt.motion.constrained.continuation import Reference, track
from ccm_opt.motion.continuation import PAUSES, Stalled, follow, settle, without_pauses
from ccm_opt.motion.failures import Failure, nothing_found
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.guides.straight_interpolation import Interpolation
from ccm_opt.motion.lifting import lift
from ccm_opt.motion.link_space import FINENESS, LinkSpace
from ccm_opt.motion.motion_task import Motion, MotionTask, Remembered, coarsened
from ccm_opt.motion.optimisation.optimise import optimise
from ccm_opt.motion.passage_widths import fitting_margins, nominal_links_asked
from ccm_opt.motion.portfolio import GuideCandidate, first_candidates, further_candidates
from ccm_opt.motion.step import Pose, Stepper
from ccm_opt.motion.tree.tree_search import TREES, TreeTask, search_by_trees

MARGINS = (0.06, 0.024)
"""Planning margins that are tried, in units of the link space."""
TREE_MARGINS = (0.12, 0.06, 0.024)
"""Margins that trees of poses are grown with: a wide one moves on faster, a narrow one gets through."""
REACH = 0.96
"""Contacts nearer than this many units make rows of the step."""
DESIGN_LINKS = 24
"""Arms with more than half as many links again are planned with this many and lifted, where passages are wide."""
LIFT_MARGIN = 3e-3
"""Gap that an optimised motion keeps when it is to be lifted, as a share of the arm's length."""


def find_motion(task: MotionTask) -> Motion:
    """Find a certified motion from the start to the goal.

    Arms of many links are planned at ``DESIGN_LINKS`` in the same coordinates and lifted; when that fails, or the
    arm has few links, they are planned on their own links. When no candidate arrives, trees of poses are grown.

    Raises:
        MotionNotFound: every candidate failed; the diagnosis lists why.
        TimeLimitReached: the deadline passed first.
    """
    failures: list[Failure] = []
    for search in SEARCHES if task.terms is None else OWN_SEARCHES[task.terms.parametric]:
        motion = _found_by(search, task, failures)
        if motion is not None:
            return motion
    raise nothing_found(task, failures)


def _found_by(search: "Search", task: MotionTask, failures: "list[Failure]") -> Motion | None:
    """The optimised motion that a search finds at few links, lifted, or else on the task's own links."""
    fineness = nominal_links_asked(task)
    if task.arm.links > 1.5 * DESIGN_LINKS and fineness <= FINENESS and not task.clamped and task.terms is None:
        coarse = coarsened(task, DESIGN_LINKS)
        found = search(coarse, failures, FINENESS)
        lifted = _lifted(found, coarse, task) if found is not None else None
        if lifted is not None:
            return lifted
    motion = search(task, failures, fineness)
    return optimise(motion, task) if motion is not None else None


def _lifted(found: Motion, coarse: MotionTask, task: MotionTask) -> Motion | None:
    """A coarse motion on the task's links: optimised and lifted, or else lifted as it was found and then optimised."""
    lifted = lift(optimise(found, coarse, LIFT_MARGIN), task)
    if lifted is not None:
        return lifted
    lifted = lift(found, task)
    return optimise(lifted, task) if lifted is not None else None


Search: TypeAlias = Callable[[MotionTask, list[Failure], float], Motion | None]
"""Finds a motion for a task at some fineness, or adds to the failures."""


def _grow_trees(task: MotionTask, failures: list[Failure], fineness: float) -> Motion | None:
    """The motion found by trees of poses from both ends, until the deadline or until they reach nothing new."""
    if not task.tip_paths or task.deadline.passed():
        return None
    attempts = [_Attempt.of(task, margin, fineness) for margin in TREE_MARGINS]
    attempt = attempts[-1]
    steppers = tuple(each.stepper for each in attempts)
    try:
        return attempt.motion(TREES, attempt.brisk(search_by_trees(attempt.tree_task(steppers))))
    except Stalled as stalled:
        failures.append(attempt.failure(TREES, stalled))
    return None


def _try_margins(task: MotionTask, failures: list[Failure], fineness: float) -> Motion | None:
    for margin in fitting_margins(task, MARGINS, fineness):
        for motion in _motions(task, margin, fineness, failures):
            if motion is not None:
                return motion
            if task.deadline.passed():
                return None
    return None


def _motions(task: MotionTask, margin: float, fineness: float, failures: list[Failure]) -> Iterator[Motion | None]:
    """Forwards, then backwards from every pose at the goal, then forwards with all that is left; None for failures."""
    forward = _Attempt.of(task, margin, fineness)
    yield forward.run(forward.first(), failures)
    for turned in backward_tasks(task, forward.stepper):
        if turned is not None:
            backward = _Attempt.of(turned, margin, fineness)
            motion = backward.run(backward.first(), failures)
            yield reversed_motion(motion) if motion is not None else None
    yield forward.run(forward.further(), failures)


SEARCHES: tuple[Search, ...] = (_try_margins, _grow_trees)
"""What is tried in turn."""


def _track(task: MotionTask, failures: list[Failure], fineness: float) -> Motion | None:
    """A motion found without the user's constraints, tracked under them; the other ways to go there in turn."""
    own = task.terms
    if own is None or task.deadline.passed():
        return None
    for margin in fitting_margins(task, MARGINS, fineness):
        for found in _motions(replace(task, terms=None), margin, fineness, []):
            if found is None:
                continue
            motion = _Attempt.of(task, margin, fineness).tracked(found, failures)
            if motion is not None or task.deadline.passed():
                return motion
            break
    return None


OWN_SEARCHES: dict[bool, tuple[Search, ...]] = {
    False: (_try_margins, _track, _grow_trees),
    True: (_track,),
}
"""What is tried in turn where the user has constraints; whether they depend on the path parameter."""


@dataclass(frozen=True)
class _Attempt:
    """One pass through the portfolio with one margin."""

    task: MotionTask
    stepper: Stepper
    start: Pose
    goal: GoalPose
    guesses: Iterable[FloatArray]
    certificate: Certificate

    @classmethod
    def of(cls, task: MotionTask, units: float, fineness: float) -> "_Attempt":
        space, start = LinkSpace.through(task.arm, task.start, fineness, clamped=task.clamped)
        margin = units * space.unit
        goal = task.goal_in(space)
        guesses: Iterable[FloatArray] = Remembered(_coordinates(space, guess) for guess in task.guesses)
        if task.goal_headings is not None:
            space, end = space.blended_to(task.goal_headings)
            start, goal = np.append(start, 0.0), replace(task.goal_in(space), coordinates=end)
            guesses = (end,)
        reach = max(REACH * space.unit, 4.0 * margin)
        finder = ContactFinder(task.arm, Walls.of(task.workspace), task.workspace.clearance, margin, reach)
        stepper = Stepper(space, finder, task.own_rows(space), task.settings)
        attempt = cls(task, stepper, stepper.pose(start), goal, guesses, task.certificate)
        return attempt if task.terms is None else replace(attempt, guesses=attempt.own_guesses())

    def own_guesses(self) -> Iterable[FloatArray]:
        """The guesses brought onto the goal and the user's constraints there, those that can be."""
        if self.goal.coordinates is not None:
            return self.guesses
        poses = (pose_at_goal(self.task, self.stepper, guess) for guess in self.task.guesses)
        return Remembered(pose.v for pose in poses if pose is not None)

    def first(self) -> Iterator[GuideCandidate]:
        """The candidates that solve most problems."""
        return first_candidates(self.stepper, self.start, self.guesses, self.task.tip_paths, self.goal.coordinates)

    def further(self) -> Iterator[GuideCandidate]:
        """All other candidates."""
        return further_candidates(self.stepper, self.start, self.task.tip_paths, self.goal.coordinates)

    def run(self, tried: Iterator[GuideCandidate], failures: list[Failure]) -> Motion | None:
        """The finished motion of the first candidate that arrives and is certified, or None."""
        for candidate in tried:
            try:
                return self.motion(candidate.name, self._attempt(candidate))
            except Stalled as stalled:
                failures.append(self.failure(candidate.name, stalled))
            if self.task.deadline.passed():
                return None
        return None

    def _attempt(self, candidate: GuideCandidate) -> list[Pose]:
        poses = self._led(candidate)
        return self.brisk(poses + self._arrive(poses[-1])[1:])

    def brisk(self, poses: list[Pose]) -> list[Pose]:
        """The motion without pauses, certified.

        Raises:
            Stalled: when it cannot be certified.
        """
        for pause in PAUSES:
            brisk = without_pauses(poses, pause)
            if self._certified(headings_of(brisk)):
                return brisk
        raise Stalled("the motion arrived but could not be certified", poses)

    def _led(self, candidate: GuideCandidate) -> list[Pose]:
        """Follow the candidate's guide, then the one that resumes where it ends or stalls."""
        guide = candidate.make_guide()
        try:
            poses = follow(self.stepper, guide, self.start, self.task.deadline)
        except Stalled as stalled:
            if candidate.resume is None:
                raise
            poses = stalled.poses
        if candidate.resume is None:
            return poses
        rest = candidate.resume(guide, poses[-1])
        return poses + follow(self.stepper, rest, poses[-1], self.task.deadline)[1:]

    def _arrive(self, pose: Pose) -> list[Pose]:
        if self.goal.coordinates is None:
            return settle(self.stepper, self.goal, pose, self.task.deadline)
        guide = Interpolation(self.stepper.space, pose.v, self.goal.coordinates)
        poses = follow(self.stepper, guide, pose, self.task.deadline)
        return [*poses, self.stepper.pose(self.goal.coordinates)]

    def _certified(self, headings: FloatArray) -> bool:
        return len(self.certificate.failures(headings)) == 0

    def tree_task(self, steppers: tuple[Stepper, ...]) -> TreeTask:
        """What trees of poses are grown for, maybe with several margins."""
        task = self.task
        return TreeTask(
            steppers,
            self.start,
            self.goal,
            self._goal_poses(),
            task.tip_paths,
            self.certificate,
            task.deadline,
            task.seed,
        )

    def _goal_poses(self) -> Iterator[Pose]:
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
        return Motion(self.stepper.space, np.array([p.v for p in poses]), headings_of(poses), name)

    def tracked(self, found: Motion, failures: list[Failure]) -> Motion | None:
        """A motion bent to the user's constraints; None when that fails."""
        own, reference = self.stepper.own, Reference.along(found.headings)
        if own is None:
            return None
        name = f"{found.candidate}, tracked"
        try:
            way = track(self.stepper, own, reference, self.goal, self.start, self.task.deadline)
        except Stalled as stalled:
            failures.append(self.failure(name, stalled))
            return None
        if not self._certified(headings_of(way.poses)):
            failures.append(self.failure(name, Stalled("the motion arrived but could not be certified", way.poses)))
            return None
        return replace(self.motion(name, way.poses), u=np.array(way.u))

    def failure(self, name: str, stalled: Stalled) -> Failure:
        """Why a candidate stalled, and what was near."""
        pose, finder = stalled.poses[-1], self.stepper.finder
        contacts = finder.find(pose.points)
        own = "" if self.goal.own is None else self.goal.own.describe(pose.headings)
        where = finder.tightest(contacts)
        return Failure(name, str(stalled), finder.describe(contacts), self._remaining(pose), own, where, pose.headings)

    def _remaining(self, pose: Pose) -> float:
        """How far the tip, or with a goal for the whole arm the farthest joint, still is from the goal [m]."""
        if self.goal.coordinates is None:
            return self.goal.errors(pose)[0]
        apart = self.stepper.space.positions(self.goal.coordinates) - pose.points
        return float(np.linalg.norm(apart, axis=1).max())


def headings_of(poses: list[Pose]) -> FloatArray:
    """Link headings of a motion, shape (K, links) [rad]."""
    return np.array([pose.headings for pose in poses])


def _coordinates(space: LinkSpace, headings: FloatArray) -> FloatArray:
    """Coordinates in the space nearest to given link headings."""
    return space.blended_to(headings)[1][:-1]
