"""Start and goal of a motion in the form that planning uses, checks of both, and gaps between bodies at poses."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely

from ccm_opt.core.arrays import ROUNDING, FloatArray, IntArray, in_space
from ccm_opt.core.errors import Diagnosis, ProblemError, UnreachableGoal
from ccm_opt.core.length_words import long_length, place, short_length
from ccm_opt.core.polyline import unit_vector
from ccm_opt.ik.tip_roll import TipRoll
from ccm_opt.planning.goal import GoalPose
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bad_pose import clearance_advice, refuse_bad_pose
from ccm_opt.scene.contact_finder import WALL, WallFinder, describe_clearance, nearest_links
from ccm_opt.scene.distances.enclosures import Enclosure, deepest_enclosure, enclosure_advice
from ccm_opt.scene.distances.surface_tree import SurfaceTree

if TYPE_CHECKING:
    from ccm_opt.planning.space_task import SpaceTask

_STRAIGHTENING = 5e-4
"""Largest displacement of the tip, if bends inside the guide tube are set to 0, up to which these bends count as errors
of mapping a curve to links and not as bent joints [m]. Heuristic."""
_CLEARANCE_SHARE = 0.05
"""Additional clearance of the tip at a goal moved away from an obstacle, as a fraction of the largest permitted
displacement of the goal. Heuristic."""

_TOLERANCE_SHARE = 0.5
"""Fraction of the goal's tolerances that planning uses if the goal cannot be met exactly. Heuristic."""
_PRECISE_PLACE = 5e-3
"""Position tolerance, as a fraction of the arm's length, up to which the goal is a point that is met exactly. A wider
tolerance makes the goal a set. Heuristic."""
_PRECISE_TURN = 0.03490658503988659
"""Heading tolerance up to which the heading is met exactly [rad]. Heuristic: 2°, twice the default tolerance."""
_CLEARANCE_USED = 0.95
"""Fraction of the tolerances of a goal set that planning uses; the rest is left to rounding and smoothing.
Heuristic."""
_AIM_SHARE = 0.9
"""Fraction of the position tolerance by which planning may displace a goal that the tip cannot reach. Heuristic."""
_UPRIGHT = 0.1
"""Sine of the angle between a mount and its wall's normal above which a turn of the base leaves the wall. Heuristic."""
_STRETCH = 2e-3
"""Fraction of its length by which an arm is kept from full stretch if the goal is out of reach. Heuristic: at full
stretch the tip cannot move along the arm."""
_FLUSH = 1e-5
"""Largest deviation of the gap at the end of a mount from zero, as a fraction of the arm's length, for the mount to
count as flush with the wall. Heuristic."""
_REACH = 0.02
"""Gap up to which contacts are checked, as a fraction of the arm's length. Heuristic."""


@dataclass(frozen=True)
class Ends:
    """Start and goal of a planar motion.

    Attributes:
        start: configuration at the start, shape (c,) [rad, m].
        goal: goal of the tip.
        goal_pose: configuration of a goal for the whole arm, shape (c,) [rad, m], or None.
        clamped: whether the base joint cannot turn because the arm leaves a wall flush with its mount.
    """

    start: FloatArray
    goal: GoalPose
    goal_pose: FloatArray | None
    clamped: bool = False


def resolve_ends(problem: Problem) -> Ends:
    """Return the start and goal of a planar problem, after checking them for contact and joint limits.

    Raises:
        UnreachableGoal: the start or goal is in contact or beyond a joint limit; the message names link, obstacle and
            depth, or joint and angle.
    """
    start = _configuration(problem, problem.start, "start")
    clamped = not problem.arm.base_axes and stands_flush(problem, start)
    arm = clamped_arm(problem.arm) if clamped else problem.arm
    refuse_bad_pose(arm, problem.workspace, start, "start", _REACH)
    goal = problem.goal
    if goal.for_joints is None:
        refuse_blocked_tip(problem, goal.for_tip)
        return Ends(start, tip_goal(problem, goal.for_tip), None, clamped)
    q = _within_limits(problem, goal.for_joints)
    # A base that is clamped at the start is clamped at the goal only if it has not turned.
    at_goal = arm if q[0] == start[0] else problem.arm
    refuse_bad_pose(at_goal, problem.workspace, q, "goal", _REACH)
    tip = GoalPose(arm.joint_positions_at(q)[-1], arm.link_rotations(q)[-1, :, 0])
    return Ends(start, tip, q, clamped)


def _configuration(problem: Problem, pose: JointPose, which: str) -> FloatArray:
    """Return the configuration of a start or goal pose, shape (c,), with bends of exactly 0 inside the guide tube.

    Args:
        problem: the problem, for its arm.
        pose: the pose.
        which: name of the pose in messages, "start" or "goal".

    Raises:
        UnreachableGoal: a joint inside the tube is bent.
    """
    arm = problem.arm
    if not arm.base_axes:
        return pose.configuration(arm)
    held = arm.held(pose.feed)
    # A bend moves the tip by at most the bend times the arm's length.
    mapped = _STRAIGHTENING / (arm.length * max(int(held.sum()), 1))
    bent = held & (np.abs(pose.bends) > (ROUNDING if pose.curve is None else mapped))
    if bent.any():
        joint = int(np.argmax(bent))
        reason = (
            f"the {which} bends joint {joint + 1} by {np.rad2deg(pose.bends[joint]):.3g}° inside the guide tube, which "
            "holds it straight"
        )
        advice = (f"straighten the {which} inside the guide tube", f"raise {which}.feed")
        raise UnreachableGoal(Diagnosis(reason, which, advice))
    return arm.configuration(np.where(held, 0.0, pose.bends), pose.feed)


def tip_goal(problem: Problem, goal: TipGoal) -> GoalPose:
    """Return a goal of the tip in the form that planning uses: a tip pose to be met exactly, or a set of tip poses.

    A small tolerance is a precision, and the goal is met exactly where possible. A wide tolerance makes the goal a set,
    any member of which is acceptable.
    """
    allowed = problem.tolerances
    # With half a turn of tolerance either way every direction is acceptable.
    direction = None if allowed.heading >= np.pi else goal.direction
    wide = allowed.position > _PRECISE_PLACE * problem.arm.length
    turning = direction is not None and allowed.heading > _PRECISE_TURN
    room = (_CLEARANCE_USED * allowed.position * wide, _CLEARANCE_USED * allowed.heading * turning)
    spare = (_TOLERANCE_SHARE * allowed.position, _TOLERANCE_SHARE * allowed.heading)
    position = goal.position if wide or problem.dimension == 3 else aim(problem, goal)
    # An aim next to the goal has used up some of the tolerance.
    left = _CLEARANCE_USED * allowed.position - float(np.linalg.norm(position - goal.position))
    near_enough = (0.0 if wide else float(np.clip(left, 0.0, spare[0])), 0.0 if turning else spare[1])
    roll = TipRoll.of(goal, problem.arm, allowed.roll)
    return GoalPose(position, direction, room=room, near_enough=near_enough, roll=roll)


def aim(problem: Problem, goal: TipGoal) -> FloatArray:
    """Return the position to which planning leads the tip for a goal, shape (2,) [m].

    The goal itself is returned if the tip can be there. A goal out of reach is moved towards the base, a goal too near
    to an obstacle to the nearest position with clearance, both within the tolerance.
    """
    arm = problem.arm
    slack = _AIM_SHARE * problem.tolerances.position
    offset = goal.position - arm.base

    # At full stretch the tip cannot move along the arm and Newton's method would stall; an aim slightly nearer keeps
    # the arm bent, as far as the tolerance allows.
    beyond = float(np.hypot(*offset)) - (1.0 - _STRETCH) * arm.length
    if beyond > _STRETCH * arm.length and not arm.base_axes:
        return np.asarray(goal.position - min(beyond, slack) * offset / np.hypot(*offset))

    need = arm.tip_radius + problem.workspace.clearance
    place = shapely.Point(goal.position)
    _, room_there = problem.workspace.nearest(place)
    if room_there >= need:
        return goal.position

    # Slightly more clearance than needed: at the very edge of free space no step has a choice.
    need += _CLEARANCE_SHARE * slack
    room = problem.workspace.boundary.buffer(-need)
    bodies = [wall.buffered(wall.rounding + need) for wall in problem.workspace.obstacles]
    free = shapely.difference(room, shapely.union_all(bodies))

    nearest = shapely.get_coordinates(shapely.shortest_line(place, free))
    if len(nearest) == 0 or float(np.hypot(*(nearest[1] - goal.position))) > slack:
        return goal.position
    return np.asarray(nearest[1])


def stands_flush(problem: Problem, q: FloatArray) -> bool:
    """Return whether the base joint cannot turn because the end of the arm's mount just touches a wall.

    This is so if the arm leaves the wall along its normal: a turn in either direction would press the mount's end into
    the wall.

    Args:
        problem: the problem.
        q: configuration, shape (c,) [rad].
    """
    arm = problem.arm
    # The whole first link belongs to the mount already.
    if arm.mount_length >= arm.lengths[0]:
        return False
    points = arm.joint_positions_at(q)
    reach = _REACH * arm.length
    near = problem.workspace.near(shapely.LineString(points), arm.radius + problem.workspace.clearance + reach)
    contacts = WallFinder(arm, near.flat_walls, near.clearance, 0.0, reach).find(points)
    at_mount = (contacts.first == 0) & np.isclose(contacts.first_at * arm.lengths[0], arm.mount_length)
    flush = at_mount & (contacts.second == WALL) & (np.abs(contacts.gap) <= _FLUSH * arm.length)

    # Turning the base by dφ moves the mount's end sideways by mount · dφ. With the wall square to the link the gap can
    # only shrink, by the square of dφ: the base cannot turn in either direction.
    sideways = contacts.normal @ arm.link_rotations(q)[0, :, 1]
    return bool(np.any(flush & (np.abs(sideways) < _UPRIGHT)))


def clamped_arm(arm: Arm) -> Arm:
    """Return an arm whose first link, which cannot move, belongs to the mount, for planning with a clamped base."""
    return replace(arm, mount_length=float(arm.lengths[0]))


def _within_limits(problem: Problem, pose: JointPose) -> FloatArray:
    """Return the configuration of a goal for the whole arm, shape (c,), with bends clipped to the joint limits.

    Bends are clipped only if they exceed their limits by less than the tolerance of the goal.
    """
    arm = problem.arm
    q = _configuration(problem, pose, "goal")
    bends = q[: arm.links]
    kept = np.clip(bends, -arm.bend_limits, arm.bend_limits)
    over = float(np.max(np.abs(bends - kept)))
    clipped = np.append(kept, q[arm.links :])
    return clipped if pose.curve is None and 0.0 < over <= _CLEARANCE_USED * problem.tolerances.heading else q


def refuse_blocked_tip(problem: Problem, goal: TipGoal) -> None:
    """Check that the tip at a goal, or the last link for a goal heading, is clear of obstacles within the tolerances.

    Raises:
        UnreachableGoal: the tip or link is too near to an obstacle; the message names the obstacle and the depth.
    """
    arm = problem.arm
    tolerances = problem.tolerances
    play = tolerances.position
    last: shapely.Point | shapely.LineString = shapely.Point(goal.position)
    if goal.heading is not None:
        length = float(arm.lengths[-1])
        back = length * unit_vector(goal.heading)
        last = shapely.LineString([goal.position - back, goal.position])
        # Within the heading tolerance, the rear end of the last link may swing by this much.
        play += length * tolerances.heading
    need = arm.tip_radius + problem.workspace.clearance - play
    k, apart = problem.workspace.nearest(last)
    gap = apart - need
    if gap < 0.0:
        what = "tip" if goal.heading is None else "last link"
        depth = short_length(play - gap)
        reason = f"the goal is in contact: the {what} is {depth} too near to '{problem.workspace.walls[k].name}'"
        turn = "" if goal.heading is None else ", or change its heading"
        advice = (
            f"move the goal away by {depth}{turn}",
            *clearance_advice(arm.tip_radius, problem.workspace.clearance, -gap, key=arm.key("radius")),
        )
        raise UnreachableGoal(Diagnosis(reason, "goal", advice))


def refuse_ends(problem: Problem, task: "SpaceTask") -> None:
    """Check that start and goal of a problem in space are clear, within reach, and satisfy the user's constraints.

    Args:
        problem: the problem.
        task: search task of the problem.

    Raises:
        ProblemError: the start is in contact or violates a constraint.
        UnreachableGoal: the goal is in contact, violates a constraint or is out of reach.
    """
    for limit in task.user_limits:
        limit.refuse_ends(task.start, task.goal_pose)
    bad = _what_is_bad(problem, task, task.start, "from there")
    if bad:
        raise ProblemError(f"the start {bad}")
    if task.goal_pose is not None:
        bad = _what_is_bad(problem, task, task.goal_pose, "to it")
        if bad:
            raise UnreachableGoal(Diagnosis(f"the goal pose {bad}", "necessary checks"))
    elif problem.goal.path is None:
        refuse_goal(problem, task, task.goal)


def refuse_goal(problem: Problem, task: "SpaceTask", goal: GoalPose) -> None:
    """Check that a goal for the tip in space is clear of obstacles and within reach of the arm.

    Raises:
        UnreachableGoal: the goal is inside or too near to an obstacle, or out of reach; the message says by how much.
    """
    found = deepest_enclosure(problem.workspace, goal.position[None], entering=problem.arm.tip_radius)
    if found is not None:
        reason = f"the goal is {_depth_words(found)}"
        ways = (
            enclosure_advice(problem.workspace, found.name, "the goal")
            if found.name
            else ("move the goal inside workspace.bounds",)
        )
        raise UnreachableGoal(Diagnosis(reason, "necessary checks", ways))
    kept = task.kept
    # Any position within the tolerance is an acceptable goal.
    least = kept - problem.tolerances.position
    near = task.tree.nearest(np.stack((goal.position, goal.position))[None], kept)
    if near.owner[0] >= 0 and near.gap[0] < least:
        missing = short_length(kept - float(near.gap[0]))
        name = task.names[near.owner[0]]
        reason = f"the goal is in contact: the tip is {missing} too near to '{name}' at {place(near.point[0])}"
        lacking = least - float(near.gap[0])
        key = task.arm.key("radius")
        thinner = clearance_advice(task.arm.tip_radius, problem.workspace.clearance, lacking, key=key)
        advice = (f"move the goal away from it by {missing}", *thinner)
        raise UnreachableGoal(Diagnosis(reason, "necessary checks", advice))
    arm = task.arm
    low, high = arm.base_range
    along = float(np.clip((goal.position - arm.base) @ arm.direction, low, high))
    base = arm.base + along * arm.direction if arm.base_axes else arm.base
    distance = float(np.linalg.norm(goal.position - base))
    if distance > arm.length and not arm.carrier:
        missing = short_length(distance - arm.length)
        reason = (
            f"the goal is out of reach: it is {long_length(distance)} from the base, and the arm is only "
            f"{long_length(arm.length)} long"
        )
        advice = (f"move the goal nearer by {missing} at least", f"lengthen the arm by {missing} at least")
        raise UnreachableGoal(Diagnosis(reason, "necessary checks", advice))


def _what_is_bad(problem: Problem, task: "SpaceTask", q: FloatArray, motion: str) -> str:
    """Return a message if a start or goal configuration is in contact or too near to it to be certified, else "".

    Args:
        problem: the problem.
        task: search task of the problem.
        q: configuration of the start or goal, shape (c,) [rad, m].
        motion: words for the motion in the message, "from there" or "to it".
    """
    contact = contact_words(problem, task, q)
    if contact:
        return f"is in contact: {contact}"
    near = describe_contact(task, q, 2.0 * task.least_spare)
    return f"has too little clearance for a motion {motion} to be certified: {near}" if near else ""


def contact_words(problem: Problem, task: "SpaceTask", q: FloatArray) -> str:
    """Return a message about contact of a configuration in space (c,) and its depth inside bodies, or "" if free."""
    contact = describe_contact(task, q)
    joints = task.arm.joint_positions_at(q)
    _, exposed = task.arm.exposed_links(joints)
    # An arm that touches nothing lies inside a closed body as a whole, and one whose mount ends outside an open body
    # has entered it through an opening.
    first = int(np.searchsorted(task.arm.joint_places, task.arm.mount_length)) if contact else len(joints)
    found = deepest_enclosure(problem.workspace, np.concatenate((joints[first:], exposed[:1, 0])))
    if found is None:
        return contact
    number = first + found.number
    point = "the tip" if number == task.arm.links else task.arm.joint_name(number)
    point = "the end of the mount" if found.number == len(joints) - first else point
    deep = f"{point} is {_depth_words(found)}"
    ways = enclosure_advice(problem.workspace, found.name, "the arm")[1:] if found.name else ()
    return "; ".join((*([contact] if contact else []), deep, *ways))


def _depth_words(found: Enclosure) -> str:
    where = f"inside '{found.name}'" if found.name else "outside workspace.bounds"
    return f"{short_length(found.depth)} {where}, at {place(found.place)}"


def describe_contact(task: "SpaceTask", q: FloatArray, beyond: float = 0.0) -> str:
    """Return a message about the nearest bodies in contact, or within a distance of contact, or "" if there are none.

    Args:
        task: search task in space.
        q: configuration, shape (c,) [rad, m].
        beyond: distance from contact up to which bodies count [m].
    """
    arm = task.arm
    points = arm.joint_positions_at(q)
    first, segments = arm.exposed_links(points)
    if len(segments):
        kept = arm.radii[first:] + task.clearance + beyond
        near = task.tree.nearest(segments, float(np.max(kept)) + arm.link_length)
        gap = near.gap - kept
        k = int(np.argmin(gap))
        if gap[k] < -ROUNDING:
            missing = short_length(-float(gap[k]))
            name = task.names[near.owner[k]]
            return f"{arm.link_name(first + k)} is {missing} too near to '{name}' at {place(near.point[k])}"
    if arm.self_collision:
        nearest = nearest_links(arm, points[None], beyond)
        if nearest.first[0] >= 0:
            missing = short_length(beyond - float(nearest.gap[0]))
            one, other = (arm.link_name(link) for link in (nearest.first[0], nearest.second[0]))
            return f"{one} is {missing} too near to {other}"
    return ""


@dataclass(frozen=True, eq=False)
class NearestOfSamples:
    """Minimum gap at each of T samples of a motion, with the two bodies concerned.

    Attributes:
        gap: gap between the nearest bodies, capped at the search distance, shape (T,) [m].
        link: number of the link, counted from 1; 0 if nothing is within the search distance, shape (T,).
        other: index of the object to which the other surface belongs, or number of the other link, counted from 1,
            shape (T,).
    """

    gap: FloatArray
    link: IntArray
    other: IntArray


@dataclass(frozen=True, eq=False)
class GapsAtSamples:
    """Gaps at samples of a motion, between the arm and the scene and between links; clearance is not subtracted.

    Attributes:
        arm: the arm.
        walls: gaps of links to the nearest surface of the scene.
        itself: gaps between links that must not touch.
        names: names of the objects to which the surfaces belong.
        reach: search distance, at which gaps to walls are capped [m].
    """

    arm: Arm
    walls: NearestOfSamples
    itself: NearestOfSamples
    names: tuple[str, ...]
    reach: float

    @classmethod
    def from_poses(
        cls, problem: Problem, points: FloatArray, reach: float | None = None, own_reach: float | None = None
    ) -> "GapsAtSamples":
        """Return the gaps at T poses of the arm.

        Args:
            problem: problem with the surfaces and the arm.
            points: joints and tip of every pose, shape (T, links + 1, d) [m].
            reach: search distance, at which gaps to walls are capped; the length of a link if None [m].
            own_reach: search distance, at which gaps between links are capped; that for walls if None [m].
        """
        arm = problem.arm
        far = arm.link_length if reach is None else reach
        walls = _walls(problem, problem.workspace.surface_tree, points, far)
        itself = _itself(problem, points, far if own_reach is None else own_reach)
        return cls(arm, walls, itself, problem.workspace.triangle_soup.names, far)

    @classmethod
    def nearest_words(cls, problem: Problem, q: FloatArray) -> str:
        """Return a message with the two bodies nearest to each other in a configuration (c,) and their gap, or ""."""
        gaps = cls.from_poses(problem, problem.arm.joint_positions_at(q)[None])
        to_walls = float(gaps.walls.gap[0]) - problem.workspace.clearance
        to_itself = float(gaps.itself.gap[0])
        near = gaps.walls if to_walls <= to_itself else gaps.itself
        if not near.link[0]:
            return ""
        link = problem.arm.link_name(near.link[0] - 1)
        return describe_clearance(link, gaps.other(near, 0), min(to_walls, to_itself))

    def other(self, near: NearestOfSamples, sample: int) -> str:
        """Return the name of the body that is nearest to a link at the sample with a given index.

        ``near`` is either ``walls`` or ``itself``.
        """
        number = int(near.other[sample])
        return f"'{self.names[number]}'" if near is self.walls else self.arm.link_name(number - 1)


def _walls(problem: Problem, tree: SurfaceTree, points: FloatArray, reach: float) -> NearestOfSamples:
    arm = problem.arm
    link, exposed = arm.exposed_links(points)
    count = len(points)
    if link == arm.links or len(problem.workspace.triangle_soup) == 0:
        return _nothing(count, reach)
    # The link whose centre line is nearest has the least gap only among links of one radius.
    together = exposed.shape[1] if np.ptp(arm.radii[link:]) == 0.0 else 1
    found = tree.nearest(in_space(exposed.reshape(-1, 2, arm.dimension)), reach + arm.radius, together)
    gaps = found.gap.reshape(count, -1) - arm.radii[link:]
    best = np.argmin(gaps, axis=1)
    rows = np.arange(count)
    gap = np.minimum(gaps[rows, best], reach)
    owner = np.where(gap < reach, found.owner.reshape(count, -1)[rows, best], -1)
    return NearestOfSamples(gap, np.where(owner >= 0, link + best + 1, 0), owner)


def _itself(problem: Problem, points: FloatArray, reach: float) -> NearestOfSamples:
    arm = problem.arm
    if not arm.self_collision:
        return _nothing(len(points), reach)
    nearest = nearest_links(arm, in_space(points), reach)
    found = nearest.first >= 0
    return NearestOfSamples(nearest.gap, nearest.first + 1, np.where(found, nearest.second + 1, -1))


def _nothing(count: int, reach: float) -> NearestOfSamples:
    return NearestOfSamples(np.full(count, reach), np.zeros(count, dtype=np.intp), np.full(count, -1, dtype=np.intp))
