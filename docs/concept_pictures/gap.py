"""Three gaps that are easily confused: clearance, margin and spare, drawn between an arm and a wall.

The figure is a scheme, not to scale: on an arm of 1 m the margin is some millimetres and the spare 0.1 mm.
"""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

from ccm_opt.viz import figure_files as style
from concept_pictures.panels import INFLATED, PORTAL, SMALL, look_at, panels, picture

HEIGHT = 2.85
WIDE = 7.4
WALL = -0.45
CLEARANCE = 0.62
"""Height of the clearance over the wall, in the figure's units."""
SPARE = 0.20
"""Height of the spare over the clearance."""
MARGIN = 0.62
"""Height of the margin over the clearance."""
RADIUS = 0.21
LONG = 1.35
"""Length of the links."""
PLACES = (1.1, 3.55, 6.0)
"""Where the three links lie."""


def gaps_png() -> bytes:
    """The picture as the content of a PNG file."""
    return picture(gaps_figure)


def gaps_figure() -> Figure:
    """Three links over one wall: in contact, as near as the certificate allows, and as planning keeps it."""
    figure, (axes,) = panels(1, 1, HEIGHT)
    look_at(axes, (0.0, WALL, WIDE, 2.32))
    axes.add_patch(Rectangle((0.0, WALL), WIDE, -WALL, facecolor=style.WALL, edgecolor="none"))
    axes.plot([0.0, WIDE], [0.0, 0.0], color=style.WALL_EDGE, linewidth=1.2)
    axes.add_patch(Rectangle((0.0, 0.0), WIDE, CLEARANCE, facecolor=INFLATED, edgecolor="none"))
    axes.plot([0.0, WIDE], [CLEARANCE, CLEARANCE], color=PORTAL, linewidth=1.1, linestyle=(0, (4, 2)))
    axes.text(0.08, 0.5 * WALL, "wall", fontsize=style.FONT_SIZE, color=style.BOUNDARY, va="center")
    axes.text(WIDE - 0.05, CLEARANCE - 0.04, "contact: gap 0", fontsize=SMALL, color=PORTAL, ha="right", va="top")
    axes.text(WIDE - 0.05, 0.5 * WALL, "not to scale", fontsize=SMALL, color=style.BOUNDARY, ha="right", va="center")
    texts = (
        ("clearance", "asked for by the user,\n" + r"key $\tt{workspace.clearance}$"),
        ("spare", "certified beyond contact,\nat all times"),
        ("margin", "kept while planning,\nbeyond contact"),
    )
    for place, gap, (name, meaning) in zip(PLACES, (0.0, SPARE, MARGIN), texts, strict=True):
        _draw_link(axes, place, CLEARANCE + gap)
        axes.text(place - 0.55, 2.3, name, fontsize=10, weight="bold", color=style.BOUNDARY, va="top")
        axes.text(place - 0.55, 2.06, meaning, fontsize=SMALL + 0.5, color=style.BOUNDARY, va="top", linespacing=1.25)
    _measure(axes, PLACES[0] - 0.35, 0.0, CLEARANCE, "clearance")
    _measure(axes, PLACES[1] - 0.35, CLEARANCE, CLEARANCE + SPARE, "spare")
    _measure(axes, PLACES[2] - 0.35, CLEARANCE, CLEARANCE + MARGIN, "margin")
    return figure


def _draw_link(axes: Axes, place: float, underside: float) -> None:
    """A link whose surface ends at a height: its body, its axis, its radius."""
    body = FancyBboxPatch(
        (place - 0.5 * LONG + RADIUS, underside + RADIUS), LONG - 2.0 * RADIUS, 0.0,
        boxstyle=f"round,pad={RADIUS},rounding_size={RADIUS}", facecolor=style.GOAL_ARM, edgecolor=style.GOAL_ARM_EDGE,
        linewidth=1.0, zorder=3,
    )  # fmt: skip
    axes.add_patch(body)
    ends = (place - 0.5 * LONG + RADIUS, place + 0.5 * LONG - RADIUS)
    axis = underside + RADIUS
    axes.plot(ends, (axis, axis), color="white", linewidth=1.0, marker="o", markersize=3, zorder=4)
    axes.plot((place + 0.28, place + 0.28), (underside + 0.02, axis), color="white", linewidth=1.2, zorder=4)
    axes.text(place + 0.35, underside + 0.5 * RADIUS, "r", fontsize=SMALL + 0.5, color="white", va="center", zorder=6)


def _measure(axes: Axes, x: float, low: float, high: float, name: str) -> None:
    """A dimension line between two heights, its name to the right of it."""
    line = {
        "arrowstyle": "|-|, widthA=0.22, widthB=0.22",
        "color": style.BOUNDARY,
        "linewidth": 1.2,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axes.annotate("", xy=(x, high), xytext=(x, low), arrowprops=line, zorder=6)
    axes.text(x + 0.07, 0.5 * (low + high), name, fontsize=SMALL + 0.5, color=style.BOUNDARY, va="center", zorder=6)
