"""The section of a report about the verifier's checks of a plan."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from ccm_opt.problem.poses import Stop, name_suffix
from ccm_opt.problem.solution import Check, SimulationVerdict, Solution
from ccm_opt.viz.document import Child, Markup, PageUnits, element, joined, table

_WORDS = {
    "wall clearance": "Gap to walls",
    "self-collision": "Gap between links",
    "joint limit": "Joint bends",
    "joint velocity": "Joint velocities",
    "joint acceleration": "Joint accelerations",
    "joint jerk": "Joint jerks",
    "joint torque": "Joint torques",
    "joints inside the guide": "Bends inside the guide",
    "following the tip": "Deviation from the path of the tip",
    "free side": "Links beyond a wall",
    "start tip": "Tip error at the start",
    "start on the curve": "Deviation from the start curve",
    "rest": "Joint speed at rest",
    "samples": "Longest step between samples",
    "joint names": "Joint names that differ",
    "message limits": "Limits between message points",
    "message deviation": "Message deviation, of its margin",
}
_ORDER = (
    "wall clearance",
    "self-collision",
    "goal",
    "stop",
    "surface",
    "constraint",
    "soft constraint",
    "joint",
    "feed",
    "axis",
    "following",
    "tip",
)
"""Prefixes of the names of checks that matter to a user, the most important first."""
_OF_ITSELF = re.compile(
    r"samples|joint names|free side|start .*|rest|.* at rest|.* against .*|share of .*|.* of the samples"
    r"|duration of the tour|even bends of sections|true arcs beyond links"
)
"""Pattern of the names of checks that concern only the consistency of a plan's data, or the fraction of the limits that
plans may use."""
_PATH = re.compile(r"u = (\d+(?:\.\d+)?)")
"""Pattern of the path parameter at which a constraint comes nearest to its bounds; used only if no time is given."""
_TIME = re.compile(r"t = (\d+(?:\.\d+)?) s")
_PAUSE = re.compile(r"stop (\d+) pause")
"""Pattern of the name of the check of the pause at an intermediate goal."""
_AT_LEAST = re.compile(r"stop \d+ pause|(goal|stop \d+) (least distance|line of sight)|surface seen")
"""Pattern of the names of the checks whose value must be at least its limit; gaps are told apart by their names."""
_GOAL = re.compile(r"goal \d+|the goal")
"""Pattern of a goal in the title of a check."""
_VIEW = {
    "least distance": "Distance from what is seen at",
    "greatest distance": "Distance from what is seen at",
    "field of view": "Angle off the axis of sight at",
    "normal": "Angle off the normal of what is seen at",
    "line of sight": "Free cone of sight at",
}
"""Titles of the checks of a goal of looking at a place, up to the name of the goal, by the name of the check."""


_BOUND = 1e-5
"""Distance from a constraint's bound up to which a value counts as at the bound: ten times the allowed violation."""


@dataclass(frozen=True)
class CheckWords:
    """One check of the verifier as texts for a table.

    Attributes:
        title: name of the checked quantity.
        worst: worst value found, with unit.
        limit: the limit, with unit.
        used: ratio of the worst value to the limit, at least 0; None if the limit is a minimum, 0 or an end of a range.
        where: link or joint, and obstacle, at which the worst value was found.
        time: time of the worst value [s]; None if the check has none.
        passed: whether the check passed.
        of_itself: whether the check only concerns the consistency of the plan's own data.
    """

    title: str
    worst: str
    limit: str
    used: float | None
    where: str
    time: float | None
    passed: bool
    of_itself: bool


def checks_in_words(
    checks: Iterable[Check], units: PageUnits, goals: Sequence[Stop] = (), *, in_space: bool = False
) -> list[CheckWords]:
    """Return all checks of a plan as texts, the most important first, checks of the plan's consistency last.

    Args:
        checks: checks of the verifier.
        units: units of the page.
        goals: goals in the order of the visits, whose names are added to titles.
        in_space: whether joints have two bend angles, which have separate names.
    """
    ordered = sorted(checks, key=lambda check: (_self_check_rows(check), check.passed, _rank(check.name)))
    suffixes = {f"goal {k}": name_suffix(stop.goal) for k, stop in enumerate(goals, start=1)}
    suffixes["the goal"] = name_suffix(goals[-1].goal) if goals else ""

    def named(words: CheckWords) -> CheckWords:
        return replace(words, title=_GOAL.sub(lambda goal: goal[0] + suffixes.get(goal[0], ""), words.title))

    return [named(_in_words(check, units, in_space=in_space)) for check in ordered]


def _self_check_rows(check: Check) -> bool:
    return bool(_OF_ITSELF.fullmatch(check.name))


def _rank(name: str) -> int:
    return next((k for k, begin in enumerate(_ORDER) if name.startswith(begin)), len(_ORDER))


def joint_in_words(where: str, *, in_space: bool) -> str:
    """Return the place of a check in readable form: names of revolute joints are dropped, or become a and b in space.

    Args:
        where: place as the verifier names it, such as ``joint 3 (ball03_yaw)``.
        in_space: whether joints have two bend angles.
    """
    if in_space:
        return re.sub(r" \(ball\d+_(yaw|bend)\)", lambda name: " a" if name[1] == "yaw" else " b", where)
    return re.sub(r" \(ball\d+_bend\)", "", where)


def _in_words(check: Check, units: PageUnits, *, in_space: bool) -> CheckWords:
    gap = check.name in {"wall clearance", "self-collision"}
    rest = _AT_LEAST.fullmatch(check.name) is not None
    end = check.name.endswith(" range")
    bound = units.given(check.limit, check.unit)
    if "constraint " in check.name:
        # The value of a constraint is its violation, in a unit that only the user knows.
        worst = _constraint_value(check)
        limit = "soft" if check.name.startswith("soft") else "hard"
    elif gap:
        # Gaps are given beyond the clearance, as everywhere else; the limit of the check is the clearance.
        worst = units.shown(check.worst - check.limit, check.unit, check.limit)
        limit = "no contact"
    elif check.unit == "tolerances":
        worst = units.shown(check.worst, "of the limit")
        limit = "at most 100 %"
    elif end:
        # The limit is the lower or the upper end, whichever is nearer.
        worst, limit = units.shown(check.worst, check.unit, check.limit), bound
    else:
        worst = units.shown(check.worst, check.unit, check.limit)
        limit = f"at least {bound}" if rest else f"at most {bound}"
    bounded = 0.0 < check.limit < float("inf") and not (gap or rest or end) and "constraint " not in check.name
    used = abs(check.worst) / check.limit if bounded else None
    when = _TIME.search(check.where)
    # The time has a field of its own.
    where = _PATH.sub(lambda u: "" if when else f"{100.0 * float(u[1]):.0f} % of the path", check.where)
    where = joint_in_words(re.sub(r"\s*,?\s*((at|from) )?t = \S+ s", "", where), in_space=in_space)
    return CheckWords(
        title=f"{check_title(check.name)} beyond {bound}" if gap and check.limit else check_title(check.name),
        worst=worst if check.worst != float("inf") else "none in range",
        limit=limit,
        used=used,
        where=where,
        time=float(when[1]) if when else None,
        passed=check.passed,
        of_itself=_self_check_rows(check),
    )


def check_title(name: str) -> str:
    """Return the readable title of a check of the verifier, given the check's name."""
    if name in _WORDS:
        return _WORDS[name]
    if stop := _PAUSE.fullmatch(name):
        return f"Rest at goal {stop[1]}"
    if end := re.fullmatch(r"(?:(start|goal)|stop (\d+)) (position|heading|direction|roll|joints|feed|axis_\d+)", name):
        what = {"position": "Tip", "joints": "Joint"}.get(end[3], end[3].capitalize().replace("_", " "))
        return f"{what} error at {f'the {end[1]}' if end[1] else f'goal {end[2]}'}"
    if way := re.fullmatch(rf"(?:goal|stop (\d+)) (path|via \d+|{'|'.join(_VIEW)})", name):
        number = way[1]
        view = f"{_VIEW.get(way[2])} {f'goal {number}' if number else 'the goal'}"
        return view if way[2] in _VIEW else f"Tip distance from {way[2]}" + (f" of goal {number}" if number else "")
    for begin, words in (("constraint ", "Your constraint"), ("soft constraint ", "Your soft constraint")):
        if name.startswith(begin):
            return f"{words} “{name.removeprefix(begin)}”"
    ranged = " nearest to its limit" if name.endswith(" range") else ""
    words = name.removesuffix(" range").replace("axis_", "axis ")
    return words[:1].upper() + words[1:] + ranged


def _constraint_value(check: Check) -> str:
    """Return the violation of a user's constraint, or the distance from its bounds, in words.

    A soft constraint passes its check with any violation, but the violation is stated nevertheless.
    """
    allowed = 0.0 if check.name.startswith("soft") else check.limit
    if not check.worst <= allowed:
        return f"violated by {check.worst:.3g}"
    return "at its bound" if check.worst > -_BOUND else f"{-check.worst:.3g} to spare"


def checks_section(solution: Solution, units: PageUnits) -> Markup:
    """Return the section of a report about the checks of a plan, and about its simulation.

    Args:
        solution: the plan.
        units: units of the page.
    """
    checks = checks_in_words(
        solution.checks, units, solution.problem.numbered_goals, in_space=solution.problem.dimension == 3
    )
    demanded = [check for check in checks if not check.of_itself]
    internal = [check for check in checks if check.of_itself]
    failed = sum(not check.passed for check in internal)
    words = f"{len(internal)} checks of the plan's consistency" + (f", {failed} failed" if failed else ", all passed")
    folded = element("details", element("summary", words), _table(internal), open=failed > 0) if internal else None
    verdict = solution.simulation.verdict
    return element(
        "section",
        element("h2", "Checks: every limit and its use"),
        _table(demanded),
        _simulation(verdict),
        folded,
    )


def _table(checks: Sequence[CheckWords]) -> Markup:
    rows = [_row(check) for check in checks]
    return table(("", "worst", "limit", "used", "where", ""), rows, cls="checks", numbers=(1, 2))


def _row(check: CheckWords) -> tuple[Child, ...]:
    verdict = element("span", "holds" if check.passed else "fails", cls="holds" if check.passed else "fails")
    return (check.title, check.worst, check.limit, used_bar(check.used), _place(check), verdict)


def _place(check: CheckWords) -> Markup:
    """Return where the worst value of a check was found, with a button that shows the motion at this time."""
    if check.time is None:
        return joined((check.where,))
    between = ", " if check.where else ""
    look = {"type": "button", "cls": "link", "data_time": f"{check.time:.4f}"}
    return joined((check.where, between, element("button", f"{check.time:.2f} s", **look)))


def used_bar(share: float | None) -> Markup | None:
    """Return the used fraction of a limit as a bar with its percentage; None if there is no fraction."""
    if share is None:
        return None
    width = 100.0 * min(share, 1.0)
    bar = element("span", element("i", style=f"width:{width:.0f}%"), cls="used")
    return joined((bar, f"{100.0 * share:.0f} %"))


def _simulation(verdict: SimulationVerdict) -> Markup:
    """Return the outcome of the simulation of a plan, with remedies if the simulated arm did not follow the plan."""
    step = f"with steps of {1e3 * verdict.step:g} ms"
    if verdict.followed:
        return element("p", element("span", "Followed", cls="holds"), f" in the simulation, {step}.")
    reason = element("span", verdict.outcome, cls="fails") if verdict.is_failure else verdict.outcome
    advice = element("ul", *(element("li", line) for line in verdict.advice)) if verdict.advice else None
    return joined((element("p", "Simulation, ", step, ": ", reason, f". {verdict.reason}"), advice))
