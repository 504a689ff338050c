"""One run of the search over its candidates.

Where the base stands in a narrow room itself, as in a bottle, no fold has room to open there and to travel out. But
what lies in the passage can be drawn back along itself, as out of a gate, while the rest bows to one side and coils up.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from typing import Generic, TypeVar

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import UnreachableGoal
from ccm_opt.core.polyline import leg_headings, without_repeats
from ccm_opt.planning.continuation import Guide, GuideCandidate, Stalled, follow, settle, without_pauses
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.guides import PoseLed
from ccm_opt.planning.hairpin import FOLD_LENGTHS, fitting_folds, led_along, pulled_over
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion import CurveMotion, Motion
from ccm_opt.planning.motion_task import CachedItems, MotionTask
from ccm_opt.planning.passage_exit import gate_entry, pose_at_goal, slid_out
from ccm_opt.planning.passage_widths import evenly_along
from ccm_opt.planning.pose import CurveUnknowns, Pose
from ccm_opt.planning.retraction import drawn_back, fold_width, lies_confined, widths_beside_arm
from ccm_opt.planning.search import Failure, SearchTask, tell_tried
from ccm_opt.planning.step import Stepper, StepperOf
from ccm_opt.planning.tip_paths import TipPath
from ccm_opt.planning.tracking import Reference, follow_reference

_PAUSES = (0.02, 1e-3)
"""Poses nearer than this to the one before are dropped [rad], the first that leaves the motion certified; a path that
almost stands still in places cannot be timed well. Taste."""
_PUT_OFF = 0.5
"""Probability with which a seed other than 0 puts a candidate off until the others have been tried. Taste."""

_NEAR = 0.05
"""Gap below which what is near is named, as a share of the arm's length. Taste."""
_CORNER = 0.02
"""Turn that makes a corner of a path [rad]. Taste."""
_FEW_CORNERS = 2
"""A route with more corners bends the arm so that straight interpolation seldom works. Taste."""


def passage_entry(stepper: Stepper, start: Pose, path: TipPath) -> float | None:
    """Return the arc length from the base at which the arm enters the first passage that it fills [m].

    None if it fills none.
    """
    filled = np.flatnonzero(widths_beside_arm(stepper, start, path.taut) < fold_width(stepper))
    if len(filled) == 0:
        return None
    # The tip's way leads back along the arm: what it passes last is nearest to the base.
    places, _ = evenly_along(path.taut)
    axis = shapely.LineString(start.points)
    return float(shapely.line_locate_point(axis, shapely.points(places[filled])).min())


def first_candidates(
    stepper: Stepper,
    start: Pose,
    goal_coordinates: Iterable[FloatArray],
    tip_paths: tuple[TipPath, ...],
    whole_arm: FloatArray | None = None,
) -> Iterator[GuideCandidate]:
    """Yield the candidates that solve most problems, most promising first.

    Args:
        stepper: of the link space they are to run in.
        start: where the motion begins.
        goal_coordinates: of goal poses, for interpolation; unless the tip can go straight, they are asked for when the
            first tip path has failed.
        tip_paths: shortest first.
        whole_arm: coordinates of a goal for the whole arm; a fold that has run to the base is opened onto it.
    """
    # In a gate with hardly any play nothing else moves an arm.
    gates = [(path, gate_entry(stepper, start, path)) for path in tip_paths]
    yield from slid_out(stepper, start, whole_arm, gates, "slid out of gates")

    # Poses at the goal are dear among many walls, and often there are none along the routes; a tip is led in no time.
    led_first = whole_arm is None and stepper.among_many_walls
    if led_first:
        yield from (tip_led(stepper, path) for path in sorted(tip_paths, key=lambda path: path.length))

    interpolated = _interpolations(stepper, start, goal_coordinates)
    if whole_arm is not None or goes_straight(tip_paths):
        yield from interpolated

    first_length = FOLD_LENGTHS[:1]
    withdrawn = _withdrawn(stepper, start, goal_coordinates, tip_paths, first_length, whole_arm=whole_arm is not None)
    # Out of a narrow place the arm comes only as it came in, and a tip that is drawn back alone buckles it.
    if tip_paths and lies_confined(stepper, start, tip_paths[0]):
        yield from withdrawn
        passage = (tip_paths[0], passage_entry(stepper, start, tip_paths[0]))
        yield from slid_out(stepper, start, whole_arm, [passage], "drawn in")

    for path in tip_paths:
        # A fold lays the arm on its new route link by link, where a goal of the whole arm wants it; a tip alone can
        # mostly be led there.
        if whole_arm is not None:
            fitting = fitting_folds(stepper, path)
            yield from pulled_over(stepper, start, whole_arm, path, fitting[:1])
            yield tip_led(stepper, path)
        else:
            if not led_first:
                yield tip_led(stepper, path)
            yield from pulled_over(stepper, start, whole_arm, path, first_length)
            # Not before, for a pose at the goal has to be found by the NLP first. The first path uses them all up.
            yield from interpolated

    yield from interpolated
    yield from withdrawn


def _interpolations(stepper: Stepper, start: Pose, goal_coordinates: Iterable[FloatArray]) -> Iterator[GuideCandidate]:
    """Yield the straight to one pose at the goal after the other; each is made when it is asked for."""
    for k, goal in enumerate(goal_coordinates, start=1):
        make_guide = partial(PoseLed, stepper.space, start.v, goal)
        yield GuideCandidate(f"interpolation {k}", make_guide)


def _withdrawn(
    stepper: Stepper,
    start: Pose,
    goal_coordinates: Iterable[FloatArray],
    tip_paths: tuple[TipPath, ...],
    lengths: tuple[float, ...],
    *,
    whole_arm: bool,
) -> Iterator[GuideCandidate]:
    """Yield the drawn back along itself onto one pose at the goal after the other.

    Each is made when it is asked for.
    """
    for path in tip_paths[:1]:
        for goal in goal_coordinates:
            yield from drawn_back(stepper, start, goal, path, lengths, whole_arm=whole_arm)


def goes_straight(tip_paths: tuple[TipPath, ...]) -> bool:
    """Whether the tip's first path is straight and its route has few corners, so that interpolation probably works."""
    if not tip_paths:
        return False
    first = tip_paths[0]
    straight = _corners(first.taut, _CORNER) == 0
    return straight and _corners(first.route, _CORNER) <= _FEW_CORNERS


def _corners(path: FloatArray, least_turn: float) -> int:
    """Number of places where a path (k, 2) turns by more than ``least_turn`` [rad]."""
    turns = np.diff(leg_headings(without_repeats(path, 0.0)))
    return int(np.count_nonzero(np.abs(turns) > least_turn))


def further_candidates(
    stepper: Stepper,
    start: Pose,
    goal_coordinates: Iterable[FloatArray],
    tip_paths: tuple[TipPath, ...],
    whole_arm: FloatArray | None = None,
) -> Iterator[GuideCandidate]:
    """Yield the folds of other lengths, back and forth; arguments as for ``first_candidates``."""
    others = FOLD_LENGTHS[1:]
    yield from _withdrawn(stepper, start, goal_coordinates, tip_paths, others, whole_arm=whole_arm is not None)
    for path in tip_paths:
        lengths = FOLD_LENGTHS if whole_arm is None else fitting_folds(stepper, path)
        yield from pulled_over(stepper, start, whole_arm, path, lengths[1:])


def tip_led(stepper: Stepper, path: TipPath) -> GuideCandidate:
    """Return the tip drawn along the taut path."""
    return GuideCandidate(f"tip-led, {path.name}", partial(led_along, stepper, path.taut))


_GATE_RIDGE = 1e-5
"""The same in gates, with their equations. Measured on an arm of 48 links in two doors: with the narrow ridge a step
took 1165 iterations, with this one 2."""
_MENDS = 3
"""Times that poses are put between those in gates between which the motion is not certified. Taste."""


def drawn_order(candidates: Iterable[GuideCandidate], seed: int, put_off: float) -> Iterator[GuideCandidate]:
    """Yield all candidates, some of them later than their turn.

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


TaskType = TypeVar("TaskType", bound=SearchTask)
"""The kind of task."""
CurveType = TypeVar("CurveType", bound=CurveUnknowns)
"""The kind of map of its motions."""


@dataclass(frozen=True, eq=False)
class SearchRun(Generic[TaskType, CurveType]):
    """One run through candidates, with one stepper: each is led along, what stalls is recorded.

    Attributes:
        task: what is looked for.
        stepper: of the space through the start, with all limits.
        start: pose at the start.
        goal: with the limits that hold there; for a whole-arm goal in the unknowns of the space.
    """

    task: TaskType
    stepper: StepperOf[CurveType]
    start: Pose
    goal: GoalPose

    def attempt(
        self, name: str, lead: Callable[[], list[Pose]], failures: list[Failure]
    ) -> CurveMotion[CurveType] | None:
        """Return the motion through the poses of a candidate; None and why where it stalls."""
        tell_tried(name, failures)
        try:
            return self.motion(name, lead())
        except Stalled as stalled:
            failures.append(self.failure(name, stalled))
            return None

    def motion(self, name: str, poses: list[Pose]) -> CurveMotion[CurveType]:
        """Return the poses as a motion found by a candidate."""
        return CurveMotion.of(self.stepper.space, poses, name)

    def failure(self, name: str, stalled: Stalled) -> Failure:
        """Return why a candidate stalled, and what was near."""
        pose = stalled.poses[-1]
        limit = self.goal.describe_limits(pose)
        bends = self.stepper.space.bends(pose.q).reshape(self.task.arm.links, -1)
        return Failure(name, str(stalled), self._remaining(pose), self.tightest(pose), pose.q, bends, limit)

    def _remaining(self, pose: Pose) -> float:
        """Return how far the tip, or with a goal for the whole arm the farthest joint, still is from the goal [m]."""
        if self.goal.coordinates is None:
            return self.goal.errors(pose)[0]
        apart = self.stepper.pose(self.goal.coordinates).points - pose.points
        return float(np.linalg.norm(apart, axis=1).max())

    def arrived(self, poses: list[Pose]) -> list[Pose]:
        """Return poses that have come near the goal, and others onto it: settled, or led to the pose of the whole arm.

        Raises:
            Stalled: the goal is not reached.
        """
        if self.goal.coordinates is None:
            return [*poses, *settle(self.stepper, self.goal, poses[-1], self.task.deadline)[1:]]
        return [*poses, *self.led_to(self.goal.coordinates, poses[-1])[1:]]

    def led_to(self, end: FloatArray, pose: Pose) -> list[Pose]:
        """Return the poses from one to other unknowns, shape (p,), on the straight way.

        Raises:
            Stalled: when there is no such way.
        """
        guide = PoseLed(self.stepper.space, pose.v, end)
        try:
            poses = follow(self.stepper, guide, pose, self.task.deadline)
        except Stalled as stalled:
            # Unknowns that hardly turn a joint may be the last that differ.
            poses = stalled.poses
        # Where steps are not proved the motion is as a whole.
        unproved = self.stepper.settings.step.proof_depth is None and guide.finished(poses[-1])
        if not unproved and not self.stepper.edge_is_safe(poses[-1].v, end):
            raise Stalled(guide.describe(poses[-1]), poses)
        return [*poses, *(self.stepper.pose(v) for v in self.stepper.space.pieces(poses[-1].v, end)[1:])]

    def tightest(self, pose: Pose) -> tuple[int, str, float] | None:
        """Return what a pose nearly touches: link from 1, name, gap [m]; None when nothing is near."""
        finder = self.task.finder(0.0, _NEAR * self.task.arm.length)
        return finder.tightest(finder.find(pose.points))


@dataclass(frozen=True, eq=False)
class PlanarRun(SearchRun[MotionTask, LinkSpace]):
    """One pass through the portfolio with one margin.

    Attributes:
        stepper: of the link space through the start, with all limits.
        guesses: coordinates of poses at or near the goal, each of shape (p,).
    """

    stepper: Stepper
    guesses: Iterable[FloatArray]

    @classmethod
    def from_task(cls, task: MotionTask, margin_links: float) -> "PlanarRun":
        """Return a pass in the link space through the task's start.

        Args:
            task: what is looked for.
            margin_links: planning margin, in nominal links.
        """
        narrowed = task.settings.step.narrowed(margin_links)
        if task.gates is not None:
            narrowed = replace(narrowed, ridge=_GATE_RIDGE)
        if narrowed is not task.settings.step:
            task = replace(task, settings=replace(task.settings, step=narrowed))
        space, start = task.space_through(task.start)
        goal = task.limited_goal
        guesses: Iterable[FloatArray] = CachedItems(space.fitted(guess) for guess in task.guesses)
        if task.goal_pose is not None:
            # The first coordinates of the goal are fitted; the last, w, goes from 0 at the start to 1 there. A fed
            # arm needs none: its space holds any pose.
            space, end = space.blended_to(task.goal_pose)
            start = np.append(start, np.zeros(len(end) - len(start)))
            goal = replace(goal, coordinates=end)
            guesses = (end,)

        stepper = task.stepper(space, margin_links)
        run = cls(task, stepper, stepper.pose(start), goal, guesses)
        # A motion drawn towards a guess that breaks a limit would be drawn away from what the limit allows.
        settled = bool(task.user_limits) and goal.coordinates is None
        return replace(run, guesses=run.settled_guesses()) if settled else run

    def settled_guesses(self) -> Iterable[FloatArray]:
        """Return the guesses brought onto the goal and the limits there, those that can be."""
        poses = (pose_at_goal(self.task, self.stepper, guess) for guess in self.task.guesses)
        return CachedItems(pose.v for pose in poses if pose is not None)

    def direct(self) -> Iterator[GuideCandidate]:
        """Yield the straight to a goal of the whole arm."""
        whole_arm = self.goal.coordinates
        if whole_arm is not None:
            yield from islice(first_candidates(self.stepper, self.start, self.guesses, (), whole_arm), 1)

    def first(self) -> Iterator[GuideCandidate]:
        """Return the candidates that solve most problems."""
        whole_arm = self.goal.coordinates
        return self._drawn(first_candidates(self.stepper, self.start, self.guesses, self.task.tip_paths, whole_arm))

    def lies_in_gates(self) -> bool:
        """Return whether the arm lies in narrow gates at the start."""
        return any(gate_entry(self.stepper, self.start, path) is not None for path in self.task.tip_paths)

    def further(self) -> Iterator[GuideCandidate]:
        """Return all other candidates."""
        whole_arm = self.goal.coordinates
        return self._drawn(further_candidates(self.stepper, self.start, self.guesses, self.task.tip_paths, whole_arm))

    def _drawn(self, candidates: Iterator[GuideCandidate]) -> Iterator[GuideCandidate]:
        """Return the candidates in the order that the seed draws."""
        return drawn_order(candidates, self.task.seed, _PUT_OFF)

    def run(self, tried: Iterator[GuideCandidate], failures: list[Failure]) -> Motion | None:
        """Return the finished motion of the first candidate that arrives and is certified, or None."""
        for candidate in tried:
            motion = self.attempt(candidate.name, partial(self._finished, candidate), failures)
            if motion is not None or self.task.deadline.passed():
                return motion
        return None

    def _finished(self, candidate: GuideCandidate) -> list[Pose]:
        return self.certified_without_pauses(self.arrived(self._led(candidate)))

    def certified_without_pauses(self, poses: list[Pose]) -> list[Pose]:
        """Return the motion without pauses, certified.

        Raises:
            Stalled: when it cannot be certified.
        """
        # Dropping poses cuts corners a little: where that loses the certificate, fewer are dropped.
        for pause in _PAUSES:
            fewer = without_pauses(poses, pause)
            if self._certified(fewer):
                return fewer
        mended = self._mended(poses)
        if mended is not None:
            return mended
        raise Stalled("the motion arrived but could not be certified", poses)

    def _mended(self, poses: list[Pose]) -> list[Pose] | None:
        """Return poses with others between them, put back onto gates' middles, where that certifies them; else None."""
        if self.task.gates is None:
            return None
        for _ in range(_MENDS):
            failing = self.task.certificate.failures(stack_configurations(poses))
            if len(failing) == 0:
                return poses
            for k in reversed(failing):
                middle = self.stepper.pose(0.5 * (poses[k].v + poses[k + 1].v))
                for limit in self.stepper.limits:
                    middle = limit.restored(self.stepper.space, middle, self.task.settings.step.largest_turn)
                poses = [*poses[: k + 1], middle, *poses[k + 1 :]]
        return poses if self._certified(poses) else None

    def _led(self, candidate: GuideCandidate) -> list[Pose]:
        """Follow the candidate's guide, then those that resume where it ends or stalls, until one of them arrives."""
        guide = _made(candidate.make_guide, self.start)
        try:
            poses = follow(self.stepper, guide, self.start, self.task.deadline, into=self.goal)
        except Stalled as stalled:
            if not candidate.resume:
                raise
            # A guide that leads into a dead end may still have brought the arm near enough for the next.
            poses = stalled.poses
        for resume in candidate.resume:
            if self.goal.is_set and self.goal.met(poses[-1]):
                return poses
            try:
                onward = _made(partial(resume, guide, poses[-1]), poses[-1])
                return poses + follow(self.stepper, onward, poses[-1], self.task.deadline, into=self.goal)[1:]
            except Stalled as stalled:
                if resume is candidate.resume[-1]:
                    raise
                poses = poses + stalled.poses[1:]
        return poses

    def _certified(self, poses: list[Pose]) -> bool:
        return len(self.task.certificate.failures(stack_configurations(poses))) == 0

    def goal_poses(self) -> Iterator[Pose]:
        """Yield the goal of the whole arm, or poses of it that have the tip at the goal."""
        if self.goal.coordinates is not None:
            yield self.stepper.pose(self.goal.coordinates)
            return
        for guess in chain(self.task.guesses, self.task.further_guesses):
            pose = pose_at_goal(self.task, self.stepper, guess)
            if pose is not None:
                yield pose

    def tracked(self, found: Motion, failures: list[Failure]) -> Motion | None:
        """Return a motion bent to the limits; None when that fails."""
        name = f"{found.candidate}, tracked"
        reference = Reference.of(found, self.stepper.space)
        if self.goal.coordinates is not None:
            reference.unknowns[-1] = self.goal.coordinates
        try:
            way = follow_reference(self.stepper, reference, self.goal, self.start, self.task.deadline)
        except Stalled as stalled:
            failures.append(self.failure(name, stalled))
            return None
        if not self._certified(way.poses):
            failures.append(self.failure(name, Stalled("the motion arrived but could not be certified", way.poses)))
            return None
        return replace(self.motion(name, way.poses), u=np.array(way.u))


def _made(make: Callable[[], Guide], pose: Pose) -> Guide:
    """Return a guide that leads on from a pose.

    Raises:
        Stalled: when no way leads on from there. That says nothing of the problem: a tip in a wall's margin may
            have its nearest free place in a pocket.
    """
    try:
        return make()
    except UnreachableGoal as apart:
        raise Stalled(apart.diagnosis.reason, [pose]) from apart


def stack_configurations(poses: list[Pose]) -> FloatArray:
    """Return the configurations of poses, shape (K, c)."""
    return np.array([pose.q for pose in poses])
