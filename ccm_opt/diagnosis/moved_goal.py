"""The goal moved to where it can be taken: the nearest place that is free and within reach, or the nearest heading."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.diagnosis.beyond_hole import beyond_hole
from ccm_opt.diagnosis.checks import hopeless
from ccm_opt.diagnosis.contact import contact_at_tips
from ccm_opt.diagnosis.diagnosis_settings import DEFAULT_DIAGNOSIS, MovedGoalSettings
from ccm_opt.diagnosis.keyed_poses import TipPlace
from ccm_opt.diagnosis.moved_position import about_the_goal, moved_position
from ccm_opt.diagnosis.nearest_place import nearest_place
from ccm_opt.diagnosis.parameters import Parameter
from ccm_opt.diagnosis.reach import supple_enough
from ccm_opt.errors import Finding
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.problem import Problem, TipGoal


def moved_goals(
    problem: Problem,
    findings: tuple[Finding, ...],
    until: Deadline,
    settings: MovedGoalSettings = DEFAULT_DIAGNOSIS.moved_goal,
) -> Iterator[Parameter]:
    """By how far, and which way, the goal's position or its heading may have to be moved; at most one of each.

    Args:
        problem: what was asked; nothing where its goal is for the whole arm, or the last of several.
        findings: what is proved.
        until: when places are looked at no longer.
        settings: numbers.
    """
    goal = problem.goal
    if not about_the_goal(findings) or not isinstance(goal, TipGoal) or problem.stops:
        return
    turn = _least_turn(problem, goal, settings)
    if turn is not None:
        yield _heading(goal, turn, settings)
    asked = TipPlace("goal", "goal.position", goal, problem.tolerances)
    fixed = beyond_hole(problem, asked) if problem.arm.base_axes else problem

    def refused(place: FloatArray) -> bool:
        return until.passed() or hopeless(replace(problem, goal=TipGoal(place, goal.heading)))

    found = None if fixed is None else nearest_place(fixed, goal, refused, settings)
    if found is not None:
        place, inside = found
        yield _position(problem, goal, place, settings, inside=inside)


def _position(
    problem: Problem, goal: TipGoal, place: FloatArray, settings: MovedGoalSettings, *, inside: bool
) -> Parameter:
    """The goal's position moved towards a place, by a distance; beyond the place where that is on an edge."""
    distance = float(np.hypot(*(place - goal.position)))
    # The edge of the tolerance may be there already.
    bound = max(distance - problem.tolerances.position, 0.1 * distance)
    # What lies far beyond a goal far away is no better for that.
    spread = min(distance, problem.arm.length)
    beyond = [distance, *(distance + step * spread for step in settings.steps)]
    if not inside:
        beyond = [bound + step * spread for step in settings.steps]
    return moved_position(problem, goal, place, bound, beyond)


def _heading(goal: TipGoal, turn: float, settings: MovedGoalSettings) -> Parameter:
    """The goal's heading turned one way, by an angle."""
    given = goal.heading or 0.0
    sign = float(np.sign(turn))
    return Parameter(
        "goal.heading_deg",
        +1,
        lambda _: 0.0,
        lambda p, by: replace(p, goal=TipGoal(goal.position, given + sign * by)),
        lambda _, by: f"goal.heading_deg turned by {np.rad2deg(by):.4g}°, to {np.rad2deg(given + sign * by):.2f}°",
        lambda _: float(np.rad2deg(1.0)),
        whole=np.pi,
        bound=abs(turn),
        tried=tuple(abs(turn) * (1.0 + step) for step in settings.steps),
        paths_stay=False,
    )


def _least_turn(problem: Problem, goal: TipGoal, settings: MovedGoalSettings) -> float | None:
    """The least turn of the goal's heading with which neither contact nor bends refuse it [rad]; None for none."""
    if goal.heading is None:
        return None
    given = goal.heading

    def refused(turn: float) -> bool:
        turned = replace(problem, goal=TipGoal(goal.position, given + turn))
        # How far a fed arm can turn depends on how far it is fed.
        checks = (contact_at_tips,) if problem.arm.base_axes else (contact_at_tips, supple_enough)
        return any(True for check in checks for _ in check(turned))

    if not refused(0.0):
        return None
    for size in np.arange(settings.turn_step, np.pi, settings.turn_step):
        for turn in (float(size), -float(size)):
            if not refused(turn):
                return turn
    return None
