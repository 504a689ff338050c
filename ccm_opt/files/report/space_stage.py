"""The view of a page in space, empty, with its buttons and switches; the page's script draws it."""

from ccm_opt.files.report.markup import Markup, element
from ccm_opt.files.report.page_units import MINUS

_BUTTONS = (
    ("zoom-in", "+", "zoom in (+)"),
    ("zoom-out", MINUS, "zoom out (-)"),
    ("fit", "Fit", "all that the arm does (0)"),
    ("room", "Whole room", "all obstacles (r)"),
    ("look-slant", "Slanted", "from before and above (s)"),
    ("look-x", "x", "against x (x)"),
    ("look-y", "y", "along y (y)"),
    ("look-z", "z", "from above (z)"),
)
_READOUT = (("time", "time"), ("tip", "tip at"), ("heading", "points along"), ("gap", "gap"))
_KEYS = (
    ("Space", "play and pause"),
    ("← →", "a hundredth of the motion back and on; with Shift a tenth"),
    ("Home End", "start and end"),
    ("[ ]", "slower and faster"),
    (f"+ {MINUS} 0 r", "zoom in, zoom out, all that the arm does, all obstacles"),
    ("s x y z", "slanted, and from the sides"),
)


def space_stage(label: str, *, moves: bool) -> Markup:
    """The view.

    Args:
        label: what it shows, for those who do not see it.
        moves: whether there is a motion, with its figures at the time that is looked at.
    """
    buttons = [element("button", sign, id=name, type="button", title=words) for name, sign, words in _BUTTONS]
    readout = None
    if moves:
        pairs = [element("div", element("dt", words), element("dd", data_now=key)) for key, words in _READOUT]
        readout = element("dl", *pairs, cls="readout places")
    hint = (
        "Drag to turn the scene; with Shift, the right button or two fingers to move it; Ctrl and the wheel, two "
        "fingers or a double click zoom."
    )
    keys = _KEYS if moves else _KEYS[-2:]
    listed = element("ul", *(element("li", element("kbd", key), f" {words}") for key, words in keys))
    return element(
        "section",
        element("div", *buttons, cls="tools"),
        element("div", id="scene", data_label=label),
        element("div", id="layers", cls="layers"),
        element("div", _slider("clarity", "obstacles", 0.2, 0.9), *_cut(), cls="layers no-print"),
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
