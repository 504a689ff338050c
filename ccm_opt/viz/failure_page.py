"""The HTML report of a problem for which no plan was found."""

import json
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, Finding, sentences
from ccm_opt.problem import Problem
from ccm_opt.viz.document import (
    Markup,
    PageUnits,
    badge,
    element,
    html_document,
    joined,
    page_header,
    scene_scripts,
    table,
)
from ccm_opt.viz.page_sections import problem_section, stage_section, timings_table
from ccm_opt.viz.scene_data import scene_data

Mark = dict[str, object]
"""A mark in the report's scene: ``kind``, positions [m], and optionally ``words`` with their position ``at``."""
_IN_A_WORD = {"contact": "in contact", "blocked": "no passage", "hemmed in": "hemmed in"}
"""Short labels by kind of finding (reason why no plan exists), for kinds that need only a label at their position."""


def finding_marks(problem: Problem, diagnosis: Diagnosis, units: PageUnits) -> list[Mark]:
    """Return the marks in the report's scene for all findings (reasons why no plan exists) of a diagnosis.

    The text of the first finding is shown in the scene, the texts of the others in tooltips.

    Args:
        problem: the problem.
        diagnosis: reasons why no plan was found.
        units: units of the page.
    """
    marks: list[Mark] = []
    for number, finding in enumerate(diagnosis.findings):
        for mark in _marks(problem, finding, units):
            if number:
                mark.pop("at", None)
            marks.append(mark)
        if problem.dimension == 3 and finding.place is not None and finding.kind != "too thick":
            marks.append({"kind": "place", "place": _listed(finding.place), "words": finding.reason})
    pose = best_attempt(problem, diagnosis)
    if pose is not None:
        marks.append({"kind": "arm", "points": pose.round(6).tolist()})
        marks.append({"kind": "words", "at": _listed(pose[-1]), "words": "the best attempt ended here"})
    return marks


def best_attempt(problem: Problem, diagnosis: Diagnosis) -> FloatArray | None:
    """Return the pose in which the best failed attempt ended, as positions of joints and tip, shape (n + 1, d) [m].

    Returns:
        The pose of the n links, with d = 2 or 3; None if there was no search, or if it is proved that no plan exists.
    """
    found = diagnosis.evidence.get("nearest_pose")
    if diagnosis.proved or not isinstance(found, Sequence) or len(found) == 0:
        return None
    q = np.asarray(found, dtype=float)
    return problem.arm.joint_positions_at(q) if len(q) == len(problem.arm.coordinates) else None


def _marks(problem: Problem, finding: Finding, units: PageUnits) -> Iterator[Mark]:
    if finding.kind == "too short":
        yield from _too_short(problem, finding, units)
    elif finding.kind == "too thick":
        yield from _too_thick(problem, finding, units)
    elif finding.kind == "too stiff" and problem.dimension == 2:
        yield from _too_stiff(problem, finding, units)
    elif finding.place is not None:
        place = _listed(finding.place)
        yield {"kind": "place", "place": place, "words": finding.reason}
        if finding.kind in _IN_A_WORD:
            yield {"kind": "words", "at": place, "words": _IN_A_WORD[finding.kind]}


def _too_short(problem: Problem, finding: Finding, units: PageUnits) -> Iterator[Mark]:
    """Yield marks for an arm that is too short.

    These are the shortest path to the goal, if that is too long, else the circle that the arm can reach and the
    distance from it to the goal.
    """
    if finding.measured is None or finding.place is None:
        return
    missing = f"arm {units.length(finding.measured - problem.arm.length)} too short"
    if finding.way:
        yield {"kind": "way", "points": [_listed(place) for place in finding.way]}
        words = f"shortest way {units.length(finding.measured)}, arm {units.length(problem.arm.length)}"
        yield {"kind": "words", "at": _listed(finding.place), "words": words}
        return
    base = nearest_base(problem, finding.place)
    yield {"kind": "circle", "place": base, "radius": problem.arm.length}
    goal = np.array(finding.place)
    towards = (goal - base) / np.linalg.norm(goal - base)
    edge = np.array(base) + problem.arm.length * towards
    yield {"kind": "gap", "points": [_listed(edge), _listed(goal)]}
    yield {"kind": "words", "at": _listed(0.5 * (edge + goal)), "words": missing}


def nearest_base(problem: Problem, place: tuple[float, ...]) -> list[float]:
    """Return the base position nearest to a point that the feed axis allows [m]; for a fixed base its position."""
    arm = problem.arm
    low, high = arm.base_range
    along = float(np.clip((np.array(place) - arm.base) @ arm.direction, low, high)) if arm.feed else 0.0
    return _listed(arm.base + along * arm.direction)


def _too_thick(problem: Problem, finding: Finding, units: PageUnits) -> Iterator[Mark]:
    """Yield marks for an arm that is too thick: a disc as wide as arm plus clearance, and the gap between two walls."""
    if finding.place is None or finding.measured is None or finding.allowed is None:
        return
    tight = {"radius": 0.5 * finding.allowed, "room": 0.5 * finding.measured}
    yield {"kind": "disc", "place": _listed(finding.place), **tight}
    if problem.dimension == 3:
        return
    place = shapely.Point(finding.place)
    feet = []
    for wall in problem.workspace.walls:
        line = shapely.shortest_line(place, wall.core)
        ends = shapely.get_coordinates(line)
        away = float(np.hypot(*(ends[1] - ends[0])))
        foot = ends[1] + (ends[0] - ends[1]) * min(wall.rounding / away, 1.0) if away > 0.0 else ends[1]
        feet.append((away - wall.rounding, _listed(foot)))
    feet.sort(key=lambda pair: pair[0])
    yield {"kind": "gap", "points": [foot for _, foot in feet[:2]]}
    needed = "arm with clearance" if problem.workspace.clearance else "arm"
    words = f"gap {units.length(finding.measured)}, {needed} {units.length(finding.allowed)}"
    yield {"kind": "words", "at": _listed(finding.place), "words": words}


def _too_stiff(problem: Problem, finding: Finding, units: PageUnits) -> Iterator[Mark]:
    """Yield marks for joint limits that are too small.

    These are the circle that the tip cannot enter, or the arm bent as far as possible to both sides.
    """
    arm = problem.arm
    if finding.unit == "m" and finding.allowed is not None:
        base = _listed(arm.base)
        yield {"kind": "circle", "place": base, "radius": finding.allowed}
        if finding.place is not None:
            words = f"at least {units.length(finding.allowed)} from the base"
            yield {"kind": "words", "at": _listed(finding.place), "words": words}
        return
    for side in (-1.0, 1.0):
        bends = side * np.minimum(arm.bend_limits, arm.joint_limit)
        points = arm.joint_positions(arm.headings(bends))
        yield {"kind": "arm", "points": np.round(points, 6).tolist()}
    if finding.measured is not None and finding.allowed is not None:
        words = f"required turn {units.shown(finding.measured, 'rad')}, possible {units.shown(finding.allowed, 'rad')}"
        yield {"kind": "words", "at": _listed(arm.base), "words": words}


def first_look(problem: Problem, diagnosis: Diagnosis) -> FloatArray:
    """Return the points that the initial view of a failure report must contain, shape (m, d) with d = 2 or 3 [m].

    These are the start pose, the goals, the obstructions, and the pose in which the best attempt ended.
    """
    arm = problem.arm
    poses = (problem.start.configuration(arm), *(stop.goal.whole(arm) for stop in problem.goals))
    found = [arm.joint_positions_at(pose) for pose in poses if pose is not None]
    found += [stop.goal.tip(arm)[None] for stop in problem.goals]
    found += [np.array(finding.place)[None] for finding in diagnosis.findings if finding.place is not None]
    found += [np.array(finding.way) for finding in diagnosis.findings if finding.way]
    attempt = best_attempt(problem, diagnosis)
    found += [] if attempt is None else [attempt]
    return np.concatenate(found)


def _listed(place: FloatArray | tuple[float, ...]) -> list[float]:
    return [float(value) for value in place]


STATUS = {
    "infeasible": "proved infeasible",
    "timed-out": "no plan found within the time limit",
    "cancelled": "cancelled",
}


def failure_html(
    problem: Problem,
    status: str,
    diagnosis: Diagnosis,
    timings: Mapping[str, float] | None = None,
) -> str:
    """Return the HTML report of a problem for which no plan was found.

    Args:
        problem: the problem.
        status: how the search ended, as in ``solution.json``.
        diagnosis: reasons why no plan was found.
        timings: CPU time of each stage that ran, by stage name [s].

    Returns:
        A complete HTML page that loads no other files.
    """
    units = PageUnits.of_page(problem)
    in_space = problem.dimension == 3
    data = failure_data(problem, diagnosis, units)
    facts = (
        reason_section(diagnosis),
        help_section(diagnosis),
        problem_section(problem, units),
        search_section(problem, diagnosis, timings or {}),
    )
    header = page_header(problem, [badge(STATUS.get(status, status), good=False)], (), units)
    label = f"The problem {problem.name}, the arm at its start and the obstructions"
    stage = stage_section(label, moves=False, in_space=in_space)
    body = joined((header, element("main", stage, element("div", *facts, cls="facts"))))
    return html_document(f"{problem.name}: {status}", body, data, scene_scripts(problem.dimension, moves=False))


def failure_data(problem: Problem, diagnosis: Diagnosis, units: PageUnits) -> dict[str, object]:
    """Return all data that the scripts of a failure report read."""
    blocking = [name for finding in diagnosis.findings[:1] for name in finding.obstacles]
    return {
        "unit": units.data(),
        "blocking": blocking,
        "scene": scene_data(problem, first_look(problem, diagnosis)),
        "marks": finding_marks(problem, diagnosis, units),
    }


def reason_section(diagnosis: Diagnosis) -> Markup:
    """Return the section of a failure report about the reason why no plan was found, and about further obstructions."""
    others = [finding for finding in diagnosis.findings if finding.reason != diagnosis.reason]
    first = next((finding for finding in diagnosis.findings if finding.reason == diagnosis.reason), None)
    also = [element("h3", "Other findings")] if others else []
    return element(
        "section",
        element("h2", "Why there is no plan"),
        element(
            "div",
            *_sentences(diagnosis.reason),
            cls="finding" if first is None or first.proved else "finding perhaps",
        ),
        *also,
        *(_finding(finding) for finding in others),
        element("p", f"Found in stage: {diagnosis.stage}.", cls="soft"),
    )


def _sentences(reason: str, before: Markup | None = None) -> Iterator[Markup]:
    """Yield a reason as HTML: its first sentence, then the details as a list.

    Args:
        reason: the reason, of one or more sentences.
        before: markup put in front of the first sentence.
    """
    first, *details = sentences(reason)
    yield element("p", before, f"{first}.")
    if details:
        yield element("ul", *(element("li", line) for line in details))


def _finding(finding: Finding) -> Markup:
    words = "Proved: " if finding.proved else "Perhaps: "
    return element(
        "div",
        *_sentences(finding.reason, element("b", words)),
        cls="finding" if finding.proved else "finding perhaps",
    )


def help_section(diagnosis: Diagnosis) -> Markup:
    """Return the section of a failure report about remedies: changes tried with success, and further advice."""
    solved = [element("li", relaxation.words) for relaxation in diagnosis.relaxations]
    tried = [element("li", line) for line in diagnosis.advice]
    parts: list[Markup] = []
    if solved:
        words = "Planned, timed and verified with any one of these changes:"
        parts += [element("p", words), element("ul", *solved, cls="helps")]
    if diagnosis.failed_changes:
        failed = [element("li", words) for words in diagnosis.failed_changes]
        parts += [element("p", "With these changes no plan was found either:"), element("ul", *failed)]
    if tried:
        parts += [element("p", "Suggestions:"), element("ul", *tried, cls="helps")]
    if not parts:
        parts = [element("p", "No single change is known to help.")]
    return element("section", element("h2", "What would help"), *parts)


def search_section(problem: Problem, diagnosis: Diagnosis, timings: Mapping[str, float]) -> Markup:
    """Return the section of a failure report about the search: options, CPU times, and evidence for the reason."""
    evidence = None
    if diagnosis.evidence:
        text = json.dumps(diagnosis.evidence, indent=2, ensure_ascii=False, default=str)
        evidence = element("details", element("summary", "Evidence"), element("pre", text))
    rows = [("method", problem.planner.method), ("seed", str(problem.planner.seed))]
    rows.append(("time limit", f"{problem.planner.time_limit:g} s"))
    link = element("a", "solution.json", href="solution.json")
    return element(
        "section",
        element("h2", "How the search was run"),
        table((), rows, cls="pairs"),
        timings_table(timings),
        evidence,
        element("p", link, ": the problem and these findings as data"),
    )
