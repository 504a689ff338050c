"""Ends that are refused, and the clearance at samples."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray, IntArray
from ccm_opt.core.length_words import place, short_length
from ccm_opt.errors import Diagnosis, ProblemError, UnreachableGoal
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.space_certificate import LinkMotion
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.problem import Problem
from ccm_opt.scene.distances.enclosures import Enclosure, deepest_enclosure, ways_out
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import ROOM_NAME


def refuse_ends(problem: Problem, task: SpaceTask) -> None:
    """Refuse a start, or a goal of the whole arm, in contact, and a goal that is out of reach.

    Raises:
        ProblemError: the start touches something, or breaks a constraint of the user.
        UnreachableGoal: the goal does, or is too far away.
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
    if task.goal is not None:
        refuse_goal(problem, task, task.goal)


def refuse_goal(problem: Problem, task: SpaceTask, goal: GoalPose) -> None:
    """Refuse a goal for the tip that leaves it no room, or that is out of reach.

    Raises:
        UnreachableGoal: saying which, and by how much.
    """
    _refuse_goal_without_room(problem, task, goal)
    _refuse_far_goal(task, goal)


def _what_is_bad(problem: Problem, task: SpaceTask, q: FloatArray, motion: str) -> str:
    """Whether an end is in contact or has no room for a motion, in words; empty where neither."""
    contact = contact_words(problem, task, q)
    if contact:
        return f"is in contact: {contact}"
    near = contact_of(task, q, 2.0 * task.least_spare)
    return f"has no room: {near} for a motion {motion} that can be proved" if near else ""


def contact_words(problem: Problem, task: SpaceTask, q: FloatArray) -> str:
    """What a configuration touches and how deep it is inside of bodies, in words; empty where it is free."""
    contact = contact_of(task, q)
    joints = task.arm.joint_positions_at(q)
    _, exposed = task.arm.exposed_links(joints)
    # An arm that touches nothing is inside of a closed body as a whole; of an open one both its ends tell.
    first = int(np.ceil(task.arm.mount_length / task.arm.link_length)) if contact else task.arm.links
    found = deepest_enclosure(problem.workspace, np.concatenate((joints[first:], exposed[:1, 0])))
    if found is None:
        return contact
    number = first + found.number
    point = "the tip" if number == task.arm.links else f"joint {number + 1}"
    point = "the end of the mount" if number > task.arm.links else point
    deep = f"{point} is {_depth_words(found)}"
    ways = ways_out(problem.workspace, found.name, "the arm")[1:] if found.name else ()
    return "; ".join((*([contact] if contact else []), deep, *ways))


def _depth_words(found: Enclosure) -> str:
    where = f"deep inside of '{found.name}'" if found.name else f"outside of the {ROOM_NAME}"
    return f"{short_length(found.depth)} {where}, at {place(found.place)}"


def _refuse_goal_without_room(problem: Problem, task: SpaceTask, goal: GoalPose) -> None:
    """Refuse a goal for the tip inside of a body, or nearer to a surface than the arm may come."""
    found = deepest_enclosure(problem.workspace, goal.position[None])
    if found is not None:
        reason = f"the goal is {_depth_words(found)}"
        ways = ways_out(problem.workspace, found.name, "the goal") if found.name else ("move the goal into it",)
        raise UnreachableGoal(Diagnosis(reason, "necessary checks", ways))
    kept = task.arm.radius + task.clearance
    # Any place within the tolerance will do for a goal.
    least = kept - problem.tolerances.position
    near = task.tree.nearest(np.stack((goal.position, goal.position))[None], kept)
    if near.owner[0] >= 0 and near.gap[0] < least:
        missing = short_length(kept - float(near.gap[0]))
        name = task.names[near.owner[0]]
        reason = f"the goal leaves the tip no room: it is {missing} too near to '{name}' at {place(near.point[0])}"
        raise UnreachableGoal(
            Diagnosis(reason, "necessary checks", ("move the goal away from it", "use a thinner arm"))
        )


def contact_of(task: SpaceTask, q: FloatArray, beyond: float = 0.0) -> str:
    """What a configuration touches, or is nearer to than so much beyond contact [m], in words; empty where nothing."""
    arm = task.arm
    points = arm.joint_positions_at(q)
    first, segments = arm.exposed_links(points)
    if len(segments):
        kept = arm.radius + task.clearance + beyond
        near = task.tree.nearest(segments, kept + arm.link_length)
        k = int(np.argmin(near.gap))
        if near.gap[k] < kept - ROUNDING:
            missing = short_length(kept - float(near.gap[k]))
            return (
                f"link {first + k + 1} and '{task.names[near.owner[k]]}' at {place(near.point[k])}, {missing} too near"
            )
    if arm.self_collision:
        kept = 2.0 * arm.radius + beyond
        nearest = task.certificate.motion.nearest_pairs(points[None], kept)
        if nearest.first[0] >= 0:
            missing = short_length(kept - float(nearest.distance[0]))
            return f"link {nearest.first[0] + 1} and link {nearest.second[0] + 1}, {missing} too near"
    return ""


def _refuse_far_goal(task: SpaceTask, goal: GoalPose) -> None:
    """Refuse a goal that no stretched arm reaches."""
    arm = task.arm
    low, high = arm.base_range
    along = float(np.clip((goal.position - arm.base) @ arm.direction, low, high))
    base = arm.base + along * arm.direction if arm.base_axes else arm.base
    distance = float(np.linalg.norm(goal.position - base))
    if distance > arm.length:
        missing = short_length(distance - arm.length)
        reason = f"the goal is out of reach: {missing} farther from the base than the arm is long"
        raise UnreachableGoal(Diagnosis(reason, "necessary checks", ("move the goal nearer", "use a longer arm")))


@dataclass(frozen=True, eq=False)
class NearestOfSamples:
    """The least gap of every sample, and where it is.

    Attributes:
        gap: between the surfaces; the reach where nothing is nearer, shape (T,) [m].
        link: from 1; 0 where nothing is near, shape (T,).
        other: number of the surface's owner, or of the other link from 1, shape (T,).
    """

    gap: FloatArray
    link: IntArray
    other: IntArray


@dataclass(frozen=True, eq=False)
class GapsAtSamples:
    """Gaps between bare surfaces, without clearance.

    Attributes:
        walls: to the nearest surface of the scene.
        itself: between links that may not meet.
        names: of the owners of surfaces.
        reach: beyond which gaps to walls are not told apart [m].
    """

    walls: NearestOfSamples
    itself: NearestOfSamples
    names: tuple[str, ...]
    reach: float

    @classmethod
    def of(
        cls, problem: Problem, points: FloatArray, reach: float | None = None, own_reach: float | None = None
    ) -> "GapsAtSamples":
        """The gaps of poses.

        Args:
            problem: surfaces and arm.
            points: joints and tip of every pose, shape (T, links + 1, 3) [m].
            reach: how far is looked; a link's length when None [m].
            own_reach: how far is looked for other links; as far as for walls when None [m].
        """
        arm = problem.arm
        soup = problem.workspace.soup
        far = arm.link_length if reach is None else reach
        walls = _walls(problem, SurfaceTree.of(soup), points, far)
        return cls(walls, _itself(problem, points, far if own_reach is None else own_reach), soup.names, far)

    def other(self, near: NearestOfSamples, sample: int) -> str:
        """What a link is near to in a sample, in words."""
        number = int(near.other[sample])
        return f"'{self.names[number]}'" if near is self.walls else f"link {number}"


def _walls(problem: Problem, tree: SurfaceTree, points: FloatArray, reach: float) -> NearestOfSamples:
    arm = problem.arm
    link, exposed = arm.exposed_links(points)
    count = len(points)
    if link == arm.links or len(problem.workspace.soup) == 0:
        return _nothing(count, reach)
    found = tree.nearest(exposed.reshape(-1, 2, 3), reach + arm.radius, together=exposed.shape[1])
    gap = found.gap.reshape(count, -1) - arm.radius
    best = np.argmin(gap, axis=1)
    rows = np.arange(count)
    owner = found.owner.reshape(count, -1)[rows, best]
    return NearestOfSamples(gap[rows, best], np.where(owner >= 0, link + best + 1, 0), owner)


def _itself(problem: Problem, points: FloatArray, reach: float) -> NearestOfSamples:
    arm = problem.arm
    if not arm.self_collision:
        return _nothing(len(points), reach)
    nearest = LinkMotion(arm).nearest_pairs(points, reach + 2.0 * arm.radius)
    found = nearest.first >= 0
    gap = np.where(found, nearest.distance - 2.0 * arm.radius, reach)
    return NearestOfSamples(gap, nearest.first + 1, np.where(found, nearest.second + 1, -1))


def _nothing(count: int, reach: float) -> NearestOfSamples:
    return NearestOfSamples(np.full(count, reach), np.zeros(count, dtype=np.intp), np.full(count, -1, dtype=np.intp))
