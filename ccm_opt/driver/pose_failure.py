"""Why no pose was found at the goal: what the nearest attempt misses, in words, and whether anything is proved."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ConfigurationNotFound, Diagnosis, NoPlanFound, UnreachableGoal
from ccm_opt.core.length_words import short_length
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.ranking import ranked
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.terms import TERM_TOLERANCE
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.planning.pose_over_routes import PoseTry, pose_search, pose_tries, tried_from
from ccm_opt.problem import Problem
from ccm_opt.scene.bad_pose import room_advice

_ELASTIC_WEIGHTS = (10.0, 1e2, 1e3, 1e5)
"""Of half the squared miss of a user's constraint, as a turn of the whole arm [1/rad²], where the pose is looked for
that misses constraints least; one after the other, each from the pose before. Measured: the first is solved where the
last alone fails, and with the last misses are exact to a thousandth."""
_ELASTIC_SHARE = 0.02
"""Constraints that this pose misses by less than this share of the worst miss count as kept. Taste."""


def no_pose(problem: Problem, tries: Sequence[PoseTry], terms: UserTerms | None) -> ConfigurationNotFound:
    """The error that says why no pose at the goal was found.

    Args:
        problem: what was asked.
        tries: all of them without a feasible pose.
        terms: the user's constraints and costs.
    """
    findings = ranked(failed(problem))
    missed = {} if findings else least_misses(tries, terms)
    evidence: dict[str, object] = {
        "tried": [f"{each.start}: {failure_words(each)}" for each in tries],
        "missed_constraints": missed,
    }
    if findings:
        return ConfigurationNotFound(Diagnosis(findings[0].reason, "configuration", (), evidence, findings))
    if missed:
        advice = ("change the bounds or the goal", "make the constraint soft")
        return ConfigurationNotFound(Diagnosis(missed_words(missed), "configuration", advice, evidence))
    nearest = min((each for each in tries if each.poses), key=_miss, default=None)
    reason = f"no pose was found at the goal from {len(tries)} beginnings"
    if nearest is not None:
        reason += f"; the nearest ({nearest.start}): {failure_words(nearest)}"
    elif tries:
        reason += f"; {tries[0].start}: {tries[0].reason}"
    return ConfigurationNotFound(Diagnosis(reason, "configuration", _advice(problem), evidence))


def _advice(problem: Problem) -> tuple[str, ...]:
    """What may help the search for a pose."""
    room = room_advice(problem.arm.radius, problem.workspace.clearance)
    heading = () if problem.goal.heading is None else ("leave goal.heading_deg out",)
    return ("raise planner.routes", *room, "raise arm.joint_limit_deg", *heading)


def with_constraint_first(
    failure: NoPlanFound, problem: Problem, terms: UserTerms | None, settings: Settings = DEFAULT_SETTINGS
) -> NoPlanFound:
    """The same error; where no pose at the goal was found that keeps the user's constraints, its reason begins with it.

    Args:
        failure: how the search for a motion ended.
        problem: what was asked.
        terms: the user's constraints and costs.
        settings: of poses at the goal.
    """
    asked = terms is not None and bool(terms.hard_at_goal) and not problem.arm.base_axes and not problem.stops
    if not asked or isinstance(failure, UnreachableGoal) or problem.goal.whole(problem.arm) is not None:
        return failure
    search = pose_search(OwnUnits(problem.arm.length).scaled(problem), terms, settings.curve)
    tries = list(pose_tries(search, settings.curve))
    missed = {} if any(each.best is not None for each in tries) else least_misses(tries, terms)
    if not missed:
        return failure
    old = failure.diagnosis
    evidence = {**old.evidence, "missed_constraints": missed}
    advice = ("change the bounds of the constraint, or the goal", *old.advice)
    reason = f"{missed_words(missed)}; {old.reason}"
    return type(failure)(replace(old, reason=reason, evidence=evidence, advice=advice))


def missed_words(missed: dict[str, float]) -> str:
    """That constraints are missed at the goal, without the claim that this is proved."""
    first = "; ".join(f"constraint '{name}', the nearest misses it by {miss:.4g}" for name, miss in missed.items())
    return f"no pose was found at the goal that keeps {first} (not proved: another pose might)"


def least_misses(tries: Sequence[PoseTry], terms: UserTerms | None) -> dict[str, float]:
    """Hard constraints that the pose which misses them least still misses, and by how much, the worst first.

    The same beginnings are improved once more, with the constraints softened. Nothing is missed, and the result is
    empty, where that leads to no pose either: then other rows are in the way, too.
    """
    if terms is None or not terms.hard_at_goal:
        return {}
    found = [misses for each in tries if each.starts and (misses := _misses_from(each, terms)) is not None]
    # Where some beginning leads to a pose that misses fewer constraints, those alone are in the way.
    best = min(found, key=lambda misses: (len(misses), sum(misses.values())), default={})
    return dict(sorted(best.items(), key=lambda item: -item[1]))


def _misses_from(each: PoseTry, terms: UserTerms) -> dict[str, float] | None:
    """What the pose misses to which one beginning leads when the constraints are soft; None when there is no pose."""
    arm = each.search.problem.arm
    headings = each.starts[0]
    found = None
    for weight in _ELASTIC_WEIGHTS:
        softened = terms.softened(arm.bends(headings), weight)
        again = tried_from(replace(each.search, terms=softened), each.start, headings)
        if again.best is None:
            break
        headings = again.poses[again.best].headings
        found = _worst_misses(terms, softened, arm.bends(headings))
    return found


def _worst_misses(terms: UserTerms, softened: UserTerms, q: FloatArray) -> dict[str, float]:
    """Hard constraints that a pose misses: what is missed, and what counts beside the worst of them."""
    misses = terms.residuals_at_goal(q)
    weights = {item.constraint.name: item.constraint.weight for item in softened.constraints}
    missed = {
        item.constraint.name: misses[item.constraint.name]
        for item in terms.hard_at_goal
        if not misses[item.constraint.name] <= TERM_TOLERANCE
    }
    # Compared as turns of the whole arm, for units differ. A penalty leaves constraints that could hold a little amiss.
    turns = {name: np.sqrt(weights[name]) * miss for name, miss in missed.items()}
    least = _ELASTIC_SHARE * max(turns.values(), default=0.0)
    return {name: miss for name, miss in missed.items() if not turns[name] < least}


def _miss(each: PoseTry) -> float:
    return min((pose.answer.violation for pose in each.poses), default=np.inf)


def failure_words(each: PoseTry) -> str:
    """What the nearest pose of a try misses, in words; empty when one of its poses is feasible."""
    if each.best is not None:
        return ""
    if not each.poses:
        return each.reason
    pose = min(each.poses, key=lambda pose: pose.answer.violation)
    if pose.answer.violation > each.search.settings.feasible:
        worst = list(pose.answer.broken.items())[:3]
        return f"it misses {', '.join(_row_words(name, by, each) for name, by in worst)}"
    return f"it touches something: {each.search.nearest(pose.headings)}"


def _row_words(name: str, violation: float, each: PoseTry) -> str:
    """A row that is violated, in the user's terms."""
    length = each.search.problem.arm.length
    what, _, rest = name.partition(": ")
    if what == "user":
        return f"constraint '{rest}' by {violation:.4g}"
    if "bend" in rest:
        return f"the limit of {what} by {np.rad2deg(violation):.3g}°"
    if "torque" in rest:
        return f"the torque of {what} by {100.0 * violation:.3g} %"
    if "region" in rest:
        return f"the free region of {what} by {short_length(length * violation)}"
    return f"its own links by {short_length(length * violation)} ({name})"
