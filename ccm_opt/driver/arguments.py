"""Checks of the arguments of public functions, and of the user's constraints and costs."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ccm_opt.core.arguments import expect, expect_method, expect_that, is_whole
from ccm_opt.core.errors import Diagnosis, Finding, ProblemError, UnreachableGoal
from ccm_opt.driver.legs import Planner, Retimer
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.contradictions import Contradiction, GoalRegion, contradictions
from ccm_opt.ik.terms import TERM_TOLERANCE, Constraint, Cost, applies_at
from ccm_opt.planning.plane_in_space import needs_space
from ccm_opt.problem import Goal, Problem, Tolerances
from ccm_opt.problem.options import options_without_effect
from ccm_opt.problem.poses import name_suffix
from ccm_opt.problem.tool_rules import refuse_tool
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
    """Raise an error for arguments of a wrong type; None, which stands for a default, is accepted.

    Args:
        progress: argument that must be a function.
        planner: argument that must be an object with the method ``plan``.
        retimer: argument that must be an object with the method ``retime``.
        settings: settings of all stages of planning.
        flags: arguments, by name, that must be booleans.

    Raises:
        ProblemError: an argument is invalid; the message says what is expected and how to write it.
    """
    if progress is not None:
        expect_that(partial(callable, progress), progress, "a function for progress=", "for example progress=print")
    expect_method(planner, ["plan"], "a planner: an object with plan(problem)", "ccm_opt.BuiltInPlanner() is one")
    expect_method(
        retimer, ["retime"], "a retimer: an object with retime(problem, path)", "ccm_opt.BuiltInRetimer() is one"
    )
    if settings is not None:
        from ccm_opt.driver.settings import Settings  # noqa: PLC0415 - loads the settings of all planners

        expect(settings, Settings, "ccm_opt.Settings for settings=")
    for name, value in flags.items():
        expect(value, bool, f"True or False for {name}=")


def refuse_without_effect(problem: Problem) -> None:
    """Raise an error for planner options that were set although they have no effect on the problem.

    Raises:
        ProblemError: an option has no effect; the message names all such options and the reasons.
    """
    along = all(stop.goal.path is not None for stop in problem.goals)
    in_space = problem.dimension == 3 or needs_space(problem.arm)
    found = options_without_effect(problem.planner, in_space=in_space, along_paths=along)
    lines = [f"planner.{name}: {why}" for name, why in found]
    if problem.pause and problem.planner.order != "free":
        lines.append("goal.pause: no goal follows, so that it has no effect; leave it out")
    arm = problem.arm
    if problem.planner.follow_within is not None and arm.feed is None and not (arm.carrier and along):
        lines.append(
            "planner.follow_within: only allowed together with arm.feed, or with arm.base.axes and goal.path; "
            "leave it out"
        )
    if lines:
        raise ProblemError(f"problem '{problem.name}' cannot be used:\n" + "\n".join(f"  {line}" for line in lines))


def named_terms(reason: str, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> tuple[tuple[str, str], ...]:
    """Return every constraint and cost of the user as a pair (kind, name), first those named in a reason for failure.

    Args:
        reason: the reason why no plan was found, in words.
        constraints: constraints of the user.
        costs: costs of the user.
    """
    hard = [("constraint", each.name) for each in constraints if not each.soft]
    soft = [("constraint", each.name) for each in constraints if each.soft]
    every = [*hard, *soft, *(("cost", each.name) for each in costs)]
    return tuple(sorted(every, key=lambda term: f"'{term[1]}'" not in reason))


def refuse_sections(arm: Arm, what: str) -> None:
    """Raise an error for an arm whose sections bend evenly.

    Args:
        arm: the arm.
        what: what does not support such arms, in the plural.

    Raises:
        ProblemError: the arm has such sections.
    """
    if arm.drives is not None:
        drives = 'arm.sections with drive = "section"' if arm.sections is not None else "arm.coupling"
        raise ProblemError(f"{what} do not support {drives}")


def expect_workers(workers: object) -> None:
    """Raise an error if a value is neither a number of processes nor an object that opens an executor.

    Raises:
        ProblemError: the value is neither.
    """
    several = is_whole(workers) and workers >= 1
    opens = callable(getattr(workers, "open", None)) and not isinstance(workers, type)
    expect_that(
        lambda: several or opens, workers, "a number of processes of at least 1, or ccm_opt workers, for workers="
    )


def refuse_free_order(problem: Problem, what: str) -> None:
    """Raise an error for goals in free order.

    Args:
        problem: the problem.
        what: what is found for goals in given order only, with its verb.

    Raises:
        ProblemError: the goals are in free order.
    """
    if problem.planner.order == "free":
        raise ProblemError(f'{what} found for goals in given order only; leave planner.order = "free" out')


def compiled_terms(arm: Arm, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> "UserTerms | None":
    """Return the user's constraints and costs compiled for an arm; None if there are none.

    Raises:
        ProblemError: an argument is not a list, or a constraint or cost is invalid.
    """
    # An empty list is valid; other falsy values are not.
    expect(constraints, (list, tuple), "a list of constraints", "write constraints=[mine]")
    expect(costs, (list, tuple), "a list of costs", "write costs=[mine]")
    if not (constraints or costs):
        return None
    refuse_tool(arm, "the use of constraints and costs")
    refuse_sections(arm, "constraints and costs of the user")
    if arm.carrier:
        raise ProblemError("constraints and costs are not supported for an arm on arm.base.axes; leave them out")
    from ccm_opt.ik.compiled_terms import compile_terms  # noqa: PLC0415 - most problems have no terms

    return compile_terms(arm, constraints, costs)


ADVICE = ("change the bounds of the constraint, or the goal", "let it apply along the way only", "make it soft")


def refuse_contradictions(problem: Problem, terms: UserTerms | None) -> None:
    """Raise an error for constraints of the user that are proved to be violated in every pose at a goal.

    No error is raised if the start violates a constraint, since the planner reports that as invalid input.

    Args:
        problem: the problem.
        terms: the user's constraints and costs.

    Raises:
        UnreachableGoal: a constraint is violated in every pose; the error states its minimum violation.
    """
    if terms is None or _breaks_start(problem, terms):
        return
    # In the plane, the proofs cover fixed bases only.
    if problem.arm.base_axes and problem.dimension == 2:
        return
    several = len(problem.stops) > 0
    stops: list[tuple[Goal, Tolerances]] = [(stop.goal, stop.tolerances) for stop in problem.stops]
    goals = [*stops, (problem.goal, problem.tolerances)]
    for number, (goal, tolerances) in enumerate(goals, start=1):
        where = f"goal {number} of {len(goals)}{name_suffix(goal)}" if several else "the goal"
        findings = tuple(_finding(each, where) for each in _contradictions(terms, goal, tolerances))
        if findings:
            raise UnreachableGoal(Diagnosis(findings[0].reason, "necessary checks", ADVICE, findings=findings))


def _breaks_start(problem: Problem, terms: UserTerms) -> bool:
    """Return whether the start pose violates a hard constraint of the user that applies at the start."""
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
        f"constraint '{each.name}' cannot hold at {where}: violated by {each.miss:.4g} with the tip at the "
        f"goal, and by at least {each.least:.4g} anywhere within its tolerance"
    )
    return Finding("constraint", reason, key="constraints", measured=each.miss, allowed=0.0, unit="")
