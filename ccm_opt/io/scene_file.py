"""Scene files beside a problem file.

What follows, the copy in ``solution.json`` included, sees plain obstacles and needs the drawing no more.
"""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import shapely

from ccm_opt.core.length_words import METRES
from ccm_opt.errors import ProblemError
from ccm_opt.io.issues import Issues
from ccm_opt.io.keypath import KeyPath
from ccm_opt.io.schema import SceneTable
from ccm_opt.problem import ImportedDrawing
from ccm_opt.scene.workspace import Obstacle

if TYPE_CHECKING:
    from ccm_opt.io.drawing import ImportedScene


def place_beside(
    name: str, folder: Path | None, path: KeyPath, kind: str, issues: Issues, *, allow_outside: bool
) -> Path | None:
    """Where a file lies.

    Args:
        name: its path as the problem file gives it.
        folder: of the problem file; None where there is none.
        path: of the key that names the file.
        kind: what is expected, with an example: "a drawing, for example 'scene.svg'".
        issues: receives why there is no file that may be read.
        allow_outside: whether it may lie outside that folder.

    Returns:
        The file, which may be missing; None where it may not be read.
    """
    if folder is None:
        issues.add(path, "a path beside the problem file, but this problem was not read from a file")
        return None
    place = folder / name
    try:
        is_folder = os.path.isdir(place)  # noqa: PTH112 - pathlib's raises where the user may not look
        # A problem file from somebody else must not read what lies elsewhere, by a link neither.
        inside = os.path.realpath(place).startswith(os.path.join(os.path.realpath(folder), ""))  # noqa: PTH118
    except ValueError as error:  # a path with a zero byte in it
        issues.add(path, f"{name!r} is no path: {error}")
        return None
    if is_folder:
        issues.add(path, f"{name!r} is a directory; expected {kind}")
        return None
    if not allow_outside and not inside:
        issues.add(
            path,
            f"{name!r} is outside the folder of the problem file; copy it there, or allow it by --allow-outside "
            "(in Python allow_outside=True)",
        )
        return None
    return place


def with_scene(
    data: Mapping[str, object], folder: Path | None, issues: Issues, *, allow_outside: bool = False
) -> tuple[Mapping[str, object], ImportedDrawing | None]:
    """Replace ``workspace.file`` by the obstacles of that file, after those of the table.

    Args:
        data: the parsed problem file.
        folder: paths are relative to it; None when the problem was not read from a file.
        issues: receives what is wrong with the drawing, or with the keys that place it.
        allow_outside: whether the drawing may lie outside that folder.

    Returns:
        The data without the keys of the drawing, the same data when there are none; and what became of the drawing,
        its box in metres, when it could be read.
    """
    workspace = data.get("workspace")
    keys = SceneTable.model_fields
    if not isinstance(workspace, Mapping) or not any(key in workspace for key in keys):
        return data, None
    given = {key: workspace[key] for key in keys if key in workspace}
    rest = {key: value for key, value in workspace.items() if key not in keys}
    scene = issues.validate(SceneTable, given, ("workspace",), 1.0)
    listed = rest.get("obstacles", [])
    drawing = None
    if scene is not None and isinstance(listed, list):
        metres = METRES.get(str(data.get("units", "m")), 1.0)
        place = _place_of(scene, folder, issues, allow_outside=allow_outside)
        imported = None if place is None else _imported(scene, place, metres, listed, issues)
        if imported is not None:
            rest["obstacles"] = [*listed, *(obstacle_table(obstacle) for obstacle in imported.obstacles)]
            if imported.room is not None:
                _set_room(rest, imported.room, issues)
            xmin, ymin, xmax, ymax = imported.drawing.box
            box = (xmin * metres, ymin * metres, xmax * metres, ymax * metres)
            drawing = replace(imported.drawing, box=box)
    return {**data, "workspace": rest}, drawing


def _set_room(workspace: dict[str, object], room: shapely.Polygon, issues: Issues) -> None:
    """Make an outline of the drawing the boundary; bounds may be left, if they hold it."""
    bounds = workspace.pop("bounds", None)
    try:
        holds = bounds is None or shapely.box(*bounds).covers(room)  # type: ignore[misc]  # what it is is seen here
    except (TypeError, ValueError):
        holds = False
    if "boundary" in workspace or not holds:
        given = "boundary" if "boundary" in workspace else "bounds"
        issues.add(("workspace", "closed"), f'"room" makes an outline of the drawing the room; leave {given} out')
    workspace["boundary"] = _points(room.exterior)[:-1]


def _place_of(scene: SceneTable, folder: Path | None, issues: Issues, *, allow_outside: bool) -> Path | None:
    """Where the drawing lies; None where there is none that may be read, which is noted."""
    if scene.file is None:
        issues.add(("workspace", next(iter(scene.model_fields_set))), "only allowed together with file")
        return None
    kind = "a drawing, for example 'scene.svg'"
    return place_beside(scene.file, folder, ("workspace", "file"), kind, issues, allow_outside=allow_outside)


def _imported(
    scene: SceneTable, place: Path, metres: float, listed: list[object], issues: Issues
) -> "ImportedScene | None":
    """What the drawing gives; what is wrong is noted."""
    from ccm_opt.io.drawing import import_scene  # noqa: PLC0415 - most problems need no drawing
    from ccm_opt.io.settings import ImportOptions  # noqa: PLC0415

    tolerance = scene.curve_tolerance
    if tolerance is None:
        tolerance = ImportOptions.curve_tolerance / metres  # the default is in metres
    options = ImportOptions(
        scene.scale, (scene.offset[0], scene.offset[1]), tolerance, scene.wall_thickness, scene.closed
    )
    try:
        return import_scene(place, options, _names(listed))
    except ProblemError as error:
        issues.add(("workspace", "file"), str(error))
        return None


def _names(listed: list[object]) -> set[str]:
    """Names of the obstacles in the problem file."""
    named = (entry.get("name") if isinstance(entry, Mapping) else None for entry in listed)
    return {str(name or f"obstacle {k}") for k, name in enumerate(named, start=1)}


def obstacle_table(obstacle: Obstacle) -> dict[str, object]:
    """An obstacle as its table in a problem file, in the same unit of length."""
    core = obstacle.core
    if isinstance(core, shapely.Polygon):
        outline: dict[str, object] = {"name": obstacle.name, "polygon": _points(core.exterior)[:-1]}
        holes = [_points(ring)[:-1] for ring in core.interiors]
        return outline | ({"holes": holes} if holes else {})
    if isinstance(core, shapely.Point):
        return {"name": obstacle.name, "circle": {"center": _points(core)[0], "radius": obstacle.rounding}}
    return {"name": obstacle.name, "wall": {"points": _points(core), "thickness": 2.0 * obstacle.rounding}}


def _points(geometry: shapely.Geometry) -> list[list[float]]:
    points: list[list[float]] = shapely.get_coordinates(geometry).tolist()
    return points
