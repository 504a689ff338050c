"""Explanation of why a problem has no plan: proved causes, likely causes, and changes that would help."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import ConfigurationNotFound, Diagnosis, Finding, NoPlanFound, Relaxation
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.axis_paths import tight_passages
from ccm_opt.diagnosis.checks import (
    CHEAP_CHECKS,
    NECESSARY_CHECKS,
    QUICK_CHECKS,
    failed,
    find_scaled,
    is_covered,
    is_goal_closed_off,
    provably_infeasible,
)
from ccm_opt.diagnosis.contact import overloaded
from ccm_opt.diagnosis.named_goals import tip_goal
from ccm_opt.diagnosis.parameters import Parameter, WholeChange
from ccm_opt.diagnosis.ranking import listed, no_axis_path_error, point, rank_findings, refuse
from ccm_opt.diagnosis.relaxation import Trials, binding, candidates, hardest_bound, relaxations
from ccm_opt.ik.find_configuration import find_configuration
from ccm_opt.planning.curve_routes import configuration_task, find_routes, route_room
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.problem import Problem
from ccm_opt.scene.narrow_gates import nearest_walls

_THOUSAND = (100.0, 10000.0)
"""Range of the ratio of two lengths that suggests metres mixed with millimetres, as least and greatest value.

Heuristic: in a common unit, such lengths mostly differ by at most a factor of ten.
"""
_THICK = (1.0, 1000.0)
"""Range of the ratio of a radius or clearance to the arm's length that suggests metres mixed with millimetres.

Derived: arms are about ten to a thousand times as long as either.
"""
_SMALL_WORKSPACE = 0.01
"""Size of the room, as a fraction of the arm's length, below which its unit looks wrong. Heuristic."""
_GUESSED = ("too stiff",)
"""Kinds of findings that, unless proved, rest on a single axis path that was found, not on a bound for all paths."""
_MOST_FAILED = 4
"""Largest number of reported changes that did not help. Heuristic."""
_HARDLY_BENDS = 1.5707963267948966
"""Sum of all joint limits below which a limit of a few degrees looks like radians [rad]. Heuristic: a right angle."""


def suspected_causes(problem: Problem, until: Deadline) -> tuple[Finding, ...]:
    """Return likely but unproved obstructions found before a deadline, the tightest first."""
    return find_scaled(problem, lambda p: (*tight_passages(p, until), *_curve(p)))


def _curve(problem: Problem) -> Iterator[Finding]:
    """Yield a finding if no backbone curve along the shortest route to the goal meets all constraints.

    The finding names the violated constraints. Only planar problems with a fixed base are checked.
    """
    if problem.arm.base_axes or problem.dimension == 3 or problem.arm.proportions is not None:
        return
    try:
        ends = resolve_ends(problem)
        room = route_room(problem, ends)
        routes = find_routes(problem, ends, room) if ends.goal_pose is None else ()
        for route in routes[:1]:
            find_configuration(configuration_task(problem, ends, room, route), 1)
    except ConfigurationNotFound as error:
        yield _curve_fails(problem, error)
    except NoPlanFound:
        return


def _curve_fails(problem: Problem, error: ConfigurationNotFound) -> Finding:
    """Return a finding on a nonlinear program's violated constraints, with their positions and nearest walls."""
    rows = error.diagnosis.evidence.get("rows")
    places = [tuple(row["place"]) for row in rows] if isinstance(rows, list) else []
    walls = tuple(dict.fromkeys(nearest_walls(problem.workspace, np.array(place), 1)[0] for place in places))
    near = f" (next to {listed(walls)})" if walls else ""
    return Finding(
        "curve",
        f"{error.diagnosis.reason}{near}",
        proved=False,
        place=point(np.array(places[0])) if places else None,
        obstacles=walls,
    )


def unit_hints(problem: Problem) -> tuple[str, ...]:
    """Return advice on quantities of a problem whose unit looks wrong; usually none.

    Lengths that are off by about a factor of a thousand, and joint limits that look like radians, are suspicious.
    """
    return tuple(f"check the units: {hint}" for hint in _hints(problem))


def _hints(problem: Problem) -> Iterator[str]:
    arm = problem.arm
    lengths = [
        ("arm.radius", arm.radius, _THICK),
        ("workspace.clearance", problem.workspace.clearance, _THICK),
    ]
    goal = tip_goal(problem)
    if goal is not None:
        far = float(np.linalg.norm(goal.position - arm.base))
        lengths.append(("goal.position (its distance from the base)", far, _THOUSAND))
    for name, length, (least, most) in lengths:
        times = length / arm.length
        if least <= times <= most:
            yield f"{name} is {times:.3g} times the arm's length, as if one were in mm and the other in m"
    bounds = problem.workspace.box
    if bounds is not None:
        # Suspicious rooms are far larger than the arm, too small to hold it, or far from its base.
        share = float(np.ptp(bounds, axis=0).max()) / arm.length
        beyond = np.maximum(np.maximum(bounds[0] - arm.base, arm.base - bounds[1]), 0.0)
        if max(share, float(np.linalg.norm(beyond)) / arm.length) > _THOUSAND[0] or share < _SMALL_WORKSPACE:
            yield f"workspace.bounds is {share:.3g} times as large as the arm is long"
    # A joint limit in degrees whose number would be plausible in radians, and with which the arm can hardly bend.
    degrees = float(np.rad2deg(arm.joint_limit))
    if degrees <= np.pi and (arm.links - 1) * arm.joint_limit < _HARDLY_BENDS:
        yield (
            f"with arm.joint_limit_deg = {degrees:.4g} all joints together bend by "
            f"{degrees * (arm.links - 1):.3g}° at most; {degrees:.4g} rad would be {np.rad2deg(degrees):.4g}°"
        )


_ADVISED_STEPS = (0.0, 0.25, 0.6, 1.0)
"""Steps beyond a bound, as fractions of the bound, at which changes are tested by the necessary checks alone.

Such tests replace trial solves if every trial solve failed. Heuristic.
"""


def add_proof(problem: Problem, error: NoPlanFound) -> NoPlanFound:
    """Return a planning error extended by findings that prove that there is no plan, if any; tries no changes."""
    old = error.diagnosis
    findings = old.findings or rank_findings(failed(problem))
    reason = findings[0].reason if findings and not old.findings else old.reason
    return type(error)(replace(old, reason=reason, findings=findings, advice=(*unit_hints(problem), *old.advice)))


def explain_failure(problem: Problem, error: NoPlanFound, trials: Trials, stages: Stages | None = None) -> NoPlanFound:
    """Return a planning error extended by all known causes and by the changes with which the problem could be solved.

    Args:
        problem: the problem without a plan.
        error: the error with which planning ended.
        trials: solves changed problems in the remaining time.
        stages: receives the diagnosis as it grows.
    """
    if not is_covered(problem.arm):
        return error
    stages = stages or Stages()
    checked = failed(problem)
    # Likely causes are of no use once there is a proof; an overload concerns only the path that was found.
    known = checked or _overloads(problem, error) or suspected_causes(problem, trials.until)
    old = error.diagnosis
    hints = unit_hints(problem)
    stages.tell(known=_diagnosis(old, rank_findings(known), (), (*hints, *(() if binding(known) else old.advice))))
    solved: tuple[Relaxation, ...] = ()
    with stages("changes that would help"):
        telling = replace(trials, tell=stages.report_change)
        for relaxation in relaxations(problem, known, telling):
            solved = tuple(sorted((*solved, relaxation), key=lambda each: each.change))
            stages.tell(known=_diagnosis(old, rank_findings(known, solved), solved, hints))
        # Minimum requirements are of interest only if no change is known to help.
        advice = () if solved else _advice(problem, known, trials.until) or old.advice
    # What was tried and did not help is not advised, and no cause where it rests on no bound.
    untried = tuple(line for line in (*hints, *advice) if not any(key in line for key in trials.failed))
    left = tuple(
        each
        for each in known
        if each.proved or each.kind not in _GUESSED or not trials.failed.keys() & each.bounds.keys()
    )
    final = _diagnosis(old, rank_findings(left, solved), solved, untried)
    return type(error)(replace(final, failed_changes=tuple(trials.failed.values())[:_MOST_FAILED]))


def _overloads(problem: Problem, error: NoPlanFound) -> tuple[Finding, ...]:
    """Return a finding on the joint that is too weak to hold the arm, if timing failed for that reason."""
    evidence = error.diagnosis.evidence
    number, torque = (evidence.get(name) for name in ("revolute", "torque"))
    if problem.limits.torque is None or not isinstance(number, int) or not isinstance(torque, float):
        return ()
    # The words of timing are kept, so that the same reason is not given twice.
    return (overloaded(problem, error.diagnosis.reason, number, torque),)


def _diagnosis(
    old: Diagnosis, findings: tuple[Finding, ...], solved: tuple[Relaxation, ...], advice: tuple[str, ...]
) -> Diagnosis:
    """Return a diagnosis extended by findings, solved changes and advice; a proved cause replaces the reason."""
    reason = findings[0].reason if binding(findings[:1]) else old.reason
    return Diagnosis(reason, old.stage, advice, old.evidence, findings, solved)


def _advice(problem: Problem, findings: tuple[Finding, ...], until: Deadline) -> tuple[str, ...]:
    """Return advice on the least changes known to be necessary, for problems without a successful trial solve.

    Changes that the necessary checks prove to be insufficient are left out.
    """
    proved = tuple(finding for finding in findings if finding.proved)
    words = []
    enough = Deadline.after(1.0)
    for candidate in candidates(problem, proved, until) if proved else ():
        if enough.passed():
            break
        if isinstance(candidate, WholeChange):
            words += [] if provably_infeasible(candidate.changed(problem), enough) else [candidate.words]
        elif (bound := candidate.bound or hardest_bound(candidate, proved)) is not None:
            value = _least_with_hope(problem, candidate, bound, enough)
            words += [] if value is None else [candidate.requirement(problem, value)]
    return tuple(f"{each} (not tried with success: necessary, perhaps not enough)" for each in words)


def _least_with_hope(
    problem: Problem,
    candidate: Parameter,
    bound: float,
    until: Deadline,
) -> float | None:
    """Return the tried value nearest to a parameter's bound that passes the necessary checks; None if none does."""
    beyond = tuple(bound * (1.0 + step) ** candidate.easier for step in _ADVISED_STEPS)
    for tried in candidate.tried or beyond:
        value = candidate.rounded(problem, tried)
        if not provably_infeasible(candidate.write(problem, value), until):
            return value
    return None


FEW_OBSTACLES = 30
"""Number of obstacles up to which those that close all axis paths are found in half a second.

Measured: 0.02 s per test, and about thirty tests.
"""


def refuse_impossible(problem: Problem) -> None:
    """Raise an error if an inexpensive check proves that a problem has no plan.

    Raises:
        UnreachableGoal: there is no plan; carries the findings.
    """
    if not problem.arm.carrier:
        refuse(rank_findings(failed(problem, CHEAP_CHECKS)))


def refuse_infeasible(problem: Problem) -> None:
    """Raise an error as soon as any necessary check proves that a problem has no plan.

    In space, or among many obstacles, the obstacles that close all axis paths are determined later, with the
    explanation.

    Raises:
        UnreachableGoal: there is no plan; carries the findings, except if all axis paths are closed and finding the
            cause would take long.
    """
    at_once = problem.dimension == 2 and len(problem.workspace.obstacles) <= FEW_OBSTACLES
    refuse(rank_findings(failed(problem, NECESSARY_CHECKS if at_once else QUICK_CHECKS)))
    if not at_once and is_goal_closed_off(problem, Deadline.after(0.5 * problem.planner.time_limit)):
        raise no_axis_path_error(problem)


def refuse_closed(problem: Problem) -> None:
    """Raise an error with full findings if any necessary check proves that a problem has no plan.

    Raises:
        UnreachableGoal: there is no plan; carries the findings.
    """
    refuse(rank_findings(failed(problem)))
