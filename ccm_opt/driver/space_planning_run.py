"""The planning of a problem in space, as often as it is asked for, and what is said of its plan."""

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt import retiming
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.explain import refuse_closed_in_space, refuse_impossible_in_space
from ccm_opt.driver.attempts import surviving_errors_in_space
from ccm_opt.driver.kept_plan import versions
from ccm_opt.driver.metrics import space_figures_of_motion
from ccm_opt.driver.pipeline import plan_legs
from ccm_opt.driver.settings import DEFAULT_SETTINGS, DEFAULT_SPACE_LOOKS, Settings, SpaceLookSettings
from ccm_opt.driver.user_terms import compiled_terms, named_terms
from ccm_opt.driver.verified_motion import (
    TermResults,
    VerifiedPlan,
    failed_checks,
    results_of_terms,
    with_hair,
    worst_of_legs,
)
from ccm_opt.driver.verified_plan import kept, not_waited_for, simulated_motion
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.errors import (
    CancelledWithPlan,
    Diagnosis,
    MotionNotFound,
    NoPlanFound,
    ProblemError,
    RetimingError,
    VerificationError,
)
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.following.leader import feed_limits
from ccm_opt.planning.legs import Leg, PlannerOf, RetimerOf, whole_path
from ccm_opt.planning.space_ends import GapsAtSamples
from ccm_opt.planning.space_planner import SpacePlanner
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.solution import JointPath, JointTrajectory, NearPlace, RoomRecord, SimulatedMotion
from ccm_opt.solution.space_solution import SpaceSolution
from ccm_opt.verification.left_unchecked import left_unchecked_of_arm
from ccm_opt.verification.space_verifier import verify_in_space

if TYPE_CHECKING:
    from ccm_opt.ik.compiled_terms import UserTerms

_BEYOND_WANTED = 1.5
"""How far the room is looked at, in wanted gaps; a link at least. Taste: the chart's height."""


@dataclass(frozen=True)
class SpacePlanningRun:
    """What stays the same however often a problem in space is planned.

    Attributes:
        problem: as it was asked.
        planner: given by the caller, or None for the package's own.
        retimer: likewise, or None for the timing that the problem names.
        constraints: of the user.
        costs: of the user.
        terms: both of them, compiled; None when there are none.
        stages: names and times the stages.
        settings: of all stages.
        recorded: the paths that were found last, for those who ask what change would help.
    """

    problem: SpaceProblem
    planner: PlannerOf[SpaceProblem] | None
    retimer: RetimerOf[SpaceProblem] | None
    constraints: Sequence[Constraint]
    costs: Sequence[Cost]
    terms: "UserTerms | None"
    stages: Stages
    settings: Settings
    recorded: list[tuple[SpaceProblem, JointPath]] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.problem.planner.method != "nlp":
            raise ProblemError(
                f'planner.method = "{self.problem.planner.method}" works in the plane alone, and '
                f"'{self.problem.name}' is in space"
            )

    def refuse_impossible(self, problem: SpaceProblem) -> None:
        """Refuse a problem that is proved to have no plan.

        Raises:
            NoPlanFound: with the proof.
        """
        refuse_impossible_in_space(problem)

    def surviving(self, tried: SpaceProblem) -> Generator[SpaceProblem, VerifiedPlan, VerifiedPlan]:
        """Ask for motions with more room, until one survives the errors that a problem names."""
        return surviving_errors_in_space(tried, self.settings.tolerance)

    def planner_of(self, roomy: SpaceProblem, lowered: "UserTerms | None") -> PlannerOf[SpaceProblem]:
        """The planner for a problem, under the user's terms with the share of the costs that is tried."""
        del roomy
        return self.planner or SpacePlanner(self.stages, terms=lowered, refuse=refuse_closed_in_space)

    def timed_and_verified(self, roomy: SpaceProblem, legs: Sequence[Leg[SpaceProblem]]) -> VerifiedPlan:
        """Time legs, and verify them as one motion."""
        return self._of_legs(roomy, legs, self.terms, self.stages)

    def as_it_stands(self, problem: SpaceProblem, plan: VerifiedPlan) -> SpaceSolution:
        """The solution that a plan is, with no word of its room and its simulation; for one that is cancelled."""
        return assembled_in_space(problem, plan, not_waited_for(problem, plan), {}, self.stages, None)

    def described(self, plan: VerifiedPlan, figures: Mapping[str, float]) -> SpaceSolution:
        """The solution that a plan is, with its room and its simulation."""
        return described_in_space(self.problem, plan, self.stages, self.settings, figures)

    def explained(self, failure: NoPlanFound, deadline: Deadline, *, changes: bool) -> NoPlanFound:
        """Return a failure of the same kind, with its causes and the changes that would help.

        Args:
            failure: why there is no plan; told at once.
            deadline: until which changes are tried.
            changes: whether they are tried at all; without them nothing is told that is not proved.
        """
        self.stages.tell_known(failure.diagnosis)
        from ccm_opt.diagnosis.explain import explained, with_proof  # noqa: PLC0415 - most problems have a plan
        from ccm_opt.diagnosis.in_space import IN_SPACE  # noqa: PLC0415
        from ccm_opt.diagnosis.relaxation import Trials  # noqa: PLC0415

        if not changes:
            return with_proof(self.problem, failure, IN_SPACE)
        droppable = named_terms(str(failure), self.constraints, self.costs)
        settings = self.settings.diagnosis.space_trials
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
        its_planner = self.planner or SpacePlanner(quiet, terms=its_terms, refuse=refuse_closed_in_space)
        legs = plan_legs(changed, its_planner, self.recorded, retrace=its_terms is None)
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
        leg = Leg(changed, replace(plan.path, spare=0.0))
        return self._of_legs(changed, (leg,), its_terms, Stages())

    def _of_legs(
        self,
        problem: SpaceProblem,
        legs: Sequence[Leg[SpaceProblem]],
        terms: "UserTerms | None",
        stages: Stages,
    ) -> VerifiedPlan:
        """The legs timed, and verified as one motion."""
        with stages("dynamics model"):
            dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
        with stages("retiming"):
            timed = [self._timed(leg.problem, leg.path, dynamics) for leg in legs]
            trajectory = retiming.joined(timed, [stop.pause for stop in problem.stops]) if len(timed) > 1 else timed[0]
            joints = joint_states(problem.arm, trajectory, dynamics)
        with stages("verification"):
            checks = verify_in_space(problem, trajectory, joints)
            if failures := failed_checks(checks):
                raise VerificationError(failures)
            of_terms = self._results_of_terms(legs, timed, terms)
        return VerifiedPlan(whole_path(legs), trajectory, joints, checks, of_terms)

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
        legs: Sequence[Leg[SpaceProblem]],
        timed: Sequence[JointTrajectory],
        terms: "UserTerms | None",
    ) -> TermResults:
        """What the motion makes of the user's terms, every leg by itself.

        Raises:
            MotionNotFound: a constraint is not kept.
        """
        found = [
            results_of_terms(terms, leg.problem.arm, leg.path, trajectory, self.settings.user_terms)
            for leg, trajectory in zip(legs, timed, strict=True)
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


def timed_in_space(
    problem: SpaceProblem, path: JointPath, dynamics: InverseDynamics, settings: Settings = DEFAULT_SETTINGS
) -> JointTrajectory:
    """The motion along a path by the problem's method of timing.

    Raises:
        RetimingError: there is none within the limits.
    """
    arm = problem.arm
    timings = retiming.timings(
        path,
        feed_limits(arm, problem.limits, settings.feed.following),
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
    points = problem.arm.joint_positions_at(trajectory.positions[samples])
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


def described_in_space(
    problem: SpaceProblem,
    plan: VerifiedPlan,
    stages: Stages,
    settings: Settings,
    of_costs: Mapping[str, float] | None = None,
) -> SpaceSolution:
    """The solution that a verified plan is, with its room and its simulation; whatever happens there, it is kept.

    Raises:
        CancelledWithPlan: on Ctrl-C, with the solution as far as it is known.
    """
    room: RoomRecord | None = None
    simulated = not_waited_for(problem, plan)
    figures: Mapping[str, float] = {}
    try:
        with stages("room"):
            of_room = partial(room_in_space, problem, plan.trajectory)
            room = kept(of_room, "the room of the motion was not measured", lambda _: None)
        with stages("simulation"):
            simulated, figures = simulated_motion(problem, plan, settings.simulation)
    except KeyboardInterrupt as interrupt:
        found = assembled_in_space(problem, plan, simulated, {**figures, **(of_costs or {})}, stages, room)
        raise CancelledWithPlan(found) from interrupt
    return assembled_in_space(problem, plan, simulated, {**figures, **(of_costs or {})}, stages, room)


def assembled_in_space(
    problem: SpaceProblem,
    plan: VerifiedPlan,
    simulated: SimulatedMotion,
    of_simulation: Mapping[str, float],
    stages: Stages,
    room: RoomRecord | None,
) -> SpaceSolution:
    """The solution of a problem in space from what every stage made."""
    figures = dict(space_figures_of_motion(problem, plan.trajectory, plan.joints, plan.checks))
    figures["keyframes"] = float(len(plan.path.keyframes))
    figures["tracking_error_rad"] = simulated.tracking_error
    return SpaceSolution(
        problem=problem,
        path=plan.path,
        trajectory=plan.trajectory,
        joints=plan.joints,
        simulation=simulated,
        checks=(*plan.checks, *plan.of_terms.checks),
        metrics={**figures, **of_simulation, **plan.of_terms.figures},
        timings=dict(stages.timings),
        versions=dict(versions()),
        room=room,
        tries=plan.tries,
        not_checked=left_unchecked_of_arm(problem.arm),
    )
