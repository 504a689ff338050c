"""What is refused before anything is planned, why there is no plan, and what change would help."""

from dataclasses import replace

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.checks import AT_ONCE, BUT_WAYS, NECESSARY, any_way_closed, failed
from ccm_opt.diagnosis.contact import joint_words, overloaded
from ccm_opt.diagnosis.contact_in_space import AT_ONCE_IN_SPACE, found_in_space
from ccm_opt.diagnosis.parameters import Parameter, WholeChange
from ccm_opt.diagnosis.ranking import closed_off, ranked, refuse
from ccm_opt.diagnosis.relaxation import Knowledge, Trials, binding, candidates, hardest_bound, relaxations
from ccm_opt.errors import Diagnosis, Finding, NoPlanFound, Relaxation
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem

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


FEW_OBSTACLES = 30
"""Among so many what closes the ways is found in half a second. Measured: 0.02 s a look, and some thirty looks."""


def refuse_impossible(problem: AnyProblem) -> None:
    """Refuse a problem of which a check that costs next to nothing proves that it has no plan.

    Raises:
        UnreachableGoal: with the findings.
    """
    if isinstance(problem, SpaceProblem):
        refuse(ranked(found_in_space(problem, AT_ONCE_IN_SPACE)))
    else:
        refuse(ranked(failed(problem, AT_ONCE)))


def refuse_hopeless(problem: Problem) -> None:
    """Refuse a problem of which any of the necessary checks proves that it has no plan, as soon as that is known.

    What closes the ways among many obstacles is for those to say who explain the failure.

    Raises:
        UnreachableGoal: with the findings; without where none of the ways among many obstacles will do.
    """
    few = len(problem.workspace.obstacles) <= FEW_OBSTACLES
    refuse(ranked(failed(problem, NECESSARY if few else BUT_WAYS)))
    if not few and any_way_closed(problem):
        raise closed_off(problem)


def refuse_closed(problem: Problem) -> None:
    """Refuse a problem of which any of the necessary checks proves that it has no plan.

    Raises:
        UnreachableGoal: with the findings.
    """
    refuse(ranked(failed(problem)))


def refuse_closed_in_space(problem: SpaceProblem) -> None:
    """Refuse a problem of which it is proved that no way to its goal is wide and short enough.

    What closes the ways is for those to say who explain the failure.

    Raises:
        UnreachableGoal: without findings.
    """
    from ccm_opt.diagnosis.ways_in_space import closed_in_space  # noqa: PLC0415 - most searches never ask

    if closed_in_space(problem):
        raise closed_off(problem)
