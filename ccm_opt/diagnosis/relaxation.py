"""Search for the least change of a problem without a plan with which the problem can be solved."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Finding, NoPlanFound, ProblemError, Relaxation, VerificationError
from ccm_opt.diagnosis.diagnosis_settings import TrialSettings
from ccm_opt.diagnosis.gaps import WORKSPACE_NAMES
from ccm_opt.diagnosis.moved_goal import moved_goals, omissions
from ccm_opt.diagnosis.parameters import (
    Parameter,
    WholeChange,
    larger_bounds,
    parameters_of,
    without_obstacle,
    without_term,
)
from ccm_opt.problem import Problem

_STEPS = (0.045, 0.1, 0.2, 0.4)
"""Steps beyond its bound at which a parameter is tried, as fractions of the bound, until one succeeds. Heuristic."""
_CLOSE = 0.048
"""Relative width of the bracket between failed and successful values at which bisection ends.

Derived: slightly more than the first step relative to the value there, so a success at the first step is accepted.
"""
_LEAST_TIME = 0.05
"""Least remaining time for which a trial is started [s]. Heuristic."""
_ENOUGH = 4
"""Number of successful changes after which the search ends. Heuristic."""

_GUESSED_STEPS = (0.1, 0.25, 0.5)
"""Steps from the given value at which a parameter without a known bound is tried, as fractions. Heuristic."""
_TRY_SHARE = 0.5
"""Fraction of the remaining time that one trial may use. Heuristic."""
_MOST_DROPPED = 3
"""Largest number of user-defined constraints and costs that are dropped, each in its own trial. Heuristic."""
_MOST_OMITTED = 2
"""Largest number of obstacles that are removed, each in its own trial. Heuristic."""

Solve: TypeAlias = Callable[..., object]
"""Function that plans, times and verifies a problem, optionally without a user-defined term of a given name.

The function raises an error if there is no plan; its result is opaque to this module.
"""
CERTAIN = frozenset(("torque", "contact", "joint limit"))
"""Kinds of findings measured on a single pose or motion.

If such a finding is not proved, other poses within the tolerances may be free of it.
"""
HoldAgain: TypeAlias = Callable[[Any, object], object]
"""Function that times and verifies the plan of one problem as a plan for another, or raises an error."""


def _never_holds(problem: Problem, plan: object) -> object:
    raise ProblemError(f"{type(plan).__name__} is no plan for problem '{problem.name}'")


@dataclass(frozen=True)
class Trials:
    """Trials in which changed problems are solved, each within a fraction of the remaining time.

    Attributes:
        solve: solves a problem, optionally without one of the terms; raises an error if there is no plan.
        until: deadline of all trials.
        terms: kind and name of each user-defined constraint and cost, the most likely obstruction first.
        hold_again: verifies whether the plan of one problem also solves another.
        begun: CPU time of this process at which the time for causes and changes starts [s].
        tell: receives the description of every change before its trial, the time spent so far, and the time limit [s].
        ended: returns the final configuration of a plan, shape (c,).
        settings: time limits.
        plans: plans of the successful trials, in order.
        failed: description of the last failed change, by the change's key, or by its description if it has no key.
    """

    solve: Solve
    until: Deadline
    terms: tuple[tuple[str, str], ...] = ()
    hold_again: HoldAgain = _never_holds
    ended: Callable[[object], FloatArray] = lambda _: np.zeros(0)
    begun: float = field(default_factory=time.process_time)
    tell: Callable[[str, float, float], None] = lambda *_: None
    settings: TrialSettings = field(default_factory=TrialSettings)
    plans: list[object] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)

    @property
    def spent(self) -> float:
        """CPU time used since the search for causes and changes began [s]."""
        return time.process_time() - self.begun

    def succeeds(
        self, problem: Problem, words: str, dropped: str = "", *, key: str = "", short_trial: bool = False
    ) -> bool:
        """Return whether a changed problem is solved within the time limit of one trial.

        Args:
            problem: the changed problem.
            words: description of the change.
            dropped: name of a user-defined constraint or cost to leave out; empty for none.
            key: key of the changed parameter, of which only the last failed change is kept; empty for whole changes.
            short_trial: whether another helpful change is already known.
        """
        settings = self.settings
        longest = settings.longest_further_try if short_trial else settings.longest_try
        # Only a fraction of the remaining time, so that several changes can be tried.
        limit = min(_TRY_SHARE * self.until.left, longest)
        if limit < _LEAST_TIME:
            return False
        limited = with_short_limit(problem, limit)
        self.tell(words, self.spent, settings.longest_search)
        try:
            plan = self.solve(limited, dropped) if dropped else self.solve(limited)
        except (NoPlanFound, VerificationError, ProblemError):
            self.failed[key or words] = f"{words.partition(';')[0]}, within {limit:.2g} s"
            return False
        self.plans.append(plan)
        return True

    def holds(self, problem: Problem) -> bool:
        """Return whether the plan of the last successful trial also solves a problem, without planning again."""
        try:
            self.hold_again(problem, self.plans[-1])
        except (NoPlanFound, VerificationError, ProblemError):
            return False
        return True


def with_short_limit(problem: Problem, limit: float) -> Problem:
    """Return a problem with a time limit [s] and without options that only improve motions."""
    if problem.planner.method != "nlp":
        return replace(problem, planner=replace(problem.planner, time_limit=limit))
    # An arm that is barely strong enough may need the optimised motion.
    plain = problem.planner.optimiser if problem.limits.torque is not None else "none"
    return replace(problem, planner=replace(problem.planner, time_limit=limit, optimiser=plain, wanted_gap=0.0))


def relaxations(problem: Problem, findings: tuple[Finding, ...], trials: Trials) -> Iterator[Relaxation]:
    """Yield changes each of which alone makes a problem solvable, the most promising first.

    Args:
        problem: the problem without a plan.
        findings: known obstructions; proved ones, or else those measured on a pose or motion, must all be removed.
        trials: solves changed problems.
    """
    certain = binding(findings)
    settings = trials.settings
    found = 0
    # Dropping user-defined terms does not resolve obstructions that are due to the arm and the scene.
    dropped = [] if certain else [without_term(name, kind) for kind, name in trials.terms[:_MOST_DROPPED]]
    for candidate in chain(dropped, candidates(problem, findings, trials.until, _MOST_OMITTED)):
        if found >= _ENOUGH or trials.until.left < _LEAST_TIME:
            break
        if found and trials.spent > settings.patience:
            break
        if isinstance(candidate, WholeChange):
            relaxed = _as_little_as_helps(candidate, problem, trials, short_trial=bool(found))
        else:
            bound = hardest_bound(candidate, certain) if candidate.bound is None else candidate.bound
            relaxed = least_change(candidate, problem, bound, trials, short_trial=bool(found))
        if relaxed is not None:
            found += 1
            yield relaxed


def _as_little_as_helps(
    change: WholeChange, problem: Problem, trials: Trials, *, short_trial: bool
) -> Relaxation | None:
    """Return a change that solves a problem, or a smaller part that suffices; None if the change does not help."""
    if not trials.succeeds(change.changed(problem), change.words, change.term, short_trial=short_trial):
        return None
    part = change.part(problem, trials.ended(trials.plans[-1]))
    if part is None:
        return change.relaxation()
    # The plan of the fully changed problem also solves the problem with only the part of the change that it uses.
    return least_change(part, problem, part.bound, trials, short_trial=short_trial, solved=True) or change.relaxation()


def binding(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Return the findings that any change must remove: proved ones, or else those measured on a pose or motion."""
    proved = tuple(finding for finding in findings if finding.proved)
    return proved or tuple(finding for finding in findings if finding.kind in CERTAIN)


def candidates(
    problem: Problem,
    findings: tuple[Finding, ...],
    until: Deadline,
    most_omitted: int = _MOST_OMITTED,
) -> Iterator[Parameter | WholeChange]:
    """Yield changes that may remove all proved causes of failure, or all likely ones if none is proved.

    The most promising changes come first.

    Args:
        problem: the problem without a plan.
        findings: the known obstructions.
        until: deadline of the search for candidates.
        most_omitted: maximum number of changes that remove an obstacle, each another one.
    """
    proved = binding(findings)
    relevant = proved or findings
    keys = [key for finding in relevant for key in finding.bounds]
    # Every proved finding must be resolved, or there is still no plan.
    mends = {key for key in keys if not proved or all(key in finding.bounds for finding in proved)}
    fitting = [each for each in parameters_of(problem) if each.key in mends and each.fits(problem)]
    yield from sorted(fitting, key=lambda each: keys.index(each.key))
    room = larger_bounds(problem, proved)
    if room is not None:
        yield room
    removable = _removable(proved, findings)
    in_the_way = [without_obstacle(name) for name in removable[:most_omitted]]
    # If no parameter helps, removing the obstacle that blocks all paths is more relevant than moving the goal.
    if not fitting:
        yield from in_the_way
    yield from moved_goals(problem, proved, until)
    yield from omissions(problem, relevant)
    if fitting:
        yield from in_the_way


def _removable(proved: tuple[Finding, ...], findings: tuple[Finding, ...]) -> list[str]:
    """Return obstacles whose removal may resolve all proved findings, or else likely ones; never the boundary."""
    names = [name for finding in proved or findings for name in finding.obstacles if name not in WORKSPACE_NAMES]
    restoration = [name for name in names if all(name in finding.obstacles for finding in proved)]
    return list(dict.fromkeys(restoration))


def hardest_bound(parameter: Parameter, findings: tuple[Finding, ...]) -> float | None:
    """Return the value that a parameter must reach to remove all findings; None if the findings give no bound."""
    bounds = [finding.bounds[parameter.key] for finding in findings if parameter.key in finding.bounds]
    if not bounds:
        return None
    return max(bounds) if parameter.easier > 0 else min(bounds)


def least_change(
    parameter: Parameter,
    problem: Problem,
    bound: float | None,
    trials: Trials,
    *,
    short_trial: bool = False,
    solved: bool = False,
) -> Relaxation | None:
    """Return the least change of a parameter, among stepwise larger ones, that solves a problem; None if none is found.

    Args:
        parameter: the parameter to change.
        problem: the problem without a plan.
        bound: the value that the parameter must at least reach, or None if unknown.
        trials: solves changed problems.
        short_trial: whether another helpful change is already known, so that the time limit for further changes
            applies.
        solved: whether the last plan of the trials may also solve the problems that are tried.
    """
    settings = trials.settings
    begin = parameter.read(problem) if bound is None else bound
    steps = _GUESSED_STEPS if bound is None else _STEPS
    failed = [begin]
    for tried in parameter.tried or tuple(begin * (1.0 + parameter.easier * step) for step in steps):
        value = parameter.rounded(problem, tried)
        if trials.until.left < _LEAST_TIME or (short_trial and trials.spent > settings.patience):
            return None
        changed = parameter.write(problem, value)
        words = parameter.relaxation(problem, value, bound).words
        if (solved and trials.holds(changed)) or trials.succeeds(
            changed, words, key=parameter.key, short_trial=short_trial
        ):
            nearest = _closed_in(parameter, problem, failed, value, trials, short_trial=short_trial)
            trials.failed.pop(parameter.key, None)
            return parameter.relaxation(problem, nearest, bound)
        failed.append(value)
    return None


def _closed_in(
    parameter: Parameter, problem: Problem, failed: Sequence[float], worked: float, trials: Trials, *, short_trial: bool
) -> float:
    """Return a value that works close to one that failed, by bisection as long as time remains.

    Args:
        parameter: the parameter to change.
        problem: the problem without a plan.
        failed: values without a plan, the easiest last; the first is the bound, which was not tried.
        worked: the value for which the last plan of the trials was found.
        trials: solves changed problems.
        short_trial: whether another helpful change is already known, so that the time limit for further changes
            applies.
    """
    settings = trials.settings
    worst = failed[-1]
    # A plan for one value often also works for a harder one, which can be checked without a search.
    for value in failed[1:] if parameter.paths_stay else ():
        if trials.holds(parameter.write(problem, value)):
            return value
    while abs(worked - worst) > _CLOSE * abs(worked) and trials.until.left > _LEAST_TIME:
        middle = parameter.rounded(problem, 0.5 * (worst + worked))
        changed = parameter.write(problem, middle)
        words = parameter.relaxation(problem, middle, None).words
        # Refining a known relaxation is useful, but not worth waiting for.
        late = trials.spent > settings.patience
        if short_trial and late:
            return worked
        solved = parameter.paths_stay and trials.holds(changed)
        if solved or trials.succeeds(changed, words, key=parameter.key, short_trial=short_trial or late):
            worked = middle
        else:
            worst = middle
    return worked
