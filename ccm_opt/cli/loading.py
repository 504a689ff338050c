"""Reading of the problem files of a command, with reports and warnings about drawings, meshes and limits."""

import tomllib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import shapely

from ccm_opt.cli.outcome import warn
from ccm_opt.cli.output import output
from ccm_opt.cli.tables import report_console, result_units
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import METRES, LengthUnit, file_length, in_unit, words_in
from ccm_opt.ik.terms import Constraint, Cost, load_terms
from ccm_opt.io.place_rules import odd_mesh_size
from ccm_opt.io.reading import load_problem, with_keys_set
from ccm_opt.problem import ImportedArm, ImportedDrawing, Limits, Problem
from ccm_opt.problem.tool_rules import cover_notes
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.distances.enclosures import open_edge_words
from ccm_opt.scene.point_clouds import BallRadii
from ccm_opt.scene.surfaces import box_about
from ccm_opt.scene.workspace import PlaneScan, PlaneShape

_MOST_LEFT_OUT = 10
"""Maximum number of layers of a drawing, and of elements left out, that are listed without --verbose."""

_SAME_SIZE = 1e-3
"""Maximum relative difference between stated and imported size of a drawing that is not reported. Heuristic: sizes of
pages are rounded."""

TIMES = "\N{MULTIPLICATION SIGN}"


def report_scene(problem: Problem) -> None:
    """Print a summary of a problem's drawing or meshes and URDF, and warn of implausible sizes and limits."""
    if problem.imported_arm is not None:
        _report_imported_arm(problem.imported_arm)
    _report_covers(problem)
    tell = report_meshes if problem.dimension == 3 else report_drawing
    tell(problem)
    warn_odd_rates(problem)


def _report_imported_arm(arm: ImportedArm) -> None:
    """Print what was simplified when an arm was read from a URDF."""
    if output().as_json:
        output().note({"arm": asdict(arm)})
    if output().tables:
        console = report_console()
        for line in (f"{arm.file}: {len(arm.joints)} joints", *(f"  {note}" for note in arm.notes)):
            console.print(line, markup=False, highlight=False, soft_wrap=True)


def _report_covers(problem: Problem) -> None:
    """Print what capsules cover the meshes and polygons of bodies on links."""
    lines = cover_notes(problem.arm)
    if output().as_json and lines:
        output().note({"bodies": lines})
    if output().tables:
        for line in lines:
            report_console().print(line, markup=False, highlight=False, soft_wrap=True)


def report_drawing(problem: Problem) -> None:
    """Print a summary of a problem's drawing, and warn of implausible size and obstacles outside the workspace."""
    if problem.drawing is not None:
        _report_drawing(problem.drawing, problem)
    for obstacle in problem.workspace.obstacles:
        shape = cast("PlaneShape", obstacle.shape)
        if shape.scan is not None:
            _report_scan(obstacle.name, shape, shape.scan, problem)
    boundary = problem.workspace.boundary
    warn_outside(
        problem.name,
        [each.name for each in problem.workspace.obstacles if shapely.distance(each.core, boundary) > each.rounding],
    )


def _report_scan(name: str, shape: PlaneShape, scan: PlaneScan, problem: Problem) -> None:
    """Print a summary of a scan in the plane, and warn of an implausible size."""
    box = box_about(shape.vertices)
    if output().as_json:
        radii = {"disc_radius": scan.radii.whole, "spread": scan.radii.spread}
        summary = {"obstacle": name, "file": scan.file, "points_read": scan.points_read, "discs": len(shape.vertices)}
        output().note({"scan": {**summary, **radii, "box": box.tolist(), "notes": list(scan.notes)}})
    if output().tables:
        unit = problem.length_unit
        kept = _kept(len(shape.vertices), "discs", scan.radii, unit)
        words = f"{name}: {scan.file}, {scan.points_read} points, {_span(box, unit)}, {kept}"
        for line in (words, *(f"  {note}" for note in scan.notes)):
            report_console().print(line, markup=False, highlight=False, soft_wrap=True)
    if (odd := odd_mesh_size(scan.file, shape.vertices, problem.arm.length)) is not None:
        warn(f"{problem.name}: {odd}")


def _kept(count: int, balls: str, radii: BallRadii, unit: LengthUnit) -> str:
    """Return a description of the balls or discs that stand for the points of a scan."""
    with words_in(unit):
        whole, spread = file_length(radii.whole), file_length(radii.spread)
    return f"kept as {count} {balls} of {whole}, {spread} of it to cover points left out"


def _span(box: FloatArray, unit: LengthUnit) -> str:
    """Return a description of a box between two corners, shape (2, d) [m]."""
    low, high = box / METRES[unit]
    size = f" {TIMES} ".join(f"{length:.4g}" for length in high - low)
    return (
        f"{size} {unit}, from ({', '.join(f'{x:.4g}' for x in low)}) to ({', '.join(f'{x:.4g}' for x in high)}) {unit}"
    )


def _report_drawing(drawing: ImportedDrawing, problem: Problem) -> None:
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
    stated = drawing.stated_metres
    if stated is not None and abs(drawing.metres - stated) > _SAME_SIZE * stated:
        warn(
            f"{problem.name}: one unit of {drawing.file} is {1e3 * stated:.6g} mm by the size or unit that it states, "
            f"but is read as {1e3 * drawing.metres:.6g} mm; units and workspace.scale decide, and workspace.units = "
            '"file" would give it the stated size'
        )


def warn_outside(problem: str, obstacles: Sequence[str]) -> None:
    """Print a warning about obstacles that lie entirely outside the workspace, where the arm cannot reach them."""
    shown = ", ".join(f"'{name}'" for name in obstacles[:_MOST_LEFT_OUT])
    rest = len(obstacles) - len(obstacles[:_MOST_LEFT_OUT])
    if obstacles:
        warn(f"{problem}: obstacles entirely outside the workspace: {shown}" + (f", and {rest} more" if rest else ""))


def drawing_lines(drawing: ImportedDrawing, problem: Problem) -> Iterator[str]:
    """Yield lines of text about an imported drawing: obstacles, size, layers, and elements that were left out.

    Args:
        drawing: report on the import.
        problem: the problem, which gives workspace and unit of length.
    """
    units = result_units(problem)
    xmin, ymin, xmax, ymax = (value / units.metres for value in drawing.box)
    corners = f"from ({xmin:.4g}, {ymin:.4g}) to ({xmax:.4g}, {ymax:.4g})"
    size = f"{xmax - xmin:.4g} {TIMES} {ymax - ymin:.4g}"
    count = "1 obstacle" if drawing.obstacles == 1 else f"{drawing.obstacles} obstacles"
    yield f"{drawing.file}: {count}, {size} {units.name}, {corners} {units.name}"
    if not shapely.covers(problem.workspace.boundary, shapely.box(*drawing.box)):
        yield "  parts of it lie outside the workspace"
    shown = None if output().verbose else _MOST_LEFT_OUT
    if drawing.layers:
        listed = ", ".join(f"{name} ({number})" for name, number in drawing.layers[:shown])
        rest = len(drawing.layers) - len(drawing.layers[:shown])
        yield f"  layers: {listed}" + (f", and {rest} more" if rest else "")
    for item in drawing.left_out[:shown]:
        yield f"  left out: {item.what}: {item.reason}"
    if rest := len(drawing.left_out) - len(drawing.left_out[:shown]):
        yield f"  and {rest} more left out; --verbose lists them"


def report_meshes(problem: Problem) -> None:
    """Print a summary of a problem's meshes, and warn of implausible sizes and of obstacles outside the workspace."""
    bounds = problem.workspace.bounds
    if bounds is not None:
        boxes = [
            (each.name, box_about(each.body.triangles), each.body.rounding) for each in problem.workspace.obstacles
        ]
        warn_outside(
            problem.name,
            [name for name, (low, high), r in boxes if np.any((low - r > bounds[1]) | (high + r < bounds[0]))],
        )
    meshes = [(name, body) for _, name, body in problem.workspace.meshes]
    if not meshes:
        return
    if output().as_json:
        output().note({"meshes": [mesh_data(name, body) for name, body in meshes]})
    if output().tables:
        console = report_console()
        for name, body in meshes:
            for line in mesh_lines(name, body, problem):
                console.print(line, markup=False, highlight=False, soft_wrap=True)
    for _, body in meshes:
        odd = odd_mesh_size(body.file, body.vertices, problem.arm.length)
        if odd is not None:
            warn(f"{problem.name}: {odd}")


def mesh_lines(name: str, body: MeshBody, problem: Problem) -> Iterator[str]:
    """Yield lines of text about a mesh obstacle: a summary, then each note and repair.

    Args:
        name: name of the obstacle.
        body: the mesh.
        problem: the problem, which gives workspace bounds and unit of length.
    """
    unit = problem.length_unit
    low, high = box = box_about(body.vertices)
    count = f"{body.triangles_read} {'triangles' if body.balls is None else 'points'}"
    yield f"{name}: {body.file}, {count}, {_span(box, unit)}, {_inside(body, unit)}"
    for words in body.notes:
        yield f"  {words}"
    for words in body.mended:
        yield f"  repaired: {words}"
    room = problem.workspace.bounds
    if room is not None and np.any((low < room[0]) | (high > room[1])):
        yield "  parts of it lie outside the workspace"


def _inside(body: MeshBody, unit: LengthUnit) -> str:
    """Return a description of whether a mesh is closed, and of which region counts as its interior."""
    if body.balls is not None:
        return _kept(len(body.faces), "balls", body.balls, unit)
    if not body.solid:
        return "surface only (solid = false)"
    if body.closed:
        return "closed"
    with words_in(unit):
        return f"not closed: it {open_edge_words(body)}; the arm may enter through openings wider than its diameter"


def mesh_data(name: str, body: MeshBody) -> dict[str, object]:
    """Return a summary of a mesh obstacle for JSON output, lengths in metres."""
    box = box_about(body.vertices)
    return {
        "obstacle": name,
        "file": body.file,
        "sha256": body.digest,
        "triangles_read": body.triangles_read,
        "triangles": len(body.faces),
        "ball_radius": body.rounding,
        "box": box.tolist(),
        "closed": body.closed,
        "solid": body.solid,
        "mended": list(body.mended),
        "notes": list(body.notes),
    }


FASTEST = {"/s": 10.0, "/s²": 200.0}
"""Speed in arm lengths per second, and acceleration in arm lengths per second², above which a limit probably has a
wrong unit. Heuristic: linear motors of one
metre reach about 5 m/s and 100 m/s²."""
SLOWEST = 5e-4
"""Speed in arm lengths per second, or acceleration in arm lengths per second², below which a limit probably has a wrong
unit; at this speed, one arm length takes half an hour. Heuristic."""
STRONGEST_GRAVITY = 50.0
"""Gravity above which the unit is probably wrong: twice that of Jupiter; that of Earth is 9810 in mm/s² [m/s²]."""


def warn_odd_rates(problem: Problem) -> None:
    """Print warnings about speed and acceleration limits out of proportion to the arm, and implausible gravity."""
    unit = problem.length_unit
    for key, rate, per in _rates(problem.limits):
        share = rate / problem.arm.length
        if SLOWEST <= share <= FASTEST[per]:
            continue
        warn(
            f"{problem.name}: limits.{key} is {in_unit(rate, unit):.6g} {unit}{per}, or {share:.2g} arm "
            f"lengths{per}; it is read in the file's unit of length: check it"
        )
    strength = float(np.linalg.norm(problem.simulation.gravity))
    if strength > STRONGEST_GRAVITY:
        warn(
            f"{problem.name}: simulation.gravity is {strength:.6g} m/s²: it is read in m/s², whatever the "
            "file's unit of length: check it"
        )


def _rates(limits: Limits) -> Iterator[tuple[str, float, str]]:
    """Yield key, value [m/s or m/s²] and time unit of every limit of the feed axis, the tip and other points."""
    given = [("feed_velocity", limits.feed_velocity, "/s"), ("feed_acceleration", limits.feed_acceleration, "/s²")]
    for point in limits.points:
        name = "tip_" if point.at is None else f"points at {point.at:g} m, "
        given += [(f"{name}velocity", point.velocity, "/s"), (f"{name}acceleration", point.acceleration, "/s²")]
    return ((key, float(rate), per) for key, rate, per in given if rate is not None and np.isfinite(rate))


@dataclass
class NamedProblems:
    """Reader of problem files that refuses a second problem of the same name, since both would use one output folder.

    Attributes:
        files: all files that will be read.
        changes: overrides of keys, ``key.path=value``, applied to every file.
        taken: file of every problem read so far, by the name of the problem.
        warned: whether the files were already checked for names that occur twice.
    """

    files: Sequence[Path]
    changes: Sequence[str] = ()
    taken: dict[str, Path] = field(default_factory=dict)
    warned: bool = False

    def _warn_duplicate_names(self) -> None:
        """Print warnings about names that several files share, before the first problem is solved.

        Only the TOML files are read, without drawings and meshes.
        """
        files: dict[object, list[str]] = {}
        for file in self.files:
            # A pipe can be read only once; errors in a file are reported when it is its turn.
            if file.is_file():
                with suppress(ProblemError, OSError, ValueError):
                    data = tomllib.loads(with_keys_set(file.read_text("utf-8"), self.changes).text)
                    files.setdefault(data.get("name"), []).append(str(file))
        for name, doubles in files.items():
            if len(doubles) > 1:
                warn(
                    f"{' and '.join(doubles)} have the same name '{name}' and would share a folder; only one is solved"
                )

    def read(self, file: Path) -> Problem:
        """Return the problem in a file, after printing a report on its drawing or meshes.

        Raises:
            ProblemError: the file is invalid, or its problem has the name of a problem read before.
        """
        if len(self.files) > 1 and not self.warned:
            self.warned = True
            self._warn_duplicate_names()
        problem = load_problem(file, changes=self.changes, allow_outside=output().allow_outside)
        first = self.taken.setdefault(problem.name, file)
        if first is not file:
            raise ProblemError(
                f"{file} has the same name '{problem.name}' as {first} and would share its folder; rename one"
            )
        report_scene(problem)
        return problem


NamedTerms = tuple[Sequence[str], Sequence[str]]
"""References to the user's constraints and to the user's costs, each ``module:function`` or ``file.py:function``."""
NO_TERMS: NamedTerms = ((), ())


def loaded_terms(constraints: Sequence[str], costs: Sequence[str]) -> dict[str, Any]:
    """Return the user's constraints and costs as keyword arguments for ``solve`` and similar functions.

    Args:
        constraints: references ``module:function`` or ``file.py:function`` to constraints.
        costs: references of this form to costs.

    Returns:
        The arguments ``constraints`` and ``costs``; empty if none are given.

    Raises:
        ProblemError: a reference cannot be loaded; the message names the reference.
    """
    if not (constraints or costs):
        return {}
    return {"constraints": load_terms(constraints, Constraint), "costs": load_terms(costs, Cost)}


def point_from(problem: Problem, option: str, words: str) -> FloatArray:
    """Return a point (d,) [m] from its coordinates in the file's unit, separated by commas."""
    shape = "x,y" if problem.dimension == 2 else "x,y,z"
    found = numbers_from(option, words, problem.dimension, f"{shape} in {problem.length_unit}")
    return METRES[problem.length_unit] * found


def numbers_from(option: str, words: str, count: int, expected: str) -> FloatArray:
    """Return a number of finite numbers, separated by commas, shape (count,).

    Args:
        option: name of the option that gives them.
        words: the numbers.
        count: how many there have to be.
        expected: what the option takes, in words.

    Raises:
        ProblemError: there are more or fewer, or one is none.
    """
    try:
        found = np.array([float(each) for each in words.split(",")])
    except ValueError:
        found = np.zeros(0)
    if found.shape != (count,) or not np.all(np.isfinite(found)):
        raise ProblemError(f"{option}: expected {expected}, got {words!r}")
    return found
