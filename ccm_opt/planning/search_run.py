"""One run of a search through candidates with one stepper, and the candidates of the search in the plane.

If the base itself stands in a narrow space, as in a bottle, no fold of the arm fits there. But the part of the arm in
the passage can be retracted along its own shape, as out of a gate, while the rest bows to one side and coils up.
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
from ccm_opt.planning.retraction import fold_width, lies_confined, retraction_candidates, widths_beside_arm
from ccm_opt.planning.search import Failure, SearchTask, report_tried
from ccm_opt.planning.step import Stepper, StepperOf
from ccm_opt.planning.tip_paths import TipPath
from ccm_opt.planning.tracking import Reference, follow_reference

_PAUSES = (0.02, 1e-3)
"""Distances from the previous pose below which a pose is dropped [rad], tried in turn until the motion is certified. A
path that almost stands still at some poses is hard to time. Heuristic."""
_PUT_OFF = 0.5
"""Probability that a candidate is deferred until the others have been tried, for seeds other than 0. Heuristic."""

_NEAR = 0.05
"""Gap below which the nearest obstruction is reported, as a fraction of the arm's length. Heuristic."""
_CORNER = 0.02
"""Change of heading above which a vertex of a path counts as a corner [rad]. Heuristic."""
_FEW_CORNERS = 2
"""Maximum number of corners of a route for which interpolation is tried first: with more, it seldom works.
Heuristic."""


def passage_entry(stepper: Stepper, start: Pose, path: TipPath) -> float | None:
    """Return the arc length along the arm at which it enters a passage too narrow for a fold, nearest to the base [m].

    The result is None if the arm lies in no such passage along the tip path.

    Args:
        stepper: solver of QP steps; gives arm and walls.
        start: pose of the arm.
        path: tip path.
    """
    filled = np.flatnonzero(widths_beside_arm(stepper, start, path.taut) < fold_width(stepper))
    if len(filled) == 0:
        return None
    # The tip path leads back along the arm: the passage that it crosses last is nearest to the base.
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
    """Yield the candidates that solve most problems, the most promising ones first.

    Args:
        stepper: solver of QP steps.
        start: start pose of the motion.
        goal_coordinates: coordinates of goal poses, each of shape (p,), computed on demand.
        tip_paths: tip paths, shortest first.
        whole_arm: coordinates of a goal of the whole arm, shape (p,), or None.
    """
    # An arm in a gate with hardly any clearance can only slide along its own shape.
    gates = [(path, gate_entry(stepper, start, path)) for path in tip_paths]
    yield from slid_out(stepper, start, whole_arm, gates, "slid out of gates")

    # Among many walls goal poses are costly to find, and often there are none along the routes; leading the tip is
    # fast.
    led_first = whole_arm is None and stepper.among_many_walls
    if led_first:
        yield from (tip_led(stepper, path) for path in sorted(tip_paths, key=lambda path: path.length))

    interpolated = _interpolations(stepper, start, goal_coordinates)
    if whole_arm is not None or goes_straight(tip_paths):
        yield from interpolated

    first_length = FOLD_LENGTHS[:1]
    withdrawal_candidates = _withdrawal_candidates(
        stepper, start, goal_coordinates, tip_paths, first_length, whole_arm=whole_arm is not None
    )
    # The arm can leave a narrow passage only along its own shape, and leading only the tip back buckles it.
    if tip_paths and lies_confined(stepper, start, tip_paths[0]):
        yield from withdrawal_candidates
        passage = (tip_paths[0], passage_entry(stepper, start, tip_paths[0]))
        yield from slid_out(stepper, start, whole_arm, [passage], "drawn in")

    for path in tip_paths:
        # For a goal of the whole arm, a fold moves the arm onto its new route link by link; for a goal of the tip,
        # leading the tip there mostly suffices.
        if whole_arm is not None:
            fitting = fitting_folds(stepper, path)
            yield from pulled_over(stepper, start, whole_arm, path, fitting[:1])
            yield tip_led(stepper, path)
        else:
            if not led_first:
                yield tip_led(stepper, path)
            yield from pulled_over(stepper, start, whole_arm, path, first_length)
            # Not earlier, since the NLP has to find the goal poses. All interpolations follow the first tip path.
            yield from interpolated

    yield from interpolated
    yield from withdrawal_candidates


def _interpolations(stepper: Stepper, start: Pose, goal_coordinates: Iterable[FloatArray]) -> Iterator[GuideCandidate]:
    """Yield one candidate for each goal pose: interpolation in coordinates from the start to that pose.

    Args:
        stepper: solver of QP steps.
        start: start pose of the motion.
        goal_coordinates: coordinates of goal poses, each of shape (p,).
    """
    for k, goal in enumerate(goal_coordinates, start=1):
        make_guide = partial(PoseLed, stepper.space, start.v, goal)
        yield GuideCandidate(f"interpolation {k}", make_guide)


def _withdrawal_candidates(
    stepper: Stepper,
    start: Pose,
    goal_coordinates: Iterable[FloatArray],
    tip_paths: tuple[TipPath, ...],
    lengths: tuple[float, ...],
    *,
    whole_arm: bool,
) -> Iterator[GuideCandidate]:
    """Yield candidates that retract the arm along its own shape and lay it onto one goal pose after another.

    Args:
        stepper: solver of QP steps.
        start: start pose of the motion.
        goal_coordinates: coordinates of goal poses, each of shape (p,), computed on demand.
        tip_paths: tip paths, of which only the first is used, for its free space.
        lengths: lengths of the fold, in nominal links.
        whole_arm: whether the motion has to end in exactly a goal pose, and not only with the tip at the goal.
    """
    for path in tip_paths[:1]:
        for goal in goal_coordinates:
            yield from retraction_candidates(stepper, start, goal, path, lengths, whole_arm=whole_arm)


def goes_straight(tip_paths: tuple[TipPath, ...]) -> bool:
    """Return whether the first tip path is straight and its route has few corners, so that interpolation may work."""
    if not tip_paths:
        return False
    first = tip_paths[0]
    straight = _corners(first.taut, _CORNER) == 0
    return straight and _corners(first.route, _CORNER) <= _FEW_CORNERS


def _corners(path: FloatArray, least_turn: float) -> int:
    """Return the number of vertices at which a path (k, 2) turns by more than ``least_turn`` [rad]."""
    turns = np.diff(leg_headings(without_repeats(path, 0.0)))
    return int(np.count_nonzero(np.abs(turns) > least_turn))


def further_candidates(
    stepper: Stepper,
    start: Pose,
    goal_coordinates: Iterable[FloatArray],
    tip_paths: tuple[TipPath, ...],
    whole_arm: FloatArray | None = None,
) -> Iterator[GuideCandidate]:
    """Yield candidates that retract the arm, or lay it onto a route, by a fold that travels along the arm.

    The folds have the lengths that ``first_candidates`` does not use.

    Args:
        stepper: solver of QP steps.
        start: start pose of the motion.
        goal_coordinates: coordinates of goal poses, each of shape (p,), computed on demand.
        tip_paths: tip paths, shortest first.
        whole_arm: coordinates of a goal of the whole arm, shape (p,), or None.
    """
    others = FOLD_LENGTHS[1:]
    yield from _withdrawal_candidates(
        stepper, start, goal_coordinates, tip_paths, others, whole_arm=whole_arm is not None
    )
    for path in tip_paths:
        lengths = FOLD_LENGTHS if whole_arm is None else fitting_folds(stepper, path)
        yield from pulled_over(stepper, start, whole_arm, path, lengths[1:])


def tip_led(stepper: Stepper, path: TipPath) -> GuideCandidate:
    """Return the candidate that leads the tip along the shortest path of a homotopy class."""
    return GuideCandidate(f"tip-led, {path.name}", partial(led_along, stepper, path.taut))


_GATE_RIDGE = 1e-5
"""Ridge of the QP Hessian for steps of an arm in narrow gates, where equations hold the arm on the gates' centre lines.
Measured for an arm of 48 links in two doors: with the regularisation for narrow margins a step took 1165 iterations,
with this one 2."""
_MENDS = 3
"""Maximum number of rounds that insert poses where a motion through gates is not certified. Heuristic."""


def sampled_order(candidates: Iterable[GuideCandidate], seed: int, put_off: float) -> Iterator[GuideCandidate]:
    """Yield all candidates, some of them deferred at random until all others have been yielded.

    The first candidate that succeeds decides which motion is optimised, but another may lead to a better one. With
    deferral, other seeds give other motions, while the most promising candidates still tend to come early.

    Args:
        candidates: candidates, the most promising first.
        seed: seed of the random numbers; with 0 the order is kept.
        put_off: probability that a candidate is deferred.
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
"""Type of a run's task."""
CurveType = TypeVar("CurveType", bound=CurveUnknowns)
"""Type of the map from unknowns to configurations in a run's motions."""


@dataclass(frozen=True, eq=False)
class SearchRun(Generic[TaskType, CurveType]):
    """One run through candidates with one stepper; builds their motions and records failures.

    Attributes:
        task: the search task.
        stepper: solver of QP steps, with all limits, in a space through the start.
        start: start pose.
        goal: goal with the limits that hold there; for a goal of the whole arm, with its unknowns in that space.
    """

    task: TaskType
    stepper: StepperOf[CurveType]
    start: Pose
    goal: GoalPose

    def attempt(
        self, name: str, lead: Callable[[], list[Pose]], failures: list[Failure]
    ) -> CurveMotion[CurveType] | None:
        """Return the motion through a candidate's poses; None, and a record of the failure, if the candidate stalls.

        Args:
            name: name of the candidate.
            lead: function that computes the candidate's poses or raises ``Stalled``.
            failures: list to which a failure is appended.
        """
        report_tried(name, failures)
        try:
            return self.motion(name, lead())
        except Stalled as stalled:
            failures.append(self.failure(name, stalled))
            return None

    def motion(self, name: str, poses: list[Pose]) -> CurveMotion[CurveType]:
        """Return the motion through the poses, with the name of its candidate."""
        return CurveMotion.from_poses(self.stepper.space, poses, name)

    def failure(self, name: str, stalled: Stalled) -> Failure:
        """Return the record of a stalled candidate, with the obstruction nearest to its last pose."""
        pose = stalled.poses[-1]
        limit = self.goal.describe_limits(pose)
        bends = pose.q[self.task.arm.coordinates.bends].reshape(self.task.arm.links, -1)
        return Failure(name, str(stalled), self._remaining(pose), self.tightest(pose), pose.q, bends, limit)

    def _remaining(self, pose: Pose) -> float:
        """Return the distance of the tip or, with a goal of the whole arm, of the farthest joint from the goal [m]."""
        if self.goal.coordinates is None:
            return self.goal.errors(pose)[0]
        apart = self.stepper.pose(self.goal.coordinates).points - pose.points
        return float(np.linalg.norm(apart, axis=1).max())

    def arrived(self, poses: list[Pose]) -> list[Pose]:
        """Return the given poses, which end near the goal, with poses appended that lead onto the goal.

        For a goal of the tip they are continued by steps, for a goal of the whole arm along a straight line of
        unknowns.

        Raises:
            Stalled: the goal is not reached.
        """
        if self.goal.coordinates is None:
            return [*poses, *settle(self.stepper, self.goal, poses[-1], self.task.deadline)[1:]]
        return [*poses, *self.led_to(self.goal.coordinates, poses[-1])[1:]]

    def led_to(self, end: FloatArray, pose: Pose) -> list[Pose]:
        """Return poses that lead from a pose to given unknowns, along a straight line as far as the limits permit.

        Args:
            end: unknowns of the end, shape (p,).
            pose: first pose.

        Raises:
            Stalled: the end is not reached by a safe motion.
        """
        guide = PoseLed(self.stepper.space, pose.v, end)
        try:
            poses = follow(self.stepper, guide, pose, self.task.deadline)
        except Stalled as stalled:
            # The remaining difference may be in unknowns on which the bends hardly depend.
            poses = stalled.poses
        # Where steps are not certified one by one, the motion is certified as a whole.
        unproved = self.stepper.settings.step.proof_depth is None and guide.finished(poses[-1])
        if not unproved and not self.stepper.edge_is_safe(poses[-1].v, end):
            raise Stalled(guide.describe(poses[-1]), poses)
        return [*poses, *(self.stepper.pose(v) for v in self.stepper.space.pieces(poses[-1].v, end)[1:])]

    def tightest(self, pose: Pose) -> tuple[str, str, float] | None:
        """Return the least gap of a pose: names of link and obstruction, gap [m]; None if none is near."""
        finder = self.task.finder(0.0, _NEAR * self.task.arm.length)
        return finder.tightest(finder.find(pose.points))


@dataclass(frozen=True, eq=False)
class PlanarRun(SearchRun[MotionTask, LinkSpace]):
    """One run through the candidates in the plane with one planning margin.

    Attributes:
        stepper: solver of QP steps, with all limits, in a link space through the start.
        guesses: coordinates of poses at or near the goal, each of shape (p,).
    """

    stepper: Stepper
    guesses: Iterable[FloatArray]

    @classmethod
    def from_task(cls, task: MotionTask, margin_links: float) -> "PlanarRun":
        """Return a run in a link space through the task's start.

        Args:
            task: the task.
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
            # The first coordinates are fitted to the goal; the last one, w, is 0 at the start and 1 at the goal. The
            # space of a fed arm needs no w, as it contains every pose.
            space, end = space.blended_to(task.goal_pose)
            start = np.append(start, np.zeros(len(end) - len(start)))
            goal = replace(goal, coordinates=end)
            guesses = (end,)

        stepper = task.stepper(space, margin_links)
        run = cls(task, stepper, stepper.pose(start), goal, guesses)
        # A guess that violates a user limit would lead the motion away from the permitted poses.
        settled = bool(task.user_limits) and goal.coordinates is None
        return replace(run, guesses=run.settled_guesses()) if settled else run

    def settled_guesses(self) -> Iterable[FloatArray]:
        """Return coordinates (p,) of poses at the goal, one for each guess that can be moved onto it within limits."""
        poses = (pose_at_goal(self.task, self.stepper, guess) for guess in self.task.guesses)
        return CachedItems(pose.v for pose in poses if pose is not None)

    def direct(self) -> Iterator[GuideCandidate]:
        """Yield the one candidate for a goal of the whole arm that needs no tip path; none for a goal of the tip."""
        whole_arm = self.goal.coordinates
        if whole_arm is not None:
            yield from islice(first_candidates(self.stepper, self.start, self.guesses, (), whole_arm), 1)

    def first(self) -> Iterator[GuideCandidate]:
        """Return the candidates that solve most problems, in the order given by the seed."""
        whole_arm = self.goal.coordinates
        return self._in_sampled_order(
            first_candidates(self.stepper, self.start, self.guesses, self.task.tip_paths, whole_arm)
        )

    def lies_in_gates(self) -> bool:
        """Return whether the arm passes through a narrow gate at the start."""
        return any(gate_entry(self.stepper, self.start, path) is not None for path in self.task.tip_paths)

    def further(self) -> Iterator[GuideCandidate]:
        """Return all other candidates, in the order given by the seed."""
        whole_arm = self.goal.coordinates
        return self._in_sampled_order(
            further_candidates(self.stepper, self.start, self.guesses, self.task.tip_paths, whole_arm)
        )

    def _in_sampled_order(self, candidates: Iterator[GuideCandidate]) -> Iterator[GuideCandidate]:
        """Return the candidates, some of them deferred at random according to the seed."""
        return sampled_order(candidates, self.task.seed, _PUT_OFF)

    def run(self, tried: Iterator[GuideCandidate], failures: list[Failure]) -> Motion | None:
        """Return the certified motion of the first candidate that reaches the goal; None if none does so in time.

        Args:
            tried: candidates, in the order of trial.
            failures: list to which failures are appended.
        """
        for candidate in tried:
            motion = self.attempt(candidate.name, partial(self._finished, candidate), failures)
            if motion is not None or self.task.deadline.passed():
                return motion
        return None

    def _finished(self, candidate: GuideCandidate) -> list[Pose]:
        return self.certified_without_pauses(self.arrived(self._led(candidate)))

    def certified_without_pauses(self, poses: list[Pose]) -> list[Pose]:
        """Return the poses of a certified motion through the given poses, without those close to their predecessors.

        Raises:
            Stalled: the motion cannot be certified.
        """
        # Dropping poses cuts corners a little: if the motion is then not certified, fewer are dropped.
        for pause in _PAUSES:
            fewer = without_pauses(poses, pause)
            if self._certified(fewer):
                return fewer
        mended = self._mended(poses)
        if mended is not None:
            return mended
        raise Stalled("the motion arrived but could not be certified", poses)

    def _mended(self, poses: list[Pose]) -> list[Pose] | None:
        """Return the poses of a motion through narrow gates, with further poses inserted where it is not certified.

        The inserted poses lie on the centre lines of the gates. The result is None if the motion cannot be certified,
        or if the task has no gates.
        """
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
        """Return the poses found along a candidate's guide, then along the first of its further guides that succeeds.

        Raises:
            Stalled: the last guide stalls.
        """
        guide = _made(candidate.make_guide, self.start)
        try:
            poses = follow(self.stepper, guide, self.start, self.task.deadline, into=self.goal)
        except Stalled as stalled:
            if not candidate.resume:
                raise
            # A guide that stalls may still have brought the arm near enough to the goal for the next guide.
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
        """Yield the pose that is the goal of the whole arm or, for a goal of the tip, poses at it near the guesses."""
        if self.goal.coordinates is not None:
            yield self.stepper.pose(self.goal.coordinates)
            return
        for guess in chain(self.task.guesses, self.task.further_guesses):
            pose = pose_at_goal(self.task, self.stepper, guess)
            if pose is not None:
                yield pose

    def tracked(self, found: Motion, failures: list[Failure]) -> Motion | None:
        """Return a motion that tracks a given one by steps that respect the limits; None if that fails.

        Args:
            found: motion to be tracked, found without some of the limits.
            failures: list to which a failure is appended.
        """
        name = f"{found.candidate}, tracked"
        reference = Reference.from_motion(found, self.stepper.space)
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
    """Return the guide that ``make`` constructs from a pose.

    Args:
        make: constructs the guide.
        pose: first pose of the guide.

    Raises:
        Stalled: there is no tip path from there. This does not prove that the problem has no solution, since the
            nearest free point to a tip in a wall's margin may lie in a pocket.
    """
    try:
        return make()
    except UnreachableGoal as apart:
        raise Stalled(apart.diagnosis.reason, [pose]) from apart


def stack_configurations(poses: list[Pose]) -> FloatArray:
    """Return the configurations of poses, shape (K, c)."""
    return np.array([pose.q for pose in poses])
