"""The top of a page: name, verdict, description, and the few figures that one looks for first."""

from collections.abc import Iterable, Iterator
from math import pi

from ccm_opt.files.report.markup import Markup, element, joined
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.space.problem import AnyProblem
from ccm_opt.space.space_solution import AnySolution

Figure = tuple[str, str]
"""A value with its unit, and what it is."""


def page_header(problem: AnyProblem, badges: Iterable[Markup], figures: Iterable[Figure], units: PageUnits) -> Markup:
    """Name, badges, description and figures.

    Args:
        problem: what was asked.
        badges: beside the name.
        figures: below.
        units: of the page.
    """
    theme = element("button", "◐ auto", id="theme", type="button", title="light or dark")
    name = element("h1", f"{problem.name} ", *badges)
    lead = element("p", problem.description or _summary(problem, units), cls="lead")
    shown = [element("div", element("b", value), element("span", words), cls="figure") for value, words in figures]
    return element(
        "header", element("div", element("div", name, lead), theme, cls="top"), element("div", *shown, cls="figures")
    )


def badge(words: str, *, good: bool) -> Markup:
    """A verdict in a word or two."""
    return element("span", words, cls="badge" if good else "badge poor")


def plan_badges(solution: AnySolution) -> Markup:
    """What the verifier and the simulation say of a plan."""
    verdict = solution.simulation.verdict
    verified = all(check.passed for check in solution.checks)
    first = badge("solved and verified" if verified else "refused by the verifier", good=verified)
    # A plan that the simulated arm follows needs no second word.
    return first if verdict.followed else joined((first, badge(f"simulation: {verdict.outcome}", good=False)))


def plan_figures(solution: AnySolution, units: PageUnits) -> list[Figure]:
    """The figures of a plan that one looks for first; those that it does not have are left out."""
    metrics = solution.metrics
    found = [(f"{solution.trajectory.duration:.2f} s", "duration")]
    room = solution.room
    if room is not None:
        near = room.nearest
        wanted = f", of {units.given(room.wanted, 'm')} wanted" if room.wanted else ""
        value = units.length(near.gap) if near.link else f"> {units.length(room.reach)}"
        beyond = " beyond the clearance" if room.clearance and not near.second_link else ""
        found.append((value, f"least gap{beyond}{wanted}"))
    if "tip_error_m" in metrics:
        allowed = units.given(solution.problem.tolerances.position, "m")
        found.append((units.length(metrics["tip_error_m"]), f"from the goal, of {allowed} allowed"))
    if "heading_error_rad" in metrics:
        turn = units.given(min(solution.problem.tolerances.heading, pi), "rad")
        found.append((units.shown(metrics["heading_error_rad"], "rad"), f"off the goal's heading, of {turn} allowed"))
    if "direction_error_rad" in metrics:
        turn = units.given(min(solution.problem.tolerances.heading, pi), "rad")
        found.append(
            (units.shown(metrics["direction_error_rad"], "rad"), f"off the goal's direction, of {turn} allowed")
        )
    if "leader_deviation_worst_m" in metrics:
        mean = units.length(metrics["leader_deviation_mean_m"])
        found.append(
            (units.length(metrics["leader_deviation_worst_m"]), f"at most off the leader's path, {mean} on average")
        )
    found += _peak_torque(solution, units)
    found.append((units.shown(solution.simulation.tracking_error, "rad"), "tracking error, simulated"))
    found.append((f"{sum(solution.timings.values()):.2f} s", "CPU time of solving"))
    return found


def _peak_torque(solution: AnySolution, units: PageUnits) -> Iterator[Figure]:
    """The greatest torque, with its limit where there is one."""
    peak = solution.metrics.get("peak_torque_Nm")
    if peak is None:
        return
    bounds = solution.problem.limits.torque
    if bounds is None:
        yield units.shown(peak, "N m"), "peak torque"
        return
    limit = float(bounds.max())
    # The unit is not torn apart at the end of a line.
    allowed = units.given(limit, "N m").replace(" ", "\N{NO-BREAK SPACE}")
    yield units.shown(peak, "N m", limit), f"peak torque, of {allowed}"


def _summary(problem: AnyProblem, units: PageUnits) -> str:
    arm = problem.arm
    count = len(problem.workspace.obstacles)
    among = "in an empty room" if count == 0 else f"among {count} obstacle{'s' if count > 1 else ''}"
    return f"{arm.links} links of {units.length(arm.link_length)} {among}."
