"""Widths of the passages along a tip path: the distance across the path between the walls on both sides."""

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polygons import cross
from ccm_opt.core.polyline import arc_lengths, leg_indices, leg_lengths, without_repeats
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.walls import Walls

MARGINS = (0.06, 0.024)
"""Planning margins that are tried in turn, in nominal links: with the larger one motions are smoother, with the smaller
one the arm passes through narrower gaps. Measured: with an even smaller second one, the first candidate failed in one
scene."""
WIDTH_SAMPLES = 96
"""Number of points along a path at which the width of its passage is measured. Heuristic."""

_LEAST_MARGIN = 0.001
"""Minimum planning margin if none of the usual ones fits, in nominal links. Heuristic."""

_NARROW = 2.5
"""Width of a passage below which nominal links are shortened, in nominal links. Heuristic: the height of a fold is
about a third of the passage's width, and should not be less than a nominal link."""

_ROOMY = 3.2
"""Width of a narrow passage in shortened nominal links. Heuristic."""
_FITTING_SHARE = 0.8
"""Largest usable planning margin, as a fraction of the gap beside the arm. Heuristic: a margin equal to the gap would
leave the arm no freedom to move."""
_MARGIN_SHARE = 0.5
"""Planning margin if none of the usual ones fits, as a fraction of the gap beside the arm. Heuristic."""

SPARE = 1.001
"""Factor by which lines are lengthened before their crossings with edges are sought, so that rounding misses none."""


def required_nominal_links(task: MotionTask) -> float:
    """Return the number of nominal links along the arm that the narrowest passage of the first tip path requires.

    It is at least the usual number and at most the arm's number of links, since nominal links shorter than links are of
    no use; arms with no more links than the usual number get the usual number.
    """
    if not task.tip_paths or task.arm.links <= NOMINAL_LINKS:
        return NOMINAL_LINKS
    walls = task.workspace.flat_walls
    widths = passage_widths(walls, task.tip_paths[0].taut, task.arm.length)
    narrowest = float(widths.min()) / task.arm.length
    if narrowest * NOMINAL_LINKS >= _NARROW:
        return NOMINAL_LINKS
    return min(_ROOMY / max(narrowest, 1e-9), float(task.arm.links))


def fitting_margins(task: MotionTask) -> tuple[float, ...]:
    """Return the planning margins to be tried in turn, in nominal links.

    They are those of ``MARGINS`` that are smaller than the gap beside the arm, as no step gets through a passage with a
    larger one. If none is, a smaller margin is followed by the smallest of ``MARGINS``; if the gap is unknown, all of
    ``MARGINS`` are returned.
    """
    gap = gap_beside_arm(task) * task.nominal_links / task.arm.length
    if gap <= 0.0:
        return MARGINS
    # With a margin nearly as wide as the gap, no step gets through the passage.
    fitting = tuple(margin for margin in MARGINS if margin <= _FITTING_SHARE * gap)
    if fitting:
        return fitting
    return max(_LEAST_MARGIN, _MARGIN_SHARE * gap), MARGINS[-1]


def gap_beside_arm(task: MotionTask) -> float:
    """Return the smallest gap beside an arm centred in the passages of the tip path for which that gap is largest [m].

    Passages, gates and the goal of each path count, and the clearance is subtracted: the result is negative if every
    path is too narrow, and 0 without tip paths.
    """
    arm = task.arm
    walls = task.workspace.flat_walls
    rooms = []
    for path in task.tip_paths:
        if path.length > 0.0:
            half_width = 0.5 * float(passage_widths(walls, path.taut, arm.length).min())
            # With a margin wider than the gap at the goal, the tip could not reach the goal.
            rooms.append(
                min(half_width, *(_room_about(task, places) for places in (path.gate_places, path.route[-1:])))
            )
    return max(rooms) - (arm.tip_radius + task.workspace.clearance) if rooms else 0.0


def _room_about(task: MotionTask, places: FloatArray) -> float:
    """Return the least distance between any of the points (m, 2) and the walls [m]; inf if there are no points."""
    return task.gap_about(places) + task.arm.tip_radius + task.workspace.clearance


def passage_widths(walls: Walls, path: FloatArray, widest: float) -> FloatArray:
    """Return the width of the passage at points evenly spaced along a path, shape (``WIDTH_SAMPLES``,) [m].

    The width is measured perpendicular to the path, to the nearest wall on the left and on the right, and capped at
    ``widest``.

    Args:
        walls: the walls.
        path: vertices of the path, shape (k, 2) [m].
        widest: largest width that is measured [m].
    """
    places, tangent = evenly_along(path)
    # Distances along the normal to the first edge on either side; without one, the largest measured width.
    across = np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
    place, along = _crossings(walls, places, across, widest)
    left = np.full(WIDTH_SAMPLES, widest)
    right = np.full(WIDTH_SAMPLES, widest)
    np.minimum.at(left, place, np.where(along >= 0.0, along, widest))
    np.minimum.at(right, place, np.where(along <= 0.0, -along, widest))
    widths: FloatArray = np.minimum(left + right, widest)
    return widths


def evenly_along(path: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ``WIDTH_SAMPLES`` points evenly spaced along a path, without its ends, and the tangents there.

    Args:
        path: vertices of the path, shape (k, 2) [m].

    Returns:
        The points [m] and the unit tangents, each of shape (``WIDTH_SAMPLES``, 2).
    """
    path = without_repeats(path, 0.0)
    arcs = arc_lengths(path)
    at = np.linspace(0.0, arcs[-1], WIDTH_SAMPLES + 2)[1:-1]
    leg = leg_indices(arcs, at)
    tangent = np.diff(path, axis=0)[leg] / leg_lengths(path)[leg, None]
    return path[leg] + (at - arcs[leg])[:, None] * tangent, tangent


def _crossings(walls: Walls, places: FloatArray, directions: FloatArray, widest: float) -> tuple[IntArray, FloatArray]:
    """Return where lines cross the edges of walls.

    Args:
        walls: the walls.
        places: a point of each line, shape (m, 2) [m].
        directions: unit vectors along the lines, shape (m, 2).
        widest: distance from the point beyond which crossings may be omitted [m].

    Returns:
        Indices of the lines, shape (k,), and signed distances of the crossings from the points, reduced by the walls'
        rounding radius, shape (k,) [m].
    """
    # This query returns every edge crossed within reach, and few others.
    reach = SPARE * (widest + float(walls.rounding.max(initial=0.0)))
    lines = np.stack((places - reach * directions, places + reach * directions), axis=1)
    place, edge = walls.edge_lines.query(shapely.linestrings(lines))
    a = walls.edges[edge, 0] - places[place]
    b = walls.edges[edge, 1] - places[place]
    side_a = cross(directions[place], a)
    side_b = cross(directions[place], b)
    hit = side_a * side_b <= 0.0  # the ends lie on different sides of the line
    apart = side_a - side_b
    share = side_a / np.where(np.abs(apart) > 0.0, apart, 1.0)
    along = np.einsum("kd,kd->k", a + share[:, None] * (b - a), directions[place])
    nearer = np.sign(along) * np.maximum(np.abs(along) - walls.rounding[walls.edge_wall[edge]], 0.0)
    return place[hit], nearer[hit]
