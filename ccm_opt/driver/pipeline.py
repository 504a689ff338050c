"""The stages of solving, in their order: plan, time, verify, measure the room, simulate."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any, TypeVar, overload

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.driver.attempts import STAGE, Attempts, best_of_tries, with_lowered_costs
from ccm_opt.driver.calls import expect_arguments
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.user_terms import compiled_terms, refuse_contradictions
from ccm_opt.dynamics.simulation.simulation_record import check_options
from ccm_opt.errors import Diagnosis, NoPlanFound
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.legs import Leg, Planner, PlannerOf, Retimer, end_to_end
from ccm_opt.problem import JointPose, Problem, Tolerances
from ccm_opt.problem.space_problem import AnyProblem, SpaceJointPose, SpaceProblem
from ccm_opt.solution import JointPath, Solution
from ccm_opt.solution.space_solution import AnySolution, SpaceSolution

_LEAST_TIME = 0.5
"""CPU time that the planner is given for a leg, even when the legs before have used it up [s]: without any, a late leg
would fail on the clock where it might be easy. Taste."""

_SAME = 1e-9
"""Difference of coordinates up to which two configurations are the same [rad, m]: rounding of the file's numbers."""


@overload
def solve(
    problem: Problem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: Settings | None = None,
) -> Solution: ...


@overload
def solve(
    problem: SpaceProblem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: Settings | None = None,
) -> SpaceSolution: ...


def solve(
    problem: AnyProblem,
    *,
    progress: Callable[[Progress], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
    settings: Settings | None = None,
) -> AnySolution:
    """Plan, time, verify and simulate a motion, in the plane or in space.

    Args:
        problem: what to solve.
        progress: told when a stage starts, and when the search begins with another candidate.
        planner: another planner; when None the feed planner for an arm on a feed axis, else the curve planner. For a
            problem in space, one that plans such problems; the space planner when None.
        retimer: another way to time the path; the one that the problem names when None.
        constraints: of the user; another planner is not given them, but its plan is held against them.
        costs: of the user; another planner is not given them.
        explain: whether the time left after a failure is used to find out why, and what change would help.
        settings: numbers of the stages that the problem does not set; the defaults when None.

    Returns:
        A verified solution; there is no unverified one.

    Raises:
        ProblemError: the problem cannot be used as it stands, or asks in space for what only the plane knows.
        NoPlanFound: with a diagnosis: there is no plan within the limits.
        VerificationError: the verifier refuses the plan; a defect of the planner.
        CancelledWithPlan: on Ctrl-C once there is a verified plan, which it holds; a ``KeyboardInterrupt``.
    """
    kind: Any
    if isinstance(problem, SpaceProblem):
        from ccm_opt.driver.space_planning_run import SpacePlanningRun as kind  # noqa: PLC0415, N813 - loads planners
    else:
        Problem.expected(problem)
        from ccm_opt.driver.planning_run import PlanningRun as kind  # noqa: PLC0415, N813 - likewise
    expect_arguments(progress=progress, planner=planner, retimer=retimer, settings=settings, explain=explain)
    numbers = settings or DEFAULT_SETTINGS
    with on_one_thread(), words_in(problem.length_unit):
        stages = Stages(progress, problem.planner.time_limit)
        deadline = Deadline.after(problem.planner.time_limit)

        # Checks: what no plan could mend is refused before one is sought.
        with stages("dynamics model"):
            check_options(problem.arm, problem.simulation, settings=numbers.simulation)
            terms = compiled_terms(problem.arm, constraints, costs)
        # In the plane and in space a run has the same methods.
        run = kind(problem, planner, retimer, constraints, costs, terms, stages, numbers)
        with stages("necessary checks"):
            # No change of the problem that is tried after a failure would mend this.
            refuse_contradictions(problem, terms, numbers.user_terms)
        try:
            with stages("necessary checks"):
                run.refuse_impossible(problem)

            # With as much of the costs as there is a plan with,
            lowering = Attempts(with_lowered_costs(problem, None if planner else terms, numbers.curve.cost_shares))
            for hurried, lowered in lowering:
                with lowering:
                    # the best of several tries,
                    tries = Attempts(best_of_tries(hurried, partial(run.as_it_stands, hurried)))
                    for tried in tries:
                        with tries:
                            # each with so much room that the motion survives the errors of the joints:
                            rooms = Attempts(run.surviving(tried))
                            for roomy in rooms:
                                with rooms:
                                    # a leg to each goal, then the timing and verification of all of them.
                                    run.recorded.clear()
                                    chosen = run.planner_of(roomy, lowered)
                                    legs = plan_legs(roomy, chosen, run.recorded, retrace=terms is None)
                                    rooms.found = run.timed_and_verified(roomy, legs)
                            tries.found = rooms.result
                    lowering.found = tries.result
            plan, cost_share = lowering.result
        except NoPlanFound as failure:
            # What a motion survives is explained already, and further searches would not know of it.
            if failure.diagnosis.stage == STAGE:
                raise
            with stages("diagnosis" if explain else "necessary checks"):
                explanation = run.explained(failure, deadline, changes=explain)
            raise explanation from failure

        # There is a plan: room and simulation say what it is worth, and nothing that happens there can lose it.
        figures = {"cost_share": cost_share} if terms is not None and terms.all_costs else {}
        solution: AnySolution = run.described(plan, figures)
        return solution


_Problem = TypeVar("_Problem", Problem, SpaceProblem)


def plan_legs(
    problem: _Problem,
    planner: PlannerOf[_Problem],
    recorded: list[tuple[_Problem, JointPath]] | None = None,
    *,
    retrace: bool = True,
) -> tuple[Leg[_Problem], ...]:
    """Plan the motion to every goal in turn, each from where the one before ends; without stops that is one leg.

    Args:
        problem: with any number of stops; its time limit is for all legs together.
        planner: plans a leg.
        recorded: paths that are known already, with their problems; is added to.
        retrace: whether an arm in space that goes back to a pose from which a leg began may take the same way.

    Raises:
        NoPlanFound: naming the goal that is not reached.
    """
    known = [] if recorded is None else recorded
    goals: list[tuple[Any, Tolerances]] = [(stop.goal, stop.tolerances) for stop in problem.stops]
    goals.append((problem.goal, problem.tolerances))
    start: Any = problem.start
    deadline = Deadline.after(problem.planner.time_limit)
    legs: list[Leg[_Problem]] = []
    for number, (goal, tolerances) in enumerate(goals, start=1):
        options = problem.planner
        if legs:
            options = replace(options, time_limit=max(deadline.left, _LEAST_TIME))
        leg = replace(problem, start=start, goal=goal, tolerances=tolerances, stops=(), planner=options)
        path = (way_back(legs, goal) if retrace else None) or recorded_path(known, leg)
        if path is None:
            try:
                path = planner.plan(leg)
            except NoPlanFound as error:
                if len(goals) == 1:
                    raise
                raise type(error)(_of_goal(error.diagnosis, number, len(goals))) from error
            known.append((leg, path))
        legs.append(Leg(leg, path))
        end = path.spline(1.0)
        if isinstance(problem, SpaceProblem):
            start = SpaceJointPose.from_configuration(end, problem.arm.links)
        else:
            start = JointPose.from_configuration(end, problem.arm.coordinates)
    return tuple(legs)


def _of_goal(found: Diagnosis, number: int, count: int) -> Diagnosis:
    """A diagnosis that says which of several goals it is about."""
    return replace(
        found, reason=f"goal {number} of {count}: {found.reason}", evidence={**found.evidence, "goal": number}
    )


def way_back(legs: Sequence[Leg[Any]], goal: object) -> JointPath | None:
    """The paths of the last legs backwards, to where the latest of them that fits began.

    Args:
        legs: that are planned.
        goal: what comes next.

    Returns:
        None where the goal is not a pose in space in which a leg began.
    """
    if not isinstance(goal, SpaceJointPose):
        return None
    back: list[JointPath] = []
    for leg in reversed(legs):
        arm = leg.problem.arm
        back.append(leg.path.reversed())
        if np.max(np.abs(leg.problem.start.configuration(arm) - goal.configuration(arm))) < _SAME:
            return end_to_end(back)
    return None


_OF_DRIVES = frozenset(
    ("masses", "inertia_axial", "inertia_transverse", "payload", "rotor_inertia", "friction", "axes", "stray")
)
"""What of an arm no path depends on."""


def recorded_path(recorded: Sequence[tuple[AnyProblem, JointPath]], problem: AnyProblem) -> JointPath | None:
    """The path of a problem whose path is known; None where something that decides it has changed.

    Limits of torque and masses of links change no path, so none is planned twice.
    """
    return next((path for known, path in recorded if _same_geometry(known, problem)), None)


def _same_geometry(one: AnyProblem, other: AnyProblem) -> bool:
    """Whether all that decides a path is the same; parts that ``replace`` has left alone are the very same objects."""
    numbers = [each.name for each in fields(one.arm) if each.name not in _OF_DRIVES]
    parts = ("workspace", "start", "goal", "stops")
    return (
        type(one) is type(other)
        and all(np.array_equal(getattr(one.arm, name), getattr(other.arm, name)) for name in numbers)
        and one.tolerances == other.tolerances
        and all(getattr(one, name) is getattr(other, name) for name in parts)
    )
