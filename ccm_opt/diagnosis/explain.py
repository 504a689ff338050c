"""What the driver asks where there is no plan: why, and what change would help."""

from dataclasses import replace

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.holding_torque import joint_words, overloaded
from ccm_opt.diagnosis.parameters import Parameter, WholeChange
from ccm_opt.diagnosis.ranking import ranked
from ccm_opt.diagnosis.relaxation import Knowledge, Trials, binding, candidates, hardest_bound, relaxations
from ccm_opt.errors import Diagnosis, Finding, NoPlanFound, Relaxation
from ccm_opt.problem.space_problem import AnyProblem

_ADVISED_STEPS = (0.0, 0.25, 0.6, 1.0)
"""How far beyond its bound a change is looked at by the necessary checks alone, where every try failed, as a share of
the bound. Taste."""


def with_proof(problem: AnyProblem, error: NoPlanFound, knowledge: Knowledge) -> NoPlanFound:
    """The same error with what proves that there is no plan, if anything does; no change of the problem is tried."""
    old = error.diagnosis
    findings = old.findings or ranked(knowledge.proved(problem))
    reason = findings[0].reason if findings and not old.findings else old.reason
    return type(error)(replace(old, reason=reason, findings=findings, advice=(*knowledge.hints(problem), *old.advice)))


def explained(
    problem: AnyProblem, error: NoPlanFound, trials: Trials, knowledge: Knowledge, stages: Stages | None = None
) -> NoPlanFound:
    """Return the same error with all that is known of why, and the changes with which the problem was solved.

    Args:
        problem: what was asked.
        error: how the pipeline ended.
        trials: solves changed problems in the time that is left.
        knowledge: of problems of its kind.
        stages: told what is known as soon as it is.
    """
    stages = stages or Stages()
    checked = knowledge.proved(problem)
    # What is proved leaves no use for what is likely; an overload is known of the path that was found, no more.
    known = checked or _overloads(problem, error) or knowledge.likely(problem)
    old = error.diagnosis
    hints = knowledge.hints(problem)
    stages.tell_known(_diagnosis(old, ranked(known), (), (*hints, *(() if binding(known) else old.advice))))
    solved: tuple[Relaxation, ...] = ()
    with stages("changes that would help"):
        telling = replace(trials, tell=stages.tell_change)
        for relaxation in relaxations(problem, known, telling, knowledge):
            solved = tuple(sorted((*solved, relaxation), key=lambda each: each.change))
            stages.tell_known(_diagnosis(old, ranked(known, solved), solved, hints))
        # What would be needed at least is of interest where no change is known that helps.
        advice = () if solved else _advice(problem, known, knowledge, trials.until) or old.advice
    return type(error)(_diagnosis(old, ranked(known, solved), solved, (*hints, *advice)))


def _overloads(problem: AnyProblem, error: NoPlanFound) -> tuple[Finding, ...]:
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


def _advice(
    problem: AnyProblem, findings: tuple[Finding, ...], knowledge: Knowledge, until: Deadline
) -> tuple[str, ...]:
    """What would be needed at least, as far as is known, when no try of it succeeded.

    Nothing is advised of which the necessary checks prove that it is not enough.
    """
    proved = tuple(finding for finding in findings if finding.proved)
    words = []
    enough = Deadline.after(1.0)
    for candidate in candidates(problem, proved, knowledge, until) if proved else ():
        if enough.passed():
            break
        if isinstance(candidate, WholeChange):
            words += [] if knowledge.hopeless(candidate.changed(problem)) else [candidate.words]
        elif (bound := candidate.bound or hardest_bound(candidate, proved)) is not None:
            value = _least_with_hope(problem, candidate, bound, knowledge)
            words += [] if value is None else [f"{candidate.relaxation(problem, value, bound).words} at least"]
    return tuple(f"{each}, though no solve has shown that it is enough" for each in words)


def _least_with_hope(
    problem: AnyProblem,
    candidate: Parameter,
    bound: float,
    knowledge: Knowledge,
) -> float | None:
    """The least change, from the bound on, that the necessary checks let pass; None where none of them does."""
    beyond = tuple(bound * (1.0 + step) ** candidate.easier for step in _ADVISED_STEPS)
    for tried in candidate.tried or beyond:
        value = candidate.rounded(problem, tried)
        if not knowledge.hopeless(candidate.write(problem, value)):
            return value
    return None
