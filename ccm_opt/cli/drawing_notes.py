"""What people are told of a problem's drawing: how many obstacles it gave, how large, where, and what is missing."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict

import shapely

from ccm_opt.cli.display_settings import DISPLAY
from ccm_opt.cli.outcome import warn
from ccm_opt.cli.output import output
from ccm_opt.cli.tables import report_console, units_of
from ccm_opt.ground.length_words import words_in
from ccm_opt.problem import ImportedDrawing, Problem

TIMES = "\N{MULTIPLICATION SIGN}"


def tell_of_drawing(problem: Problem) -> None:
    """Print what became of a problem's drawing, and warn of what does not fit the arm or lies outside the room."""
    if problem.drawing is not None:
        _tell_of(problem.drawing, problem)
    boundary = problem.workspace.boundary
    warn_of_outside(
        problem.name,
        [each.name for each in problem.workspace.obstacles if shapely.distance(each.core, boundary) > each.rounding],
    )


def _tell_of(drawing: ImportedDrawing, problem: Problem) -> None:
    if output().as_json:
        output().note({"drawing": asdict(drawing)})
    if output().tables:
        console = report_console()
        for line in drawing_lines(drawing, problem):
            console.print(line, markup=False, highlight=False, soft_wrap=True)
    with words_in(problem.length_unit):
        odd = drawing.odd_size(problem.arm.length)
    if odd is not None:
        warn(f"{problem.name}: {odd}")


def warn_of_outside(problem: str, obstacles: Sequence[str]) -> None:
    """Warn of obstacles that lie wholly outside the room: the arm cannot come near them."""
    shown = ", ".join(f"'{name}'" for name in obstacles[: DISPLAY.most_left_out])
    rest = len(obstacles) - len(obstacles[: DISPLAY.most_left_out])
    if obstacles:
        warn(f"{problem}: wholly outside the room: {shown}" + (f", and {rest} more" if rest else ""))


def drawing_lines(drawing: ImportedDrawing, problem: Problem) -> Iterator[str]:
    """A line about the obstacles, one about the layers, and one for everything that was left out.

    Args:
        drawing: what became of the drawing.
        problem: gives the unit of lengths.
    """
    units = units_of(problem)
    xmin, ymin, xmax, ymax = (value / units.metres for value in drawing.box)
    corners = f"from ({xmin:.4g}, {ymin:.4g}) to ({xmax:.4g}, {ymax:.4g})"
    size = f"{xmax - xmin:.4g} {TIMES} {ymax - ymin:.4g}"
    count = "1 obstacle" if drawing.obstacles == 1 else f"{drawing.obstacles} obstacles"
    yield f"{drawing.file}: {count}, {size} {units.name}, {corners} {units.name}"
    if not shapely.covers(problem.workspace.boundary, shapely.box(*drawing.box)):
        yield "  parts of it lie outside the room"
    if drawing.unit not in {"", units.name}:
        yield f"  it names {drawing.unit} as its unit, the problem file {units.name}; workspace.scale alone counts"
    shown = None if output().verbose else DISPLAY.most_left_out
    if drawing.layers:
        listed = ", ".join(f"{name} ({number})" for name, number in drawing.layers[:shown])
        rest = len(drawing.layers) - len(drawing.layers[:shown])
        yield f"  layers: {listed}" + (f", and {rest} more" if rest else "")
    for item in drawing.left_out[:shown]:
        yield f"  left out: {item.what}: {item.reason}"
    if rest := len(drawing.left_out) - len(drawing.left_out[:shown]):
        yield f"  and {rest} more left out; --verbose lists them"
