"""The function ``solve``, from a problem to a verified plan, and its policies for repeated planning.

Each policy (lowered costs, several seeds, robustness to joint errors) takes a function that plans a problem, and calls
this function for one modified problem after another. It returns the best plan.
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
    ProblemError,
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
from ccm_opt.planning.tool_problem import problem_with_tool_links
from ccm_opt.problem import PlannerOptions, Problem
from ccm_opt.problem.solution import Solution, ToleratedError, TryRecord
from ccm_opt.scene.bad_pose import clearance_advice
from ccm_opt.verification.tolerance.error_model import DEFAULT_TOLERANCE, ToleranceSettings, check_of, joint_errors
from ccm_opt.verification.tolerance.tolerated_errors import tolerated_error

_CLEARANCE_SHARE = 0.9
"""Fraction of the best attempt's clearance that an attempt must keep to be chosen; clearances are capped at the
preferred clearance. Heuristic, like ``ClearanceSettings.enough``."""

_GAP_ROUNDS = 4
"""Maximum number of times that a motion is planned again with a larger preferred clearance. Heuristic."""
_GAP_GROWTH = (1.2, 4.0)
"""Minimum and maximum factor by which the preferred clearance grows in one round. Heuristic."""
_GAP_BEYOND = 1.1
"""Safety factor on the next preferred clearance, which is scaled in proportion to the joint error. Heuristic."""

STAGE = "tolerance"
"""Name of the stage in the diagnosis of a motion that does not tolerate the required joint error."""


Plans: TypeAlias = Callable[[Problem, UserTerms | None], VerifiedPlan]
"""Function that plans a problem with the user's constraints and costs, or raises an error with the reason."""


def with_lowered_costs(
    problem: Problem,
    terms: UserTerms,
    planned: Plans,
    shares: Sequence[float] = COST_SHARES,
) -> tuple[VerifiedPlan, float]:
    """Return a plan made with the user's costs scaled by the largest of several factors for which a plan is found.

    Args:
        problem: the problem; its time limit applies to all attempts together.
        terms: the user's constraints, which are not changed, and costs.
        planned: function that plans a problem with given terms.
        shares: factors of the weights of the costs, tried in this order.

    Returns:
        The plan, and the factor with which it was made.

    Raises:
        NoPlanFound: no plan was found even with the last factor, or the goal is unreachable.
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
    """Return the best of several plans made with successive seeds, as many as ``planner.tries`` says.

    The remaining time is divided equally among the remaining attempts. A seed always gives the same plan unless an
    attempt runs out of time.

    Args:
        problem: the problem.
        terms: the user's constraints and costs.
        planned: function that plans a problem once.
        draft_solution: function that makes a solution of the best plan so far, for Ctrl-C.

    Raises:
        NoPlanFound: no attempt found a plan; the error is that of the first attempt.
        VerificationError: no attempt found a plan, and the verifier rejected that of the first.
        CancelledWithPlan: Ctrl-C was pressed after an attempt found a plan; the error holds the best so far.
    """
    requested = problem.planner.tries
    deadline = Deadline.after(problem.planner.time_limit)
    tries = _Tries(problem.wanted_gap)
    try:
        for number in range(requested):
            if number > 0 and deadline.passed():
                break
            seed = problem.planner.seed + number
            options = replace(problem.planner, seed=seed, time_limit=deadline.left / (requested - number))
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
    """Return a plan's minimum clearance, beyond the required one, to obstacles and between links [m]."""
    return min(check.worst - check.limit for check in plan.checks if check.name in {"wall clearance", "self-collision"})


@dataclass
class _Tries:
    """Results of several planning attempts, which differ in their seeds.

    Attributes:
        wanted_gap: preferred clearance of the problem [m].
        plans: plans found so far, by seed.
        failures: errors of failed attempts, by seed.
    """

    wanted_gap: float
    plans: dict[int, VerifiedPlan] = field(default_factory=dict)
    failures: dict[int, NoPlanFound | VerificationError] = field(default_factory=dict)

    def best(self) -> VerifiedPlan:
        """Return the fastest of the plans with nearly the maximum clearance, with a record of all attempts.

        Nearly means a fraction ``_CLEARANCE_SHARE`` of the maximum; clearances are capped at the preferred clearance.

        Raises:
            NoPlanFound: no attempt found a plan; the error is that of the first attempt.
            VerificationError: no attempt found a plan, and the verifier rejected that of the first.
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


def insufficient_robustness(problem: Problem, best: ToleratedError) -> Diagnosis:
    """Return the diagnosis for a motion that tolerates smaller joint errors than the problem requires."""
    requested = float(np.rad2deg(problem.joint_error))
    reached = float(np.rad2deg(best.size))
    if not best.limited:
        reason = f"joint errors are checked up to {reached:.3g}°, but tolerance.joint_error_deg is {requested:.3g}"
        return Diagnosis(reason, STAGE, (f"lower tolerance.joint_error_deg to {_below(reached)}",))
    # Near contact gaps fall in proportion to errors, and the clearance adds to what they may use up.
    reason = (
        f"no motion was found that tolerates joint errors of {requested:.3g}°: the best tolerates "
        f"{reached:.3g}°, limited by {best.where}, where it would need {requested / max(reached, 1e-9):.2g} "
        "times the clearance"
    )
    advice = (
        f"lower tolerance.joint_error_deg to {_below(reached)}, which the best motion tolerates",
        *clearance_advice(problem.arm.radius, problem.workspace.clearance, key=problem.arm.key("radius")),
        "move the limiting obstacle or the goal",
    )
    evidence = {
        "asked_deg": requested,
        "survived_deg": reached,
        "where": best.where,
        "link": best.link,
        "time": best.time,
    }
    return Diagnosis(reason, STAGE, advice, evidence)


def _below(angle: float) -> str:
    """Return an angle as text, rounded down to three significant digits."""
    digits = 2 - int(np.floor(np.log10(angle))) if angle > 0.0 else 0
    return f"{np.floor(angle * 10.0**digits) / 10.0**digits:.{max(digits, 0)}f}"


def surviving_errors(
    problem: Problem, terms: UserTerms | None, planned: Plans, settings: ToleranceSettings = DEFAULT_TOLERANCE
) -> VerifiedPlan:
    """Return a plan that tolerates the required joint error, found by planning with growing preferred clearances.

    Near contact, the tolerated joint error grows with clearance. Each round prefers the clearance that the best motion
    so far would need. The preferred clearance is a soft constraint, so that narrow passages do not prevent a motion;
    the certificate of tolerated errors decides.

    Args:
        problem: the problem.
        terms: the user's constraints and costs.
        planned: function that plans a problem.
        settings: time limits of the rounds, and precision of the certificate.

    Raises:
        NoPlanFound: no motion was found with the problem's preferred clearance; or none tolerates the error, in which
            case the diagnosis states the error that the best one tolerates and the limiting contact.
        VerificationError: the verifier rejects the plan.
    """
    deadline = Deadline.after(problem.planner.time_limit)
    wanted = problem.wanted_gap or problem.default_gap

    def judged(options: PlannerOptions) -> tuple[VerifiedPlan, ToleratedError]:
        plan = planned(replace(problem, planner=options, joint_error=0.0), terms)
        return plan, tolerated_error(problem, plan.trajectory, joint_errors(problem.arm), settings)

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
    plan, tolerated = best
    check = check_of(problem.joint_error, tolerated)
    if check.passed:
        return replace(plan, checks=(*plan.checks, check))
    raise MotionNotFound(insufficient_robustness(problem, tolerated))


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
    """Return a planned, timed, verified and simulated motion that solves a problem, planar or in space.

    Args:
        problem: the problem.
        progress: function called when a stage starts, and when the search turns to another candidate.
        planner: planner that supports problems of this dimension; None for the built-in planner.
        retimer: method of timing the path; None for the method that the problem names.
        constraints: constraints of the user; not passed to ``planner``, but checked on its plan.
        costs: costs of the user; not passed to ``planner``.
        explain: whether to use the time left after a failure to find its cause and helpful changes.
        settings: settings of all stages of planning; None for the defaults.

    Returns:
        A verified solution; unverified ones are never returned.

    Raises:
        ProblemError: the problem is invalid, or sets an option that has no effect.
        NoPlanFound: no plan was found within the limits; the error holds a diagnosis.
        VerificationError: the verifier rejects the plan, which is a defect of the planner.
        CancelledWithPlan: Ctrl-C was pressed after a plan was verified, which the error, a ``KeyboardInterrupt``,
            holds.
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
            if terms is not None and problem.planner.order == "free":
                raise ProblemError(
                    'constraints and costs are not supported with planner.order = "free"; leave them out'
                )
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
                if problem.planner.order == "given":  # else each goal by itself
                    refuse_impossible(problem_with_tool_links(problem, weighed=True))
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
            raise run.explain(failure, changes=explain) from failure

        # Clearance and simulation only assess the plan; no failure there discards it.
        return described(problem, plan, stages, numbers, figures)
