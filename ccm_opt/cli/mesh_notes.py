"""What people are told of a problem's meshes: triangles, size, place, whether they are closed, and what was mended."""

from collections.abc import Iterator

import numpy as np

from ccm_opt.cli.drawing_notes import TIMES, warn_of_outside
from ccm_opt.cli.outcome import warn
from ccm_opt.cli.output import output
from ccm_opt.cli.tables import report_console
from ccm_opt.files.problem_file.space_placement import odd_mesh_size
from ccm_opt.ground.length_units import METRES
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
    inside = "closed" if body.closed else "not closed: its surface alone counts"
    yield f"{name}: {body.file}, {body.triangles_read} triangles, {size} {unit}, {corners}, {inside}"
    for words in body.notes:
        yield f"  {words}"
    for words in body.mended:
        yield f"  mended: {words}"
    room = problem.workspace.bounds
    if room is not None and np.any((low * METRES[unit] < room[0]) | (high * METRES[unit] > room[1])):
        yield "  parts of it lie outside the room"


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
        "mended": list(body.mended),
        "notes": list(body.notes),
    }
