"""The planning of a problem in space, leg by leg."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ccm_opt import retiming
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.explain import refuse_closed_in_space, refuse_impossible_in_space
from ccm_opt.diagnosis.relaxation import RecordingPlanner
from ccm_opt.driver.settings import DEFAULT_IN_SPACE, DEFAULT_SPACE_LOOKS, SpaceLookSettings, SpaceSettings
from ccm_opt.driver.user_terms import compiled_terms, named_terms
from ccm_opt.driver.verified_motion import (
    TermResults,
    VerifiedPlan,
    failed_checks,
    results_of_terms,
    with_hair,
    worst_of_legs,
)
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.errors import Diagnosis, MotionNotFound, NoPlanFound, ProblemError, RetimingError, VerificationError
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.following.leader import feed_limits
from ccm_opt.planning.legs import end_to_end
from ccm_opt.planning.space_ends import GapsAtSamples
from ccm_opt.planning.space_planner import SpacePlanner
from ccm_opt.problem.space_problem import SpaceGoal, SpaceJointPose, SpaceProblem
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.robot.space_arm import joint_positions
from ccm_opt.solution import JointPath, JointTrajectory, NearPlace, RoomRecord
from ccm_opt.verification.space_verifier import verify_in_space

if TYPE_CHECKING:
    from ccm_opt.ik.compiled_terms import UserTerms

_BEYOND_WANTED = 1.5
"""How far the room is looked at, in wanted gaps; a link at least. Taste: the chart's height."""

_SAME = 1e-9
"""Difference of coordinates up to which two configurations are the same [rad, m]: rounding of the file's numbers."""


def way_back(legs: Sequence[tuple[SpaceProblem, JointPath]], goal: SpaceGoal) -> JointPath | None:
    """The paths of the last legs backwards, to where the latest of them that fits began.

    Args:
        legs: that are planned, each with its problem.
        goal: what comes next.

    Returns:
        None where the goal is not a pose in which a leg began.
    """
    if not isinstance(goal, SpaceJointPose):
        return None
    back: list[JointPath] = []
    for leg, path in reversed(legs):
        back.append(path.reversed())
        end = leg.start.configuration(leg.arm)
        if np.max(np.abs(end - goal.configuration(leg.arm))) < _SAME:
            return end_to_end(back)
    return None


class RetimerInSpace(Protocol):
    """Lays time along a joint path of an arm in space."""

    def retime(self, problem: SpaceProblem, path: JointPath) -> JointTrajectory:
        """Time a path from rest to rest within ``problem.limits``; what it returns is verified.

        Raises:
            RetimingError: with a diagnosis, when there is no timing within the limits.
        """
        ...


class PlannerInSpace(Protocol):
    """Finds a certified joint path for a problem in space."""

    def plan(self, problem: SpaceProblem) -> JointPath:
        """Plan a motion to the problem's only goal.

        Raises:
            NoPlanFound: with a diagnosis, when there is none within the limits.
        """
        ...


@dataclass(frozen=True)
class SpacePlanningRun:
    """What stays the same however often a problem in space is planned.

    Attributes:
        problem: as it was asked.
        planner: given by the caller, or None for the package's own.
        retimer: likewise, or None for the timing that the problem names.
        constraints: of the user.
        costs: of the user.
        stages: names and times the stages.
        settings: of all stages.
        recorded: the paths that were found last, for those who ask what change would help.
    """

    problem: SpaceProblem
    planner: PlannerInSpace | None
    retimer: RetimerInSpace | None
    constraints: Sequence[Constraint]
    costs: Sequence[Cost]
    stages: Stages
    settings: SpaceSettings
    recorded: list[tuple[SpaceProblem, JointPath]] = field(default_factory=list)

    def planned(self, problem: SpaceProblem, lowered: "UserTerms | None") -> VerifiedPlan:
        """Legs, one to each goal, then their timing, and the verification of all as one motion.

        Args:
            problem: the problem with the time that is left.
            lowered: the user's terms with the share of the costs that is tried.

        Raises:
            NoPlanFound: there is none within the limits.
            VerificationError: the verifier refuses it.
        """
        own = SpacePlanner(self.stages, terms=lowered, refuse=refuse_closed_in_space)
        chosen = RecordingPlanner(self.planner or own)
        terms = compiled_terms(problem.arm, self.constraints, self.costs)
        try:
            legs = plan_legs_in_space(problem, chosen, retrace=terms is None)
            return self._of_legs(problem, legs, terms, self.stages)
        finally:
            self.recorded[:] = chosen.paths

    def explained(self, failure: NoPlanFound, deadline: Deadline, *, changes: bool) -> NoPlanFound:
        """Return a failure of the same kind, with its causes and the changes that would help.

        Args:
            failure: why there is no plan; told at once.
            deadline: until which changes are tried.
            changes: whether they are tried at all; without them nothing is told that is not proved.
        """
        self.stages.tell_known(failure.diagnosis)
        from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS  # noqa: PLC0415 - as below
        from ccm_opt.diagnosis.explain import explained, with_proof  # noqa: PLC0415 - most problems have a plan
        from ccm_opt.diagnosis.in_space import IN_SPACE  # noqa: PLC0415
        from ccm_opt.diagnosis.relaxation import Trials  # noqa: PLC0415

        if not changes:
            return with_proof(self.problem, failure, IN_SPACE)
        droppable = named_terms(str(failure), self.constraints, self.costs)
        settings = self.settings.trials or DEFAULT_DIAGNOSIS.space_trials
        trials = Trials(
            self._solve_changed,
            deadline.within(settings.longest_search),
            droppable,
            self._solve_changed,
            self._held_again,
            _ended,
            settings=settings,
        )
        return explained(self.problem, failure, trials, IN_SPACE, self.stages)

    def _solve_changed(self, changed: SpaceProblem, dropped: str = "") -> VerifiedPlan:
        """Plan, time and verify a problem that differs in one thing; paths found already are taken over."""
        refuse_impossible_in_space(changed)
        # Trials report no progress of their own.
        quiet = Stages()
        kept = [each for each in self.constraints if each.name != dropped]
        its_terms = compiled_terms(changed.arm, kept, [each for each in self.costs if each.name != dropped])
        own = SpacePlanner(quiet, terms=its_terms, refuse=refuse_closed_in_space)
        recording = RecordingPlanner(self.planner or own, self.recorded)
        legs = plan_legs_in_space(changed, recording, retrace=its_terms is None)
        return self._of_legs(changed, legs, its_terms, quiet)

    def _held_again(self, changed: SpaceProblem, plan: object) -> VerifiedPlan:
        """Time and verify the path of one plan for a problem that differs in one number; nothing is searched.

        Raises:
            ProblemError: the plan is none of one leg.
            NoPlanFound: the path cannot be timed.
            VerificationError: the path is none for this problem.
        """
        if not isinstance(plan, VerifiedPlan) or changed.stops:
            raise ProblemError("only the path of a plan with one leg can be held against another problem")
        its_terms = compiled_terms(changed.arm, self.constraints, self.costs)
        # What it was certified to keep for the other problem says nothing here.
        leg = (changed, replace(plan.path, spare=0.0))
        return self._of_legs(changed, (leg,), its_terms, Stages())

    def _of_legs(
        self,
        problem: SpaceProblem,
        legs: Sequence[tuple[SpaceProblem, JointPath]],
        terms: "UserTerms | None",
        stages: Stages,
    ) -> VerifiedPlan:
        """The legs timed, and verified as one motion."""
        with stages("dynamics model"):
            dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
        with stages("retiming"):
            timed = [self._timed(leg, path, dynamics) for leg, path in legs]
            trajectory = retiming.joined(timed, [stop.pause for stop in problem.stops]) if len(timed) > 1 else timed[0]
            joints = joint_states(problem.arm, trajectory, dynamics)
        with stages("verification"):
            checks = verify_in_space(problem, trajectory, joints)
            if failures := failed_checks(checks):
                raise VerificationError(failures)
            of_terms = self._results_of_terms(legs, timed, terms)
        path = end_to_end([path for _, path in legs])
        return VerifiedPlan(path, trajectory, joints, checks, of_terms)

    def _timed(self, leg: SpaceProblem, path: JointPath, dynamics: InverseDynamics) -> JointTrajectory:
        """A leg's motion; where its path has corners, as one back over several legs has, it rests in them."""
        timed = [
            self.retimer.retime(leg, part)
            if self.retimer is not None
            else timed_in_space(leg, part, dynamics, self.settings)
            for part in path.parts or (path,)
        ]
        # The stops of a motion are the goals on its way, which corners are not.
        return replace(retiming.joined(timed), stops=()) if len(timed) > 1 else timed[0]

    def _results_of_terms(
        self,
        legs: Sequence[tuple[SpaceProblem, JointPath]],
        timed: Sequence[JointTrajectory],
        terms: "UserTerms | None",
    ) -> TermResults:
        """What the motion makes of the user's terms, every leg by itself.

        Raises:
            MotionNotFound: a constraint is not kept.
        """
        found = [
            results_of_terms(terms, leg.arm, path, trajectory, self.settings.user_terms)
            for (leg, path), trajectory in zip(legs, timed, strict=True)
        ]
        whole = worst_of_legs(found) if len(found) > 1 else found[0]
        if broken := failed_checks(whole.checks):
            reason = f"the motion that was found does not keep every constraint; the first that fails: {broken[0]}"
            advice = ("widen the constraint, or make it soft", "move the goal")
            raise MotionNotFound(Diagnosis(reason, "constraints", advice, {"failures": broken}))
        return whole


def _ended(plan: object) -> FloatArray:
    """The configuration in which a plan ends, shape (c,) [rad, m]."""
    if not isinstance(plan, VerifiedPlan):
        raise ProblemError(f"{type(plan).__name__} is no plan")
    return np.asarray(plan.trajectory.positions[-1])


def plan_legs_in_space(
    problem: SpaceProblem, planner: PlannerInSpace, *, retrace: bool = True
) -> list[tuple[SpaceProblem, JointPath]]:
    """The way to every goal in turn, each from where the one before ends.

    Args:
        problem: what to plan.
        planner: of single legs.
        retrace: whether an arm that goes back to a pose from which a leg began may take the same way.

    Raises:
        NoPlanFound: naming the goal that is not reached.
    """
    deadline = Deadline.after(problem.planner.time_limit)
    start = problem.start
    legs: list[tuple[SpaceProblem, JointPath]] = []
    for number, stop in enumerate(problem.goals, start=1):
        options = replace(problem.planner, time_limit=max(deadline.left, 0.5)) if legs else problem.planner
        leg = replace(problem, start=start, goal=stop.goal, tolerances=stop.tolerances, stops=(), planner=options)
        try:
            path = (way_back(legs, stop.goal) if retrace else None) or planner.plan(leg)
        except NoPlanFound as error:
            if not problem.stops:
                raise
            found = error.diagnosis
            reason = f"goal {number} of {len(problem.goals)}: {found.reason}"
            raise type(error)(replace(found, reason=reason, evidence={**found.evidence, "goal": number})) from error
        legs.append((leg, path))
        start = SpaceJointPose.from_configuration(path.spline(1.0), problem.arm.links)
    return legs


def timed_in_space(
    problem: SpaceProblem, path: JointPath, dynamics: InverseDynamics, settings: SpaceSettings = DEFAULT_IN_SPACE
) -> JointTrajectory:
    """The motion along a path by the problem's method of timing.

    Raises:
        RetimingError: there is none within the limits.
    """
    arm = problem.arm
    timings = retiming.timings(
        path,
        feed_limits(arm, problem.limits, settings.following),
        dynamics,
        revolutes=partial(revolute_angles, arm),
        method=problem.planner.retiming,
        link_length=arm.link_length,
        coordinates=arm.coordinates,
        arm=arm,
        share=problem.planner.effort_share,
        settings=with_hair(settings.timing, 0.5 * problem.contact_tolerance),
        paul=settings.transitions,
    )
    for trajectory in timings:
        # The fastest of Paul's transitions leave the path farther than it is certified to spare.
        if problem.planner.retiming == "toppra" or _passes(problem, trajectory, dynamics):
            return trajectory
    reason = "even with its narrowest turns a motion of legs and turns does not pass the verifier"
    raise RetimingError(Diagnosis(reason, "retiming", ('use planner.retiming = "toppra", which stays on the path',)))


def _passes(problem: SpaceProblem, trajectory: JointTrajectory, dynamics: InverseDynamics) -> bool:
    checks = verify_in_space(problem, trajectory, joint_states(problem.arm, trajectory, dynamics))
    return not failed_checks(checks)


def room_in_space(
    problem: SpaceProblem, trajectory: JointTrajectory, settings: SpaceLookSettings = DEFAULT_SPACE_LOOKS
) -> RoomRecord:
    """The record of the room that a verified motion keeps.

    Args:
        problem: what was asked.
        trajectory: the motion.
        settings: at how many samples is looked, and how far.
    """
    rests = [0, *trajectory.stops, len(trajectory.time) - 1]
    even = np.linspace(0, len(trajectory.time) - 1, min(settings.looks, len(trajectory.time))).round().astype(np.intp)
    samples = np.union1d(even, rests)
    points = joint_positions(problem.arm, trajectory.positions[samples])
    # Far enough that the wanted gap, or the usual one, can be told from more.
    wanted = max(problem.wanted_gap, problem.default_gap)
    reach = max(problem.arm.link_length, _BEYOND_WANTED * wanted) + problem.workspace.clearance
    gaps = GapsAtSamples.of(problem, points, reach)
    walls = gaps.walls.gap - problem.workspace.clearance
    itself = gaps.itself.gap

    def place(sample: int) -> NearPlace:
        near_wall = bool(walls[sample] <= itself[sample])
        near = gaps.walls if near_wall else gaps.itself
        link = int(near.link[sample])
        gap = float(min(walls[sample], itself[sample]))
        other = int(near.other[sample])
        obstacle = gaps.names[other] if near_wall and link else ""
        second = 0 if near_wall or not link else other
        return NearPlace(gap, problem.wanted_gap, float(trajectory.time[samples[sample]]), link, obstacle, second)

    ends = tuple(place(int(np.searchsorted(samples, rest))) for rest in rests)
    nearest = place(int(np.argmin(np.minimum(walls, itself))))
    time = trajectory.time[samples]
    return RoomRecord(time, problem.wanted_gap, problem.workspace.clearance, walls, itself, reach, nearest, ends)
