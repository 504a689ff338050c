"""The least change with which a problem is solved."""

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
from ccm_opt.diagnosis.gaps import ROOM_NAMES
from ccm_opt.diagnosis.moved_goal import left_out, moved_goals
from ccm_opt.diagnosis.parameters import PARAMETERS, Parameter, WholeChange, wider_room, without_obstacle, without_term
from ccm_opt.problem import Problem

_STEPS = (0.045, 0.1, 0.2, 0.4)
"""How far beyond its bound a parameter is tried, as a share of the bound, until a try succeeds. Taste."""
_CLOSE = 0.048
"""Share of its value within which a parameter is bracketed by what failed, or cannot be, and what worked. Derived: just
more than the first step is of the value after it, so that a try that succeeds there need not be repeated."""
_LEAST_TIME = 0.05
"""No try begins with less time than this [s]. Taste."""
_ENOUGH = 4
"""Relaxations that are reported. Taste."""

_GUESSED_STEPS = (0.1, 0.25, 0.5)
"""The same where the bound is only where the problem stands. Taste."""
_TRY_SHARE = 0.5
"""Share of the time left that one try may use. Taste."""
_MOST_DROPPED = 3
"""Constraints and costs of the user's that are dropped in a try of their own. Taste."""
_MOST_OMITTED = 2
"""Obstacles that are left out in a try of their own. Taste."""

Solve: TypeAlias = Callable[..., object]
"""Plans, times and verifies a problem, perhaps with one constraint or cost of the user's dropped, by its name, or
raises; what it returns is not looked at."""
CERTAIN = frozenset(("torque", "contact", "joint limit"))
"""Kinds of findings that are measured on a pose or a path; not proved, they leave other poses within tolerance."""
HoldAgain: TypeAlias = Callable[[Any, object], object]
"""Times and verifies what was returned for one problem as a plan for another, or raises."""


def _never_holds(problem: Problem, plan: object) -> object:
    raise ProblemError(f"{type(plan).__name__} is no plan for problem '{problem.name}'")


@dataclass(frozen=True)
class Trials:
    """Solves changed problems, each within a share of the time that is left.

    Attributes:
        solve: solves a problem, perhaps less one of the terms by its name, or raises.
        until: when all must end.
        terms: kind and name of each constraint and cost of the user's, the likelier ones to be in the way first.
        hold_again: holds what solved one problem against another.
        begun: CPU time of this process from which on the time for reasons and changes counts [s].
        tell: told of every change before it is tried, in words, with the time spent so far and the most [s].
        ended: the configuration in which what was returned for a problem ends, shape (c,).
        settings: steps, and shares of the time.
        plans: what solved the problems that were tried, in their order.
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

    @property
    def spent(self) -> float:
        """CPU time since the trials were set up, as soon as there was a reason [s]."""
        return time.process_time() - self.begun

    def succeeds(self, problem: Problem, words: str, dropped: str = "", *, hurried: bool = False) -> bool:
        """Return whether a problem, perhaps less a term of the user's, is solved within its share of the time.

        Args:
            problem: what is tried.
            words: what is changed in it.
            dropped: name of a constraint or cost that is left out besides.
            hurried: whether something else helps already.
        """
        settings = self.settings
        longest = settings.longest_further_try if hurried else settings.longest_try
        # A share of what is left, so that several things can be tried.
        limit = min(_TRY_SHARE * self.until.left, longest)
        if limit < _LEAST_TIME:
            return False
        limited = _in_haste(problem, limit)
        self.tell(words, self.spent, settings.longest_search)
        try:
            plan = self.solve(limited, dropped) if dropped else self.solve(limited)
        except (NoPlanFound, VerificationError, ProblemError):
            return False
        self.plans.append(plan)
        return True

    def holds(self, problem: Problem) -> bool:
        """Return whether the last plan is one for this problem as well; nothing is planned for that."""
        try:
            self.hold_again(problem, self.plans[-1])
        except (NoPlanFound, VerificationError, ProblemError):
            return False
        return True


def _in_haste(problem: Problem, limit: float) -> Problem:
    """Return the problem with a time limit [s], and with nothing asked for that only makes motions better."""
    # An arm that is hardly strong enough may need the shorter way.
    plain = problem.planner.optimiser if problem.limits.torque is not None else "none"
    return replace(problem, planner=replace(problem.planner, time_limit=limit, optimiser=plain, wanted_gap=0.0))


def relaxations(problem: Problem, findings: tuple[Finding, ...], trials: Trials) -> Iterator[Relaxation]:
    """Find changes of one thing with which the problem is solved, the most promising first.

    Args:
        problem: what was asked.
        findings: what stands in its way; what is proved, or an overload on the path that was found, binds.
        trials: solves.
    """
    certain = binding(findings)
    settings = trials.settings
    found = 0
    # Nothing of the user's own mends what is known of the arm and the room.
    dropped = [] if certain else [without_term(name, kind) for kind, name in trials.terms[:_MOST_DROPPED]]
    for candidate in chain(dropped, candidates(problem, findings, trials.until, _MOST_OMITTED)):
        if found >= _ENOUGH or trials.until.left < _LEAST_TIME:
            break
        if found and trials.spent > settings.patience:
            break
        if isinstance(candidate, WholeChange):
            relaxed = _as_little_as_helps(candidate, problem, trials, hurried=bool(found))
        else:
            bound = hardest_bound(candidate, certain) if candidate.bound is None else candidate.bound
            relaxed = least_change(candidate, problem, bound, trials, hurried=bool(found))
        if relaxed is not None:
            found += 1
            yield relaxed


def _as_little_as_helps(change: WholeChange, problem: Problem, trials: Trials, *, hurried: bool) -> Relaxation | None:
    """Return a change with which the problem is solved, or as much of it as is needed; None where it is not solved."""
    if not trials.succeeds(change.changed(problem), change.words, change.term, hurried=hurried):
        return None
    part = change.part(problem, trials.ended(trials.plans[-1]))
    if part is None:
        return change.relaxation()
    # What solved the problem with the whole change solves it with that part of it which it made use of.
    return least_change(part, problem, part.bound, trials, hurried=hurried, solved=True) or change.relaxation()


def binding(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """What any change has to mend: what is proved, or else what is known of the pose or the path that was asked for."""
    proved = tuple(finding for finding in findings if finding.proved)
    return proved or tuple(finding for finding in findings if finding.kind in CERTAIN)


def candidates(
    problem: Problem,
    findings: tuple[Finding, ...],
    until: Deadline,
    most_omitted: int = _MOST_OMITTED,
) -> Iterator[Parameter | WholeChange]:
    """Yield what may mend all that is proved, or else all that is likely, most promising first.

    Args:
        problem: what was asked.
        findings: what stands in its way.
        until: when nothing more is looked for.
        most_omitted: obstacles that are left out, each alone.
    """
    proved = binding(findings)
    relevant = proved or findings
    keys = [key for finding in relevant for key in finding.bounds]
    # Of what is proved, every single finding has to be mended, or there is still no plan.
    mends = {key for key in keys if not proved or all(key in finding.bounds for finding in proved)}
    fitting = [each for each in PARAMETERS if each.key in mends and each.fits(problem)]
    yield from sorted(fitting, key=lambda each: keys.index(each.key))
    room = wider_room(problem, proved)
    if room is not None:
        yield room
    removable = _removable(proved, findings)
    in_the_way = [without_obstacle(name) for name in removable[:most_omitted]]
    # Where no number of the arm helps, what closes the way is more to the point than a goal on this side of it.
    if not fitting:
        yield from in_the_way
    yield from moved_goals(problem, proved, until)
    yield from left_out(problem, relevant)
    if fitting:
        yield from in_the_way


def _removable(proved: tuple[Finding, ...], findings: tuple[Finding, ...]) -> list[str]:
    """Return the obstacles whose removal may mend all that is proved, or else all that is likely; the room stays."""
    names = [name for finding in proved or findings for name in finding.obstacles if name not in ROOM_NAMES]
    mending = [name for name in names if all(name in finding.obstacles for finding in proved)]
    return list(dict.fromkeys(mending))


def hardest_bound(parameter: Parameter, findings: tuple[Finding, ...]) -> float | None:
    """Return the value that a parameter must reach to mend all findings; None when they say nothing about it."""
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
    hurried: bool = False,
    solved: bool = False,
) -> Relaxation | None:
    """Return the least change of a parameter, within the steps, with which the problem is solved.

    None when none is found.

    Args:
        parameter: what is changed.
        problem: what was asked.
        bound: the value that it must pass, or None when that is not known.
        trials: solves.
        hurried: whether something else helps already, so that patience counts.
        solved: whether the last plan of the trials may be one for the values that are tried, too.
    """
    settings = trials.settings
    begin = parameter.read(problem) if bound is None else bound
    steps = _GUESSED_STEPS if bound is None else _STEPS
    failed = [begin]
    for tried in parameter.tried or tuple(begin * (1.0 + parameter.easier * step) for step in steps):
        value = parameter.rounded(problem, tried)
        if trials.until.left < _LEAST_TIME or (hurried and trials.spent > settings.patience):
            return None
        changed = parameter.write(problem, value)
        words = parameter.relaxation(problem, value, bound).words
        if (solved and trials.holds(changed)) or trials.succeeds(changed, words, hurried=hurried):
            nearest = _closed_in(parameter, problem, failed, value, trials, hurried=hurried)
            return parameter.relaxation(problem, nearest, bound)
        failed.append(value)
    return None


def _closed_in(
    parameter: Parameter, problem: Problem, failed: Sequence[float], worked: float, trials: Trials, *, hurried: bool
) -> float:
    """Return a value that works, close to one that does not, by bisection while there is time.

    Args:
        parameter: what is changed.
        problem: what was asked.
        failed: values with which nothing was found, the first of which perhaps nothing can be; the easiest last.
        worked: a value with which the last plan of the trials was found.
        trials: solves.
        hurried: whether something else helps already, so that patience counts.
    """
    settings = trials.settings
    worst = failed[-1]
    # What moves the arm at one value often does so at the next: to see that takes no search.
    for value in failed[1:] if parameter.paths_stay else ():
        if trials.holds(parameter.write(problem, value)):
            return value
    while abs(worked - worst) > _CLOSE * abs(worked) and trials.until.left > _LEAST_TIME:
        middle = parameter.rounded(problem, 0.5 * (worst + worked))
        changed = parameter.write(problem, middle)
        words = parameter.relaxation(problem, middle, None).words
        # What is known already is worth being told more exactly, but not worth waiting for.
        late = trials.spent > settings.patience
        if hurried and late:
            return worked
        if (parameter.paths_stay and trials.holds(changed)) or trials.succeeds(changed, words, hurried=hurried or late):
            worked = middle
        else:
            worst = middle
    return worked
