"""The driver for arms in space, in the order of the plane's: plan, time, verify, measure the room, simulate."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol, TypeVar

from ccm_opt import retiming
from ccm_opt.driver.closed_loop import not_simulated, simulate_and_check
from ccm_opt.driver.file_words import in_words_of_its_file
from ccm_opt.driver.solution_assembly import versions
from ccm_opt.driver.solve_settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.space_metrics import space_figures_of_motion
from ccm_opt.driver.space_room import room_in_space
from ccm_opt.driver.verified_plan import failed_checks, with_hair
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.dynamics.simulation.simulation_checks import check_options
from ccm_opt.errors import CancelledWithPlan, Diagnosis, NoPlanFound, ProblemError, RetimingError, VerificationError
from ccm_opt.ground.deadline import Deadline
from ccm_opt.ground.progress import Progress
from ccm_opt.ground.stages import Stages
from ccm_opt.ground.threads import on_one_thread
from ccm_opt.jointed.frames import revolute_angles
from ccm_opt.planners.following.gating import feed_limits
from ccm_opt.planners.legs import end_to_end
from ccm_opt.solution import Check, JointPath, JointStates, JointTrajectory, RoomRecord, SimulatedMotion
from ccm_opt.space.planner import SpacePlanner
from ccm_opt.space.problem import SpaceJointPose, SpaceProblem
from ccm_opt.space.space_solution import SpaceSolution
from ccm_opt.space.verification import verify_in_space

_Result = TypeVar("_Result")

logger = logging.getLogger(__name__)


class PlannerInSpace(Protocol):
    """Finds a certified joint path for a problem in space."""

    def plan(self, problem: SpaceProblem) -> JointPath:
        """Plan a motion to the problem's only goal.

        Raises:
            NoPlanFound: with a diagnosis, when there is none within the limits.
        """
        ...


@dataclass(frozen=True)
class VerifiedSpacePlan:
    """A motion in space that passes every check.

    Attributes:
        path: the way, of all legs end to end.
        trajectory: the same in time.
        joints: the same for all drives.
        checks: of the verifier.
    """

    path: JointPath
    trajectory: JointTrajectory
    joints: JointStates
    checks: tuple[Check, ...]


@on_one_thread
@in_words_of_its_file
def solve_in_space(
    problem: SpaceProblem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: PlannerInSpace | None = None,
    settings: Settings | None = None,
) -> SpaceSolution:
    """Plan, time, verify and simulate a motion of an arm in space.

    Args:
        problem: what to solve.
        progress: told when a stage starts.
        planner: another planner; when None the package's own.
        settings: numbers of timing and simulation; the defaults when None.

    Returns:
        A verified solution; there is no unverified one.

    Raises:
        ProblemError: the problem cannot be used as it stands.
        NoPlanFound: with a diagnosis: there is no plan within the limits.
        VerificationError: the verifier refuses the plan; a defect of the planner.
        CancelledWithPlan: on Ctrl-C once there is a verified plan, which it holds; a ``KeyboardInterrupt``.
    """
    refuse_what_is_planar(problem)
    numbers = settings or DEFAULT_SETTINGS
    stages = Stages(progress, problem.planner.time_limit)
    with stages("dynamics model"):
        check_options(problem.arm, problem.simulation, settings=numbers.simulation)
        dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)

    legs = plan_legs_in_space(problem, planner or SpacePlanner(stages))
    with stages("retiming"):
        timed = [timed_in_space(leg, path, dynamics, numbers) for leg, path in legs]
        trajectory = retiming.joined(timed, [stop.pause for stop in problem.stops]) if len(timed) > 1 else timed[0]
        joints = joint_states(problem.arm, trajectory, dynamics)
    with stages("verification"):
        checks = verify_in_space(problem, trajectory, joints)
        if failures := failed_checks(checks):
            raise VerificationError(failures)
    path = end_to_end([path for _, path in legs])
    return _described(problem, VerifiedSpacePlan(path, trajectory, joints, checks), stages, numbers)


def refuse_what_is_planar(problem: SpaceProblem) -> None:
    """Refuse what a problem in space asks for and only the plane knows, by its key.

    Raises:
        ProblemError: naming everything that is asked for in vain.
    """
    asked = {
        'planner.method = "hill-climbing"': problem.planner.method != "nlp",
        "planner.tries": problem.planner.tries != 1,
        "tolerance.joint_error_deg": problem.joint_error != 0.0,
    }
    if found := [name for name, given in asked.items() if given]:
        raise ProblemError(f"{' and '.join(found)} work in the plane alone, and '{problem.name}' is in space")


def plan_legs_in_space(problem: SpaceProblem, planner: PlannerInSpace) -> list[tuple[SpaceProblem, JointPath]]:
    """The way to every goal in turn, each from where the one before ends.

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
            path = planner.plan(leg)
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


def _described(problem: SpaceProblem, plan: VerifiedSpacePlan, stages: Stages, settings: Settings) -> SpaceSolution:
    """The solution that a verified plan is, with its room and its simulation; whatever happens there, it is kept.

    Raises:
        CancelledWithPlan: on Ctrl-C, with the solution as far as it is known.
    """
    room: RoomRecord | None = None
    simulated = not_simulated(plan.trajectory, plan.joints, problem.simulation.step, "it was not waited for")
    figures: Mapping[str, float] = {}
    try:
        with stages("room"):
            room = _kept(partial(room_in_space, problem, plan.trajectory), "the room of the motion was not measured")
        with stages("simulation"):
            run = partial(simulate_and_check, problem, plan.trajectory, plan.joints, settings)
            simulated, figures = _kept(run, "the plan was not simulated") or (simulated, figures)
    except KeyboardInterrupt as interrupt:
        raise CancelledWithPlan(assembled_in_space(problem, plan, simulated, figures, stages, room)) from interrupt
    return assembled_in_space(problem, plan, simulated, figures, stages, room)


def _kept(stage: Callable[[], _Result], what: str) -> _Result | None:
    """What a stage makes; None, and the defect is logged, where it fails: it can make no verified plan worse."""
    try:
        return stage()
    except Exception:
        logger.exception("%s: this is a bug in ccm-opt, please report it", what)
        return None


def assembled_in_space(
    problem: SpaceProblem,
    plan: VerifiedSpacePlan,
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
        checks=plan.checks,
        metrics={**figures, **of_simulation},
        timings=dict(stages.timings),
        versions=dict(versions()),
        room=room,
    )
