"""The document of a page, and units and numbers in it."""

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
from ccm_opt.core.length_words import METRES
from ccm_opt.problem import LengthUnit, Problem
from ccm_opt.problem.solution import Solution

MINUS = "\N{MINUS SIGN}"
NONE = "\N{EN DASH}"
"""Stands where there is no value."""
_UNITS_OF_LENGTH = (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6))
_PREFIXES = (("", 1.0), ("m", 1e-3), ("µ", 1e-6), ("n", 1e-9))
_LARGE_ARM = 20.0
"""Arms from here on are spoken of in metres [m]."""
_SMALL_ARM = 0.02
"""Arms below are spoken of in micrometres [m]."""
_LEAST_MASS = 0.1
"""Masses below are spoken of in grams [kg]."""
_FINEST_SHARE = 4e-6
"""Share of the arm's length below which lengths are not told apart on the page."""
_FINEST_OF_SCALE = 1e-3
"""The same share of other quantities, of the greatest there is."""


NUMBER_STEP = 1e-4
"""Of the numbers in a page, as a share of the range of their chart."""
_ROUNDING = 1e-5
"""What is below this share of the last decimal is rounding of what was reckoned with, and told as 0."""


def three_digits(value: float, finest: int) -> str:
    """Return a number with three digits, but no more than so many decimals unless it would be 0.

    A dash where there is none.

    Args:
        value: the number.
        finest: decimals at most.
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
    """The units of a page: lengths by the size of the arm, angles in degrees.

    Attributes:
        name: of the unit of lengths.
        metres: in that unit.
        decimals: of lengths, at most.
    """

    name: str
    metres: float
    decimals: int

    @classmethod
    def of_arm(cls, length: float) -> "PageUnits":
        """Return the units for an arm of a length [m]."""
        name, metres = _UNITS_OF_LENGTH[1]
        if length >= _LARGE_ARM:
            name, metres = _UNITS_OF_LENGTH[0]
        elif length < _SMALL_ARM:
            name, metres = _UNITS_OF_LENGTH[2]
        finest = floor(-log10(_FINEST_SHARE * length / metres))
        return cls(name, metres, min(max(finest, 0), 4))

    @classmethod
    def of_file(cls, length_unit: LengthUnit, length: float) -> "PageUnits":
        """Return the unit that a problem file counts lengths in, for an arm of a length [m]."""
        metres = METRES[length_unit]
        finest = floor(-log10(_FINEST_SHARE * length / metres))
        return cls(length_unit, metres, min(max(finest, 0), 6))

    @classmethod
    def of_page(cls, problem: Problem) -> "PageUnits":
        """Return the unit of a problem's page: that of its file.

        Who counts in metres is told those that suit the arm.
        """
        length = problem.arm.length
        return cls.of_arm(length) if problem.length_unit == "m" else cls.of_file(problem.length_unit, length)

    def data(self) -> dict[str, object]:
        """Return the unit as the scripts of a page read it."""
        return {"name": self.name, "metres": self.metres, "decimals": self.decimals}

    def length(self, value: float) -> str:
        """Return a length [m] with its unit."""
        return f"{three_digits(value / self.metres, self.decimals)} {self.name}"

    def given(self, value: float, unit: str) -> str:
        """Return a value that somebody chose, such as a limit, without zeros behind its last digit."""
        number, _, rest = self.shown(value, unit).partition(" ")
        digits = number.rstrip("°")
        whole = digits.rstrip("0").rstrip(".") if "." in digits else digits
        return f"{whole}{number[len(digits) :]} {rest}".rstrip()

    def shown(self, value: float, unit: str, scale: float = 0.0) -> str:
        """Return a value with its unit, in units for people.

        Args:
            value: in ``unit``.
            unit: in SI: lengths and their rates become those of the page, angles degrees.
            scale: the greatest of the values that are compared; what is far below is nothing.
        """
        if unit in {"m", "m/s", "m/s²", "m/s³"}:
            return f"{self.length(value)}{unit[1:]}"
        if unit == "rad":
            return f"{three_digits(degrees(value), 2)}°"
        if unit == "of the limit":
            return f"{three_digits(100.0 * value, 1)} %"
        if unit == "kg" and max(abs(scale), abs(value)) < _LEAST_MASS:
            return self.shown(1e3 * value, "g", 1e3 * scale)
        # Seconds are for people already; the others take a prefix where they are tiny.
        scale = max(abs(scale), abs(value)) if isfinite(value) else abs(scale)
        prefixes = _PREFIXES[:1] if unit in _WHOLE_UNITS else _PREFIXES
        prefix, size = next((each for each in prefixes if scale >= 0.1 * each[1] or scale == 0.0), prefixes[-1])
        finest = 3 if scale == 0.0 else min(max(floor(-log10(_FINEST_OF_SCALE * scale / size)), 0), 6)
        return f"{three_digits(value / size, finest)} {prefix}{unit}".rstrip()


_WHOLE_UNITS = frozenset(("", "s", "names", "tolerances", "rad/s", "rad/s²", "rad/s³", "1/m"))
"""Units that take no prefix."""


class Markup(str):
    """Text that is HTML already; every other text is escaped when it is put into an element."""

    __slots__ = ()


Child = Markup | str | None
"""What an element may hold: markup, text, or nothing."""
_VOID = frozenset(("input", "br", "hr"))
"""Elements that hold nothing and have no end."""


def element(name: str, *children: Child, **attributes: str | float | bool | None) -> Markup:
    """Return an element of HTML.

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
    """Return several things one after the other; texts are escaped."""
    return Markup("".join(child if isinstance(child, Markup) else escape(child) for child in children if child))


def table(
    heads: Iterable[Child], rows: Iterable[Iterable[Child]], *, cls: str = "", numbers: Iterable[int] = ()
) -> Markup:
    """Return a table that scrolls by itself where it is too wide for the page.

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
_SCENE = ("elements", "numbers", "sampled", "arm", "timeline", "theme")
_VIEWS = {2: ("viewport", "plane_view"), 3: ("space_view",)}
_CHARTS = ("axes", "chart", "joint_charts", "gap_chart", "phase_chart", "curvature_chart", "player")


def scene_scripts(dimension: int, *, moves: bool) -> tuple[str, ...]:
    """Return the scripts of a page with a scene, in the order in which they are needed.

    Args:
        dimension: of the scene.
        moves: whether there is a motion, and charts of it.
    """
    return (*_SCENE, *_VIEWS[dimension], *(_CHARTS if moves else ()), "page")


def html_document(title: str, body: Markup, data: Mapping[str, object], scripts: Sequence[str]) -> str:
    """Return a whole page.

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
    """Return the JSON that can neither end nor begin an element of HTML."""
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _resource(name: str) -> str:
    return files(_FOLDER).joinpath(name).read_text(encoding="utf-8")


CodedArray = dict[str, object]
"""``step``, and the whole numbers ``d`` whose running sums are the values in steps."""


def coded(values: FloatArray, step: float) -> CodedArray:
    """Return an array of shape (T,) as differences of whole numbers; no value is off by more than half a step."""
    whole = np.round(np.asarray(values, dtype=np.float64) / step).astype(np.int64)
    return {"step": step, "d": np.diff(whole, prepend=0).tolist()}


def step_for(values: FloatArray, share: float = NUMBER_STEP) -> float:
    """Return a round step, at most a share of the range of some values; of values that do not vary a small one."""
    extent = float(np.max(np.abs(values), initial=0.0))
    if extent == 0.0:
        return 1.0
    return float(10.0 ** np.floor(np.log10(share * extent)))


Figure = tuple[str, str]
"""A value with its unit, and what it is."""


def page_header(problem: Problem, badges: Iterable[Markup], figures: Iterable[Figure], units: PageUnits) -> Markup:
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
    """Return a verdict in a word or two."""
    return element("span", words, cls="badge" if good else "badge poor")


def plan_badges(solution: Solution) -> Markup:
    """Return what the verifier and the simulation say of a plan."""
    verdict = solution.simulation.verdict
    verified = all(check.passed for check in solution.checks)
    first = badge("solved and verified" if verified else "refused by the verifier", good=verified)
    # A plan that the simulated arm follows needs no second word.
    return first if verdict.followed else joined((first, badge(f"simulation: {verdict.outcome}", good=False)))


def plan_figures(solution: Solution, units: PageUnits) -> list[Figure]:
    """Return the figures of a plan that one looks for first; those that it does not have are left out."""
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
    for kind in ("heading", "direction"):
        if f"{kind}_error_rad" in metrics:
            turn = units.given(min(solution.problem.tolerances.heading, pi), "rad")
            off = units.shown(metrics[f"{kind}_error_rad"], "rad")
            found.append((off, f"off the goal's {kind}, of {turn} allowed"))
    if "leader_deviation_worst_m" in metrics:
        mean = units.length(metrics["leader_deviation_mean_m"])
        found.append(
            (units.length(metrics["leader_deviation_worst_m"]), f"at most off the leader's path, {mean} on average")
        )
    found += _peak_torque(solution, units)
    found.append((units.shown(solution.simulation.tracking_error, "rad"), "tracking error, simulated"))
    found.append((f"{sum(solution.timings.values()):.2f} s", "CPU time of solving"))
    return found


def _peak_torque(solution: Solution, units: PageUnits) -> Iterator[Figure]:
    """Yield the greatest torque, with its limit where there is one."""
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


def _summary(problem: Problem, units: PageUnits) -> str:
    arm = problem.arm
    count = len(problem.workspace.obstacles)
    among = "in an empty room" if count == 0 else f"among {count} obstacle{'s' if count > 1 else ''}"
    return f"{arm.links} links of {units.length(arm.link_length)} {among}."
