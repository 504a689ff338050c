"""How wide the passages are that a tip path leads through: the walls' distance across it, on both sides together."""

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polygons import cross
from ccm_opt.core.polyline import arc_lengths, leg_indices, leg_lengths, without_repeats
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.walls import Walls

MARGINS = (0.06, 0.024)
"""Planning margins that are tried in turn, in nominal links: the wide one finds smoother motions, the narrow one gets
through. Measured: with less than the narrow one, the first candidate failed in one scene."""
WIDTH_SAMPLES = 96
"""Places along a path at which its passage is measured. Taste."""

_LEAST_MARGIN = 0.001
"""Least planning margin, in nominal links. Taste."""

_NARROW = 2.5
"""Passages less wide than this many nominal links ask for shorter nominal links. Taste: a fold in a passage is about a
third of its width high, and should not be shorter than a nominal link."""

_ROOMY = 3.2
"""Width that such passages then have, in nominal links. Taste."""
_FITTING_SHARE = 0.8
"""Share of the gap beside the arm that a planning margin may be. Taste: with all of it taken, a step could move
nowhere."""
_MARGIN_SHARE = 0.5
"""Where no planning margin fits, this share of the gap that there is serves as one. Taste."""

SPARE = 1.001
"""Rounding: lines are drawn by so much longer when the edges that they cross are looked for."""


def required_nominal_links(task: MotionTask) -> float:
    """Nominal links to the arm's length that the first tip path asks for: more than usual where passages are narrow.

    A nominal link shorter than a link is of no use, so arms of few links are always planned with the usual ones.
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
    """Return the planning margins, in nominal links, that leave the way to the goal open.

    A smaller one first when none does.

    A wide margin closes passages that hardly pass the arm, and goals that hardly hold the tip: trying it costs time.
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
    """Gap that the arm has on either side in the narrowest passage of the widest tip path, and the tip at its goal [m].

    Not positive when there is no tip path, or the paths are too narrow to be told apart from walls.
    """
    arm = task.arm
    walls = task.workspace.flat_walls
    rooms = []
    for path in task.tip_paths:
        if path.length > 0.0:
            half_width = 0.5 * float(passage_widths(walls, path.taut, arm.length).min())
            # With a wider margin than it has at the goal the tip would never arrive.
            rooms.append(
                min(half_width, *(_room_about(task, places) for places in (path.gate_places, path.route[-1:])))
            )
    return max(rooms) - (arm.radius + task.workspace.clearance) if rooms else 0.0


def _room_about(task: MotionTask, places: FloatArray) -> float:
    """Return the distance from places (m, 2) to the nearest wall [m]; inf for no places."""
    return task.gap_about(places) + task.arm.radius + task.workspace.clearance


def passage_widths(walls: Walls, path: FloatArray, widest: float) -> FloatArray:
    """Return the width of the passage at places evenly spread along a path, shape (``WIDTH_SAMPLES``,) [m].

    Across the path, to the first wall on the left and on the right; a side without a wall counts ``widest``.

    Args:
        walls: the walls.
        path: shape (k, 2) [m].
        widest: what is not looked beyond [m].
    """
    places, tangent = evenly_along(path)
    # Along the normal to the first edge on either side; where there is none, as wide as is asked about.
    across = np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
    place, along = _crossings(walls, places, across, widest)
    left = np.full(WIDTH_SAMPLES, widest)
    right = np.full(WIDTH_SAMPLES, widest)
    np.minimum.at(left, place, np.where(along >= 0.0, along, widest))
    np.minimum.at(right, place, np.where(along <= 0.0, -along, widest))
    widths: FloatArray = np.minimum(left + right, widest)
    return widths


def evenly_along(path: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the places evenly spread along a path (k, 2) between its ends, and the path's directions there."""
    path = without_repeats(path, 0.0)
    arcs = arc_lengths(path)
    at = np.linspace(0.0, arcs[-1], WIDTH_SAMPLES + 2)[1:-1]
    leg = leg_indices(arcs, at)
    tangent = np.diff(path, axis=0)[leg] / leg_lengths(path)[leg, None]
    return path[leg] + (at - arcs[leg])[:, None] * tangent, tangent


def _crossings(walls: Walls, places: FloatArray, directions: FloatArray, widest: float) -> tuple[IntArray, FloatArray]:
    """Where lines through places (m, 2) meet edges: place of each crossing and its signed distance, each of shape (k,).

    Distances [m] are less the rounding of the wall; crossings farther than ``widest`` [m] may be left out.
    """
    # Every edge that is crossed so near, and few others.
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
