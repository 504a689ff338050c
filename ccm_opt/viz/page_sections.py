"""Sections of HTML reports: scene and player, the problem, how the plan was made, output files, and other plans."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import span_words
from ccm_opt.problem import Problem
from ccm_opt.problem.poses import name_suffix
from ccm_opt.problem.solution import ParetoPlan, ParetoPlans, Solution
from ccm_opt.viz.document import MINUS, NONE, Child, Markup, PageUnits, element, joined, table, three_digits

_ZOOMS = (("zoom-in", "+", "zoom in (+)"), ("zoom-out", MINUS, "zoom out (-)"))
_SIDES = (
    ("look-slant", "Oblique", "oblique view (s)"),
    ("look-x", "x", "view against x (x)"),
    ("look-y", "y", "view along y (y)"),
    ("look-z", "z", "view from above (z)"),
)
_KEYS = (
    ("Space", "play and pause"),
    ("← →", "back and forward by 1 % of the motion; with Shift by 10 %"),
    ("Home End", "jump to start and end"),
    ("[ ]", "slower and faster"),
)


def stage_section(label: str, *, moves: bool, in_space: bool = False) -> Markup:
    """Return the section of a report in which the report's script draws the scene, with its controls.

    Args:
        label: description of the scene for screen readers.
        moves: whether there is a motion, with a readout at the selected time.
        in_space: whether the scene is three-dimensional, so that it can be rotated and obstacles can be cut open.
    """
    reach = ("show the motion", "show all obstacles") if in_space else ("show the motion", "show the whole workspace")
    looks = (("fit", "Fit", f"{reach[0]} (0)"), ("room", "Show all", f"{reach[1]} (r)"))
    buttons = [
        element("button", sign, id=name, type="button", title=words)
        for name, sign, words in (*_ZOOMS, *looks, *(_SIDES if in_space else ()))
    ]
    readout = None
    if moves:
        heads = "direction" if in_space else "heading"
        words = (("time", "time"), ("tip", "tip"), ("heading", heads), ("gap", "gap"))
        pairs = [element("div", element("dt", word), element("dd", data_now=key)) for key, word in words]
        readout = element("dl", *pairs, cls="readout places" if in_space else "readout")
    zoom = "Ctrl + wheel, pinch or double-click"
    hint = (
        f"Drag to rotate; drag with Shift, the right button or two fingers to pan; {zoom} to zoom."
        if in_space
        else f"Drag to pan; {zoom} to zoom."
    )
    keys = [*(_KEYS if moves else ()), (f"+ {MINUS} 0 r", f"zoom in, zoom out, {', '.join(reach)}")]
    keys += [("s x y z", "oblique view, side views, top view")] if in_space else []
    listed = element("ul", *(element("li", element("kbd", key), f" {words}") for key, words in keys))
    place = None if in_space else element("span", id="place", cls="soft")
    return element(
        "section",
        element("div", *buttons, place, cls="tools"),
        element("div", id="scene", data_label=label),
        element("div", id="layers", cls="layers"),
        element("div", _slider("clarity", "obstacles", 0.2, 0.9), *_cut(), cls="layers no-print") if in_space else None,
        readout,
        element("details", element("summary", "Mouse and keys"), element("p", hint), listed, cls="no-print"),
        cls="stage",
    )


def _slider(name: str, words: str, value: float, most: float) -> Markup:
    """Return a slider with a label, for the opacity of obstacles or the position of a cut.

    Args:
        name: id of the slider.
        words: label.
        value: initial value.
        most: maximum value; the minimum is 0.
    """
    bar = element("input", id=name, type="range", min="0", max=str(most), step="0.01", value=str(value))
    return element("label", words, " ", bar)


def _cut() -> tuple[Markup, Markup]:
    """Return the controls for position and axis of the plane that cuts obstacles open."""
    options = [element("option", name, value=str(k), selected=k == 1) for k, name in enumerate("xyz")]
    axis = element("select", *options, id="cut-axis", aria_label="axis of the section")
    return _slider("cut", "cut", 1.0, 1.0), element("label", "across ", axis)


def player_bar() -> Markup:
    """Return the playback controls of a report, which stay at the lower edge of the window."""
    slider = element("input", id="time", type="range", min="0", max="1", value="0", aria_label="time")
    return element(
        "div",
        element("button", "Play", id="play", type="button", title="play and pause (Space)"),
        element("div", element("div", id="marks"), slider, cls="track"),
        element("output", id="clock"),
        joined((element("select", id="speed", aria_label="playback speed", title="playback speed"),)),
        element("label", element("input", id="loop", type="checkbox", checked=True), "loop"),
        cls="player",
    )


def goal_times(solution: Solution) -> list[dict[str, object]]:
    """Return the times at which the arm reaches each goal [s], as data for the report's scripts."""
    time = solution.trajectory.time
    numbers = [*solution.trajectory.stops, len(time) - 1]
    single = len(numbers) == 1
    return [
        {
            "at": float(time[k]),
            "words": "goal" if single else str(n),
            "title": f"goal {n}{name_suffix(stop.goal)}, at {time[k]:.2f} s",
        }
        for n, (k, stop) in enumerate(zip(numbers, solution.problem.goals, strict=True), start=1)
    ]


_FILES = {
    "solution.json": "problem, result and checks",
    "solution.npz": "all arrays",
    "trajectory.csv": "motion as a table",
    "trajectory.yaml": "motion for ROS 2",
    "arm.urdf": "arm for RViz and other programs",
    "arm.mjcf.xml": "arm for MuJoCo",
}
"""Descriptions of the files next to a report to which the report links, by file name."""

Row = tuple[Child, Child]


def problem_section(problem: Problem, units: PageUnits) -> Markup:
    """Return the section of a report about the problem: arm, limits, workspace, goals and gravity.

    Args:
        problem: the problem.
        units: units of the page.
    """
    rows = [
        *_arm_rows(problem, units),
        *_limit_rows(problem, units),
        *_workspace_rows(problem, units),
        *_goal_rows(problem, units),
        ("gravity", f"({', '.join(f'{value:g}' for value in problem.simulation.gravity)}) m/s²"),
    ]
    return element("section", element("h2", "The problem"), table((), rows, cls="pairs"))


def _arm_rows(problem: Problem, units: PageUnits) -> Iterable[Row]:
    arm = problem.arm
    each, thick = (span_words(values, lambda value: units.given(value, "m")) for values in (arm.lengths, arm.radii))
    yield "arm", f"{arm.links} links of {each}, {units.given(arm.length, 'm')} in total"
    yield "radius", thick
    along = (
        f"heading {units.given(arm.base_heading, 'rad')}"
        if arm.dimension == 2
        else f"along {_direction(arm.direction)}"
    )
    yield "base", f"{_place(arm.base, units)}, {along}"
    limits = arm.bend_limits[arm.bends_a_joint :]
    bends = span_words(limits, lambda value: f"±{units.given(value, 'rad')}")
    first = "" if arm.base_limit == arm.joint_limit else f", the first joint ±{units.given(arm.base_limit, 'rad')}"
    yield "bends", bends + first
    yield "mass", f"{units.shown(float(arm.masses.sum()), 'kg')} in total"
    for name, axis in zip(arm.coordinates.base_names, arm.carrier, strict=bool(arm.carrier)):
        low, high = (units.given(value, axis.unit) for value in (axis.low, axis.high))
        yield name, f"{'revolute' if axis.revolute else 'prismatic'}, {_direction(axis.direction)}, {low} to {high}"
    if arm.feed is not None:
        low, high = (units.given(value, "m") for value in (arm.feed.low, arm.feed.high))
        yield "feed axis", f"{low} to {high}, guide tube ends at {units.given(arm.feed.hole, 'm')}"


def _limit_rows(problem: Problem, units: PageUnits) -> Iterable[Row]:
    """Yield table rows for the limits of the motion, and for the fraction of them that plans may use."""
    limits = problem.limits
    yield "joint velocities", _bounds(limits.velocity, "rad/s")
    yield "joint accelerations", _bounds(limits.acceleration, "rad/s²")
    if limits.jerk is not None:
        yield "joint jerks", _bounds(limits.jerk, "rad/s³")
    yield "joint torques", "not limited" if limits.torque is None else _bounds(limits.torque, "N m")
    for name, value, unit in (
        ("feed velocity", limits.feed_velocity, "m/s"),
        ("feed acceleration", limits.feed_acceleration, "m/s²"),
        ("feed force", limits.feed_force, "N"),
    ):
        if value is not None:
            yield name, units.given(value, unit)
    for point in limits.points:
        bounds = ((point.velocity, "m/s"), (point.acceleration, "m/s²"))
        yield point.name, ", ".join(units.given(value, unit) for value, unit in bounds if np.isfinite(value))
    if problem.planner.follow_within is not None:
        yield "deviation from the path of the tip", f"at most {units.given(problem.planner.follow_within, 'm')}"
    yield "share of limits that plans use", f"{100.0 * problem.planner.effort_share:g} %"


def _bounds(values: FloatArray, unit: str) -> str:
    low = float(values.min())
    high = float(values.max())
    return f"{low:g} {unit}" if low == high else f"{low:g} to {high:g} {unit}"


def _workspace_rows(problem: Problem, units: PageUnits) -> Iterable[Row]:
    workspace = problem.workspace
    count, sides, meshes = len(workspace.obstacles), None, ""
    if workspace.dimension == 2:
        sides = np.ptp(np.reshape(workspace.boundary.bounds, (2, 2)), axis=0)
    else:
        sides = None if workspace.bounds is None else np.ptp(workspace.bounds, axis=0)
        faces = [len(body.faces) for _, _, body in workspace.meshes]
        meshes = f", {len(faces)} of them meshes with {sum(faces)} triangles" if faces else ""
    yield "workspace", "unbounded" if sides is None else " by ".join(units.given(side, "m") for side in sides)
    yield "obstacles", f"{count}{meshes}"
    yield "clearance", f"{units.given(workspace.clearance, 'm')} from walls, required"
    yield "preferred clearance", f"{units.given(problem.wanted_gap, 'm')} beyond the required one"


def _goal_rows(problem: Problem, units: PageUnits) -> Iterable[Row]:
    """Yield table rows for every goal with its tolerances."""
    for number, stop in enumerate(problem.goals, start=1):
        goal, near = stop.goal, units.given(stop.tolerances.position, "m")
        turn = units.given(min(stop.tolerances.heading, np.pi), "rad")
        place = f"tip at {_place(goal.tip(problem.arm), units)} within {near}"
        if (look_at := goal.look_at) is not None:
            least, most = (units.given(each, "m") for each in look_at.distance)
            field = units.given(look_at.field_of_view, "rad")
            words = f"looks at {_place(look_at.place, units)} from {least} to {most} away, field of view {field}"
        elif goal.whole(problem.arm) is not None:
            words = f"whole-arm pose, within {near} and {turn}"
        elif goal.heading is not None:
            words = f"{place}, heading {units.given(goal.heading, 'rad')} within {turn}"
        elif goal.direction is not None:
            words = f"{place}, along {_direction(goal.direction)} within {turn}"
            if goal.up is not None:
                words += f", up {_direction(goal.up)} within {units.given(min(stop.tolerances.roll, np.pi), 'rad')}"
        else:
            words = f"{place}, any {'heading' if problem.dimension == 2 else 'direction'}"
        passed = "".join(f", via {_place(each, units)}" for each in goal.via)
        passed += "" if goal.path is None else f", along a path of {len(goal.path)} points"
        yield f"goal {number}{name_suffix(goal)}" if problem.stops else f"goal{name_suffix(goal)}", words + passed


def _place(point: FloatArray, units: PageUnits) -> str:
    return f"({', '.join(three_digits(float(value) / units.metres, 1) for value in point)}) {units.name}"


def _direction(vector: FloatArray) -> str:
    return f"({', '.join(three_digits(float(value), 2) for value in vector)})"


def making_section(solution: Solution) -> Markup:
    """Return the section of a report about how the plan was made: method, candidate, seed, versions, CPU times."""
    problem = solution.problem
    versions = ", ".join(f"{name} {version}" for name, version in solution.versions.items())
    rows: list[Row] = [
        ("method", problem.planner.method),
        ("found by", solution.path.candidate or NONE),
        ("keyframes", str(len(solution.path.keyframes))),
        ("retiming", problem.planner.retiming),
        ("seed", str(problem.planner.seed)),
        ("versions", versions or NONE),
    ]
    return element(
        "section",
        element("h2", "How the plan was made"),
        table((), rows, cls="pairs"),
        tries_table(solution),
        timings_table(solution.timings),
    )


def tries_table(solution: Solution) -> Markup | None:
    """Return a table of all planning attempts with their seeds; None if there was only one."""
    if not solution.tries:
        return None
    rows = [
        (
            str(each.seed),
            NONE if each.duration is None else f"{each.duration:.2f} s",
            each.reason,
            "chosen" if each.taken else "",
        )
        for each in solution.tries
    ]
    return joined((element("h3", "Tries"), table(("seed", "duration", "", ""), rows, numbers=(1,))))


def timings_table(timings: Mapping[str, float]) -> Markup | None:
    """Return a table of the CPU times of the stages, the longest first; None without timings."""
    if not timings:
        return None
    longest = max(*timings.values(), 1e-9)
    rows = [
        (
            name,
            f"{seconds:.2f} s",
            element("span", element("i", style=f"width:{100 * seconds / longest:.0f}%"), cls="used"),
        )
        for name, seconds in sorted(timings.items(), key=lambda item: -item[1])
    ]
    return joined((element("h3", "CPU time"), table((), rows, numbers=(1,))))


def files_section(name: str, pictures: Sequence[str]) -> Markup:
    """Return the section of a report with links to the files next to it, and further commands.

    Args:
        name: name of the output folder.
        pictures: names of the picture and film files that show the motion.
    """
    shown = {file: "motion as a film" if file.endswith(".gif") else "motion in one picture" for file in pictures}
    files = {**_FILES, **shown}
    links = (element("li", element("a", file, href=file), f": {words}") for file, words in files.items())
    commands = "\n".join(f"ccm-opt {verb} {name}" for verb in ("check", "simulate", "tolerance"))
    return element(
        "section",
        element("h2", "Files and next steps"),
        element("ul", *links),
        element("p", "In the parent folder of this plan:"),
        element("pre", commands),
    )


@dataclass(frozen=True)
class PlanPages:
    """Several plans of one problem, with links to their reports from the report of one of them.

    Attributes:
        found: all plans.
        links: links to the plans' reports, in order; empty for the current report, and where there is no plan.
    """

    found: ParetoPlans
    links: tuple[str, ...]


def plans_section(pages: PlanPages | None, units: PageUnits) -> Markup | None:
    """Return the section of a report that compares several plans of the problem; None if there is only one.

    Args:
        pages: the plans.
        units: units of the page.
    """
    if pages is None:
        return None
    numbered = enumerate(zip(pages.found.plans, pages.links, strict=True), start=1)
    rows = [_row(number, plan, link, pages, units) for number, (plan, link) in numbered]
    return element(
        "section",
        element("h2", "Trade-off of duration and clearance"),
        table(("plan", "preferred", "least gap", "duration", ""), rows, numbers=(1, 2, 3)),
    )


def _row(number: int, plan: ParetoPlan, link: str, pages: PlanPages, units: PageUnits) -> Sequence[Markup | str]:
    wanted = units.length(plan.wanted_gap)
    if plan.solution is None:
        return str(number), wanted, NONE, NONE, plan.reason
    name: Markup | str = element("a", f"plan {number}", href=link) if link else f"plan {number}, this one"
    remark = "recommended" if number == pages.found.recommended else ""
    if plan.dominated_by:
        remark = f"dominated by plan {plan.dominated_by}"
    return name, wanted, units.length(plan.gap), f"{plan.duration:.2f} s", remark
