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
"""Planning margins that are tried in turn, in nominal links: the wide one finds smoother motions, the narrow one
gets through. Measured: with a smaller narrow one, the first candidate failed in one scene."""
WIDTH_SAMPLES = 96
"""Number of places along a path at which its passage is measured. Taste."""

_LEAST_MARGIN = 0.001
"""Least planning margin, in nominal links. Taste."""

_NARROW = 2.5
"""Width below which passages require shorter nominal links, in nominal links. Taste: a fold in a passage is about a
third of its width high, and should not be shorter than a nominal link."""

_ROOMY = 3.2
"""Width of such passages after the shortening, in nominal links. Taste."""
_FITTING_SHARE = 0.8
"""Largest planning margin as a share of the gap next to the arm. Taste: with all of the gap taken, no step could
move the arm."""
_MARGIN_SHARE = 0.5
"""Share of the available gap that serves as margin where no planning margin fits. Taste."""

SPARE = 1.001
"""Factor on the length of the lines whose crossings with edges are sought, against rounding."""


def required_nominal_links(task: MotionTask) -> float:
    """Return the number of nominal links to the arm's length that the first tip path requires.

    The number is larger than usual where passages are narrow. A nominal link shorter than a link is of no use, so arms
    of few links are always planned with the usual number.
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
    """Return the planning margins, in nominal links, that leave the path to the goal open, or else smaller ones.

    A wide margin closes passages that hardly admit the arm, and goals that hardly admit the tip; trying such a margin
    wastes time.
    """
    gap = gap_beside_arm(task) * task.nominal_links / task.arm.length
    if gap <= 0.0:
        return MARGINS
    # A margin nearly as wide as the gap closes the passage: the step would never get through.
    fitting = tuple(margin for margin in MARGINS if margin <= _FITTING_SHARE * gap)
    if fitting:
        return fitting
    return max(_LEAST_MARGIN, _MARGIN_SHARE * gap), MARGINS[-1]


def gap_beside_arm(task: MotionTask) -> float:
    """Return the gap on either side of the arm in the narrowest passage of the widest tip path, and at its goal [m].

    Not positive when there is no tip path, or the paths are too narrow to be distinguished from walls.
    """
    arm = task.arm
    walls = task.workspace.flat_walls
    rooms = []
    for path in task.tip_paths:
        if path.length > 0.0:
            half_width = 0.5 * float(passage_widths(walls, path.taut, arm.length).min())
            # With a margin wider than its gap at the goal the tip would never arrive.
            rooms.append(
                min(half_width, *(_room_about(task, places) for places in (path.gate_places, path.route[-1:])))
            )
    return max(rooms) - (arm.tip_radius + task.workspace.clearance) if rooms else 0.0


def _room_about(task: MotionTask, places: FloatArray) -> float:
    """Return the distance from places (m, 2) to the nearest wall [m]; inf for no places."""
    return task.gap_about(places) + task.arm.tip_radius + task.workspace.clearance


def passage_widths(walls: Walls, path: FloatArray, widest: float) -> FloatArray:
    """Return the width of the passage at places evenly spread along a path, shape (``WIDTH_SAMPLES``,) [m].

    The width is measured across the path, to the first wall on the left and on the right; a side without a wall counts
    as ``widest``, and widths above ``widest`` are capped.

    Args:
        walls: the walls.
        path: shape (k, 2) [m].
        widest: largest width that is measured [m].
    """
    places, tangent = evenly_along(path)
    # Along the normal to the first edge on either side; where there is none, the largest width measured.
    across = np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
    place, along = _crossings(walls, places, across, widest)
    left = np.full(WIDTH_SAMPLES, widest)
    right = np.full(WIDTH_SAMPLES, widest)
    np.minimum.at(left, place, np.where(along >= 0.0, along, widest))
    np.minimum.at(right, place, np.where(along <= 0.0, -along, widest))
    widths: FloatArray = np.minimum(left + right, widest)
    return widths


def evenly_along(path: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ``WIDTH_SAMPLES`` places evenly spread along a path (k, 2) between its ends, and its directions there."""
    path = without_repeats(path, 0.0)
    arcs = arc_lengths(path)
    at = np.linspace(0.0, arcs[-1], WIDTH_SAMPLES + 2)[1:-1]
    leg = leg_indices(arcs, at)
    tangent = np.diff(path, axis=0)[leg] / leg_lengths(path)[leg, None]
    return path[leg] + (at - arcs[leg])[:, None] * tangent, tangent


def _crossings(walls: Walls, places: FloatArray, directions: FloatArray, widest: float) -> tuple[IntArray, FloatArray]:
    """Return the crossings of lines through places (m, 2) with edges: place and signed distance, each of shape (k,).

    Distances [m] are reduced by the rounding of the wall; crossings farther than ``widest`` [m] may be left out.
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
