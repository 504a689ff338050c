"""The ends of a motion: resolved to link headings, and refused when they touch something or break a joint limit."""

from dataclasses import dataclass, replace

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import short_length
from ccm_opt.core.polyline import unit_vector
from ccm_opt.errors import Diagnosis, UnreachableGoal
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.settings import DEFAULT_ENDS, EndSettings
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bad_pose import refuse_bad_pose, room_advice
from ccm_opt.scene.contact_finder import WALL, ContactFinder

_ROOM_SHARE = 0.05
"""Share of that tolerance that is left as room beside a wall that is too near to the goal. Taste."""

_TOLERANCE_SHARE = 0.5
"""Share of the goal's tolerances that planning uses where the goal cannot be met exactly. Taste."""
_PRECISE_PLACE = 5e-3
"""Position tolerances up to this share of the arm's length say how exactly a place is to be met; wider ones make the
goal a set. Taste."""
_PRECISE_TURN = 0.03490658503988659
"""The same for heading tolerances [rad]. Taste: 2°, twice what is allowed by default."""
_ROOM_USED = 0.95
"""Share of the tolerances of such a set that planning uses; the rest is left to rounding and smoothing. Taste."""
_AIM_SHARE = 0.9
"""Share of the position tolerance by which planning may aim beside a goal that the tip cannot take. Taste."""
_UPRIGHT = 0.1
"""Sine of the angle between a flush mount and its wall's normal above which a turn of the base leaves the wall.
Taste."""


@dataclass(frozen=True)
class Ends:
    """Both ends of a motion.

    Attributes:
        start: link headings, shape (links,) [rad].
        goal: where the tip has to be.
        goal_headings: link headings of a whole-arm goal, shape (links,) [rad], or None.
        clamped: whether the base stands flush on a wall, so that its joint cannot turn.
    """

    start: FloatArray
    goal: GoalPose
    goal_headings: FloatArray | None
    clamped: bool = False


def resolve_ends(problem: Problem, settings: EndSettings = DEFAULT_ENDS) -> Ends:
    """Start and goal of a problem on the links.

    Args:
        problem: whose ends they are.
        settings: numbers.

    Raises:
        UnreachableGoal: naming link and obstacle with the depth, or joint and angle.
    """
    start = problem.start.headings(problem.arm)
    clamped = stands_flush(problem, start, settings)
    arm = clamped_arm(problem.arm) if clamped else problem.arm
    refuse_bad_pose(arm, problem.workspace, start, "start", settings.reach)
    if isinstance(problem.goal, TipGoal):
        refuse_blocked_tip(problem, problem.goal)
        return Ends(start, tip_goal(problem, problem.goal, settings), None, clamped)
    headings = _within_limits(problem, problem.goal.headings(problem.arm))
    # A base that is clamped at the start is so at the goal only if it has not turned.
    at_goal = arm if headings[0] == start[0] else problem.arm
    refuse_bad_pose(at_goal, problem.workspace, headings, "goal", settings.reach)
    tip = arm.joint_positions(headings)[-1]
    return Ends(start, GoalPose(tip, unit_vector(headings[-1])), headings, clamped)


def tip_goal(problem: Problem, goal: TipGoal, settings: EndSettings = DEFAULT_ENDS) -> GoalPose:
    """A goal for the tip as planning takes it: a place and a heading to be met exactly, or a set with room in it.

    A tolerance as small as a precision leaves the goal a point, which is met exactly where that can be; a wider one
    makes it a set, of which any member will do.
    """
    allowed = problem.tolerances
    # Whoever may turn by half a turn either way may point anywhere.
    direction = None if allowed.heading >= np.pi else goal.direction
    wide = allowed.position > _PRECISE_PLACE * problem.arm.length
    turning = direction is not None and allowed.heading > _PRECISE_TURN
    room = (_ROOM_USED * allowed.position * wide, _ROOM_USED * allowed.heading * turning)
    spare = (_TOLERANCE_SHARE * allowed.position, _TOLERANCE_SHARE * allowed.heading)
    position = goal.position if wide else aim(problem, goal, settings)
    # An aim beside the goal has used some of the tolerance up.
    left = _ROOM_USED * allowed.position - float(np.hypot(*(position - goal.position)))
    near_enough = (0.0 if wide else float(np.clip(left, 0.0, spare[0])), 0.0 if turning else spare[1])
    return GoalPose(position, direction, room=room, near_enough=near_enough)


def aim(problem: Problem, goal: TipGoal, settings: EndSettings = DEFAULT_ENDS) -> FloatArray:
    """Where planning leads the tip, shape (2,) [m]: to the goal, or where that cannot be, to a place near enough.

    A goal out of reach is drawn towards the base, one too near to a wall to the nearest place with room.
    """
    arm = problem.arm
    slack = _AIM_SHARE * problem.tolerances.position
    offset = goal.position - arm.base

    # At full stretch the tip cannot move along the arm and Newton would stop; an aim a little nearer keeps the arm
    # bent, as far as the tolerance allows.
    beyond = float(np.hypot(*offset)) - (1.0 - settings.stretch) * arm.length
    if beyond > settings.stretch * arm.length:
        return np.asarray(goal.position - min(beyond, slack) * offset / np.hypot(*offset))

    need = arm.radius + problem.workspace.clearance
    place = shapely.Point(goal.position)
    _, room_there = problem.workspace.nearest(place)
    if room_there >= need:
        return goal.position

    # A little more room than need be: at the very edge of free space no step has a choice.
    need += _ROOM_SHARE * slack
    room = problem.workspace.boundary.buffer(-need)
    bodies = [shapely.buffer(wall.core, wall.rounding + need) for wall in problem.workspace.obstacles]
    free = shapely.difference(room, shapely.union_all(bodies))

    nearest = shapely.get_coordinates(shapely.shortest_line(place, free))
    if len(nearest) == 0 or float(np.hypot(*(nearest[1] - goal.position))) > slack:
        return goal.position
    return np.asarray(nearest[1])


def stands_flush(problem: Problem, headings: FloatArray, settings: EndSettings = DEFAULT_ENDS) -> bool:
    """Whether the arm leaves a wall so that the end of its mount just clears it, and no turn of the base would."""
    arm = problem.arm
    # The whole first link belongs to the mount already.
    if arm.mount_length >= arm.link_length:
        return False
    points = arm.joint_positions(headings)
    reach = settings.reach * arm.length
    near = problem.workspace.near(shapely.LineString(points), arm.radius + problem.workspace.clearance + reach)
    contacts = ContactFinder(arm, near.flat_walls, near.clearance, 0.0, reach).find(points)
    at_mount = (contacts.first == 0) & np.isclose(contacts.first_at * arm.link_length, arm.mount_length)
    flush = at_mount & (contacts.second == WALL) & (np.abs(contacts.gap) <= settings.flush * arm.length)

    # Turning the base by dφ moves the mount's end sideways by mount · dφ. With the wall square to the link the gap only
    # falls, by the square of dφ: no turn of the base is free, in either direction.
    sideways = contacts.normal @ np.array([-np.sin(headings[0]), np.cos(headings[0])])
    return bool(np.any(flush & (np.abs(sideways) < _UPRIGHT)))


def clamped_arm(arm: Arm) -> Arm:
    """The arm for planning when its base is clamped: the first link, which cannot move, belongs to the mount."""
    return replace(arm, mount_length=arm.link_length)


def _within_limits(problem: Problem, headings: FloatArray) -> FloatArray:
    """A whole-arm goal whose joints lie beyond their limits by less than its tolerance, turned back onto them."""
    arm = problem.arm
    bends = arm.bends(headings)
    kept = np.clip(bends, -arm.bend_limits, arm.bend_limits)
    over = float(np.max(np.abs(bends - kept)))
    given = isinstance(problem.goal, JointPose) and problem.goal.curve is None
    return arm.headings(kept) if given and 0.0 < over <= _ROOM_USED * problem.tolerances.heading else headings


def refuse_blocked_tip(problem: Problem, goal: TipGoal) -> None:
    """Refuse a goal at which the tip, or with a heading the last link, is deeper in a wall than tolerances allow."""
    arm = problem.arm
    tolerances = problem.tolerances
    play = tolerances.position
    last: shapely.Point | shapely.LineString = shapely.Point(goal.position)
    if goal.heading is not None:
        back = arm.link_length * unit_vector(goal.heading)
        last = shapely.LineString([goal.position - back, goal.position])
        # The rear end of the last link may swing by this much.
        play += arm.link_length * tolerances.heading
    need = arm.radius + problem.workspace.clearance - play
    k, apart = problem.workspace.nearest(last)
    gap = apart - need
    if gap < 0.0:
        what = "tip is" if goal.heading is None else "last link is"
        depth = short_length(play - gap)
        reason = f"at the goal the {what} {depth} too near to '{problem.workspace.walls[k].name}'"
        move = "move the goal" if goal.heading is None else "move the goal or change its heading"
        advice = (move, *room_advice(arm.radius, problem.workspace.clearance))
        raise UnreachableGoal(Diagnosis(reason, "goal", advice))
