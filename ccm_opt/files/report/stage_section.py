"""The scene of a page with its buttons and switches, and the bar by which the motion is played."""

from ccm_opt.files.report.markup import Markup, element, joined
from ccm_opt.files.report.page_units import MINUS

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
