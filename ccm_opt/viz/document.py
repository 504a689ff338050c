"""Pages: markup, data and header."""

import json
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from hashlib import sha256
from html import escape
from importlib.resources import files
from math import pi

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem.space_problem import AnyProblem
from ccm_opt.solution.space_solution import AnySolution
from ccm_opt.viz.page_units import PageUnits


class Markup(str):
    """Text that is HTML already; every other text is escaped when it is put into an element."""

    __slots__ = ()


Child = Markup | str | None
"""What an element may hold: markup, text, or nothing."""
_VOID = frozenset(("input", "br", "hr"))
"""Elements that hold nothing and have no end."""


def element(name: str, *children: Child, **attributes: str | float | bool | None) -> Markup:
    """An element of HTML.

    Args:
        name: of the element.
        children: what it holds; texts are escaped.
        attributes: by name; ``cls`` stands for ``class``, an underscore for a hyphen; None and False are left out.
    """
    named = {("class" if key == "cls" else key.replace("_", "-")): value for key, value in attributes.items()}
    written = "".join(
        _attribute(key, value) for key, value in named.items() if value is not None and value is not False
    )
    if name in _VOID:
        return Markup(f"<{name}{written}>")
    return Markup(f"<{name}{written}>{joined(children)}</{name}>")


def joined(children: Iterable[Child]) -> Markup:
    """Several things one after the other; texts are escaped."""
    return Markup("".join(child if isinstance(child, Markup) else escape(child) for child in children if child))


def table(
    heads: Iterable[Child], rows: Iterable[Iterable[Child]], *, cls: str = "", numbers: Iterable[int] = ()
) -> Markup:
    """A table that scrolls by itself where it is too wide for the page.

    Args:
        heads: of the columns; none for a table without heads.
        rows: of the table, cell by cell.
        cls: class of the table.
        numbers: columns that hold numbers, counted from 0.
    """
    right = frozenset(numbers)

    def cells(name: str, row: Iterable[Child]) -> Markup:
        return joined(element(name, cell, cls="n" if k in right else None) for k, cell in enumerate(row))

    heads = list(heads)
    head = element("thead", element("tr", cells("th", heads))) if heads else None
    body = element("tbody", *(element("tr", cells("td", row)) for row in rows))
    return element("div", element("table", head, body, cls=cls or None), cls="wide")


def _attribute(key: str, value: str | float | bool) -> str:
    return f" {key}" if value is True else f' {key}="{escape(str(value), quote=True)}"'


_FOLDER = "ccm_opt.viz"
COMMON = ("elements", "numbers", "sampled", "arm", "timeline", "viewport", "scene", "marks", "theme", "controls")
"""Scripts that every page with a scene has, in the order in which they are needed."""


def html_document(title: str, body: Markup, data: Mapping[str, object], scripts: Sequence[str]) -> str:
    """A whole page.

    Args:
        title: of the window, plain text.
        body: of the page.
        data: what its scripts read, as JSON.
        scripts: names of files in ``script``, without their ending, in order.
    """
    script = '"use strict";\n' + "\n".join(_resource(f"script/{name}.js") for name in scripts)
    digest = b64encode(sha256(script.encode()).digest()).decode()
    parts = {
        "title": escape(title),
        "hash": f"sha256-{digest}",
        "style": _resource("page.css"),
        "body": body,
        "data": json_for_html(data),
        "script": script,
    }
    # Split first and filled once: what is filled in is never searched for further places.
    first, *others = _resource("page.html").split("{{")
    filled = [first]
    for part in others:
        name, rest = part.split("}}", maxsplit=1)
        filled += [parts[name], rest]
    return "".join(filled)


def json_for_html(data: Mapping[str, object]) -> str:
    """JSON that can neither end nor begin an element of HTML."""
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _resource(name: str) -> str:
    return files(_FOLDER).joinpath(name).read_text(encoding="utf-8")


CodedArray = dict[str, object]
"""``step``, and the whole numbers ``d`` whose running sums are the values in steps."""


def coded(values: FloatArray, step: float) -> CodedArray:
    """An array of shape (T,) as differences of whole numbers; no value is off by more than half a step."""
    whole = np.round(np.asarray(values, dtype=np.float64) / step).astype(np.int64)
    return {"step": step, "d": np.diff(whole, prepend=0).tolist()}


def step_for(values: FloatArray, share: float) -> float:
    """A round step, at most a share of the range of some values; of values that do not vary a small one."""
    extent = float(np.max(np.abs(values), initial=0.0))
    if extent == 0.0:
        return 1.0
    return float(10.0 ** np.floor(np.log10(share * extent)))


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
