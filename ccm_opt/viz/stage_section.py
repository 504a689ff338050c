"""The stage of a page: the scene with its buttons, and the bar that plays the motion."""

from ccm_opt.solution import Solution
from ccm_opt.viz.document import MINUS, Markup, element, joined

_ZOOMS = (("zoom-in", "+", "zoom in (+)"), ("zoom-out", MINUS, "zoom out (-)"))
_SIDES = (
    ("look-slant", "Slanted", "from before and above (s)"),
    ("look-x", "x", "against x (x)"),
    ("look-y", "y", "along y (y)"),
    ("look-z", "z", "from above (z)"),
)
_KEYS = (
    ("Space", "play and pause"),
    ("← →", "a hundredth of the motion back and on; with Shift a tenth"),
    ("Home End", "start and end"),
    ("[ ]", "slower and faster"),
)


def stage_section(label: str, *, moves: bool, in_space: bool = False) -> Markup:
    """The scene, empty: the page's script draws it.

    Args:
        label: what it shows, for those who do not see it.
        moves: whether there is a motion, with its figures at the time that is looked at.
        in_space: whether it can be turned, and obstacles cut open.
    """
    reach = ("all that the arm does", "all obstacles") if in_space else ("all that matters", "the whole room")
    looks = (("fit", "Fit", f"{reach[0]} (0)"), ("room", "Whole room", f"{reach[1]} (r)"))
    buttons = [
        element("button", sign, id=name, type="button", title=words)
        for name, sign, words in (*_ZOOMS, *looks, *(_SIDES if in_space else ()))
    ]
    readout = None
    if moves:
        heads = "points along" if in_space else "heads"
        words = (("time", "time"), ("tip", "tip at"), ("heading", heads), ("gap", "gap"))
        pairs = [element("div", element("dt", word), element("dd", data_now=key)) for key, word in words]
        readout = element("dl", *pairs, cls="readout places" if in_space else "readout")
    zoom = "Ctrl and the wheel, two fingers or a double click"
    hint = (
        "Drag to turn the scene; with Shift, the right button or two fingers to move it; " + f"{zoom} zoom."
        if in_space
        else f"Drag to move the scene, {zoom} to zoom."
    )
    keys = [*(_KEYS if moves else ()), (f"+ {MINUS} 0 r", f"zoom in, zoom out, {', '.join(reach)}")]
    keys += [("s x y z", "slanted, and from the sides")] if in_space else []
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
    """How clearly obstacles are seen, or where they are cut."""
    bar = element("input", id=name, type="range", min="0", max=str(most), step="0.01", value=str(value))
    return element("label", words, " ", bar)


def _cut() -> tuple[Markup, Markup]:
    """Where the obstacles are cut away, and across which axis."""
    options = [element("option", name, value=str(k), selected=k == 1) for k, name in enumerate("xyz")]
    axis = element("select", *options, id="cut-axis", aria_label="axis of the cut")
    return _slider("cut", "cut", 1.0, 1.0), element("label", "across ", axis)


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


def goal_times(solution: Solution) -> list[dict[str, object]]:
    """When the arm rests at a goal: those on the way, then the last."""
    time = solution.trajectory.time
    numbers = [*solution.trajectory.stops, len(time) - 1]
    single = len(numbers) == 1
    return [
        {"at": float(time[k]), "words": "goal" if single else str(n), "title": f"goal {n}, at {time[k]:.2f} s"}
        for n, k in enumerate(numbers, start=1)
    ]
