"""Construction of HTML reports: elements, formatting of numbers and units, page header, and compact arrays."""

import json
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from html import escape
from importlib.resources import files
from math import degrees, floor, isfinite, log10, pi

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, span_words
from ccm_opt.problem import LengthUnit, Problem
from ccm_opt.problem.solution import Solution

MINUS = "\N{MINUS SIGN}"
NONE = "\N{EN DASH}"
"""Placeholder for a missing value."""
_UNITS_OF_LENGTH = (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6))
_PREFIXES = (("", 1.0), ("m", 1e-3), ("µ", 1e-6), ("n", 1e-9))
_LARGE_ARM = 20.0
"""Arm length from which lengths are shown in metres [m]."""
_SMALL_ARM = 0.02
"""Arm length below which lengths are shown in micrometres [m]."""
_LEAST_MASS = 0.1
"""Mass below which masses are shown in grams [kg]."""
_FINEST_SHARE = 4e-6
"""Resolution of lengths in a report, as a fraction of the arm's length."""
_FINEST_OF_SCALE = 1e-3
"""Resolution of other quantities in a report, as a fraction of their maximum."""


NUMBER_STEP = 1e-4
"""Resolution of chart values in a report, as a fraction of the chart's range."""
_ROUNDING = 1e-5
"""Fraction of the last decimal below which values count as rounding errors and are shown as 0."""


def three_digits(value: float, finest: int) -> str:
    """Return the text of a number with three significant digits, but at most a given number of decimals.

    A number that would be rounded to 0 is shown with two significant digits; NaN and infinity become a dash.

    Args:
        value: the number.
        finest: maximum number of decimals.
    """
    if not isfinite(value):
        return NONE
    size = abs(value)
    decimals = finest if size == 0.0 else min(max(2 - floor(log10(size)), 0), finest)
    text = f"{size:.{decimals}f}"
    if not float(text) and size > _ROUNDING * 10.0**-finest:
        text = f"{size:.2g}"
    return f"{MINUS}{text}" if value < 0.0 and float(text) else text


@dataclass(frozen=True)
class PageUnits:
    """Units of a report: lengths in the unit of the problem file or one that suits the arm, angles in degrees.

    Attributes:
        name: name of the unit of length.
        metres: size of that unit [m].
        decimals: maximum number of decimals of lengths.
    """

    name: str
    metres: float
    decimals: int

    @classmethod
    def of_arm(cls, length: float) -> "PageUnits":
        """Return units of length that suit an arm of the given length [m]."""
        name, metres = _UNITS_OF_LENGTH[1]
        if length >= _LARGE_ARM:
            name, metres = _UNITS_OF_LENGTH[0]
        elif length < _SMALL_ARM:
            name, metres = _UNITS_OF_LENGTH[2]
        finest = floor(-log10(_FINEST_SHARE * length / metres))
        return cls(name, metres, min(max(finest, 0), 4))

    @classmethod
    def of_file(cls, length_unit: LengthUnit, length: float) -> "PageUnits":
        """Return units with a problem file's unit of length, for an arm of the given length [m]."""
        metres = METRES[length_unit]
        finest = floor(-log10(_FINEST_SHARE * length / metres))
        return cls(length_unit, metres, min(max(finest, 0), 6))

    @classmethod
    def of_page(cls, problem: Problem) -> "PageUnits":
        """Return the units of the report on a problem.

        The unit of length is that of the problem file; for a file in metres, one that suits the arm.
        """
        length = problem.arm.length
        return cls.of_arm(length) if problem.length_unit == "m" else cls.of_file(problem.length_unit, length)

    def data(self) -> dict[str, object]:
        """Return the unit of length as data for the report's scripts."""
        return {"name": self.name, "metres": self.metres, "decimals": self.decimals}

    def length(self, value: float) -> str:
        """Return the text of a length [m], with its unit."""
        return f"{three_digits(value / self.metres, self.decimals)} {self.name}"

    def given(self, value: float, unit: str) -> str:
        """Return the text of a value that the user chose, such as a limit, with its unit and without trailing zeros."""
        number, _, rest = self.shown(value, unit).partition(" ")
        digits = number.rstrip("°")
        # The zeros that end a power of ten count.
        whole = digits.rstrip("0").rstrip(".") if "." in digits and "e" not in digits else digits
        return f"{whole}{number[len(digits) :]} {rest}".rstrip()

    def shown(self, value: float, unit: str, scale: float = 0.0) -> str:
        """Return the text of a value with a unit that is easy to read.

        Args:
            value: the value in ``unit``.
            unit: SI unit of the value; lengths and their rates are converted to the report's unit, angles to degrees.
            scale: maximum of several values to be compared, which determines their common prefix and resolution.
        """
        if unit in {"m", "m/s", "m/s²", "m/s³"}:
            return f"{self.length(value)}{unit[1:]}"
        if unit == "rad":
            return f"{three_digits(degrees(value), 2)}°"
        if unit == "of the limit":
            return f"{three_digits(100.0 * value, 1)} %"
        if unit == "kg" and max(abs(scale), abs(value)) < _LEAST_MASS:
            return self.shown(1e3 * value, "g", 1e3 * scale)
        # Seconds and the like take no prefix; other units take one for small values.
        scale = max(abs(scale), abs(value)) if isfinite(value) else abs(scale)
        prefixes = _PREFIXES[:1] if unit in _WHOLE_UNITS else _PREFIXES
        prefix, size = next((each for each in prefixes if scale >= 0.1 * each[1] or scale == 0.0), prefixes[-1])
        finest = 3 if scale == 0.0 else min(max(floor(-log10(_FINEST_OF_SCALE * scale / size)), 0), 6)
        return f"{three_digits(value / size, finest)} {prefix}{unit}".rstrip()


_WHOLE_UNITS = frozenset(("", "s", "names", "tolerances", "rad/s", "rad/s²", "rad/s³", "1/m"))
"""Units that are shown without prefixes such as milli."""


class Markup(str):
    """HTML text that is inserted into elements as it stands, while all other text is escaped."""

    __slots__ = ()


Child = Markup | str | None
"""Content of an element: markup, text, or nothing."""
_VOID = frozenset(("input", "br", "hr"))
"""Elements without content or end tag."""


def element(name: str, *children: Child, **attributes: str | float | bool | None) -> Markup:
    """Return an HTML element with the given content and attributes.

    Args:
        name: name of the element.
        children: content of the element; texts are escaped.
        attributes: attributes by name; ``cls`` stands for ``class``, an underscore for a hyphen; None and False are
            left out.
    """
    named = {("class" if key == "cls" else key.replace("_", "-")): value for key, value in attributes.items()}
    written = "".join(
        _attribute(key, value) for key, value in named.items() if value is not None and value is not False
    )
    if name in _VOID:
        return Markup(f"<{name}{written}>")
    return Markup(f"<{name}{written}>{joined(children)}</{name}>")


def joined(children: Iterable[Child]) -> Markup:
    """Return several pieces of HTML content concatenated; texts are escaped."""
    return Markup("".join(child if isinstance(child, Markup) else escape(child) for child in children if child))


def table(
    heads: Iterable[Child], rows: Iterable[Iterable[Child]], *, cls: str = "", numbers: Iterable[int] = ()
) -> Markup:
    """Return an HTML table that scrolls horizontally if the page is too narrow.

    Args:
        heads: column heads; empty for a table without heads.
        rows: rows of cells.
        cls: CSS class of the table.
        numbers: indices, from 0, of columns that hold numbers.
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
_SCENE = ("elements", "numbers", "sampled", "arm", "timeline", "theme")
_VIEWS = {2: ("viewport", "plane_view"), 3: ("space_view",)}
_CHARTS = ("axes", "chart", "joint_charts", "gap_chart", "phase_chart", "curvature_chart", "player")


def scene_scripts(dimension: int, *, moves: bool) -> tuple[str, ...]:
    """Return the names of the scripts of a report with a scene, in loading order.

    Args:
        dimension: dimension of the scene, 2 or 3.
        moves: whether there is a motion, with charts.
    """
    return (*_SCENE, *_VIEWS[dimension], *(_CHARTS if moves else ()), "page")


def html_document(title: str, body: Markup, data: Mapping[str, object], scripts: Sequence[str]) -> str:
    """Return a complete HTML page that loads no other files.

    Args:
        title: title of the window, plain text.
        body: body of the page.
        data: data that the scripts read, as JSON.
        scripts: names of the scripts, without suffix, in loading order.
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
    # The template is split before it is filled, so that inserted text is never searched for placeholders.
    first, *others = _resource("page.html").split("{{")
    filled = [first]
    for part in others:
        name, rest = part.split("}}", maxsplit=1)
        filled += [parts[name], rest]
    return "".join(filled)


def json_for_html(data: Mapping[str, object]) -> str:
    """Return data as JSON text in which <, > and & are escaped, so that the text is safe inside an HTML element."""
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _resource(name: str) -> str:
    return files(_FOLDER).joinpath(name).read_text(encoding="utf-8")


CodedArray = dict[str, object]
"""An array encoded as a ``step`` and integers ``d``, whose cumulative sums times the step are the values."""


def coded(values: FloatArray, step: float) -> CodedArray:
    """Return an array of shape (T,) encoded as integer differences, with an error of at most half a step per value."""
    whole = np.round(np.asarray(values, dtype=np.float64) / step).astype(np.int64)
    return {"step": step, "d": np.diff(whole, prepend=0).tolist()}


def step_for(values: FloatArray, share: float = NUMBER_STEP) -> float:
    """Return the step for encoding values, the largest power of ten up to ``share`` times their maximum magnitude.

    The step is 1 if all values are zero.
    """
    extent = float(np.max(np.abs(values), initial=0.0))
    if extent == 0.0:
        return 1.0
    return float(10.0 ** np.floor(np.log10(share * extent)))


Figure = tuple[str, str]
"""A key figure of a plan: value with unit, and description."""


def page_header(problem: Problem, badges: Iterable[Markup], figures: Iterable[Figure], units: PageUnits) -> Markup:
    """Return the header of a report: name of the problem, badges, description and key figures.

    Args:
        problem: the problem.
        badges: verdicts shown next to the name.
        figures: key figures shown below the description.
        units: units of the page.
    """
    theme = element("button", "◐ auto", id="theme", type="button", title="light or dark theme")
    name = element("h1", f"{problem.name} ", *badges)
    lead = element("p", problem.description or _summary(problem, units), cls="lead")
    shown = [element("div", element("b", value), element("span", words), cls="figure") for value, words in figures]
    return element(
        "header", element("div", element("div", name, lead), theme, cls="top"), element("div", *shown, cls="figures")
    )


def badge(words: str, *, good: bool) -> Markup:
    """Return an HTML badge with a verdict of one or a few words."""
    return element("span", words, cls="badge" if good else "badge poor")


def plan_badges(solution: Solution) -> Markup:
    """Return badges with the verdicts of verifier and simulation on a plan."""
    verdict = solution.simulation.verdict
    verified = all(check.passed for check in solution.checks)
    partly = solution.tour is not None and bool(solution.tour.left_out)
    passed = "solved in part, and verified" if partly else "solved and verified"
    first = badge(passed if verified else "rejected by the verifier", good=verified and not partly)
    # A plan that the simulated arm follows needs no second badge.
    return joined((first, badge(f"simulation: {verdict.outcome}", good=False))) if verdict.is_failure else first


def plan_figures(solution: Solution, units: PageUnits) -> list[Figure]:
    """Return the key figures of a plan for the report's header; figures that the plan does not have are left out."""
    metrics = solution.metrics
    found = [(f"{solution.trajectory.duration:.2f} s", "duration")]
    room = solution.room
    if room is not None:
        near = room.nearest
        wanted = f", {units.given(room.wanted, 'm')} preferred" if room.wanted else ""
        value = units.length(near.gap) if near.link else f"> {units.length(room.reach)}"
        beyond = " beyond the clearance" if room.clearance and not near.second_link else ""
        found.append((value, f"least gap{beyond}{wanted}"))
    if "tip_error_m" in metrics:
        allowed = units.given(solution.problem.tolerances.position, "m")
        found.append((units.length(metrics["tip_error_m"]), f"tip error at the goal, {allowed} allowed"))
    most = solution.problem.tolerances
    for kind, allowed_turn in (("heading", most.heading), ("direction", most.heading), ("roll", most.roll)):
        if f"{kind}_error_rad" in metrics:
            turn = units.given(min(allowed_turn, pi), "rad")
            off = units.shown(metrics[f"{kind}_error_rad"], "rad")
            found.append((off, f"{kind} error at the goal, {turn} allowed"))
    if "leader_deviation_worst_m" in metrics:
        mean = units.length(metrics["leader_deviation_mean_m"])
        found.append(
            (
                units.length(metrics["leader_deviation_worst_m"]),
                f"largest deviation from the leader's path, mean {mean}",
            )
        )
    found += _peak_torque(solution, units)
    if isfinite(solution.simulation.tracking_error):
        found.append((units.shown(solution.simulation.tracking_error, "rad"), "tracking error in simulation"))
    found.append((f"{sum(solution.timings.values()):.2f} s", "CPU time to solve"))
    return found


def _peak_torque(solution: Solution, units: PageUnits) -> Iterator[Figure]:
    """Yield the peak joint torque of a plan, with the torque limit if there is one."""
    peak = solution.metrics.get("peak_torque_Nm")
    if peak is None:
        return
    bounds = solution.problem.limits.torque
    if bounds is None:
        yield units.shown(peak, "N m"), "peak torque"
        return
    limit = float(bounds.max())
    # Keep "N m" on one line.
    allowed = units.given(limit, "N m").replace(" ", "\N{NO-BREAK SPACE}")
    yield units.shown(peak, "N m", limit), f"peak torque, {allowed} allowed"


def _summary(problem: Problem, units: PageUnits) -> str:
    arm = problem.arm
    count = len(problem.workspace.obstacles)
    among = "in an empty workspace" if count == 0 else f"among {count} obstacle{'s' if count > 1 else ''}"
    return f"{arm.links} links of {span_words(arm.lengths, units.length)} {among}."
