"""Plans that are updated while a user drags the goal or an obstacle."""

import time
from collections.abc import Callable, Sequence
from dataclasses import InitVar, dataclass, field, replace
from itertools import pairwise
from math import inf
from typing import Any, Self

import numpy as np

from ccm_opt.core.arguments import expect, expect_that, expect_vector, is_number
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound, ProblemError, VerificationError
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.explain import refuse_closed, refuse_impossible
from ccm_opt.driver.arguments import compiled_terms, expect_arguments, refuse_without_effect
from ccm_opt.driver.legs import Leg, plan_legs
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.solution_assembly import described, draft_solution
from ccm_opt.driver.verified_plan import TermResults, VerifiedPlan, failed_checks, timed_and_verified, verified
from ccm_opt.dynamics.retiming.timing_settings import TimingSettings
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.motion import CurveMotion
from ccm_opt.planning.plane_in_space import needs_space
from ccm_opt.planning.planner import MotionPlanner, PlannedPath
from ccm_opt.planning.positioning import PositioningPlanner
from ccm_opt.planning.resuming import known_motion
from ccm_opt.planning.search import clearance_cost
from ccm_opt.planning.settings import CurvePlannerSettings
from ccm_opt.planning.tool_problem import problem_with_tool_links
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointPath, Solution
from ccm_opt.verification.verifier import verify

_PATIENCE = 0.6
"""CPU time limit for replanning a planar motion after a change [s]. Heuristic: a tolerable delay while dragging."""
_PATIENCE_IN_SPACE = 0.95
"""CPU time limit for replanning a motion in space after a change [s]. Derived: the search may use 0.8 of it, and
timing and verification take up to 0.2 s, so an answer comes within a second."""
_PATIENCE_ON_FEED = 3.0
"""CPU time limit for replanning a planar motion on a feed axis, which may have to be searched for [s]. Heuristic: twice
as long as an example problem takes."""
_REPORT_SHARE = 0.3
"""Largest excess of the least gap reported in space over the true one, as a fraction of the gap; all that is required
is proved as for ``solve``. Measured: the verifier takes 0.5 to 0.7 times as long, and the reported gaps of three jobs
grow by 0.01 to 0.1 %."""
_INTERVALS = 100
"""Number of intervals of the grid for timing motions in space. Measured on drags in an elbow and a row of blades: with
this, one interval a span, and the next number, timing takes half of the time; motions take up to 1.5 and 7 % longer."""
_NEGLIGIBLE = 1.02
"""Factor of slowing down up to which another round of timing is not worthwhile. Measured: see above."""
_STEP = 5e-3
"""Largest time between two samples of motions in space [s]. Derived: the largest that the format of plans allows, as
the verifier takes the longer the more samples there are."""
_FREE_ROUNDS = 4
"""Maximum number of optimisation steps before the final pose is fixed. Measured (``bench_live``): with four and three
steps, durations after 25 drags agree to 1 % with those of the nine and five steps of ``solve``, in four fifths of the
time."""
_END_ROUNDS = 3
"""Maximum number of optimisation steps with fixed final pose. Heuristic: the next change continues from the result."""


_SHORTENED_EVERY = 4
"""Number of changes after which motions in space are optimised again as far as time permits, twice as many after each
time that gains little. Heuristic: motions that are only adapted grow longer, and an optimisation takes as long as all
else. Measured in drags in a wing box: with it, motions last 0.68 to 1.30 times as long as those of ``solve``; without,
1.10 to 1.55 times."""

_UNSUPPORTED: dict[str, Callable[[Problem], object]] = {
    "goals in free order": lambda problem: problem.planner.order == "free",
    "surfaces to see": lambda problem: problem.coverage is not None,
    "a required joint error": lambda problem: problem.joint_error,
    "a planner other than nlp": lambda problem: problem.planner.method != "nlp",
    "a path to follow": lambda problem: any(stop.goal.path is not None for stop in problem.goals),
    "a place to look at": lambda problem: any(stop.goal.look_at is not None for stop in problem.goals),
}
"""What is not planned live, each with what tells whether a problem has it."""


def _dragging_settings(curve: CurvePlannerSettings) -> CurvePlannerSettings:
    """Return planner settings with few optimisation steps, for planar plans made during a drag."""
    optimisation = replace(curve.motion.optimisation, free_rounds=_FREE_ROUNDS, end_rounds=_END_ROUNDS)
    return replace(curve, motion=replace(curve.motion, optimisation=optimisation))


def _dragging_timing(timing: TimingSettings) -> TimingSettings:
    """Return settings of timing with a coarser grid, fewer rounds and fewer samples, for dragged plans in space."""
    grid = replace(timing.grid, intervals=_INTERVALS, intervals_a_span=1)
    profile = replace(timing.profile, negligible=_NEGLIGIBLE)
    return replace(timing, grid=grid, profile=profile, sampling=replace(timing.sampling, step=_STEP))


@dataclass
class _FollowingPlanner:
    """Planner of one plan, which adapts the motions of the last one.

    Attributes:
        planner: planner of motions, which takes few steps while a goal or obstacle is dragged.
        known: motions of the last plan, one for each path planned, in the plane in units of the arm.
        shortened: whether motions adapted in space are optimised again.
        made: the paths planned, with their motions.
    """

    planner: MotionPlanner
    known: tuple[CurveMotion[Any], ...]
    shortened: bool = False
    made: list[PlannedPath] = field(default_factory=list)

    def plan(self, problem: Problem) -> JointPath:
        """Return a certified path for a problem.

        Raises:
            ProblemError: the start is in contact.
            NoPlanFound: no path was found; the caller keeps the previous motion.
        """
        carried = PositioningPlanner(self.planner.stages, self.planner)
        planner = carried if problem.arm.carrier else self.planner
        planned = planner.replanned(problem, self.known, shortened=self.shortened)
        self.made.append(planned)
        return planned.path


@dataclass(frozen=True)
class LiveAnswer:
    """Result of a change of a live plan's goal or obstacles.

    Attributes:
        current: whether the plan solves the changed problem.
        reason: reason why the plan does not solve the changed problem; empty if it does.
        cpu: CPU time of replanning [s].
        same_route: whether the motion shown before was kept or adapted, or can be deformed into the new one; else the
            plan was made from scratch, and the arm may take another way round obstacles.
    """

    current: bool
    reason: str
    cpu: float
    same_route: bool = True


@dataclass
class LivePlan:
    """A verified plan that is updated whenever goal or obstacles of its problem move, for interactive tools.

    Every new plan is verified. It is made from the last motion, so that it keeps the route; only where that fails, a
    motion is searched for. If an obstacle in space moves and the present motion keeps its clearance, this motion is
    verified again and kept. If no plan is found within about a second a goal (in the plane on a feed axis, where every
    motion may be searched for, three), the last plan is kept, and the result says why::

        live = ccm_opt.LivePlan(ccm_opt.load_problem("problems/swan-neck.toml"))
        answer = live.move_goal(position=(0.44, 0.10))
        print(answer.current, answer.reason, live.plan.trajectory.duration)

    Attributes:
        problem: the problem with all changes so far.
        constraints: constraints of the user, as for ``solve``.
        costs: costs of the user, as for ``solve``.
        settings: settings of all stages of planning.
        plan: the last verified plan, without clearance, tolerance, simulation and metrics of how closely the arm
            follows the path of its tip, which ``finished`` adds. In space, its least gap to obstacles is reported to
            within a third.
        current: whether the plan solves ``problem``.
        reason: reason why the plan does not solve ``problem``; empty if it does.
        begun: first plan, see ``from_plan``; None to plan one.

    Raises:
        ProblemError: the problem is not supported: it has goals in free order, surfaces to see, a required joint error,
            another planner than "nlp", or a path or view as goal.
        NoPlanFound: no first plan was found, or the start is in contact.
        VerificationError: the verifier rejects the first plan.
    """

    problem: Problem
    constraints: Sequence[Constraint] = ()
    costs: Sequence[Cost] = ()
    settings: Settings = DEFAULT_SETTINGS
    plan: Solution = field(init=False, repr=False)
    current: bool = field(init=False, default=True)
    reason: str = field(init=False, default="")
    _verified: VerifiedPlan = field(init=False, repr=False)
    _known: tuple[CurveMotion[Any], ...] = field(init=False, repr=False, default=())
    _coarse: tuple[Leg, ...] = field(init=False, repr=False, default=())
    _settings: Settings = field(init=False, repr=False)
    _wait: int = field(init=False, repr=False, default=_SHORTENED_EVERY)
    _left: int = field(init=False, repr=False, default=_SHORTENED_EVERY)
    begun: InitVar[Solution | None] = None

    @classmethod
    def from_plan(cls, plan: Solution, settings: Settings = DEFAULT_SETTINGS) -> Self:
        """Return a live plan that begins with a given plan, for example one that was loaded, instead of planning.

        The plan is verified again. Its motion is continued when a goal or an obstacle moves.

        Args:
            plan: the plan, made without constraints and costs of the user, which a folder does not hold.
            settings: settings of all stages of planning.

        Raises:
            ProblemError: the plan's problem is not supported.
            VerificationError: the verifier rejects the plan.
        """
        expect(plan, Solution, "a ccm_opt.Solution", "ccm_opt.solve makes one and ccm_opt.load reads one")
        return cls(plan.problem, settings=settings, begun=plan)

    def __post_init__(self, begun: Solution | None) -> None:
        problem = self.problem
        Problem.expected(problem)
        refuse_without_effect(problem)
        expect_arguments(settings=self.settings)
        if found := [what for what, is_in in _UNSUPPORTED.items() if is_in(problem)]:
            raise ProblemError(
                f"'{problem.name}' cannot be planned live: it has {' and '.join(found)}; solve it anew after every "
                "change"
            )
        self._terms = compiled_terms(problem.arm, self.constraints, self.costs)
        self._settings = self.settings
        if problem.dimension == 3:
            coarse = replace(self.settings.verification, report_share=_REPORT_SHARE)
            self._settings = replace(self.settings, verification=coarse, timing=_dragging_timing(self.settings.timing))
        thorough = MotionPlanner(Stages(), self._terms, plane=self.settings.curve, space=self.settings.space)
        if problem.dimension == 2 and not needs_space(problem.arm):
            # In space, a proof that there is no way takes longer than is tolerable while dragging.
            thorough = replace(thorough, refuse=refuse_closed)
        self._thorough = thorough
        self._quick = replace(thorough, plane=_dragging_settings(self.settings.curve), first_found=True)
        with on_one_thread(), words_in(problem.length_unit):
            if begun is not None:
                self._begin_with(begun)
                return
            self._make(problem, thorough)

    def _begin_with(self, plan: Solution) -> None:
        """Make a given plan the current one, with its motion to each goal as known.

        Raises:
            VerificationError: the verifier rejects the plan.
        """
        checks = verified(plan.problem, plan.trajectory, plan.joints, self._settings.verification)
        self._keep(VerifiedPlan(plan.path, plan.trajectory, plan.joints, checks, TermResults()), Stages())
        ends = (0, *plan.trajectory.stops, len(plan.trajectory.time) - 1)
        legs = [plan.trajectory.positions[first : last + 1] for first, last in pairwise(ends) if last > first]
        self._known = tuple(known_motion(plan.problem.arm, leg) for leg in legs)

    @staticmethod
    def suits(problem: Problem) -> bool:
        """Return whether a problem is supported: see the errors of the class."""
        return not any(is_in(problem) for is_in in _UNSUPPORTED.values())

    def move_goal(
        self,
        position: Sequence[float] | FloatArray | None = None,
        direction: float | Sequence[float] | FloatArray | None = None,
        number: int | None = None,
    ) -> LiveAnswer:
        """Move a goal of the tip, replan the motion, and return whether the plan solves the changed problem.

        Args:
            position: new position of the tip, shape (2,) or (3,) [m]; None for no change.
            direction: new direction of the last link, a nonzero vector of shape (2,) or (3,), or in the plane a heading
                [rad]; None for no change.
            number: number of the goal, from 1; None for the last. Motions to the goals before it are kept.

        Returns:
            Whether a plan to the new goal was found, and if not, the reason.

        Raises:
            ProblemError: the goal gives the pose of the whole arm, or an argument is not a valid position, direction or
                number.
        """
        goals = self.problem.goals
        last = len(goals)
        known = number is None or (isinstance(number, int) and 1 <= number <= last)
        expect_that(lambda: known, number, f"the number of a goal, 1 to {last}" if last > 1 else "number=1 or None")
        index = (last if number is None else number) - 1
        goal = goals[index].goal.for_tip
        if goal is None:
            raise ProblemError("a whole-arm goal cannot be moved; give a goal for the tip")
        place = goal.position if position is None else self._vector(position, "a position {} in metres")
        moved = replace(goal, position=place)
        if direction is not None and self.problem.dimension == 2:
            moved = replace(moved, heading=self._heading(direction))
        elif direction is not None:
            moved = replace(moved, direction=self._unit(direction))
        if index == last - 1:
            return self._changed(replace(self.problem, goal=moved, source=""))
        stops = list(self.problem.stops)
        stops[index] = replace(stops[index], goal=moved)
        return self._changed(replace(self.problem, stops=tuple(stops), source=""))

    def move_obstacle(self, name: str, by: Sequence[float] | FloatArray) -> LiveAnswer:
        """Move an obstacle, replan the motion, and return whether the plan solves the changed problem.

        Args:
            name: name of the obstacle.
            by: displacement, shape (2,) or (3,) [m].

        Returns:
            Whether a plan was found, and if not, the reason. A plan that is not current may pass through the obstacle.

        Raises:
            ProblemError: no obstacle has this name, or the displacement is invalid.
        """
        workspace = self.problem.workspace
        expect(name, str, "the name of an obstacle")
        if name not in {obstacle.name for obstacle in workspace.obstacles}:
            known = ", ".join(obstacle.name for obstacle in workspace.obstacles)
            raise ProblemError(f"there is no obstacle '{name}'; there are {known or 'none'}")
        shift = self._vector(by, "a displacement, {} in metres")
        changed = replace(self.problem, workspace=workspace.with_moved(name, shift), source="")
        _ = changed.workspace.surface_tree  # raises before anything is changed
        return self._changed(changed)

    def plan_anew(self, time_limit: float | None = None) -> LiveAnswer:
        """Plan the present problem from scratch, and keep the old or the new plan, whichever costs less.

        Plans made during a drag stay in one homotopy class; planning from scratch may find a better motion. The cost of
        a plan is its duration, doubled if it keeps none of the preferred clearance.

        Args:
            time_limit: CPU time limit of planning [s]; None for that of the problem.

        Returns:
            Whether the plan kept solves the problem, and if not, the reason.
        """
        limited = time_limit is None or (is_number(time_limit) and time_limit > 0.0)
        expect_that(lambda: limited, time_limit, "a time limit above 0 [s]")
        begin = time.process_time()
        followed = self.current
        plan, before = self.plan, (self._verified, self._coarse, self._known)
        limit = self.problem.planner.time_limit if time_limit is None else time_limit
        self._attempt(limit, self._thorough)
        if followed and not (self.current and self._cost(self._verified) < self._cost(before[0])):
            self.current = True
            self.reason = ""
            self.plan = plan
            self._verified, self._coarse, self._known = before
        kept = self.plan is plan
        return LiveAnswer(self.current, self.reason, time.process_time() - begin, same_route=kept)

    def finished(self, progress: Callable[[Progress], None] | None = None) -> Solution:
        """Return the current plan with its clearance over time, tolerated errors, and simulation.

        A plan in space that was made during a drag, where timing is coarse, is timed as by ``solve``.

        Args:
            progress: function called when a stage starts.
        """
        expect_arguments(progress=progress)
        problem, plan = self.plan.problem, self._verified
        stages = Stages(progress)
        if self._settings is not self.settings:
            with on_one_thread(), words_in(problem.length_unit):
                plan = self._timed_finely(stages) or plan
            if plan is self._verified:
                checks = verified(problem, plan.trajectory, plan.joints, self.settings.verification)
                plan = replace(plan, checks=checks)
        return described(problem, plan, stages, self.settings)

    def _timed_finely(self, stages: Stages) -> VerifiedPlan | None:
        """Return the current plan timed as by ``solve`` if it was timed coarsely and is then faster; else None."""
        if not self._coarse:
            return None
        try:
            fine = timed_and_verified(self.plan.problem, self._coarse, stages, None, self._terms, self.settings)
        except (NoPlanFound, VerificationError):
            return None
        return fine if fine.trajectory.duration < self._verified.trajectory.duration else None

    def _changed(self, problem: Problem) -> LiveAnswer:
        """Replan a changed problem and return the result; if no plan is found, the last plan is kept."""
        begin = time.process_time()
        self.problem = problem
        if self._kept():
            return LiveAnswer(current=True, reason="", cpu=time.process_time() - begin)
        in_space = problem.dimension == 3 or needs_space(problem.arm)
        patience = _PATIENCE_IN_SPACE if in_space else _PATIENCE_ON_FEED if problem.arm.base_axes else _PATIENCE
        same_route = self._attempt(patience * len(problem.goals), self._quick, self._known)
        return LiveAnswer(self.current, self.reason, time.process_time() - begin, same_route or not self.current)

    def _attempt(self, limit: float, planner: MotionPlanner, known: tuple[CurveMotion[Any], ...] = ()) -> bool:
        """Plan the present problem and keep the plan, or record the reason why no plan was found.

        Args:
            limit: CPU time limit of planning [s].
            planner: planner of motions.
            known: motions that are adapted where possible.

        Returns:
            Whether a plan was found whose motions were all adapted.
        """
        problem = replace(self.problem, planner=replace(self.problem.planner, time_limit=limit))
        try:
            with on_one_thread(), words_in(problem.length_unit):
                return self._make(problem, planner, known)
        except NoPlanFound as failure:
            self.reason = failure.diagnosis.reason
        except ProblemError as refused:
            # An obstacle was dragged over the start: there is no plan, but the call was valid.
            self.reason = str(refused)
        except VerificationError as failure:
            self.reason = "the verifier rejects the plan: " + "; ".join(failure.failures)
        self.current = False
        return False

    def _make(self, problem: Problem, planner: MotionPlanner, known: tuple[CurveMotion[Any], ...] = ()) -> bool:
        """Plan, time and verify a problem, make the result the current plan, and return whether it was adapted.

        Raises:
            ProblemError: the start is in contact.
            NoPlanFound: no plan was found.
            VerificationError: the verifier rejects the plan.
        """
        stages = Stages()
        refuse_impossible(problem_with_tool_links(problem, weighed=True))
        self._left = self._left - 1 if self._left > 0 else self._wait
        following = _FollowingPlanner(planner, known, shortened=self._left == 0)
        legs = plan_legs(problem, following)
        if following.shortened:
            gained = any(planned.shortened for planned in following.made)
            self._wait = _SHORTENED_EVERY if gained else 2 * self._wait
        settings = self._settings if planner is self._quick else self.settings
        self._keep(timed_and_verified(problem, legs, stages, None, self._terms, settings), stages)
        self._coarse = () if settings is self.settings else tuple(legs)
        self._known = tuple(planned.motion for planned in following.made)
        return all(planned.resumed for planned in following.made)

    @on_one_thread()
    def _kept(self) -> bool:
        """Keep the present motion in space if it solves the changed problem with enough clearance; return whether.

        Enough is the preferred clearance or, if less, the clearance that the motion had before the change.
        """
        if not (self.problem.dimension == 3 and self.current):
            return False
        before = self.plan.problem
        if before.goal is not self.problem.goal or before.stops is not self.problem.stops:
            return False
        checks = verify(self.problem, self._verified.trajectory, self._verified.joints, self._settings.verification)
        wanted = self.problem.workspace.clearance + self.problem.wanted_gap
        # With less clearance than before and than wanted, another plan may be better.
        if failed_checks(checks) or _wall_gap(checks) < min(_wall_gap(self._verified.checks), wanted):
            return False
        self._keep(replace(self._verified, checks=checks), Stages())
        return True

    def _cost(self, verified: VerifiedPlan) -> float:
        """Return the cost of a plan by its duration and the clearance that it lacks [s]; see ``clearance_cost``."""
        wanted = self.problem.wanted_gap
        lacking = self.problem.workspace.clearance + wanted - _wall_gap(verified.checks)
        return clearance_cost(verified.trajectory.duration, lacking / wanted if wanted > 0.0 else 0.0)

    def _keep(self, verified: VerifiedPlan, stages: Stages) -> None:
        """Make a verified plan the current plan of the present problem."""
        self._verified = verified
        self.plan = draft_solution(self.problem, verified, stages, following=False)
        self.current = True
        self.reason = ""

    def _vector(self, value: object, what: str) -> FloatArray:
        """Return a user's value as a vector of the problem's dimension d = 2 or 3, shape (d,).

        Args:
            value: the value.
            what: what is expected, with ``{}`` for the coordinates, for the message.

        Raises:
            ProblemError: the value is not a vector of this shape.
        """
        size = self.problem.dimension
        return expect_vector(value, size, what.format("(x, y)" if size == 2 else "(x, y, z)"))

    def _unit(self, value: object) -> FloatArray:
        vector = self._vector(value, "a direction {}")
        length = float(np.linalg.norm(vector))
        if length == 0.0:
            raise ProblemError("a direction must be nonzero")
        return vector / length

    def _heading(self, value: object) -> float:
        if is_number(value):
            return float(value)
        expect_that(lambda: not np.isscalar(value), value, "a heading [rad], or a direction (x, y)")
        x, y = self._unit(value)
        return float(np.arctan2(y, x))


def _wall_gap(checks: Sequence[Check]) -> float:
    """Return the minimum distance to obstacles according to verifier's checks [m]; inf without obstacles."""
    return next((each.worst for each in checks if each.name == "wall clearance"), inf)
