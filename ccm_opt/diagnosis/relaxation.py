"""The least change of one thing with which a problem is solved: tried by solving, within the time that is left."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from ccm_opt.diagnosis.parameters import PARAMETERS, Omission, Parameter, without_heading, without_obstacle
from ccm_opt.errors import Finding, NoPlanFound, ProblemError, Relaxation, TimeLimitReached, VerificationError
from ccm_opt.freespace.workspace import BOUNDARY_NAME
from ccm_opt.problem import Problem

Solve: TypeAlias = Callable[[Problem], object]
"""Plans, times and verifies a problem, or raises; what it returns is not looked at."""
STEPS = (0.045, 0.1, 0.2, 0.4)
"""How far beyond its bound a parameter is tried, as a share of the bound, until a try succeeds."""
GUESSED_STEPS = (0.1, 0.25, 0.5)
"""The same where the bound is only where the problem stands."""
CLOSE = 0.046
"""Share of its value within which a parameter is bracketed by what failed, or cannot be, and what worked."""
LEAST_TIME = 0.05
"""No try begins with less time than this [s]."""
TRY_SHARE = 0.5
"""Share of the time left that one try may use."""
LONGEST_TRY = 2.5
"""CPU time that one try may use at most [s]."""
LONGEST_SEARCH = 8.0
"""CPU time that all tries may use together, however much is left [s]."""
STARVED = 0.5
"""A try that got less than this share of the CPU time that one may use did not get its chance."""
ATTEMPTS = 2
"""Tries of one problem, when the first was starved."""
PATIENCE = 2.0
"""CPU time after which nothing new is begun when something that helps is known [s]."""
ENOUGH = 4
"""Relaxations that are told."""
MOST_OMITTED = 2
"""Obstacles that are left out in a try of their own."""


@dataclass(frozen=True)
class Trials:
    """Solves changed problems, each within a share of the time that is left.

    How long to try is counted in CPU time, so that a busy machine finds the same; the user's limit is wall time.

    Attributes:
        solve: solves a problem or raises.
        until: monotonic time at which all must end [s].
        begun: monotonic time and CPU time at which the trials began [s].
    """

    solve: Solve
    until: float
    begun: tuple[float, float] = field(default_factory=lambda: (time.monotonic(), time.process_time()))

    @property
    def spent(self) -> float:
        """CPU time since the trials began [s]."""
        return time.process_time() - self.begun[1]

    @property
    def slowness(self) -> float:
        """Wall time that a second of CPU time takes on this machine now."""
        return max(1.0, (time.monotonic() - self.begun[0]) / self.spent) if self.spent > LEAST_TIME else 1.0

    @property
    def left(self) -> float:
        """Wall time that is left [s]."""
        return min(self.until - time.monotonic(), (LONGEST_SEARCH - self.spent) * self.slowness)

    def succeeds(self, problem: Problem) -> bool:
        """Whether a problem is solved within its share of the time; a try that a busy machine starved is repeated."""
        for _ in range(ATTEMPTS):
            limit = min(TRY_SHARE * self.left, LONGEST_TRY * self.slowness)
            before = self.spent
            if limit < LEAST_TIME:
                return False
            try:
                self.solve(replace(problem, planner=replace(problem.planner, time_limit=limit)))
            except TimeLimitReached:
                if self.spent - before > STARVED * LONGEST_TRY:
                    return False
            except (NoPlanFound, VerificationError, ProblemError):
                return False
            else:
                return True
        return False


def relaxations(problem: Problem, findings: tuple[Finding, ...], trials: Trials) -> tuple[Relaxation, ...]:
    """Changes of one thing with which the problem is solved, the smallest first.

    Args:
        problem: what was asked.
        findings: what stands in its way; what is proved, or an overload on the path that was found, binds.
        trials: solves.
    """
    binding = tuple(f for f in findings if f.proved) or tuple(f for f in findings if f.kind == "torque")
    found: list[Relaxation] = []
    for candidate in candidates(problem, findings):
        if len(found) >= ENOUGH or trials.left < LEAST_TIME or (found and trials.spent > PATIENCE):
            break
        if isinstance(candidate, Omission):
            relaxed = candidate.relaxation() if trials.succeeds(candidate.changed(problem)) else None
        else:
            relaxed = least_change(candidate, problem, hardest_bound(candidate, binding), trials)
        if relaxed is not None:
            found.append(relaxed)
    return tuple(sorted(found, key=lambda relaxed: relaxed.change))


def candidates(problem: Problem, findings: tuple[Finding, ...]) -> Iterator[Parameter | Omission]:
    """What may mend all that is proved, or else all that is likely, most promising first."""
    proved = tuple(finding for finding in findings if finding.proved)
    relevant = proved or findings
    keys = [key for finding in relevant for key in finding.bounds]
    mends = {key for key in keys if not proved or all(key in finding.bounds for finding in proved)}
    fitting = [each for each in PARAMETERS if each.key in mends and each.fits(problem)]
    yield from sorted(fitting, key=lambda each: keys.index(each.key))
    if relevant and all(_heading_may_mend(finding) for finding in relevant):
        heading = without_heading(problem)
        yield from () if heading is None else (heading,)
    yield from (without_obstacle(name) for name in _removable(proved, findings)[:MOST_OMITTED])


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


def least_change(parameter: Parameter, problem: Problem, bound: float | None, trials: Trials) -> Relaxation | None:
    """The least change of a parameter, within the steps, with which the problem is solved; None when none is found.

    Args:
        parameter: what is changed.
        problem: what was asked.
        bound: the value that it must pass, or None when that is not known.
        trials: solves.
    """
    failed = begin = parameter.read(problem) if bound is None else bound
    for step in GUESSED_STEPS if bound is None else STEPS:
        value = parameter.rounded(problem, begin * (1.0 + parameter.easier * step))
        if trials.left < LEAST_TIME:
            return None
        if trials.succeeds(parameter.write(problem, value)):
            return parameter.relaxation(problem, _closed_in(parameter, problem, failed, value, trials), bound)
        failed = value
    return None


def _closed_in(parameter: Parameter, problem: Problem, failed: float, worked: float, trials: Trials) -> float:
    """A value that works, close to one that does not, by bisection while there is time."""
    while abs(worked - failed) > CLOSE * abs(worked) and trials.left > LEAST_TIME:
        middle = parameter.rounded(problem, 0.5 * (failed + worked))
        if trials.succeeds(parameter.write(problem, middle)):
            worked = middle
        else:
            failed = middle
    return worked
