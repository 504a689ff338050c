"""Members of a goal that an arm comes by on its way into it: where the shortest ways enter the set, and as they head.

A disc that lies across walls has members on both sides of them, and most of those that differ most may be shut off.
Along the shortest way there is nothing to go round.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.ground.angles import unit_vector, wrap
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import arc_lengths, leg_headings, legs_at, path_length, points_at
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.goal import GoalPose
from ccm_opt.planners.goal_members import GoalMember


def members_on_way(
    arm: Arm,
    goal: GoalPose,
    room: FreeSpace,
    begin: FloatArray,
    others: Sequence[GoalMember],
    spacing: float,
    off_corners: float,
) -> tuple[GoalMember, ...]:
    """The first good member on the shortest way to each of some other members, the one on the shortest way first.

    Args:
        arm: whose tip is to get there.
        goal: a set.
        room: free space of the arm's axis.
        begin: where the ways begin, shape (2,) [m].
        others: members to lead ways to.
        spacing: between the places of a way that are looked at [m].
        off_corners: what ways keep from corners where there is room [m].
    """
    ways = [route.taut for other in others for route in room.routes(begin, other.position, 1, shrink=off_corners)]
    ways.sort(key=path_length)
    kept: list[GoalMember] = []
    for member in (each for way in ways for each in _first_good(arm, goal, room, way, spacing)):
        if all(np.hypot(*(member.position - each.position)) > arm.link_length for each in kept):
            kept.append(member)
    return tuple(kept)


def _first_good(arm: Arm, goal: GoalPose, room: FreeSpace, way: FloatArray, spacing: float) -> Iterator[GoalMember]:
    """The first place of a way in the set at which the way heads as the goal allows, else where it nearly does."""
    arcs = arc_lengths(way)
    # The way's end is a member whatever the spacing; a small set may hold no other place.
    places = np.append(np.arange(0.0, arcs[-1], spacing), arcs[-1])
    points = points_at(way, arcs, places)
    inside = np.hypot(*(points - goal.position).T) <= goal.room[0]
    if not inside.any():
        return
    points = points[inside]
    if goal.heading is None:
        yield GoalMember(points[0], None)
        return
    along = leg_headings(way)[legs_at(arcs, places[inside])]
    turned = wrap(along - goal.heading)
    headings = goal.heading + np.clip(turned, -goal.room[1], goal.room[1])
    missed = np.abs(turned) - goal.room[1]
    # The last link lies straight behind the tip.
    rears = points - arm.link_length * unit_vector(headings).reshape(-1, 2)
    fits = room.contains(rears)
    best = int(np.argmin(np.maximum(missed, 0.0) + np.pi * ~fits))
    yield GoalMember(points[best], float(headings[best]))
