"""Goals of a set and proposed motions of a fed arm.

A disc that lies across walls has members on both sides of them, and most of those that differ most may be shut off.
Along the shortest way there is nothing to go round.

Where the straight line between the start and the end leads into a wall or through the arm itself, both are drawn back
along their own paths first, no farther than need be: what is left to change is less, and so is what is in its way.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from ccm_opt.core.arrays import ROUNDING, SHORTEST, FloatArray
from ccm_opt.core.polyline import arc_lengths, leg_headings, legs_at, path_length, points_at, unit_vector, wrap
from ccm_opt.planning.ends import Ends, resolve_ends, tip_goal
from ccm_opt.planning.feed.leader import LeaderPath, joined_keyframes, slide
from ccm_opt.planning.feed.query import FeedQuery
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.goal_members import GoalMember, goal_members
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.planning.settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.problem import JointPose, Limits, Problem, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

_WAY_SPACING = 0.5
"""Between the places of a way into a goal that is a set at which it may end, in link lengths. Taste."""
_LEAST_LINKS_RESHAPED = 2
"""Shapes of fewer links beyond the hole are not changed. Derived: a single link has no shape."""
_TIGHT_GAP = 0.05
"""Room on either side of the arm, in link lengths, below which a place of the axis is tight: no joint can bend there as
paths would have it. Taste."""
_TIGHT_SPACING = 0.05
"""Places of the axis that are looked at, in link lengths. Taste."""
_TIGHT_PLACES = 3
"""Of which paths are tried that stay straight up to their end. Taste."""


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


def member_problems(
    problem: Problem, feed: Feed, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
) -> tuple[Problem, ...]:
    """The problem; where its goal is a set, one for each of some members of it, the most promising first.

    Args:
        problem: with a feed axis.
        feed: the axis.
        settings: numbers.
    """
    if not isinstance(problem.goal, TipGoal):
        return (problem,)
    goal = tip_goal(problem, problem.goal)
    if not goal.is_set:
        return (problem,)
    arm = problem.arm
    room = FreeSpace(problem.workspace, max(arm.radius + problem.workspace.clearance, SHORTEST))
    # What lies within reach begins at the hole, where the guide tube ends.
    at_hole = replace(arm, base=arm.base + feed.hole * arm.direction)
    members = goal_members(at_hole, goal, room, fed=max(feed.high - feed.hole, 0.0))
    beyond = at_hole.base + arm.link_length * arm.direction
    spacing = _WAY_SPACING * arm.link_length
    off_corners = settings.corner_distance * arm.length
    members = (*members_on_way(arm, goal, room, beyond, members, spacing, off_corners), *members)
    # A member is a place and not the middle of another set: around it the whole tolerance would reach beyond the goal.
    point = Tolerances()
    tolerances = Tolerances(
        min(problem.tolerances.position, point.position), min(problem.tolerances.heading, point.heading)
    )
    goals = [TipGoal(member.position, heading=member.heading) for member in members]
    return tuple(replace(problem, goal=each, tolerances=tolerances) for each in goals) or (problem,)


def ends_of_tight_places(problem: Problem, beyond: float) -> list[float]:
    """Arc lengths from ``Arm.base`` at which the axis leaves what is hardly wider than the arm, nearest first [m].

    Args:
        problem: with a feed axis.
        beyond: arc length from which on they count [m].
    """
    arm = problem.arm
    spacing = _TIGHT_SPACING * arm.link_length
    along = np.arange(beyond, arm.base_range[1] + arm.length, spacing)
    if len(along) < 2:
        return []
    gaps = _gaps(problem, arm, along)
    # Nothing passes a wall across the axis; what touches, within the tolerance of contact, does pass.
    blocked = np.flatnonzero(gaps < -problem.contact_tolerance)
    if len(blocked):
        gaps = gaps[: blocked[0]]
    tight = gaps < _TIGHT_GAP * arm.link_length
    leaves = np.flatnonzero(tight[:-1] & ~tight[1:])
    return [float(along[k + 1]) for k in leaves[:_TIGHT_PLACES]]


def _gaps(problem: Problem, arm: Arm, along: FloatArray) -> FloatArray:
    """How far the arm is from walls where its axis passes the axis of the feed, shape (m,) [m]."""
    points = shapely.points(arm.base + along[:, None] * arm.direction)
    need = arm.radius + problem.workspace.clearance
    gaps = [shapely.distance(wall.core, points) - wall.rounding - need for wall in problem.workspace.walls]
    return np.asarray(np.min(gaps, axis=0))


@dataclass(frozen=True)
class PartBeyond:
    """The problem of an arm from one of its joints on, at one feed.

    Attributes:
        problem: of the part, what is before it an obstacle.
        first: number of links before it.
        clamped: whether its first link is one that the guide tube keeps straight.
    """

    problem: Problem
    first: int
    clamped: bool

    @classmethod
    def of(
        cls,
        problem: Problem,
        start: JointPose,
        goal: FloatArray | TipGoal,
        outside: float,
    ) -> "PartBeyond | None":
        """The part that begins in a pose and is to take other bends, or to come to a goal of the tip, at its feed.

        Args:
            problem: of the whole arm, with a feed axis.
            start: where it begins.
            goal: bends of the whole arm, shape (links,) [rad], or a goal of the tip.
            outside: arc length from which on joints may bend [m].

        Returns:
            None where too few links are beyond, or what is before them bends.
        """
        arm = problem.arm
        joints = start.feed + arm.link_length * np.arange(arm.links)
        first = int(np.searchsorted(joints, outside - ROUNDING))
        too_few = arm.links - first < _LEAST_LINKS_RESHAPED
        start_bent = bool(np.any(start.bends[:first]))
        goal_bent = not isinstance(goal, TipGoal) and bool(np.any(goal[:first]))
        if too_few or start_bent or goal_bent:
            return None
        # An arm has an even number of links: an odd part gets one link more, which the guide tube keeps straight.
        clamped = (arm.links - first) % 2 == 1
        first -= int(clamped)
        return cls(_problem_of_part(problem, start, goal, first), first, clamped)

    def ends(self) -> Ends:
        """Start and goal of the part.

        Raises:
            UnreachableGoal: one of them cannot be.
        """
        ends = resolve_ends(self.problem)
        # Clamped ends keep the first link still, which holds the extra link straight.
        return replace(ends, clamped=self.clamped or ends.clamped)


def _problem_of_part(problem: Problem, start: JointPose, goal: FloatArray | TipGoal, first: int) -> Problem:
    """The problem of the arm from a joint on, what is before it an obstacle."""
    limits = problem.limits
    torque = None if limits.torque is None else limits.torque[3 * first :]
    return replace(
        problem,
        arm=part_of(problem.arm, first, start.feed),
        limits=Limits(limits.velocity[3 * first :], limits.acceleration[3 * first :], torque),
        workspace=_with_held_links(problem, start, first),
        start=JointPose(start.bends[first:]),
        goal=goal if isinstance(goal, TipGoal) else JointPose(goal[first:]),
        stops=(),
        # What is wanted by default is a share of the arm's length.
        planner=replace(problem.planner, mapping="least-squares", wanted_gap=problem.wanted_gap),
    )


def _with_held_links(problem: Problem, start: JointPose, first: int) -> Workspace:
    """The workspace with those links in the guide tube that the arm from a joint on might meet."""
    arm = problem.arm
    held = first + 1 - arm.first_self_pair
    if held < 1 or not arm.self_collision:
        return problem.workspace
    # Self-contact is measured between distant links only, so the last links in the guide tube are left out.
    ends = arm.base + np.outer([start.feed, start.feed + held * arm.link_length], arm.direction)
    rounding = max(arm.radius - problem.workspace.clearance, 0.0)
    body = Obstacle("the arm in its guide tube", PlaneShape(shapely.LineString(ends), rounding))
    return replace(problem.workspace, obstacles=(*problem.workspace.obstacles, body))


def part_of(arm: Arm, first: int, feed: float) -> Arm:
    """The arm from one of its joints on, its base fixed where that joint is at some feed."""

    def of_joints(values: FloatArray | float) -> FloatArray | float:
        return values[3 * first :] if isinstance(values, np.ndarray) and values.ndim else values

    return replace(
        arm,
        links=arm.links - first,
        base=arm.base + (feed + first * arm.link_length) * arm.direction,
        base_limit=arm.base_limit if first == 0 else arm.joint_limit,
        mount_length=max(arm.mount_length - first * arm.link_length, 0.0),
        masses=arm.masses[first:],
        inertia_axial=arm.inertia_axial[first:],
        inertia_transverse=arm.inertia_transverse[first:],
        rotor_inertia=of_joints(arm.rotor_inertia),
        friction=of_joints(arm.friction),
        feed=None,
    )


_DRAWN_BACK_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of the way that it takes to draw both ends back onto the axis, from which the arm is led straight to the goal's path,
in the order in which they are tried. Taste."""


@dataclass(frozen=True)
class StraightenedEnd:
    """An end that bends too near to the hole, and a pose like it that does not.

    Attributes:
        keyframes: from the end to that pose, shape (K, links + 1) [rad, m].
        pose: the pose that the motion goes on from.
    """

    keyframes: FloatArray
    pose: JointPose


@dataclass(frozen=True)
class ProposedMotion:
    """Keyframes from start to goal that nobody has certified yet, and what they came from.

    Attributes:
        keyframes: bends and feed, shape (K, links + 1) [rad, m].
        leaders: paths followed, each of shape (m, 2) [m]; none when the arm does not follow all the way.
        name: of the tactic.
        draws_back: whether the arm is drawn back first as far as it came.
    """

    keyframes: FloatArray
    leaders: tuple[FloatArray, ...]
    name: str
    draws_back: bool = False

    def between(self, start: StraightenedEnd, goal: StraightenedEnd | None = None) -> "ProposedMotion":
        """The motion with what straightens its ends before and after it."""
        pieces = [start.keyframes, self.keyframes]
        straightens = len(start.keyframes) > 1
        if goal is not None:
            pieces.append(goal.keyframes[::-1])
            straightens = straightens or len(goal.keyframes) > 1
        keyframes = joined_keyframes(*pieces)
        if straightens:
            return ProposedMotion(keyframes, (), f"straighten, {self.name}")
        return ProposedMotion(keyframes, self.leaders, self.name)


def pinned(query: FeedQuery, keyframes: FloatArray) -> FloatArray:
    """Keyframes whose ends are the start, and the goal of the whole arm when there is one, without rounding."""
    pinned = keyframes.copy()
    pinned[0] = query.start.configuration(query.arm)
    if query.goal is not None:
        pinned[-1] = query.goal.configuration(query.arm)
    return pinned


def straight_to_goal(query: FeedQuery, task: MotionTask) -> Iterator[ProposedMotion]:
    """Motions straight to the goal of the whole arm, wherever the ends bend."""
    if query.goal is None:
        return
    start = query.start.configuration(query.arm)
    keyframes = led_between(start, query.goal.configuration(query.arm), task)
    if keyframes is not None:
        yield ProposedMotion(keyframes, (), "straight")


def drawn_back_a_little(query: FeedQuery, path: LeaderPath, task: MotionTask) -> Iterator[ProposedMotion]:
    """Motions to the end of a path, drawn back along the start's path as far as need be, and in along the other."""
    end = query.end_on(path)
    if end is None:
        return
    arm = query.arm
    for share in _DRAWN_BACK_SHARES:
        ways = _drawn_back(query, path, end, share)
        if ways is None:
            continue
        there = slide(arm, ways[0], query.start.feed, ways[1]) if ways[0] is not None else _start(query)
        onward = slide(arm, path, ways[2], end)
        between = led_between(there[-1], onward[0], task)
        if between is not None:
            keyframes = joined_keyframes(there, between, onward)
            name = "straight" if share == 0.0 else f"drawn back by {100 * share:.0f} % of the way"
            yield ProposedMotion(pinned(query, keyframes), (), f"{name}, {path.name}")
            return


def led_between(start: FloatArray, end: FloatArray, task: MotionTask) -> FloatArray | None:
    """Keyframes from one configuration straight to another, shape (K, c); None when the arm cannot be led there.

    Args:
        start: shape (c,) [rad, m].
        end: likewise.
        task: of the whole motion, with the limits to keep on the way.
    """
    arm = task.arm
    pose = arm.poses(end)
    goal = GoalPose(arm.points(pose)[-1], unit_vector(pose[arm.links - 1]))
    asked = replace(task, start=arm.poses(start), goal=goal, goal_pose=pose)
    for links in task.settings.search.margins:
        run = PlanarRun.from_task(asked, links)
        motion = run.run(run.direct(), [])
        if motion is not None:
            return np.vstack((start, arm.configurations(motion.configurations[1:-1]), end))
    return None


def _start(query: FeedQuery) -> FloatArray:
    return query.start.configuration(query.arm)[None]


def _drawn_back(
    query: FeedQuery, path: LeaderPath, end: float, share: float
) -> tuple[LeaderPath | None, float, float] | None:
    """The start's path, and the feeds to which both ends are drawn back [m]; None where the start cannot be."""
    if share == 0.0:
        return None, query.start.feed, end
    if query.start_path is None:
        return None
    low = query.feed.low
    back_from_start = max(min(query.fully_drawn_back(query.start_path), query.start.feed), low)
    back_from_end = max(min(query.fully_drawn_back(path), end), low)
    return (
        query.start_path,
        query.start.feed - share * (query.start.feed - back_from_start),
        end - share * (end - back_from_end),
    )
