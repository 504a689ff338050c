"""The page ``report.html`` of a problem without a plan: why there is none, drawn and in words, and what would help."""

import json
from collections.abc import Iterator, Mapping

from ccm_opt.errors import Diagnosis, Finding, sentences
from ccm_opt.files.report.document import COMMON, html_document
from ccm_opt.files.report.drawn_findings import drawn_findings, first_look, pose_points
from ccm_opt.files.report.header_section import badge, page_header
from ccm_opt.files.report.markup import Markup, element, joined, table
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.files.report.problem_section import problem_section, timings_table
from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.files.report.scene_data import goals_data, scene_data
from ccm_opt.files.report.stage_section import stage_section
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import Goal, Problem, TipGoal
from ccm_opt.space.problem import AnyProblem

SCRIPTS = (*COMMON, "failure_page")
"""Scripts of the page of a failure, in the order in which they are needed."""
STATUS = {
    "infeasible": "proved: there is no plan",
    "timed-out": "no plan within the time",
    "cancelled": "cancelled",
}


def failure_html(
    problem: Problem,
    status: str,
    diagnosis: Diagnosis,
    timings: Mapping[str, float] | None = None,
    settings: ReportSettings = REPORT,
) -> str:
    """The report of a problem without a plan.

    Args:
        problem: what was asked.
        status: how the search ended, as in ``solution.json``.
        diagnosis: why there is no plan.
        timings: of the stages that ran [s].
        settings: how exact the scene is.

    Returns:
        A whole HTML page that loads nothing.
    """
    units = PageUnits.of_page(problem)
    facts = (
        reason_section(diagnosis),
        help_section(diagnosis),
        problem_section(problem, units),
        search_section(problem, diagnosis, timings or {}),
    )
    header = page_header(problem, [badge(STATUS.get(status, status), good=False)], (), units)
    stage = stage_section(f"The problem {problem.name}, and what stands in its way", moves=False)
    body = joined((header, element("main", stage, element("div", *facts, cls="facts"))))
    return html_document(f"{problem.name}: {status}", body, failure_data(problem, diagnosis, units, settings), SCRIPTS)


def failure_data(
    problem: Problem, diagnosis: Diagnosis, units: PageUnits, settings: ReportSettings = REPORT
) -> dict[str, object]:
    """Everything that the scripts of a failure's page read."""
    start = pose_points(problem, problem.start)
    poses = [_end_pose(problem, goal) for goal in (*(stop.goal for stop in problem.stops), problem.goal)]
    blocking = [name for finding in diagnosis.findings[:1] for name in finding.obstacles]
    return {
        "unit": {"name": units.name, "metres": units.metres, "decimals": units.decimals},
        "scene": scene_data(problem, first_look(problem, diagnosis), settings),
        "start": None if start is None else start.round(6).tolist(),
        "goals": goals_data(problem, poses),
        "blocking": blocking,
        "marks": drawn_findings(problem, diagnosis, units),
    }


def _end_pose(problem: Problem, goal: Goal) -> FloatArray | None:
    return None if isinstance(goal, TipGoal) else pose_points(problem, goal)


def reason_section(diagnosis: Diagnosis) -> Markup:
    """Why there is no plan, and what else is in the way."""
    others = [finding for finding in diagnosis.findings if finding.reason != diagnosis.reason]
    first = next((finding for finding in diagnosis.findings if finding.reason == diagnosis.reason), None)
    also = [element("h3", "Also in the way")] if others else []
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
        element("p", f"Found at this stage: {diagnosis.stage}.", cls="soft"),
    )


def _sentences(reason: str, before: Markup | None = None) -> Iterator[Markup]:
    """What a reason says: its first sentence, and the details as a list."""
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
    """What would help: what was tried, and what was not."""
    solved = [element("li", relaxation.words) for relaxation in diagnosis.relaxations]
    tried = [element("li", line) for line in diagnosis.advice]
    parts: list[Markup] = []
    if solved:
        words = "With one of these changes the problem was planned, timed and verified:"
        parts += [element("p", words), element("ul", *solved, cls="helps")]
    if tried:
        parts += [element("p", "Not tried, but promising:"), element("ul", *tried, cls="helps")]
    if not parts:
        parts = [element("p", "No change of one thing alone is known to help.")]
    return element("section", element("h2", "What would help"), *parts)


def search_section(problem: AnyProblem, diagnosis: Diagnosis, timings: Mapping[str, float]) -> Markup:
    """How a plan was looked for: options, times, the figures behind the reason."""
    evidence = None
    if diagnosis.evidence:
        text = json.dumps(diagnosis.evidence, indent=2, ensure_ascii=False, default=str)
        evidence = element("details", element("summary", "The figures behind the reason"), element("pre", text))
    rows = [("method", problem.planner.method), ("seed", str(problem.planner.seed))]
    rows.append(("time limit", f"{problem.planner.time_limit:g} s"))
    link = element("a", "solution.json", href="solution.json")
    return element(
        "section",
        element("h2", "How it was looked for"),
        table((), rows, cls="pairs"),
        timings_table(timings),
        evidence,
        element("p", link, ": what was asked, and all of this as data"),
    )
