"""The least change of one thing with which a problem is solved: tried by solving, within the time that is left."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TypeAlias

from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, TrialSettings
from ccm_opt.diagnosis.moved_goal import moved_goals
from ccm_opt.diagnosis.parameters import (
    PARAMETERS,
    Parameter,
    WholeChange,
    without_heading,
    without_obstacle,
    without_term,
)
from ccm_opt.diagnosis.wider_room import wider_room
from ccm_opt.errors import Finding, NoPlanFound, ProblemError, Relaxation, VerificationError
from ccm_opt.freespace.workspace import BOUNDARY_NAME
from ccm_opt.ground.deadline import Deadline
from ccm_opt.problem import Problem

Solve: TypeAlias = Callable[[Problem], object]
"""Plans, times and verifies a problem, or raises; what it returns is not looked at."""
CERTAIN = frozenset(("torque", "contact", "joint limit"))
"""Kinds of findings that are measured on a pose or a path; not proved, they leave other poses within tolerance."""
SolveWithout: TypeAlias = Callable[[Problem, str], object]
"""The same with one constraint or cost of the user's dropped, by its name."""
HoldAgain: TypeAlias = Callable[[Problem, object], object]
"""Times and verifies what was returned for one problem as a plan for another, or raises."""


def _nothing_to_drop(problem: Problem, name: str) -> object:
    raise ProblemError(f"problem '{problem.name}' has no constraint or cost '{name}'")


def _never_holds(problem: Problem, plan: object) -> object:
    raise ProblemError(f"{type(plan).__name__} is no plan for problem '{problem.name}'")


@dataclass(frozen=True)
class Trials:
    """Solves changed problems, each within a share of the time that is left.

    Attributes:
        solve: solves a problem or raises.
        until: when all must end.
        terms: kind and name of each constraint and cost of the user's, the likelier ones to be in the way first.
        solve_without: solves a problem less one of these, or raises.
        hold_again: holds what solved one problem against another.
        begun: CPU time of this process at which the trials began [s].
        settings: steps, and shares of the time.
        plans: what solved the problems that were tried, in their order.
    """

    solve: Solve
    until: Deadline
    terms: tuple[tuple[str, str], ...] = ()
    solve_without: SolveWithout = _nothing_to_drop
    hold_again: HoldAgain = _never_holds
    begun: float = field(default_factory=time.process_time)
    settings: TrialSettings = DEFAULT_DIAGNOSIS.trials
    plans: list[object] = field(default_factory=list)

    @property
    def spent(self) -> float:
        """CPU time since the trials began [s]."""
        return time.process_time() - self.begun

    @property
    def left(self) -> float:
        """CPU time that is left [s]."""
        return min(self.until.left, self.settings.longest_search - self.spent)

    def succeeds(self, problem: Problem, dropped: str = "", *, hurried: bool = False) -> bool:
        """Whether a problem, perhaps less a term of the user's, is solved within its share of the time.

        Args:
            problem: what is tried.
            dropped: name of a constraint or cost that is left out besides.
            hurried: whether something else helps already.
        """
        settings = self.settings
        longest = settings.longest_further_try if hurried else settings.longest_try
        # A share of what is left, so that several things can be tried.
        limit = min(settings.try_share * self.left, longest)
        if limit < settings.least_time:
            return False
        limited = _in_haste(problem, limit)
        try:
            plan = self.solve_without(limited, dropped) if dropped else self.solve(limited)
        except (NoPlanFound, VerificationError, ProblemError):
            return False
        self.plans.append(plan)
        return True

    def holds(self, problem: Problem) -> bool:
        """Whether the last plan is one for this problem as well; nothing is planned for that."""
        try:
            self.hold_again(problem, self.plans[-1])
        except (NoPlanFound, VerificationError, ProblemError):
            return False
        return True


def _in_haste(problem: Problem, limit: float) -> Problem:
    """The problem with a time limit [s], and with nothing asked for that only makes motions better."""
    # An arm that is hardly strong enough may need the shorter way.
    plain = problem.planner.optimiser if problem.limits.torque is not None else "none"
    return replace(problem, planner=replace(problem.planner, time_limit=limit, optimiser=plain, wanted_gap=0.0))


def relaxations(problem: Problem, findings: tuple[Finding, ...], trials: Trials) -> tuple[Relaxation, ...]:
    """Changes of one thing with which the problem is solved, the smallest first.

    Args:
        problem: what was asked.
        findings: what stands in its way; what is proved, or an overload on the path that was found, binds.
        trials: solves.
    """
    certain = binding(findings)
    settings = trials.settings
    found: list[Relaxation] = []
    # Nothing of the user's own mends what is known of the arm and the room.
    dropped = [] if certain else [without_term(name, kind) for kind, name in trials.terms[: settings.most_dropped]]
    for candidate in chain(dropped, candidates(problem, findings, settings.most_omitted)):
        if len(found) >= settings.enough or trials.left < settings.least_time:
            break
        if found and trials.spent > settings.patience:
            break
        if isinstance(candidate, WholeChange):
            solved = trials.succeeds(candidate.changed(problem), candidate.term, hurried=bool(found))
            relaxed = candidate.relaxation() if solved else None
        else:
            bound = hardest_bound(candidate, certain) if candidate.bound is None else candidate.bound
            relaxed = least_change(candidate, problem, bound, trials, hurried=bool(found))
        if relaxed is not None:
            found.append(relaxed)
    return tuple(sorted(found, key=lambda relaxed: relaxed.change))


def binding(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """What any change has to mend: what is proved, or else what is known of the pose or the path that was asked for."""
    proved = tuple(finding for finding in findings if finding.proved)
    return proved or tuple(finding for finding in findings if finding.kind in CERTAIN)


def candidates(
    problem: Problem, findings: tuple[Finding, ...], most_omitted: int = DEFAULT_DIAGNOSIS.trials.most_omitted
) -> Iterator[Parameter | WholeChange]:
    """What may mend all that is proved, or else all that is likely, most promising first.

    Args:
        problem: what was asked.
        findings: what stands in its way.
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
    in_the_way = [without_obstacle(name) for name in _removable(proved, findings)[:most_omitted]]
    # Where no number of the arm helps, what closes the way is more to the point than a goal on this side of it.
    if not fitting:
        yield from in_the_way
    yield from moved_goals(problem, proved)
    if relevant and all(_heading_may_mend(finding) for finding in relevant):
        heading = without_heading(problem)
        if heading is not None:
            yield heading
    if fitting:
        yield from in_the_way


def _heading_may_mend(finding: Finding) -> bool:
    """Whether a finding may be due to the heading asked for at the goal."""
    return finding.kind in {"too stiff", "contact", "curve"} and not finding.key.startswith("start")


def _removable(proved: tuple[Finding, ...], findings: tuple[Finding, ...]) -> list[str]:
    """Obstacles whose removal may mend all that is proved, or else all that is likely; the boundary stays."""
    names = [name for finding in proved or findings for name in finding.obstacles if name != BOUNDARY_NAME]
    mending = [name for name in names if all(name in finding.obstacles for finding in proved)]
    return list(dict.fromkeys(mending))


def hardest_bound(parameter: Parameter, findings: tuple[Finding, ...]) -> float | None:
    """The value that a parameter must reach to mend all findings; None when they say nothing about it."""
    bounds = [finding.bounds[parameter.key] for finding in findings if parameter.key in finding.bounds]
    if not bounds:
        return None
    return max(bounds) if parameter.easier > 0 else min(bounds)


def least_change(
    parameter: Parameter, problem: Problem, bound: float | None, trials: Trials, *, hurried: bool = False
) -> Relaxation | None:
    """The least change of a parameter, within the steps, with which the problem is solved; None when none is found.

    Args:
        parameter: what is changed.
        problem: what was asked.
        bound: the value that it must pass, or None when that is not known.
        trials: solves.
        hurried: whether something else helps already, so that patience counts.
    """
    settings = trials.settings
    if bound is None:
        begin = parameter.read(problem)
        steps = settings.guessed_steps
    else:
        begin = bound
        steps = parameter.steps or settings.steps
    failed = [begin]
    for step in steps:
        value = parameter.rounded(problem, begin * (1.0 + parameter.easier * step))
        if trials.left < settings.least_time or (hurried and trials.spent > settings.patience):
            return None
        if trials.succeeds(parameter.write(problem, value), hurried=hurried):
            nearest = _closed_in(parameter, problem, failed, value, trials, hurried=hurried)
            return parameter.relaxation(problem, nearest, bound)
        failed.append(value)
    return None


def _closed_in(
    parameter: Parameter, problem: Problem, failed: Sequence[float], worked: float, trials: Trials, *, hurried: bool
) -> float:
    """A value that works, close to one that does not, by bisection while there is time.

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
    while abs(worked - worst) > settings.close * abs(worked) and trials.left > settings.least_time:
        middle = parameter.rounded(problem, 0.5 * (worst + worked))
        changed = parameter.write(problem, middle)
        # What is known already is worth being told more exactly, but not worth waiting for.
        late = trials.spent > settings.patience
        if hurried and late:
            return worked
        if (parameter.paths_stay and trials.holds(changed)) or trials.succeeds(changed, hurried=hurried or late):
            worked = middle
        else:
            worst = middle
    return worked
