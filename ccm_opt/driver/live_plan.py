"""Plans that are updated while a user drags the goal or an obstacle."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from ccm_opt.core.arguments import expect, expect_that, finite_array, is_number, refusal
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound, ProblemError, VerificationError
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.explain import refuse_closed, refuse_impossible
from ccm_opt.driver.arguments import compiled_terms, expect_arguments, refuse_without_effect
from ccm_opt.driver.legs import plan_legs
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.solution_assembly import described, draft_solution
from ccm_opt.driver.verified_plan import VerifiedPlan, failed_checks, timed_and_verified
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.own_units import planning_units
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.settings import CurvePlannerSettings
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointPath, Solution
from ccm_opt.problem.tool_rules import refuse_tool
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.verification.verifier import verify

_PATIENCE = 0.6
"""CPU time limit for replanning a planar motion after a change [s]. Heuristic: a tolerable delay while dragging."""
_PATIENCE_IN_SPACE = 1.25
"""CPU time limit for replanning a motion in space after a change, without timing and verification [s]. Heuristic: three
times as long as an example problem takes."""
_FREE_ROUNDS = 4
"""Maximum number of optimisation steps before the final pose is fixed. Measured (``bench_live``): with four and three
steps, durations after 25 drags agree to 1 % with those of the nine and five steps of ``solve``, in four fifths of the
time."""
_END_ROUNDS = 3
"""Maximum number of optimisation steps with fixed final pose. Heuristic: the next change continues from the result."""


def _dragging_settings(curve: CurvePlannerSettings) -> CurvePlannerSettings:
    """Return planner settings with few optimisation steps, for planar plans made during a drag."""
    optimisation = replace(curve.motion.optimisation, free_rounds=_FREE_ROUNDS, end_rounds=_END_ROUNDS)
    return replace(curve, motion=replace(curve.motion, optimisation=optimisation))


@dataclass
class _FollowingPlanner:
    """Planner for use during a drag, which continues planar motions and takes the first motion found in space.

    Attributes:
        thorough: planner used for plans from scratch.
        quick: planner used while a goal or obstacle is dragged.
        known: the last planar motion; None before the first.
        dragging: whether a goal or obstacle is being dragged.
    """

    thorough: MotionPlanner
    quick: MotionPlanner
    known: Motion | None = None
    dragging: bool = False

    def plan(self, problem: Problem) -> JointPath:
        """Return a certified path for a problem.

        Raises:
            ProblemError: the start is in contact.
            NoPlanFound: no path was found; the caller keeps the previous motion.
        """
        planner = self.quick if self.dragging else self.thorough
        if problem.dimension == 3:
            return planner.plan(problem)
        with planning_units(problem) as units:
            path, self.known = planner.planned(units.scaled(problem), self.known)
        return units.path_in_metres(path, problem.arm)


@dataclass(frozen=True)
class LiveAnswer:
    """Result of a change of a live plan's goal or obstacles.

    Attributes:
        current: whether the plan solves the changed problem.
        reason: reason why the plan does not solve the changed problem; empty if it does.
        cpu: CPU time of replanning [s].
    """

    current: bool
    reason: str
    cpu: float


@dataclass
class LivePlan:
    """A verified plan that is updated whenever goal or obstacles of its problem move, for interactive tools.

    Every new plan is verified. In the plane it continues from the last motion; in space it is the first motion found.
    If an obstacle in space moves and the present motion keeps its clearance, this motion is verified again and kept. If
    no plan is found within about a second, the last plan is kept, and the result says why::

        live = ccm_opt.LivePlan(ccm_opt.load_problem("problems/swan-neck.toml"))
        answer = live.move_goal(position=(0.44, 0.10))
        print(answer.current, answer.reason, live.plan.trajectory.duration)

    Attributes:
        problem: the problem with all changes so far.
        constraints: constraints of the user, as for ``solve``.
        costs: costs of the user, as for ``solve``.
        settings: settings of all stages of planning.
        plan: the last verified plan, without clearance, tolerance and simulation, which ``finished`` adds.
        current: whether the plan solves ``problem``.
        reason: reason why the plan does not solve ``problem``; empty if it does.

    Raises:
        ProblemError: the problem is not supported: it has intermediate goals, a required joint error, another planner
            than "nlp", or a planar arm with a feed axis.
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
    _planner: _FollowingPlanner = field(init=False, repr=False)
    _verified: VerifiedPlan = field(init=False, repr=False)

    def __post_init__(self) -> None:
        problem = self.problem
        Problem.expected(problem)
        refuse_tool(problem.arm, "live planning")
        refuse_without_effect(problem)
        expect_arguments(settings=self.settings)
        if not self.suits(problem):
            raise ProblemError(
                f"'{problem.name}' cannot be planned live: it has several goals, a required joint error, a planner "
                "other than nlp, a place to look at, sections that bend evenly, base axes, or in the plane a feed "
                "axis; solve it anew after every change"
            )
        self._terms = compiled_terms(problem.arm, self.constraints, self.costs)
        thorough = MotionPlanner(Stages(), self._terms, plane=self.settings.curve, space=self.settings.space)
        if problem.dimension == 2:
            # In space, a proof that there is no way takes longer than is tolerable while dragging.
            thorough = replace(thorough, refuse=refuse_closed)
        self._planner = _FollowingPlanner(
            thorough, replace(thorough, plane=_dragging_settings(self.settings.curve), first_found=True)
        )
        with on_one_thread(), words_in(problem.length_unit):
            refuse_impossible(problem)
            self._make(problem)

    @staticmethod
    def suits(problem: Problem) -> bool:
        """Return whether a problem is supported: no stops, joint error, path, view, planar feed or even sections."""
        fed = bool(problem.arm.base_axes) and problem.dimension == 2
        arm = problem.arm
        plain = not (fed or arm.sections or arm.carrier or problem.stops or problem.joint_error)
        plain = plain and problem.goal.path is None and problem.goal.look_at is None
        return plain and problem.planner.method == "nlp"

    def move_goal(
        self,
        position: Sequence[float] | FloatArray | None = None,
        direction: float | Sequence[float] | FloatArray | None = None,
    ) -> LiveAnswer:
        """Move the goal of the tip, replan the motion, and return whether the plan solves the changed problem.

        Args:
            position: new position of the tip, shape (2,) or (3,) [m]; None for no change.
            direction: new direction of the last link, a nonzero vector of shape (2,) or (3,), or in the plane a heading
                [rad]; None for no change.

        Returns:
            Whether a plan to the new goal was found, and if not, the reason.

        Raises:
            ProblemError: the goal gives the pose of the whole arm, or an argument is not a valid position or direction.
        """
        goal = self.problem.goal.for_tip
        if goal is None:
            raise ProblemError("a whole-arm goal cannot be moved; give a goal for the tip")
        place = goal.position if position is None else self._vector(position, "a position {} in metres")
        moved = replace(goal, position=place)
        if direction is not None and self.problem.dimension == 2:
            moved = replace(moved, heading=self._heading(direction))
        elif direction is not None:
            moved = replace(moved, direction=self._unit(direction))
        return self._changed(replace(self.problem, goal=moved, source=""))

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
        SurfaceTree.from_triangles(changed.workspace.triangle_soup)  # raises before anything is changed
        return self._changed(changed)

    def plan_anew(self, time_limit: float | None = None) -> LiveAnswer:
        """Plan the present problem from scratch, and keep the old or the new plan, whichever takes less time.

        Plans made during a drag stay in one homotopy class; planning from scratch may find a shorter motion.

        Args:
            time_limit: CPU time limit of planning [s]; None for that of the problem.

        Returns:
            Whether the plan kept solves the problem, and if not, the reason.
        """
        limited = time_limit is None or (is_number(time_limit) and time_limit > 0.0)
        expect_that(lambda: limited, time_limit, "a time limit above 0 [s]")
        begin = time.process_time()
        followed = self.current
        plan = self.plan
        verified = self._verified
        planner = self._planner
        self._planner = replace(planner, known=None, dragging=False)
        self._attempt(self._within(self.problem.planner.time_limit if time_limit is None else time_limit))
        shorter = self.current and self.plan.trajectory.duration < plan.trajectory.duration
        if followed and not shorter:
            self.current = True
            self.reason = ""
            self.plan = plan
            self._verified = verified
            self._planner = planner
        elif not self.current:
            self._planner = planner
        return LiveAnswer(self.current, self.reason, time.process_time() - begin)

    def finished(self, progress: Callable[[Progress], None] | None = None) -> Solution:
        """Return the current plan with its clearance over time, tolerated errors, and simulation.

        Args:
            progress: function called when a stage starts.
        """
        expect_arguments(progress=progress)
        return described(self.plan.problem, self._verified, Stages(progress), self.settings)

    def _changed(self, problem: Problem) -> LiveAnswer:
        """Replan a changed problem and return the result; if no plan is found, the last plan is kept."""
        begin = time.process_time()
        self.problem = problem
        self._planner.dragging = True
        if not self._kept():
            in_space = problem.dimension == 3
            self._attempt(self._within(_PATIENCE_IN_SPACE if in_space else _PATIENCE))
        return LiveAnswer(self.current, self.reason, time.process_time() - begin)

    def _within(self, time_limit: float) -> Problem:
        """Return the present problem with another CPU time limit of planning [s]."""
        return replace(self.problem, planner=replace(self.problem.planner, time_limit=time_limit))

    def _attempt(self, problem: Problem) -> None:
        """Plan a problem and keep the plan, or record the reason why no plan was found."""
        try:
            with on_one_thread(), words_in(problem.length_unit):
                refuse_impossible(problem)
                self._make(problem)
        except NoPlanFound as failure:
            self.current = False
            self.reason = failure.diagnosis.reason
        except ProblemError as refused:
            # An obstacle was dragged over the start: there is no plan, but the call was valid.
            self.current = False
            self.reason = str(refused)
        except VerificationError as failure:
            self.current = False
            self.reason = "the verifier rejects the plan: " + "; ".join(failure.failures)

    def _make(self, problem: Problem) -> None:
        """Plan, time and verify a problem, and make the result the current plan.

        Raises:
            ProblemError: the start is in contact.
            NoPlanFound: no plan was found.
            VerificationError: the verifier rejects the plan.
        """
        stages = Stages()
        legs = plan_legs(problem, self._planner)
        self._keep(timed_and_verified(problem, legs, stages, None, self._terms, self.settings), stages)

    @on_one_thread()
    def _kept(self) -> bool:
        """Keep the present motion in space if it solves the changed problem with enough clearance; return whether.

        Enough is the preferred clearance or, if less, the clearance that the motion had before the change.
        """
        if not (self.problem.dimension == 3 and self.current):
            return False
        if self.plan.problem.goal is not self.problem.goal:
            return False
        checks = verify(self.problem, self._verified.trajectory, self._verified.joints, self.settings.verification)
        wanted = self.problem.workspace.clearance + self.problem.wanted_gap
        # With less clearance than before and than wanted, another plan may be better.
        if failed_checks(checks) or _wall_gap(checks) < min(_wall_gap(self._verified.checks), wanted):
            return False
        self._keep(replace(self._verified, checks=checks), Stages())
        return True

    def _keep(self, verified: VerifiedPlan, stages: Stages) -> None:
        """Make a verified plan the current plan of the present problem."""
        self._verified = verified
        self.plan = draft_solution(self.problem, verified, stages)
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
        vector = finite_array(value)
        size = self.problem.dimension
        if vector is None or vector.shape != (size,):
            raise ProblemError(refusal(value, what.format("(x, y)" if size == 2 else "(x, y, z)")))
        return vector

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
