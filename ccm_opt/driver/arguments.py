"""What callers give: checks of arguments, and the users' constraints and costs."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ccm_opt.core.arguments import expect, expect_callable, expect_method
from ccm_opt.core.errors import Diagnosis, Finding, ProblemError, UnreachableGoal
from ccm_opt.driver.legs import Planner, Retimer
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.contradictions import Contradiction, GoalRegion, contradictions
from ccm_opt.ik.terms import TERM_TOLERANCE, Constraint, Cost, applies_at
from ccm_opt.problem import Goal, Problem, Tolerances
from ccm_opt.problem.options import options_without_effect
from ccm_opt.robot.arm import Arm

if TYPE_CHECKING:
    from ccm_opt.driver.settings import Settings


def expect_arguments(
    *,
    progress: Callable[..., Any] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    settings: "Settings | None" = None,
    **flags: bool,
) -> None:
    """Refuse arguments of another kind than they are meant to be; None stands for the default.

    Args:
        progress: a function.
        planner: an object with the method ``plan``.
        retimer: an object with the method ``retime``.
        settings: of all stages.
        flags: true or false, by name.

    Raises:
        ProblemError: naming what was expected, and what to write.
    """
    expect_callable(progress, "a function for progress=", "for example progress=print")
    expect_method(planner, ["plan"], "a planner, an object with plan(problem)", "ccm_opt.BuiltInPlanner() is one")
    expect_method(
        retimer, ["retime"], "a retimer, an object with retime(problem, path)", "ccm_opt.BuiltInRetimer() is one"
    )
    if settings is not None:
        from ccm_opt.driver.settings import Settings  # noqa: PLC0415 - loads the settings of all planners

        expect(settings, Settings, "ccm_opt.Settings for settings=")
    for name, value in flags.items():
        expect(value, bool, f"True or False for {name}=")


def refuse_without_effect(problem: Problem) -> None:
    """Refuse planner options that do nothing for a problem, as its file would have been.

    Raises:
        ProblemError: naming them, and why they do nothing.
    """
    found = options_without_effect(problem.planner, in_space=problem.dimension == 3)
    lines = [f"planner.{name}: {why}" for name, why in found]
    if lines:
        raise ProblemError(f"problem '{problem.name}' cannot be used:\n" + "\n".join(f"  {line}" for line in lines))


def named_terms(reason: str, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> tuple[tuple[str, str], ...]:
    """Return the kind and name of every constraint and cost that binds a plan, those first that a reason names."""
    hard = [("constraint", each.name) for each in constraints if not each.soft]
    soft = [("constraint", each.name) for each in constraints if each.soft]
    every = [*hard, *soft, *(("cost", each.name) for each in costs)]
    return tuple(sorted(every, key=lambda term: f"'{term[1]}'" not in reason))


def compiled_terms(arm: Arm, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> "UserTerms | None":
    """Return the user's constraints and costs for an arm; None when there are none.

    Raises:
        ProblemError: they are no lists, or one of them cannot be used.
    """
    # An empty list is fine, and everything else that is as good as false to Python is not.
    expect(constraints, (list, tuple), "a list of constraints", "write constraints=[mine]")
    expect(costs, (list, tuple), "a list of costs", "write costs=[mine]")
    if not (constraints or costs):
        return None
    from ccm_opt.ik.compiled_terms import compile_terms  # noqa: PLC0415 - most problems have no terms

    return compile_terms(arm, constraints, costs)


ADVICE = ("change the bounds of the constraint, or the goal", "let it apply on the way only", "make it soft")


def refuse_contradictions(problem: Problem, terms: UserTerms | None) -> None:
    """Refuse constraints that are proved not to hold at a goal, whatever the pose.

    A start that breaks a constraint is bad input, which is for the planner to say; then nothing is refused here.

    Args:
        problem: what to solve.
        terms: the user's constraints and costs.

    Raises:
        UnreachableGoal: naming the constraint and by how much it is off.
    """
    if terms is None or _breaks_start(problem, terms):
        return
    # In the plane proofs know a fixed base alone.
    if problem.arm.base_axes and problem.dimension == 2:
        return
    several = len(problem.stops) > 0
    stops: list[tuple[Goal, Tolerances]] = [(stop.goal, stop.tolerances) for stop in problem.stops]
    goals = [*stops, (problem.goal, problem.tolerances)]
    for number, (goal, tolerances) in enumerate(goals, start=1):
        where = f"goal {number} of {len(goals)}" if several else "the goal"
        findings = tuple(_finding(each, where) for each in _contradictions(terms, goal, tolerances))
        if findings:
            raise UnreachableGoal(Diagnosis(findings[0].reason, "necessary checks", ADVICE, findings=findings))


def _breaks_start(problem: Problem, terms: UserTerms) -> bool:
    """Return whether the start breaks a constraint: then the input is bad, and the planner says so."""
    start = problem.start.configuration(problem.arm)
    misses = (
        float(item.residuals(start[None], np.zeros(1))[0])
        for item in terms.hard
        if bool(applies_at(item.constraint.where, np.array([0.0, 1.0]))[0])
    )
    return any(not miss <= TERM_TOLERANCE for miss in misses)


def _contradictions(terms: UserTerms, goal: Goal, tolerances: Tolerances) -> tuple[Contradiction, ...]:
    tip = goal.for_tip
    if tip is None:
        return ()
    region = GoalRegion(tip.position, tip.direction, tolerances.position, tolerances.heading)
    return contradictions(terms, region)


def _finding(each: Contradiction, where: str) -> Finding:
    reason = (
        f"constraint '{each.name}' cannot hold at {where}: off by {each.miss:.4g} with the tip there, and by "
        f"{each.least:.4g} at least wherever it counts as there"
    )
    return Finding("constraint", reason, key="constraints", measured=each.miss, allowed=0.0, unit="")
