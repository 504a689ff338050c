"""How wide the passages are that a tip path leads through: the walls' distance across it, on both sides together."""

import numpy as np
import shapely

from ccm_opt.arrays import FloatArray
from ccm_opt.collision.walls import Walls
from ccm_opt.geometry.polyline import arc_lengths, leg_lengths, legs_at, without_repeats
from ccm_opt.motion.link_space import FINENESS
from ccm_opt.motion.motion_task import MotionTask

NARROW = 2.5
"""Passages less wide than this many units ask for a shorter unit, so that ..."""
ROOM = 3.2
"""... they are this many units wide: a fold in a passage is about a third of its width high."""
HALF = 0.5
"""Where no planning margin fits, this share of the room that there is serves as one."""
LEAST_MARGIN = 0.004
"""Least planning margin, in units."""
SAMPLES = 96
"""Places along a path at which its passage is measured."""


def fineness_asked(task: MotionTask) -> float:
    """Units to the arm's length that the first tip path asks for: more than usual where its passages are narrow.

    A unit shorter than a link is of no use, so arms of few links are always planned with the usual one.
    """
    if not task.tip_paths or task.arm.links <= FINENESS:
        return FINENESS
    widths = passage_widths(Walls.of(task.workspace), task.tip_paths[0].taut, task.arm.length)
    share = float(widths.min()) / task.arm.length
    if share * FINENESS >= NARROW:
        return FINENESS
    return min(ROOM / max(share, 1e-9), float(task.arm.links))


def fitting_margins(task: MotionTask, margins: tuple[float, ...], fineness: float) -> tuple[float, ...]:
    """The planning margins, in units, that leave a way to the goal; a smaller one first when none does.

    A wide margin closes passages that hardly pass the arm, and goals that hardly hold the tip: trying it costs time.
    """
    spare = room_to_spare(task) * fineness / task.arm.length
    if spare <= 0.0:
        return margins
    fitting = tuple(margin for margin in margins if margin <= spare)
    return fitting or (max(LEAST_MARGIN, HALF * spare), margins[-1])


def room_to_spare(task: MotionTask) -> float:
    """Gap that the arm has on either side in the narrowest passage of the widest tip path, and the tip at its goal [m].

    Not positive when there is no tip path, or the paths are too narrow to be told apart from walls.
    """
    walls, arm = Walls.of(task.workspace), task.arm
    need = arm.radius + task.workspace.clearance
    ways = [path.taut for path in task.tip_paths if path.length > 0.0]
    passages = [0.5 * float(passage_widths(walls, taut, arm.length).min()) for taut in ways]
    if not passages:
        return 0.0
    tip = shapely.Point(task.goal.position)
    at_goal = min(float(shapely.distance(tip, wall.core)) - wall.rounding for wall in task.workspace.walls)
    return min(max(passages), at_goal) - need


def passage_widths(walls: Walls, path: FloatArray, widest: float, samples: int = SAMPLES) -> FloatArray:
    """Width of the passage at places evenly spread along a path, shape (samples,) [m].

    Across the path, to the first wall on the left and on the right; a side without a wall counts ``widest``.

    Args:
        walls: the walls.
        path: shape (k, 2) [m].
        widest: what is not looked beyond [m].
        samples: number of places.
    """
    path = without_repeats(path, 0.0)
    arcs = arc_lengths(path)
    at = np.linspace(0.0, arcs[-1], samples + 2)[1:-1]
    leg = legs_at(arcs, at)
    tangent = np.diff(path, axis=0)[leg] / leg_lengths(path)[leg, None]
    places = path[leg] + (at - arcs[leg])[:, None] * tangent
    across = np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
    along = _crossings(walls, places, across)
    left = np.min(np.where(along >= 0.0, along, widest), axis=1, initial=widest)
    right = np.min(np.where(along <= 0.0, -along, widest), axis=1, initial=widest)
    widths: FloatArray = np.minimum(left + right, widest)
    return widths


def _crossings(walls: Walls, places: FloatArray, directions: FloatArray) -> FloatArray:
    """Signed distance along lines through places to every edge less its rounding, inf when missed, shape (m, E) [m]."""
    a, b = (walls.edges[None, :, k] - places[:, None] for k in (0, 1))
    side_a, side_b = (_cross(directions[:, None], p) for p in (a, b))
    hit = side_a * side_b <= 0.0
    share = side_a / np.where(np.abs(side_a - side_b) > 0.0, side_a - side_b, 1.0)
    along = np.einsum("med,md->me", a + share[..., None] * (b - a), directions)
    rounding = walls.rounding[walls.edge_wall]
    nearer = np.sign(along) * np.maximum(np.abs(along) - rounding, 0.0)
    return np.where(hit, nearer, np.inf)


def _cross(u: FloatArray, v: FloatArray) -> FloatArray:
    product: FloatArray = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return product
