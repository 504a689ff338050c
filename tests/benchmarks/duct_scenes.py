"""The right-angle S-duct of ``problems/s-duct.toml`` at other widths, about the same centre lines."""

from collections.abc import Sequence
from typing import Any

from ccm_opt.problem import Problem
from tests.benchmarks.shared_problems import problem_data, with_links

FILE_WIDTH = 0.14
"""Width of the duct in the problem file [m]."""
CENTRES: tuple[tuple[float, ...], tuple[float, ...]] = ((0.55,), (0.02, 0.30))
"""Centre lines: x of the riser; y of the entry and of the exit [m]."""


def s_duct(width: float, links: int = 24) -> Problem:
    """The S-duct with a given width [m]; room, start, goal and length of the arm are those of the file."""
    data: dict[str, Any] = problem_data("s-duct")
    data["name"] = f"s-duct-{1e3 * width:.0f}"
    for obstacle in data["workspace"]["obstacles"]:
        obstacle["polygon"] = [_moved(corner, width) for corner in obstacle["polygon"]]
    return with_links(data, links)


def _moved(corner: Sequence[float], width: float) -> list[float]:
    """A corner of the file; what lies on a side of the duct there lies on the same side of the duct that is asked."""
    place = list(corner)
    for axis, centres in enumerate(CENTRES):
        for centre in centres:
            for side in (-0.5, 0.5):
                if abs(corner[axis] - centre - side * FILE_WIDTH) < 1e-9:
                    place[axis] = centre + side * width
    return place
