"""A verified plan, and the checks that it passes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.errors import VerificationError
from ccm_opt.core.length_words import file_length
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointPath, JointStates, JointTrajectory, TryRecord
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.verifier import verify

if TYPE_CHECKING:
    from ccm_opt.ik.compiled_terms import UserTerms


@dataclass(frozen=True)
class TermResults:
    """What a motion makes of the user's constraints and costs.

    Attributes:
        checks: one for each constraint.
        figures: residuals of the constraints and values of the costs, by name.
    """

    checks: tuple[Check, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class VerifiedPlan:
    """A motion that passes every check.

    Attributes:
        path: the way, of all legs end to end.
        trajectory: the same in time.
        joints: the same for all drives.
        checks: of the verifier.
        of_terms: what the motion makes of the user's constraints and costs.
        tries: what came of every try, where several were asked for.
    """

    path: JointPath
    trajectory: JointTrajectory
    joints: JointStates
    checks: tuple[Check, ...]
    of_terms: TermResults
    tries: tuple[TryRecord, ...] = ()


def results_of_terms(
    terms: "UserTerms | None",
    path: JointPath,
    trajectory: JointTrajectory,
) -> TermResults:
    """What a motion makes of the user's constraints and costs; nothing when there are none."""
    if terms is None:
        return TermResults()
    from ccm_opt.ik import term_checks  # noqa: PLC0415 - most problems have no constraints of the user

    return TermResults(*term_checks.results_of_terms(terms, path, trajectory))


def worst_of_legs(legs: Sequence[TermResults]) -> TermResults:
    """The checks of all legs, each with the number of its goal, and of every figure the one farthest from zero."""
    checks = [
        replace(check, name=f"{check.name}, goal {number}")
        for number, leg in enumerate(legs, start=1)
        for check in leg.checks
    ]
    # Every leg was solved with the same terms, so the names of the first are those of all.
    figures = {name: float(np.max(np.abs([leg.figures[name] for leg in legs]))) for name in legs[0].figures}
    return TermResults(tuple(checks), figures)


def failed_checks(checks: Sequence[Check]) -> list[str]:
    """What the checks that do not hold say."""
    return [f"{check.name}: {_value(check)} at {check.where}" for check in checks if not check.passed]


def _value(check: Check) -> str:
    """The worst value of a check, lengths in the unit of the problem's file."""
    return file_length(check.worst, 6) if check.unit == "m" else f"{check.worst:.6g} {check.unit}"


def verified(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> tuple[Check, ...]:
    """Check a motion that has to pass; arguments as for ``verify``.

    Raises:
        VerificationError: naming the checks that fail.
    """
    checks = verify(problem, trajectory, joints, settings)
    if failures := failed_checks(checks):
        raise VerificationError(failures)
    return checks
