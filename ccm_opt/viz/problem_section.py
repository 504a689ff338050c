"""The sections of the page on the problem and on other plans."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Goal, Problem, TipGoal, Tolerances
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.solution import ParetoPlan, ParetoPlans, Solution
from ccm_opt.viz.document import NONE, Child, Markup, PageUnits, element, joined, table, three_digits

_FILES = {
    "solution.json": "what was asked, what came out, every limit",
    "solution.npz": "all arrays",
    "trajectory.csv": "the motion as a table",
    "trajectory.yaml": "the motion for ROS 2",
    "arm.urdf": "the arm for RViz and others",
    "arm.mjcf.xml": "the arm for MuJoCo",
}
"""Files beside the page, which links lead to."""

Row = tuple[Child, Child]


def problem_section(problem: Problem, units: PageUnits) -> Markup:
    """What was asked: arm, limits, room, start and goals.

    Args:
        problem: what was asked.
        units: of the page.
    """
    rows = [
        *_arm_rows(problem, units),
        *_limit_rows(problem, units),
        *_room_rows(problem, units),
        *_goal_rows(problem, units),
        ("gravity", f"({', '.join(f'{value:g}' for value in problem.simulation.gravity)}) m/s²"),
    ]
    return element("section", element("h2", "The problem"), table((), rows, cls="pairs"))


def _arm_rows(problem: Problem, units: PageUnits) -> Iterable[Row]:
    arm = problem.arm
    yield "arm", f"{arm.links} links of {units.given(arm.link_length, 'm')}, {units.given(arm.length, 'm')} in all"
    yield "radius", units.given(arm.radius, "m")
    along = (
        f"heading {units.given(arm.base_heading, 'rad')}"
        if arm.dimension == 2
        else f"along {_direction(arm.direction)}"
    )
    yield "base", f"{_place(arm.base, units)}, {along}"
    bends = f"±{units.given(arm.joint_limit, 'rad')}"
    first = "" if arm.base_limit == arm.joint_limit else f", the first joint ±{units.given(arm.base_limit, 'rad')}"
    yield "bends", bends + first
    yield "mass", f"{units.shown(float(arm.masses.sum()), 'kg')} in all"
    if arm.feed is not None:
        low, high = (units.given(value, "m") for value in (arm.feed.low, arm.feed.high))
        yield "feed axis", f"{low} to {high}, hole at {units.given(arm.feed.hole, 'm')}"


def _limit_rows(problem: Problem, units: PageUnits) -> Iterable[Row]:
    """The limits that the motion keeps, and what plans use of them."""
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
    yield "share that plans use", f"{100.0 * problem.planner.effort_share:g} %"


def _bounds(values: FloatArray, unit: str) -> str:
    low = float(values.min())
    high = float(values.max())
    return f"{low:g} {unit}" if low == high else f"{low:g} to {high:g} {unit}"


def _room_rows(problem: Problem, units: PageUnits) -> Iterable[Row]:
    workspace = problem.workspace
    count, sides, meshes = len(workspace.obstacles), None, ""
    if workspace.dimension == 2:
        sides = np.ptp(np.reshape(workspace.boundary.bounds, (2, 2)), axis=0)
    else:
        sides = None if workspace.bounds is None else np.ptp(workspace.bounds, axis=0)
        faces = [len(each.body.faces) for each in workspace.obstacles if isinstance(each.body, MeshBody)]
        meshes = f", {len(faces)} of them meshes with {sum(faces)} triangles" if faces else ""
    yield "room", "none" if sides is None else " by ".join(units.given(side, "m") for side in sides)
    yield "obstacles", f"{count}{meshes}"
    yield "clearance", f"{units.given(workspace.clearance, 'm')} to walls, required"
    yield "wanted gap", f"{units.given(problem.wanted_gap, 'm')} beyond radius and clearance"


def _goal_rows(problem: Problem, units: PageUnits) -> Iterable[Row]:
    asked = [*((stop.goal, stop.tolerances) for stop in problem.stops), (problem.goal, problem.tolerances)]
    for number, (goal, tolerances) in enumerate(asked, start=1):
        name = f"goal {number}" if len(asked) > 1 else "goal"
        yield name, _goal_words(goal, tolerances, units)


def _goal_words(goal: Goal, tolerances: Tolerances, units: PageUnits) -> str:
    """A goal with its tolerances."""
    near = units.given(tolerances.position, "m")
    turn = units.given(min(tolerances.heading, np.pi), "rad")
    if not isinstance(goal, TipGoal):
        return f"a pose of the whole arm, within {near} and {turn}"
    place = f"tip at {_place(goal.position, units)} within {near}"
    if goal.heading is not None:
        return f"{place}, heading {units.given(goal.heading, 'rad')} within {turn}"
    if len(goal.position) == 2:
        return f"{place}, any heading"
    along = "any direction" if goal.direction is None else f"along {_direction(goal.direction)} within {turn}"
    return f"{place}, {along}" + "".join(f", past {_place(passed, units)}" for passed in goal.via)


def _place(point: FloatArray, units: PageUnits) -> str:
    return f"({', '.join(three_digits(float(value) / units.metres, 1) for value in point)}) {units.name}"


def _direction(vector: FloatArray) -> str:
    return f"({', '.join(three_digits(float(value), 2) for value in vector)})"


def making_section(solution: Solution) -> Markup:
    """How the plan was made: method, tactic, seed, versions, and where the time went."""
    problem = solution.problem
    versions = ", ".join(f"{name} {version}" for name, version in solution.versions.items())
    rows: list[Row] = [
        ("method", problem.planner.method),
        ("tactic that found it", solution.path.candidate or NONE),
        ("keyframes", str(len(solution.path.keyframes))),
        ("timed by", problem.planner.retiming),
        ("seed", str(problem.planner.seed)),
        ("versions", versions or NONE),
    ]
    return element(
        "section",
        element("h2", "How it was made"),
        table((), rows, cls="pairs"),
        tries_table(solution),
        timings_table(solution.timings),
    )


def tries_table(solution: Solution) -> Markup | None:
    """What came of every try, where there were several."""
    if not solution.tries:
        return None
    rows = [
        (
            str(each.seed),
            NONE if each.duration is None else f"{each.duration:.2f} s",
            each.reason,
            "taken" if each.taken else "",
        )
        for each in solution.tries
    ]
    return joined((element("h3", "Tries"), table(("seed", "duration", "", ""), rows, numbers=(1,))))


def timings_table(timings: Mapping[str, float]) -> Markup | None:
    """Where the CPU time went, the longest first."""
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
    """Links to the files beside the page, and the commands that go on from here.

    Args:
        name: of the output folder.
        pictures: names of the files that show the motion.
    """
    shown = {
        file: "the motion as a film" if file.endswith(".gif") else "the motion in one picture" for file in pictures
    }
    files = {**_FILES, **shown}
    links = (element("li", element("a", file, href=file), f": {words}") for file, words in files.items())
    commands = "\n".join(f"ccm-opt {verb} {name}" for verb in ("check", "simulate", "tolerance"))
    return element(
        "section",
        element("h2", "Files and what to do next"),
        element("ul", *links),
        element("p", "From the folder that holds this plan's folder:"),
        element("pre", commands),
    )


@dataclass(frozen=True)
class PlanPages:
    """The plans, and where their pages are as seen from one of them.

    Attributes:
        found: all plans.
        links: to their pages, in their order; empty for that of the page itself, and where there is no plan.
    """

    found: ParetoPlans
    links: tuple[str, ...]


def plans_section(pages: PlanPages | None, units: PageUnits) -> Markup | None:
    """The table; nothing where there is only one plan.

    Args:
        pages: the plans.
        units: of the page.
    """
    if pages is None:
        return None
    numbered = enumerate(zip(pages.found.plans, pages.links, strict=True), start=1)
    rows = [_row(number, plan, link, pages, units) for number, (plan, link) in numbered]
    return element(
        "section",
        element("h2", "From the fastest plan to the roomiest"),
        table(("plan", "wanted gap", "least gap", "duration", ""), rows, numbers=(1, 2, 3)),
    )


def _row(number: int, plan: ParetoPlan, link: str, pages: PlanPages, units: PageUnits) -> Sequence[Markup | str]:
    wanted = units.length(plan.wanted_gap)
    if plan.solution is None:
        return str(number), wanted, NONE, NONE, plan.reason
    name: Markup | str = element("a", f"plan {number}", href=link) if link else f"plan {number}, this one"
    remark = "recommended" if number == pages.found.recommended else ""
    if plan.dominated_by:
        remark = f"plan {plan.dominated_by} is better"
    return name, wanted, units.length(plan.gap), f"{plan.duration:.2f} s", remark
