"""Picture of the least length of an arm over its radius: plans, what is proved impossible, and what was not found."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.core.length_words import METRES
from ccm_opt.problem.solution import SizeFront
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.figure_files import figure_file
from ccm_opt.viz.settings import PICTURES

_SIDES = (6.4, 4.4)
"""Width and height of the picture [inch]."""
_MARGIN = 0.08
"""Share of the range of the axes that stays free at its ends."""


def size_png(found: SizeFront) -> bytes:
    """Return the picture of least lengths over radii as bytes of a PNG file, as drawn by ``size_figure``."""
    return figure_file(lambda: size_figure(found), "png")


def size_figure(found: SizeFront) -> Figure:
    """Return a matplotlib figure of length over radius: verified plans, the region without any, and failed trials."""
    figure = Figure(figsize=_SIDES, dpi=PICTURES.dots_per_inch, layout="constrained")
    axes = figure.add_subplot()
    metres = METRES[found.problem.length_unit]
    lengths = [size.enough.length / metres for size in found.sizes if size is not None]
    failed = [each for each in found.trials if each.outcome == "not found"]
    shown = [*lengths, *(each.length / metres for each in failed)]
    shown += [
        each.length / metres for each in found.bounds if each is not None and each.length / metres <= max(lengths)
    ]
    low, high = min(shown), max(shown)
    margin = _MARGIN * max(high - low, 0.02 * high)
    radii = np.array(found.radii) / metres
    aside = _MARGIN * float(np.ptp(radii))
    axes.set_xlim(radii[0] - aside, radii[-1] + aside)
    axes.set_ylim(max(low - 2.0 * margin, 0.0), high + 3.0 * margin)
    _draw_impossible(axes, found, metres)
    axes.plot(
        [each.radius / metres for each in failed], [each.length / metres for each in failed], linestyle="", marker="x",
        markersize=5, color=style.WALL_EDGE, label="no plan found within the time", zorder=3,
    )  # fmt: skip
    plans = [(size.enough.radius / metres, size.enough.length / metres) for size in found.sizes if size is not None]
    axes.plot(
        *np.transpose(plans), color=style.GOAL_ARM_EDGE, marker="o", markerfacecolor=style.GOAL_ARM, linewidth=1.0,
        linestyle=(0, (1, 2)), label="verified plan", zorder=4,
    )  # fmt: skip
    axes.set_xlabel(f"radius of the arm [{found.problem.length_unit}]")
    axes.set_ylabel(f"length of the arm [{found.problem.length_unit}]")
    axes.set_title(f"{found.problem.name}: which arm?", fontsize=10, loc="left", pad=8)
    axes.legend(loc="upper left", frameon=False, fontsize=8.5)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure


def _draw_impossible(axes: Axes, found: SizeFront, metres: float) -> None:
    """Fill the region of arms that are proved impossible: shorter and thicker than an arm with such a proof."""
    bottom, top = axes.get_ylim()
    right = axes.get_xlim()[1]
    lengths = [0.0 if bound is None else bound.length / metres for bound in found.bounds]
    highest = np.minimum(np.maximum.accumulate(np.array([*lengths, 0.0])), top)
    radii = np.array([*(radius / metres for radius in found.radii), right])
    seen = highest > bottom
    if np.any(seen):
        axes.fill_between(
            radii[seen], bottom, highest[seen], step="post", facecolor="#ecd9d5", edgecolor="#b3695c", linewidth=0.8,
            label="proved impossible", zorder=1,
        )  # fmt: skip
