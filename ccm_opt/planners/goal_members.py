"""Members of a goal that is a set of places and headings: the few to which routes are led.

What a wide tolerance leaves open is closed again by a few members that differ: at least one in every piece of the set
that the tip can get to, those first onto which the arm can run in straight, and far apart otherwise. The search takes
any other member that it comes by.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.ground.angles import unit_vector, wrap
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.link_space import NOMINAL_LINKS
from ccm_opt.planners.goal_member_settings import GoalMemberSettings


@dataclass(frozen=True)
class GoalMember:
    """One place and heading of a goal.

    Attributes:
        position: of the tip, shape (2,) [m].
        heading: of the tip [rad], or None where any will do.
    """

    position: FloatArray
    heading: float | None


@dataclass(frozen=True)
class _Choice:
    """Members to choose from.

    Attributes:
        places: shape (m, 2) [m].
        headings: shape (m,) [rad]; zeros where any will do.
        runs: nominal links that run straight onto each without meeting a wall, shape (m,).
        pieces: number of the piece of the set that each place belongs to, shape (m,).
    """

    places: FloatArray
    headings: FloatArray
    runs: FloatArray
    pieces: IntArray


def goal_members(
    arm: Arm, goal: GoalPose, room: FreeSpace, settings: GoalMemberSettings | None = None, fed: float = 0.0
) -> tuple[GoalMember, ...]:
    """Members of a goal to lead routes to; the goal itself alone when it is no set.

    Args:
        arm: that is to get there.
        goal: of the tip.
        room: free space of the arm's axis.
        settings: numbers.
        fed: how far the base can be fed in beyond where it stands [m].

    Returns:
        At least one unless the whole set is closed to the tip; the one nearest to the middle of the set first.
    """
    if not goal.is_set:
        return (GoalMember(goal.position, goal.heading),)
    settings = settings or GoalMemberSettings()
    choice = _choice(arm, goal, room, settings, fed)
    chosen = _far_apart(arm, goal, choice, settings)
    any_heading = goal.heading is None
    return tuple(GoalMember(choice.places[k], None if any_heading else float(choice.headings[k])) for k in chosen)


def _choice(arm: Arm, goal: GoalPose, room: FreeSpace, settings: GoalMemberSettings, fed: float) -> _Choice:
    """All places and headings that are looked at."""
    places, pieces = _places(arm, goal, room, settings, fed)
    headings = _headings(goal, settings)
    each = np.repeat(np.arange(len(places)), len(headings))
    turned = np.tile(headings, len(places))
    runs = np.zeros(len(each))
    if goal.heading is not None and len(each):
        unit = arm.length / NOMINAL_LINKS
        # The longest run comes last, so that it stays.
        for links in sorted(settings.runs):
            runs[_runs_in(room, places[each], turned, links * unit, settings)] = links
    return _Choice(places[each], turned, runs, pieces[each])


def _runs_in(
    room: FreeSpace, places: FloatArray, headings: FloatArray, length: float, settings: GoalMemberSettings
) -> BoolArray:
    """Onto which places (m, 2) [m] with headings (m,) [rad] a straight run of some length [m] is free; shape (m,)."""
    back = -np.linspace(0.0, length, settings.run_samples)
    samples = places[:, None] + back[:, None] * unit_vector(headings).reshape(-1, 2)[:, None]
    return np.asarray(room.contains(samples.reshape(-1, 2)).reshape(len(places), -1).all(axis=1))


def _headings(goal: GoalPose, settings: GoalMemberSettings) -> FloatArray:
    """Headings within the range, evenly, the middle one among them; shape (h,) [rad]."""
    if goal.heading is None:
        return np.zeros(1)
    steps = int(np.ceil(goal.room[1] / settings.turn_step))
    return goal.heading + np.linspace(-goal.room[1], goal.room[1], 2 * steps + 1)


def _places(
    arm: Arm, goal: GoalPose, room: FreeSpace, settings: GoalMemberSettings, fed: float
) -> tuple[FloatArray, IntArray]:
    """Places of the set that are connected with the base and within the arm's length of it, with their pieces."""
    if goal.room[0] == 0.0:
        return goal.position[None], np.zeros(1, dtype=np.intp)
    parts = shapely.get_parts(room.polygons)
    if len(parts) == 0:
        return np.zeros((0, 2)), np.zeros(0, dtype=np.intp)
    base = shapely.Point(arm.base)
    around_base = parts[int(np.argmin(shapely.distance(parts, base)))]
    middle = shapely.Point(goal.position)
    within = shapely.intersection(middle.buffer(goal.room[0]), base.buffer(settings.reach * arm.length + fed))
    pieces = [
        piece
        for piece in shapely.get_parts(shapely.intersection(around_base, within))
        if isinstance(piece, shapely.Polygon) and not piece.is_empty
    ]
    pieces.sort(key=lambda piece: -piece.area)
    places = [_places_in(piece, middle, base, goal.room[0], settings) for piece in pieces[: settings.pieces]]
    numbers = [np.full(len(some), k, dtype=np.intp) for k, some in enumerate(places)]
    return np.concatenate([np.zeros((0, 2)), *places]), np.concatenate([np.zeros(0, dtype=np.intp), *numbers])


def _places_in(
    piece: shapely.Polygon, middle: shapely.Point, base: shapely.Point, width: float, settings: GoalMemberSettings
) -> FloatArray:
    """Places of one piece: a grid, its roomiest place, and those nearest to the middle and to the base; (m, 2) [m]."""
    roomiest = shapely.get_coordinates(shapely.maximum_inscribed_circle(piece))[:1]
    # A little inside: at the very edge of free space no step has a choice.
    inside = piece.buffer(-settings.edge * width)
    inside = piece if inside.is_empty else inside
    ends = [shapely.get_coordinates(shapely.shortest_line(inside, end))[:1] for end in (middle, base)]
    across = np.linspace(-width, width, settings.grid)
    grid = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2) + shapely.get_coordinates(middle)
    return np.concatenate([*ends, roomiest, grid[shapely.intersects_xy(inside, grid[:, 0], grid[:, 1])]])


def _far_apart(arm: Arm, goal: GoalPose, choice: _Choice, settings: GoalMemberSettings) -> list[int]:
    """Which members are taken: the nearest to the middle of every piece, then the farthest from those taken."""
    if len(choice.places) == 0:
        return []
    off = np.linalg.norm(choice.places - goal.position, axis=1) / arm.length
    turned = np.abs(choice.headings - (goal.heading or 0.0)) * settings.turn_share
    # What can be run onto straight is better than what can not, whatever else.
    short = choice.runs.max() - choice.runs
    chosen: list[int] = []
    for piece in range(int(choice.pieces.max()) + 1):
        mine = np.flatnonzero(choice.pieces == piece)
        best = mine[np.argmin(short[mine] + 1e-3 * (off + turned)[mine])]
        chosen.append(int(best))
    while len(chosen) < settings.most:
        apart = np.min([_apart(arm, choice, k, settings) for k in chosen], axis=0)
        apart[short > 0.0] = 0.0
        farthest = int(np.argmax(apart))
        if apart[farthest] < settings.different:
            break
        chosen.append(farthest)
    return chosen


def _apart(arm: Arm, choice: _Choice, k: int, settings: GoalMemberSettings) -> FloatArray:
    """How much all members differ from one of them, shape (m,): in arm lengths, turns by their share."""
    off = np.linalg.norm(choice.places - choice.places[k], axis=1) / arm.length
    turned = np.abs(wrap(choice.headings - choice.headings[k])) * settings.turn_share
    return np.asarray(off + turned)
