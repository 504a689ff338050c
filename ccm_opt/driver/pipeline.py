"""The stages from a problem to a verified plan, and the retries around planning.

Each retry policy (lowered costs, several seeds, robustness to joint errors) takes a function that plans a problem,
calls it for one modified problem after another, and returns the best plan.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import (
    CancelledWithPlan,
    Diagnosis,
    MotionNotFound,
    NoPlanFound,
    UnreachableGoal,
    VerificationError,
)
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.explain import refuse_impossible
from ccm_opt.driver.arguments import (
    compiled_terms,
    expect_arguments,
    refuse_contradictions,
    refuse_without_effect,
)
from ccm_opt.driver.legs import Planner, Retimer
from ccm_opt.driver.planning_run import PlanningRun
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.solution_assembly import described, draft_solution
from ccm_opt.driver.verified_plan import VerifiedPlan
from ccm_opt.dynamics.simulation.simulation_record import check_options
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.terms import COST_SHARES, Constraint, Cost
from ccm_opt.problem import PlannerOptions, Problem
from ccm_opt.problem.solution import Solution, SurvivedError, TryRecord
from ccm_opt.scene.bad_pose import clearance_advice
from ccm_opt.verification.tolerance.error_model import DEFAULT_TOLERANCE, ToleranceSettings, check_of, joint_errors
from ccm_opt.verification.tolerance.survived_errors import survived_error

_CLEARANCE_SHARE = 0.9
"""Share of the largest gap that any try keeps (counted up to the preferred clearance) that a try must keep to be
eligible. Taste, like the share of the preferred clearance below which a record calls a motion short of clearance."""

_GAP_ROUNDS = 4
"""Most times that a motion is replanned with a larger preferred clearance. Taste."""
_GAP_GROWTH = (1.2, 4.0)
"""Least and greatest factor by which the preferred clearance grows in one round. Taste."""
_GAP_BEYOND = 1.1
"""Factor on top of the preferred clearance that scaling in proportion to the error gives. Taste."""

STAGE = "tolerance"
"""Stage named in the diagnosis of a motion that does not survive the required joint errors."""


Plans: TypeAlias = Callable[[Problem, UserTerms | None], VerifiedPlan]
"""Plans a problem with the user's constraints and costs, or raises with the reason why there is no plan."""


def with_lowered_costs(
    problem: Problem,
    terms: UserTerms,
    planned: Plans,
    shares: Sequence[float] = COST_SHARES,
) -> tuple[VerifiedPlan, float]:
    """Plan with the user's costs scaled by the largest factor for which a plan is found; keep hard constraints.

    Args:
        problem: the problem to solve.
        terms: the user's constraints and costs.
        planned: function that plans a problem with given terms; the time limit of the problem is the CPU time left.
        shares: factors of the costs' weights, tried in this order.

    Returns:
        The plan, and the factor of the costs' weights with which it was planned.

    Raises:
        NoPlanFound: there is no plan even with the last factor; or the goal is unreachable.
        VerificationError: the verifier rejects the plan made with the last factor.
    """
    deadline = Deadline.after(problem.planner.time_limit)
    for share in shares[:-1]:
        try:
            return planned(problem, _lowered(terms, share)), share
        except UnreachableGoal:
            raise
        except (NoPlanFound, VerificationError):
            left = deadline.left
            if left <= 0.0:
                raise
            problem = replace(problem, planner=replace(problem.planner, time_limit=left))
    return planned(problem, _lowered(terms, shares[-1])), shares[-1]


def _lowered(terms: UserTerms, share: float) -> UserTerms:
    return terms if share == 1.0 else terms.with_costs_lowered(share)


def best_try(
    problem: Problem,
    terms: UserTerms | None,
    planned: Plans,
    draft_solution: Callable[[Problem, VerifiedPlan], Solution],
) -> VerifiedPlan:
    """Plan with as many seeds as the problem asks for, and return the best plan; time is shared equally.

    Try k uses the problem's seed plus k. A seed gives the same plan as long as no try runs out of its share of the
    time.

    Args:
        problem: the problem to solve.
        terms: the user's constraints and costs.
        planned: function that plans the problem once.
        draft_solution: function that turns the best plan so far into a solution, for Ctrl-C.

    Raises:
        NoPlanFound: no try found a plan; the error is that of the first try.
        VerificationError: no try found a plan, and the verifier refused the plan of the first.
        CancelledWithPlan: on Ctrl-C once a try has found a plan; it holds the best so far.
    """
    asked = problem.planner.tries
    deadline = Deadline.after(problem.planner.time_limit)
    tries = _Tries(problem.wanted_gap)
    try:
        for number in range(asked):
            if number > 0 and deadline.passed():
                break
            seed = problem.planner.seed + number
            options = replace(problem.planner, seed=seed, time_limit=deadline.left / (asked - number))
            try:
                tries.plans[seed] = planned(replace(problem, planner=options), terms)
            except UnreachableGoal:
                raise  # no other seed makes the goal reachable
            except (NoPlanFound, VerificationError) as failure:
                tries.failures[seed] = failure
    except KeyboardInterrupt as interrupt:
        if not tries.plans:
            raise
        raise CancelledWithPlan(draft_solution(problem, tries.best())) from interrupt
    return tries.best()


def least_gap(plan: VerifiedPlan) -> float:
    """Return the least gap beyond the clearance that the verifier measured between any two bodies [m]."""
    return min(check.worst - check.limit for check in plan.checks if check.name in {"wall clearance", "self-collision"})


@dataclass
class _Tries:
    """Results of the tries so far.

    Attributes:
        wanted_gap: preferred clearance of the problem [m].
        plans: plans found so far, by seed.
        failures: errors of the failed tries, by seed.
    """

    wanted_gap: float
    plans: dict[int, VerifiedPlan] = field(default_factory=dict)
    failures: dict[int, NoPlanFound | VerificationError] = field(default_factory=dict)

    def best(self) -> VerifiedPlan:
        """Return the shortest plan among those that keep nearly the largest gap, with the record of all tries.

        Gaps count up to the preferred clearance.

        Raises:
            NoPlanFound: no try found a plan; the error is that of the first try.
            VerificationError: no try found a plan, and the verifier rejected the plan of the first try.
        """
        if not self.plans:
            raise next(iter(self.failures.values()))
        gaps = {seed: min(least_gap(plan), self.wanted_gap) for seed, plan in self.plans.items()}
        most = max(gaps.values())
        roomy = [seed for seed, gap in gaps.items() if gap >= min(_CLEARANCE_SHARE * most, most)]
        taken = min(roomy, key=lambda seed: self.plans[seed].trajectory.duration)
        found: list[TryRecord] = [
            TryRecord(seed, plan.trajectory.duration, least_gap(plan), "", taken=seed == taken)
            for seed, plan in self.plans.items()
        ]
        failed: list[TryRecord] = [
            TryRecord(seed, None, None, _reason(failure)) for seed, failure in self.failures.items()
        ]
        return replace(self.plans[taken], tries=tuple(sorted([*found, *failed], key=lambda each: each.seed)))


def _reason(failure: NoPlanFound | VerificationError) -> str:
    if isinstance(failure, NoPlanFound):
        return failure.diagnosis.reason
    return "the verifier rejects the plan: " + "; ".join(failure.failures)


def insufficient_robustness(problem: Problem, best: SurvivedError) -> Diagnosis:
    """Return the diagnosis of a motion that survives smaller joint errors than its problem requires."""
    asked = float(np.rad2deg(problem.joint_error))
    reached = float(np.rad2deg(best.size))
    if not best.limited:
        reason = f"joint errors are checked up to {reached:.3g}°, but tolerance.joint_error_deg is {asked:.3g}"
        return Diagnosis(reason, STAGE, (f"lower tolerance.joint_error_deg to {_below(reached)}",))
    # Near contact gaps fall in proportion to errors, and the clearance adds to what they may use up.
    reason = (
        f"no motion was found that tolerates joint errors of {asked:.3g}°: the best tolerates "
        f"{reached:.3g}°, limited by {best.where}, where it would need {asked / max(reached, 1e-9):.2g} "
        "times the clearance"
    )
    advice = (
        f"lower tolerance.joint_error_deg to {_below(reached)}, which the best motion tolerates",
        *clearance_advice(problem.arm.radius, problem.workspace.clearance),
        "move the limiting obstacle or the goal",
    )
    evidence = {"asked_deg": asked, "survived_deg": reached, "where": best.where, "link": best.link, "time": best.time}
    return Diagnosis(reason, STAGE, advice, evidence)


def _below(angle: float) -> str:
    """Return an angle as text, rounded down to three significant digits."""
    digits = 2 - int(np.floor(np.log10(angle))) if angle > 0.0 else 0
    return f"{np.floor(angle * 10.0**digits) / 10.0**digits:.{max(digits, 0)}f}"


def surviving_errors(
    problem: Problem, terms: UserTerms | None, planned: Plans, settings: ToleranceSettings = DEFAULT_TOLERANCE
) -> VerifiedPlan:
    """Plan motions with growing preferred clearances until one survives the joint error that the problem requires.

    Near contact, the joint error that an arm survives grows with its gap. Each round asks for the gap that the best
    motion so far would need. The preferred clearance is a soft goal, so narrow passages do not keep a motion from being
    found; the certificate, computed from the poses, decides.

    Args:
        problem: the problem to solve.
        terms: the user's constraints and costs.
        planned: function that plans a motion.
        settings: time limits of the rounds, and precision of the certificate.

    Raises:
        NoPlanFound: no motion was found with the problem's own preferred clearance; or none of those found survives the
            error, with the error that the best one survives and what limits it.
        VerificationError: the verifier rejects the plan.
    """
    deadline = Deadline.after(problem.planner.time_limit)
    wanted = problem.wanted_gap or problem.default_gap

    def judged(options: PlannerOptions) -> tuple[VerifiedPlan, SurvivedError]:
        plan = planned(replace(problem, planner=options, joint_error=0.0), terms)
        return plan, survived_error(problem, plan.trajectory, joint_errors(problem.arm), settings)

    best = judged(replace(problem.planner, time_limit=settings.time_share * problem.planner.time_limit))
    for _ in range(_GAP_ROUNDS):
        if best[1].size >= problem.joint_error or deadline.passed():
            break
        least, most = _GAP_GROWTH
        wanted *= min(max(_GAP_BEYOND * problem.joint_error / max(best[1].size, 1e-12), least), most)
        limit = max(settings.time_share * deadline.left, settings.least_time)
        try:
            roomier = judged(replace(problem.planner, wanted_gap=wanted, time_limit=limit))
        except (NoPlanFound, VerificationError):
            break
        best = max(best, roomier, key=lambda found: found[1].size)
    plan, survived = best
    check = check_of(problem.joint_error, survived)
    if check.passed:
        return replace(plan, checks=(*plan.checks, check))
    raise MotionNotFound(insufficient_robustness(problem, survived))


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
) -> Solution:
    """Plan, time, verify and simulate a motion, in the plane or in space.

    Args:
        problem: the problem to solve.
        progress: called when a stage starts, and when the search turns to another candidate.
        planner: another planner, in space one that plans spatial problems; when None the built-in planner for the
            problem.
        retimer: another method of timing the path; when None the one that the problem names.
        constraints: constraints of the user; a planner given here does not receive them, but its plan is checked
            against them.
        costs: costs of the user; a planner given here does not receive them.
        explain: whether the time left after a failure is used to find its cause and the changes that would help.
        settings: settings of the stages that the problem does not set; the defaults when None.

    Returns:
        A verified solution; unverified ones are never returned.

    Raises:
        ProblemError: the problem is invalid, or uses in space an option of the plane.
        NoPlanFound: there is no plan within the limits; the error holds a diagnosis.
        VerificationError: the verifier rejects the plan, which is a defect of the planner.
        CancelledWithPlan: on Ctrl-C once there is a verified plan, which the error holds; a ``KeyboardInterrupt``.
    """
    Problem.expected(problem)
    if planner is None:
        refuse_without_effect(problem)
    expect_arguments(progress=progress, planner=planner, retimer=retimer, settings=settings, explain=explain)
    numbers = settings or DEFAULT_SETTINGS
    with on_one_thread(), words_in(problem.length_unit):
        stages = Stages(progress, problem.planner.time_limit)
        deadline = Deadline.after(problem.planner.time_limit)
        with stages("dynamics model"):
            check_options(problem.arm, problem.simulation)
            terms = compiled_terms(problem.arm, constraints, costs)
        with stages("necessary checks"):
            refuse_contradictions(problem, terms)
        run = PlanningRun(problem, planner, retimer, constraints, costs, terms, stages, numbers, deadline)
        # best_try wraps surviving_errors: every try has to survive the joint errors, and the best of them is taken.
        planned: Plans = run.planned
        if problem.joint_error > 0.0:
            planned = partial(surviving_errors, planned=planned, settings=numbers.tolerance)
        if problem.planner.tries > 1:
            planned = partial(best_try, planned=planned, draft_solution=partial(draft_solution, stages=stages))
        figures: dict[str, float] = {}
        try:
            with stages("necessary checks"):
                refuse_impossible(problem)
            if terms is None or not terms.all_costs:
                plan = planned(problem, terms)
            else:
                # Another planner is not given the costs.
                shares = COST_SHARES if planner is None else COST_SHARES[:1]
                plan, figures["cost_share"] = with_lowered_costs(problem, terms, planned, shares)
        except NoPlanFound as failure:
            # The diagnosis names the survived error already, and searches for other changes ignore robustness.
            if failure.diagnosis.stage == STAGE:
                raise
            raise run.explained(failure, changes=explain) from failure

        # Clearance and simulation only assess the plan; no failure there discards it.
        return described(problem, plan, stages, numbers, figures)
