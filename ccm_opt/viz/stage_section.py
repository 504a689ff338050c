"""The section of the page on stages, routes and goals."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import path_length
from ccm_opt.errors import CcmError
from ccm_opt.problem import Problem
from ccm_opt.scene.corridor import Route
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.solution.space_solution import AnySolution
from ccm_opt.viz.document import MINUS, Markup, element, joined

_MOST_OBSTACLES = 80
"""With more of them, routes and regions are left out, whose search would take too long."""

_BUTTONS = (
    ("zoom-in", "+", "zoom in (+)"),
    ("zoom-out", MINUS, "zoom out (-)"),
    ("fit", "Fit", "all that matters (0)"),
    ("room", "Whole room", "the whole room (r)"),
)
_READOUT = (("time", "time"), ("tip", "tip at"), ("heading", "heads"), ("gap", "gap"))
_KEYS = (
    ("Space", "play and pause"),
    ("← →", "a hundredth of the motion back and on; with Shift a tenth"),
    ("Home End", "start and end"),
    ("[ ]", "slower and faster"),
    (f"+ {MINUS} 0 r", "zoom in, zoom out, all that matters, the whole room"),
)


def stage_section(label: str, *, moves: bool) -> Markup:
    """The scene, empty: the page's script draws it.

    Args:
        label: what it shows, for those who do not see it.
        moves: whether there is a motion, with its figures at the time that is looked at.
    """
    buttons = [element("button", sign, id=name, type="button", title=words) for name, sign, words in _BUTTONS]
    readout = None
    if moves:
        pairs = [element("div", element("dt", words), element("dd", data_now=key)) for key, words in _READOUT]
        readout = element("dl", *pairs, cls="readout")
    hint = "Drag to move the scene, Ctrl and the wheel, two fingers or a double click to zoom."
    return element(
        "section",
        element("div", *buttons, element("span", id="place", cls="soft"), cls="tools"),
        element("div", id="scene", data_label=label),
        element("div", id="layers", cls="layers"),
        readout,
        element(
            "details", element("summary", "Mouse and keys"), element("p", hint), _keys(moves=moves), cls="no-print"
        ),
        cls="stage",
    )


def _keys(*, moves: bool) -> Markup:
    shown = _KEYS if moves else _KEYS[-1:]
    return element("ul", *(element("li", element("kbd", keys), f" {words}") for keys, words in shown))


def player_bar() -> Markup:
    """Play, time, speed; it stays at the lower edge of the window."""
    slider = element("input", id="time", type="range", min="0", max="1", value="0", aria_label="time")
    return element(
        "div",
        element("button", "Play", id="play", type="button", title="play and pause (Space)"),
        element("div", element("div", id="marks"), slider, cls="track"),
        element("output", id="clock"),
        joined((element("select", id="speed", aria_label="speed of the playback", title="speed"),)),
        element("label", element("input", id="loop", type="checkbox", checked=True), "again"),
        cls="player",
    )


_NO_WIDTH = 1e-6
"""Stands for the radius of an arm of no width, as a share of its length."""


def route_layers(problem: Problem, end: FloatArray) -> dict[str, object]:
    """The way that the arm takes round the obstacles in its last pose, drawn taut, and the regions along it.

    Args:
        problem: what was asked.
        end: the last pose, joints and tip, shape (links + 1, 2) [m].

    Returns:
        ``route``, ``length`` [m] and ``regions``; empty where there are too many obstacles or no such way.
    """
    if len(problem.workspace.obstacles) > _MOST_OBSTACLES:
        return {}
    inflation = problem.arm.radius + problem.workspace.clearance or _NO_WIDTH * problem.arm.length
    space = FreeSpace(problem.workspace, inflation)
    try:
        sleeve = space.sleeve_of(end)
        taut = space.path_of_sleeve(sleeve, end[0], end[-1])
        corridor = space.corridor(Route(sleeve, taut, path_length(taut)))
    except CcmError:
        # The base may stand in a wall, and the mount may lead through one: then there is no such way.
        return {}
    regions = [np.round(region.vertices, 6).tolist() for region in corridor.regions]
    return {"route": np.round(taut, 6).tolist(), "length": path_length(taut), "regions": regions}


def goal_times(solution: AnySolution) -> list[dict[str, object]]:
    """When the arm rests at a goal: those on the way, then the last."""
    time = solution.trajectory.time
    numbers = [*solution.trajectory.stops, len(time) - 1]
    single = len(numbers) == 1
    return [
        {"at": float(time[k]), "words": "goal" if single else str(n), "title": f"goal {n}, at {time[k]:.2f} s"}
        for n, k in enumerate(numbers, start=1)
    ]
