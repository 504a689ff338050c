"""What is refused before anything is planned, why there is no plan, and what change would help."""

from dataclasses import replace

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.checks import AT_ONCE, BUT_WAYS, NECESSARY, failed, hopeless, no_way
from ccm_opt.diagnosis.contact import joint_words, overloaded
from ccm_opt.diagnosis.likely import likely, unit_hints
from ccm_opt.diagnosis.parameters import Parameter, WholeChange
from ccm_opt.diagnosis.ranking import closed_off, ranked, refuse
from ccm_opt.diagnosis.relaxation import Trials, binding, candidates, hardest_bound, relaxations
from ccm_opt.errors import Diagnosis, Finding, NoPlanFound, Relaxation
from ccm_opt.problem import Problem

_ADVISED_STEPS = (0.0, 0.25, 0.6, 1.0)
"""How far beyond its bound a change is looked at by the necessary checks alone, where every try failed, as a share of
the bound. Taste."""


def with_proof(problem: Problem, error: NoPlanFound) -> NoPlanFound:
    """The same error with what proves that there is no plan, if anything does; no change of the problem is tried."""
    old = error.diagnosis
    findings = old.findings or ranked(failed(problem))
    reason = findings[0].reason if findings and not old.findings else old.reason
    return type(error)(replace(old, reason=reason, findings=findings, advice=(*unit_hints(problem), *old.advice)))


def explained(problem: Problem, error: NoPlanFound, trials: Trials, stages: Stages | None = None) -> NoPlanFound:
    """Return the same error with all that is known of why, and the changes with which the problem was solved.

    Args:
        problem: what was asked.
        error: how the pipeline ended.
        trials: solves changed problems in the time that is left.
        stages: told what is known as soon as it is.
    """
    stages = stages or Stages()
    checked = failed(problem)
    # What is proved leaves no use for what is likely; an overload is known of the path that was found, no more.
    known = checked or _overloads(problem, error) or likely(problem, trials.until)
    old = error.diagnosis
    hints = unit_hints(problem)
    stages.tell_known(_diagnosis(old, ranked(known), (), (*hints, *(() if binding(known) else old.advice))))
    solved: tuple[Relaxation, ...] = ()
    with stages("changes that would help"):
        telling = replace(trials, tell=stages.tell_change)
        for relaxation in relaxations(problem, known, telling):
            solved = tuple(sorted((*solved, relaxation), key=lambda each: each.change))
            stages.tell_known(_diagnosis(old, ranked(known, solved), solved, hints))
        # What would be needed at least is of interest where no change is known that helps.
        advice = () if solved else _advice(problem, known, trials.until) or old.advice
    return type(error)(_diagnosis(old, ranked(known, solved), solved, (*hints, *advice)))


def _overloads(problem: Problem, error: NoPlanFound) -> tuple[Finding, ...]:
    """The joint that timing found too weak to hold the arm somewhere on the path, if that is how it ended."""
    evidence = error.diagnosis.evidence
    number, torque, place = (evidence.get(name) for name in ("revolute", "torque", "path_position"))
    if problem.limits.torque is None or not isinstance(number, int) or not isinstance(torque, float):
        return ()
    where = f"at {place:.1%} of the path " if isinstance(place, float) else "on the path "
    return (overloaded(problem, f"{where}{joint_words(problem.arm, number)}", number, torque),)


def _diagnosis(
    old: Diagnosis, findings: tuple[Finding, ...], solved: tuple[Relaxation, ...], advice: tuple[str, ...]
) -> Diagnosis:
    """Return the old diagnosis with what was found; a proof takes the place of its reason."""
    reason = findings[0].reason if binding(findings[:1]) else old.reason
    return Diagnosis(reason, old.stage, advice, old.evidence, findings, solved)


def _advice(problem: Problem, findings: tuple[Finding, ...], until: Deadline) -> tuple[str, ...]:
    """What would be needed at least, as far as is known, when no try of it succeeded.

    Nothing is advised of which the necessary checks prove that it is not enough.
    """
    proved = tuple(finding for finding in findings if finding.proved)
    words = []
    enough = Deadline.after(1.0)
    for candidate in candidates(problem, proved, until) if proved else ():
        if enough.passed():
            break
        if isinstance(candidate, WholeChange):
            words += [] if hopeless(candidate.changed(problem), enough) else [candidate.words]
        elif (bound := candidate.bound or hardest_bound(candidate, proved)) is not None:
            value = _least_with_hope(problem, candidate, bound, enough)
            words += [] if value is None else [f"{candidate.relaxation(problem, value, bound).words} at least"]
    return tuple(f"{each}, though no solve has shown that it is enough" for each in words)


def _least_with_hope(
    problem: Problem,
    candidate: Parameter,
    bound: float,
    until: Deadline,
) -> float | None:
    """The least change, from the bound on, that the necessary checks let pass; None where none of them does."""
    beyond = tuple(bound * (1.0 + step) ** candidate.easier for step in _ADVISED_STEPS)
    for tried in candidate.tried or beyond:
        value = candidate.rounded(problem, tried)
        if not hopeless(candidate.write(problem, value), until):
            return value
    return None


FEW_OBSTACLES = 30
"""Among so many what closes the ways is found in half a second. Measured: 0.02 s a look, and some thirty looks."""


def refuse_impossible(problem: Problem) -> None:
    """Refuse a problem of which a check that costs next to nothing proves that it has no plan.

    Raises:
        UnreachableGoal: with the findings.
    """
    refuse(ranked(failed(problem, AT_ONCE)))


def refuse_hopeless(problem: Problem) -> None:
    """Refuse a problem of which any of the necessary checks proves that it has no plan, as soon as that is known.

    What closes the ways in space, or among many obstacles, is for those to say who explain the failure.

    Raises:
        UnreachableGoal: with the findings; without where no way will do and to say why takes long.
    """
    at_once = problem.dimension == 2 and len(problem.workspace.obstacles) <= FEW_OBSTACLES
    refuse(ranked(failed(problem, NECESSARY if at_once else BUT_WAYS)))
    if not at_once and no_way(problem, Deadline.after(0.5 * problem.planner.time_limit)):
        raise closed_off(problem)


def refuse_closed(problem: Problem) -> None:
    """Refuse a problem of which any of the necessary checks proves that it has no plan.

    Raises:
        UnreachableGoal: with the findings.
    """
    refuse(ranked(failed(problem)))
