"""A plan in space that follows while its goal or an obstacle is dragged: found, timed and verified at every place."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import inf

from ccm_opt.core.arguments import finite_array
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.expected import expect, refusal
from ccm_opt.core.length_words import words_in
from ccm_opt.core.threads import on_one_thread
from ccm_opt.driver.live_plan import LiveAnswer
from ccm_opt.driver.settings import LIVE_IN_SPACE, LiveInSpaceSettings
from ccm_opt.driver.space_planning_run import timed_in_space
from ccm_opt.driver.verified_motion import failed_checks
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.errors import NoPlanFound, ProblemError, VerificationError
from ccm_opt.planning.pose_beginnings import any_motion
from ccm_opt.planning.space_ends import refuse_ends
from ccm_opt.planning.space_planner import SpacePlanner, joint_path
from ccm_opt.planning.space_settings import SpaceMotionSettings
from ccm_opt.planning.space_task import space_task
from ccm_opt.problem.space_problem import SpaceProblem, SpaceTipGoal
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.solution import Check, JointPath, JointStates, JointTrajectory
from ccm_opt.verification.space_verifier import verify_in_space


@dataclass(frozen=True)
class LiveMotion:
    """A verified motion in space.

    Attributes:
        problem: what it solves.
        trajectory: in time.
        joints: the same for the drives.
        checks: of the verifier; all hold.
    """

    problem: SpaceProblem
    trajectory: JointTrajectory
    joints: JointStates
    checks: tuple[Check, ...]


@dataclass
class LivePlanInSpace:
    """A verified plan of a problem in space whose goal and obstacles are dragged.

    Every change is answered by the first motion that is found, timed and verified like any other, which takes about a
    second; where an obstacle moves that the present motion keeps off as well as before, that motion is verified once
    more and kept. ``plan_anew`` plans with the NLP and the optimisation. Where there is none, the last one stays, and
    the answer says why.

    Attributes:
        problem: as it is now.
        live: how long changes may take.
        plan: the last verified motion.
        current: whether it is one for ``problem``.
        reason: why it is not; empty when it is.

    Raises:
        ProblemError: the problem cannot be planned live: it has goals on the way.
        NoPlanFound: there is no plan to begin with.
        VerificationError: the verifier refuses it.
    """

    problem: SpaceProblem
    live: LiveInSpaceSettings = LIVE_IN_SPACE
    plan: LiveMotion = field(init=False, repr=False)
    current: bool = field(init=False, default=True)
    reason: str = field(init=False, default="")

    def __post_init__(self) -> None:
        expect(self.problem, SpaceProblem, "a SpaceProblem", "problems in the plane are planned live by LivePlan")
        if not self.suits(self.problem):
            raise ProblemError(f"'{self.problem.name}' cannot be planned live: it has goals on the way")
        self._dynamics = InverseDynamics(self.problem.arm, self.problem.simulation.gravity)
        self._tree = SurfaceTree.of(self.problem.workspace.soup)
        self.plan = self._verified(self.problem, SpacePlanner().plan(self.problem))

    @staticmethod
    def suits(problem: SpaceProblem) -> bool:
        """Whether a problem can be planned live."""
        return not problem.stops and problem.joint_error == 0.0

    def move_goal(
        self, position: Sequence[float] | FloatArray | None = None, direction: FloatArray | None = None
    ) -> LiveAnswer:
        """Move the goal of the tip, and plan again.

        Args:
            position: of the tip, shape (3,) [m]; where it was when None.
            direction: of the last link, of any length but zero; as it was when None.

        Returns:
            Whether there is a plan to there, and else why not.

        Raises:
            ProblemError: the goal is one for the whole arm, or what is asked for is no place or direction.
        """
        goal = self.problem.goal
        if not isinstance(goal, SpaceTipGoal):
            raise ProblemError("a goal for the whole arm cannot be moved; only one for the tip can")
        place = goal.position if position is None else _vector(position, "a place (x, y, z) in metres")
        towards = goal.direction if direction is None else _unit(_vector(direction, "a direction (x, y, z)"))
        begin = time.process_time()
        self.problem = replace(self.problem, goal=replace(goal, position=place, direction=towards), source="")
        self._attempt(self.problem)
        return LiveAnswer(self.current, self.reason, time.process_time() - begin)

    def move_obstacle(self, name: str, by: Sequence[float] | FloatArray) -> LiveAnswer:
        """Move an obstacle, and plan again.

        Args:
            name: of the obstacle.
            by: how far, (x, y, z) [m].

        Returns:
            Whether there is a plan past it, and else why not. A plan that is not current may pass through it.

        Raises:
            ProblemError: there is no obstacle of that name, or it is no way to go.
        """
        expect(name, str, "the name of an obstacle")
        workspace = self.problem.workspace
        if name not in {obstacle.name for obstacle in workspace.obstacles}:
            known = ", ".join(obstacle.name for obstacle in workspace.obstacles)
            raise ProblemError(f"there is no obstacle '{name}'; there are {known or 'none'}")
        begin = time.process_time()
        moved = workspace.with_moved(name, _vector(by, "how far to move it, (x, y, z) in metres"))
        self._tree = SurfaceTree.of(moved.soup)  # first: what it refuses leaves all as it was
        self.problem = replace(self.problem, workspace=moved, source="")
        if not self._kept():
            self._attempt(self.problem)
        return LiveAnswer(self.current, self.reason, time.process_time() - begin)

    def plan_anew(self, time_limit: float | None = None) -> LiveAnswer:
        """Plan the problem as it is thoroughly; the shorter of two plans is kept.

        Args:
            time_limit: CPU time for it [s]; that of the problem when None.

        Returns:
            Whether there is a plan, and else why not.
        """
        begin = time.process_time()
        options = self.problem.planner
        limited = replace(options, time_limit=options.time_limit if time_limit is None else time_limit)
        followed = self.current
        plan = self.plan
        self._attempt(replace(self.problem, planner=limited), thorough=True)
        if followed and not (self.current and self.plan.trajectory.duration < plan.trajectory.duration):
            self.current = True
            self.reason = ""
            self.plan = plan
        return LiveAnswer(self.current, self.reason, time.process_time() - begin)

    @on_one_thread()
    def _attempt(self, problem: SpaceProblem, *, thorough: bool = False) -> None:
        """Plan a problem, or note why there is no plan."""
        try:
            with words_in(problem.length_unit):
                path = SpacePlanner().plan(problem) if thorough else self._found(problem)
                self.plan = self._verified(problem, path)
            self.current = True
            self.reason = ""
        except NoPlanFound as failure:
            self.current = False
            self.reason = failure.diagnosis.reason
        except ProblemError as refused:
            # An obstacle was put over the start: no fault of whoever asked, and no plan either.
            self.current = False
            self.reason = str(refused)
        except VerificationError as failure:
            self.current = False
            self.reason = "the verifier refuses the plan: " + "; ".join(failure.failures)

    @on_one_thread()
    def _kept(self) -> bool:
        """Whether the present motion solves the problem as it is now, with as much room; it is its plan then."""
        if not self.current or self.plan.problem.goal is not self.problem.goal:
            return False
        checks = verify_in_space(self.problem, self.plan.trajectory, self.plan.joints)
        wanted = self.problem.workspace.clearance + self.problem.wanted_gap
        # With less room than it had, or was wanted, there may be a better one.
        if failed_checks(checks) or _wall_gap(checks) < min(_wall_gap(self.plan.checks), wanted):
            return False
        self.plan = replace(self.plan, problem=self.problem, checks=checks)
        return True

    def _found(self, problem: SpaceProblem) -> JointPath:
        """The first motion that is found."""
        task = space_task(problem, self._tree, Deadline.after(self.live.patience), SpaceMotionSettings())
        refuse_ends(problem, task)
        return joint_path(task, any_motion(task))

    def _verified(self, problem: SpaceProblem, path: JointPath) -> LiveMotion:
        """The motion along a path, in time.

        Raises:
            NoPlanFound: it cannot be timed.
            VerificationError: the verifier refuses it.
        """
        trajectory = timed_in_space(problem, path, self._dynamics)
        joints = joint_states(problem.arm, trajectory, self._dynamics)
        checks = verify_in_space(problem, trajectory, joints)
        if failures := failed_checks(checks):
            raise VerificationError(failures)
        return LiveMotion(problem, trajectory, joints, checks)


def _vector(value: Sequence[float] | FloatArray, what: str) -> FloatArray:
    vector = finite_array(value)
    if vector is None or vector.shape != (3,):
        raise ProblemError(refusal(value, what))
    return vector


def _unit(vector: FloatArray) -> FloatArray:
    length = float((vector @ vector) ** 0.5)
    if length == 0.0:
        raise ProblemError("a direction must not be zero")
    return vector / length


def _wall_gap(checks: Sequence[Check]) -> float:
    """Least gap to walls [m]; inf where there are none."""
    return next((check.worst for check in checks if check.name == "wall clearance"), inf)
