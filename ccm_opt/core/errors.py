"""Hierarchy of all exceptions of the package, with records of why a problem has no plan.

::

    CcmError ├── ProblemError            the input cannot be used                              exit code 2 │   └──
    ProblemFileError    all issues of a problem file, with key path and line ├── NoPlanFound             the input is
    sound, but no plan was found             exit code 3 │   ├── UnreachableGoal     a necessary condition fails before
    any search │   ├── ConfigurationNotFound  no goal configuration in any corridor tried │   ├── MotionNotFound      no
    candidate motion reached the goal │   ├── TimeLimitReached    the time limit passed first │   ├── RetimingError
    the path cannot be timed within the limits │   └── SimulationError     the simulated arm left the finite world ├──
    VerificationError       a plan, or a folder, that the verifier rejects        exit code 3 └── NativeLibraryError
    the compiled library is missing or an old one         exit code 2

    KeyboardInterrupt └── CancelledWithPlan       Ctrl-C once there is a verified plan                  exit code 130
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


class CcmError(Exception):
    """Base class of all errors that this package raises deliberately."""


class NativeLibraryError(CcmError):
    """The compiled library is missing or out of date; the message says how to build the library."""


class ProblemError(CcmError):
    """The problem cannot be used as given; the message states actual and expected value, and a remedy."""


@dataclass(frozen=True, order=True)
class FileIssue:
    """One defect of a problem file.

    Attributes:
        line: line in the file, counted from 1; 0 if the defect has no line.
        key: dotted key path, for example ``workspace.obstacles[2].polygon``.
        message: text that states the actual and the expected value.
        setting: the override ``key.path=value`` that causes the defect; empty if the file itself does.
    """

    line: int
    key: str
    message: str
    setting: str = ""

    def __str__(self) -> str:
        if self.setting:
            return f"--set {self.setting}: {self.message}"
        place = f"line {self.line}: " if self.line else ""
        return f"{place}{self.key}: {self.message}" if self.key else f"{place}{self.message}"


MOST_LISTED = 100
"""Largest number of defects that are listed for one problem file."""


class ProblemFileError(ProblemError):
    """All defects of one problem file; the message lists the first hundred by line, and counts the others."""

    def __init__(self, path: str, issues: Sequence[FileIssue]) -> None:
        self.path = path
        self.issues = tuple(sorted(issues)[:MOST_LISTED])
        lines = [f"  {issue}" for issue in self.issues]
        if len(issues) > len(lines):
            lines.append(f"  and {len(issues) - len(lines)} more")
        super().__init__(f"{path} has {len(issues)} error{'s' if len(issues) > 1 else ''}:\n" + "\n".join(lines))


@dataclass(frozen=True)
class Finding:
    """An obstruction that prevents, or probably prevents, a plan.

    Attributes:
        kind: "constraint", "contact", "joint limit", "too short", "too thick", "blocked", "hemmed in", "too stiff",
            "torque" or "curve".
        reason: the obstruction in the user's terms, with its position and size; a short sentence, with details after
            semicolons.
        proved: whether no planner could find a plan while this obstruction remains; otherwise it is merely a likely
            cause.
        key: key concerned in the problem file, or empty.
        place: position, (x, y) or in space (x, y, z) [m], or None.
        measured: value found, in ``unit``, or None.
        allowed: value with which ``measured`` is compared, in ``unit``, or None.
        unit: unit of ``measured`` and ``allowed``.
        obstacles: names of the walls involved, the most important first.
        way: points, in order, along a path of the arm's axis that is too long, or too narrow at ``place`` [m]; else
            empty.
        bounds: for each parameter that may remove the obstruction (by its key in the problem file, SI units, radians)
            the value that the parameter must at least reach.
    """

    kind: str
    reason: str
    proved: bool = True
    key: str = ""
    place: tuple[float, ...] | None = None
    measured: float | None = None
    allowed: float | None = None
    unit: str = "m"
    obstacles: tuple[str, ...] = ()
    way: tuple[tuple[float, ...], ...] = ()
    bounds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Relaxation:
    """A change of a problem with which the problem was solved, including timing and verification.

    Attributes:
        words: text for the change, for example "arm.radius ≤ 20.9 mm".
        key: key of the change in the problem file.
        value: value with which the problem was solved (SI units, radians), or a factor if ``words`` say "times"; the
            name of an omitted obstacle; None for an omitted key.
        bound: value that the parameter must at least reach, as far as is known, or None.
        change: relative size of the change; 1 for an omission.
    """

    words: str
    key: str
    value: float | str | None
    bound: float | None = None
    change: float = 1.0


@dataclass(frozen=True)
class Diagnosis:
    """Explanation, in the user's terms, of why there is no plan.

    Attributes:
        reason: the obstruction, its position and its size: a short sentence, with details after semicolons.
        stage: stage of the pipeline that failed.
        advice: possible remedies, most promising first.
        evidence: figures behind the reason; JSON-serialisable values.
        findings: obstructions found, most important first.
        relaxations: single changes with which the problem was solved, the smallest first.
        failed_changes: texts for single changes with which no plan was found, either, within the time limit of each.
    """

    reason: str
    stage: str
    advice: tuple[str, ...] = ()
    evidence: Mapping[str, object] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    relaxations: tuple[Relaxation, ...] = ()
    failed_changes: tuple[str, ...] = ()

    @property
    def proved(self) -> bool:
        """Whether it is proved that no plan exists, rather than only that none was found."""
        return any(finding.proved for finding in self.findings)

    def __str__(self) -> str:
        first, *details = sentences(self.reason)
        others = [finding for finding in self.findings if finding.reason != self.reason]
        also = [f"  {'also' if finding.proved else 'perhaps'}: {finding.reason}" for finding in others]
        solved = [f"  solved with {relaxation.words}" for relaxation in self.relaxations]
        failed = [f"  not solved with {words}" for words in self.failed_changes]
        return "\n".join(
            (
                *(first, *(f"    {line}" for line in details), *also, *solved, *failed),
                *(f"  try: {line}" for line in self.advice),
            )
        )


def sentences(reason: str) -> tuple[str, ...]:
    """Return the parts of a reason, separated by semicolons; the first is the most important."""
    return tuple(reason.split("; "))


class NoPlanFound(CcmError):  # noqa: N818 - it names a result, not a defect
    """No plan was found for a valid problem; ``diagnosis`` explains why."""

    unproved_status = "no plan found"

    def __init__(self, diagnosis: Diagnosis) -> None:
        self.diagnosis = diagnosis
        super().__init__(str(diagnosis))

    @property
    def status(self) -> str:
        """Status written to ``solution.json``; "infeasible" only if a finding proves that there is no plan."""
        return "infeasible" if self.diagnosis.proved else self.unproved_status


class UnreachableGoal(NoPlanFound):
    """A necessary condition for a plan fails before any search: out of reach, contact at start or goal, or no route."""


class ConfigurationNotFound(NoPlanFound):
    """No goal configuration of the curve was found in any corridor tried."""


class MotionNotFound(NoPlanFound):
    """None of the motions tried reached the goal."""


class TimeLimitReached(NoPlanFound):
    """The time limit passed before a plan was found."""

    unproved_status = "timed-out"


class RetimingError(NoPlanFound):
    """The joint path cannot be timed within the limits."""


class SimulationError(NoPlanFound):
    """A simulation cannot run, because of unstable gains or singular joints, or met a non-finite state."""


class VerificationError(CcmError):
    """The independent verifier rejects a plan or an output folder; ``failures`` lists the reasons."""

    def __init__(self, failures: Sequence[str]) -> None:
        self.failures = tuple(failures)
        super().__init__("the verifier rejects this plan:\n" + "\n".join(f"  {line}" for line in self.failures))


class CancelledWithPlan(KeyboardInterrupt):
    """Ctrl-C was pressed after a plan was verified; ``solution`` is the plan with the results so far."""

    def __init__(self, solution: Any) -> None:
        self.solution = solution
        super().__init__("cancelled, with a verified plan at hand")
