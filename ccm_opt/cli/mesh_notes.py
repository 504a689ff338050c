"""What people are told of a problem's meshes: triangles, size, place, whether they are closed, and what was mended."""

from collections.abc import Iterator

import numpy as np

from ccm_opt.cli.drawing_notes import TIMES, warn_of_outside
from ccm_opt.cli.outcome import warn
from ccm_opt.cli.output import output
from ccm_opt.cli.tables import report_console
from ccm_opt.files.problem_file.space_placement import odd_mesh_size
from ccm_opt.ground.length_units import METRES, LengthUnit
from ccm_opt.ground.length_words import words_in
from ccm_opt.space.distances.enclosures import open_words
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.bodies import MeshBody
from ccm_opt.space.scene.surfaces import box_about


def tell_of_meshes(problem: SpaceProblem) -> None:
    """Print what became of a problem's meshes, and warn of those that do not fit the arm, and of what is outside."""
    bounds = problem.workspace.bounds
    if bounds is not None:
        boxes = [
            (each.name, box_about(each.body.triangles), each.body.rounding) for each in problem.workspace.obstacles
        ]
        warn_of_outside(
            problem.name,
            [name for name, (low, high), r in boxes if np.any((low - r > bounds[1]) | (high + r < bounds[0]))],
        )
    meshes = [(each.name, each.body) for each in problem.workspace.obstacles if isinstance(each.body, MeshBody)]
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
        odd = odd_mesh_size(body, problem.arm.length)
        if odd is not None:
            warn(f"{problem.name}: {odd}")


def mesh_lines(name: str, body: MeshBody, problem: SpaceProblem) -> Iterator[str]:
    """A line about the mesh, and one for what was done to it.

    Args:
        name: of the obstacle.
        body: the mesh.
        problem: gives the unit of lengths.
    """
    unit = problem.length_unit
    low, high = box_about(body.vertices) / METRES[unit]
    size = f" {TIMES} ".join(f"{length:.4g}" for length in high - low)
    corners = f"from ({', '.join(f'{x:.4g}' for x in low)}) to ({', '.join(f'{x:.4g}' for x in high)}) {unit}"
    yield f"{name}: {body.file}, {body.triangles_read} triangles, {size} {unit}, {corners}, {_inside(body, unit)}"
    for words in body.notes:
        yield f"  {words}"
    for words in body.mended:
        yield f"  mended: {words}"
    room = problem.workspace.bounds
    if room is not None and np.any((low * METRES[unit] < room[0]) | (high * METRES[unit] > room[1])):
        yield "  parts of it lie outside the room"


def _inside(body: MeshBody, unit: LengthUnit) -> str:
    """Whether a mesh is closed, and what counts as its inside."""
    if not body.solid:
        return "its surface alone counts (solid = false)"
    if body.closed:
        return "closed"
    with words_in(unit):
        return f"not closed: it {open_words(body)}; what it goes round by more than a half counts as inside"


def mesh_data(name: str, body: MeshBody) -> dict[str, object]:
    """The same for programs, lengths in metres."""
    box = box_about(body.vertices)
    return {
        "obstacle": name,
        "file": body.file,
        "sha256": body.digest,
        "triangles_read": body.triangles_read,
        "triangles": len(body.faces),
        "box": box.tolist(),
        "closed": body.closed,
        "solid": body.solid,
        "mended": list(body.mended),
        "notes": list(body.notes),
    }
