"""What the page draws of a problem in space: bodies, room, arm, goals."""

from base64 import b64encode

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.scene.bodies import Body
from ccm_opt.scene.surfaces import seen_triangles, sharp_edges, within
from ccm_opt.viz.settings import REPORT, ReportSettings

_STEPS = 65535
"""Corners are told apart to this part of the extent of their body."""


def space_scene_data(
    problem: SpaceProblem, points: FloatArray, ends: FloatArray, settings: ReportSettings = REPORT
) -> dict[str, object]:
    """Everything that the script of the view reads.

    Args:
        problem: bodies, room, arm and goals.
        points: what is to be seen at first, shape (n, 3) [m].
        ends: where the tip is at each goal, for goals of the whole arm, shape (goals, 3) [m].
        settings: how exact.
    """
    arm = problem.arm
    workspace = problem.workspace
    share = settings.most_triangles // max(len(workspace.obstacles), 1)
    margin = 2.0 * max(arm.radius, 0.5 * arm.link_length)
    extent = workspace.extent if len(workspace.soup) else np.stack((points.min(axis=0), points.max(axis=0)))
    return {
        "arm": {
            "links": arm.links,
            "link": arm.link_length,
            "radius": arm.radius,
            "base": arm.base.tolist(),
            "direction": arm.direction.tolist(),
            "up": arm.up.tolist(),
        },
        "start": arm.joint_positions_at(problem.start.configuration(arm)).round(7).tolist(),
        "bodies": [_body_data(each.name, each.body, share, extent, settings) for each in workspace.obstacles],
        "room": None if workspace.bounds is None else workspace.bounds.tolist(),
        "goals": _goals(problem, ends),
        "look": [(points.min(axis=0) - margin).tolist(), (points.max(axis=0) + margin).tolist()],
        "extent": extent.tolist(),
    }


def _body_data(name: str, body: Body, share: int, extent: FloatArray, settings: ReportSettings) -> dict[str, object]:
    """A body: corners as whole numbers of 16 bits, faces and sharp edges as numbers of corners, in base 64."""
    surface = seen_triangles(body, settings.round_sides)
    vertices, faces = within(*surface, max(share, 500), settings.cell * float(np.max(np.ptp(extent, axis=0))))
    # Corners that several triangles have at one place are written once.
    places, number = np.unique(vertices, axis=0, return_inverse=True)
    joined = number.reshape(-1)[faces]
    low = places.min(axis=0)
    span = np.maximum(np.ptp(places, axis=0), np.finfo(np.float64).tiny)
    whole = np.round((places - low) / span * _STEPS).astype("<u2")
    return {
        "name": name,
        "low": low.tolist(),
        "span": span.tolist(),
        "corners": _text(whole),
        "faces": _text(joined.astype("<u4")),
        "edges": _text(sharp_edges(places, joined, settings.sharp).astype("<u4")),
    }


def _goals(problem: SpaceProblem, ends: FloatArray) -> list[dict[str, object]]:
    found: list[dict[str, object]] = []
    for stop, end in zip(problem.goals, ends, strict=True):
        goal = stop.goal
        if isinstance(goal, TipGoal):
            direction = None if goal.direction is None else goal.direction.tolist()
            via = [place.tolist() for place in goal.via]
            found.append({"position": goal.position.tolist(), "direction": direction, "via": via})
        else:
            found.append({"position": end.tolist(), "direction": None, "via": []})
    return found


def _text(values: npt.NDArray[np.generic]) -> str:
    return b64encode(np.ascontiguousarray(values).tobytes()).decode()
