"""A convex free region about every joint of a pose: what the goal-pose NLP keeps both ends of each link in."""

import numpy as np
from scipy.spatial import ConvexHull

from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.pose_task import JointRegions, held_points
from ccm_opt.planning.limits.clearance_rows import sweep_regions
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.contact_finder import closest_on_segments
from ccm_opt.scene.walls import WallSegments
from ccm_opt.scene.workspace import Workspace

Sides = tuple[IntArray, FloatArray, FloatArray]
"""Link or joint, outward normal and offset of every side, shapes (m,), (m, 2), (m,)."""


def joint_regions(
    arm: Arm,
    workspace: Workspace,
    headings: FloatArray,
    settings: PoseSettings,
    walls: WallSegments | None = None,
) -> JointRegions:
    """Half-planes between every link of a pose and the walls, and between links that must be kept apart.

    Between a link and a wall the side touches the wall; between two links it lies half-way, and both get one. A pose
    whose links all keep to their regions touches nothing. A joint is an end of two links: it has the sides of both.
    Sides that others imply are left out: most of those between links, and of what neighbouring links share; every row
    that is left makes every iteration dearer. Of what is left a joint gets the nearest sides, as many as the settings
    say.

    Args:
        arm: the arm.
        workspace: the room.
        headings: of the links, shape (links,) [rad].
        settings: how far away walls and links make sides, and how many.
        walls: of the room, when they are known already.
    """
    walls = workspace.wall_segments if walls is None else walls
    reach = settings.reach * arm.length
    parts = [_wall_sides(arm, walls, workspace.clearance, headings, reach)]
    if arm.self_collision:
        parts.append(_link_sides(arm, headings, reach))
    sides = _of_joints(_beyond_mount(arm, _joined(parts)))
    places = held_points(arm.free_shares, arm.joint_positions(headings))
    sides = _needed(places, sides, reach + arm.link_length)
    joint, normal, offset = _nearest(places, sides, settings.most_sides)
    return JointRegions(joint, -normal, -offset, np.ones(len(joint)))


def _wall_sides(arm: Arm, walls: WallSegments, clearance: float, headings: FloatArray, reach: float) -> Sides:
    """Sides before the walls, as the optimisation of motions draws them about a motion that stands still."""
    space, coordinates = LinkSpace.through(arm, arm.bends(headings))
    resting = PlanarSweep(space, np.stack((coordinates, coordinates)))
    found = sweep_regions(resting, walls, 0, reach)
    return found.link, found.normal, found.bound - arm.radius - clearance - arm.room_for_errors(found.link + 1)


def _link_sides(arm: Arm, headings: FloatArray, reach: float) -> Sides:
    """Sides half-way between links that must be kept apart, for both of them."""
    points = arm.joint_positions(headings)
    first, second = np.triu_indices(arm.links, arm.first_self_pair)
    at_first, at_second, apart = closest_on_segments(
        points[first], points[first + 1], points[second], points[second + 1]
    )
    distance = np.hypot(apart[:, 0], apart[:, 1])
    near = (distance > TINY) & (distance < reach)
    first = first[near]
    second = second[near]
    on_first = points[first] + at_first[near, None] * (points[first + 1] - points[first])
    on_second = points[second] + at_second[near, None] * (points[second + 1] - points[second])
    towards = -apart[near] / distance[near, None]
    half_way = np.einsum("md,md->m", towards, 0.5 * (on_first + on_second))
    links = np.concatenate((first, second))
    normals = np.concatenate((towards, -towards))
    room = arm.room_for_errors(second - first)
    offsets = np.concatenate((half_way, -half_way)) - arm.radius - 0.5 * np.tile(room, 2)
    return links, normals, offsets


def _joined(parts: list[Sides]) -> Sides:
    link, normal, offset = (np.concatenate(column) for column in zip(*parts, strict=True))
    return link, normal, offset


def _beyond_mount(arm: Arm, sides: Sides) -> Sides:
    """The sides of links that do not belong to the mount altogether, which may lie anywhere."""
    link, normal, offset = sides
    free = arm.free_shares[link] < 1.0
    return link[free], normal[free], offset[free]


def _of_joints(sides: Sides) -> Sides:
    """The sides of links as sides of both their ends, by the number of the joint; that of the tip is the last."""
    link, normal, offset = sides
    return np.concatenate((link, link + 1)), np.tile(normal, (2, 1)), np.tile(offset, 2)


def _needed(places: FloatArray, sides: Sides, reach: float) -> Sides:
    """The sides without which a region would be larger, as far as it lies within reach of its joint.

    By duality: of half-planes n · x ≤ d with d > 0 those are needed whose n / d are corners of the hull of all n / d.

    Args:
        places: of the joints, shape (links + 1, 2) [m].
        sides: by joint.
        reach: half the width of the box about each joint that counts [m].
    """
    joint, normal, offset = sides
    behind = offset - np.einsum("md,md->m", normal, places[joint])
    # Beyond this box there may be walls that no side was made for: what a region is there says nothing.
    box = np.vstack((np.eye(2), -np.eye(2))) / reach
    needed = np.zeros(len(joint), dtype=bool)
    for each in np.unique(joint):
        of_joint = np.flatnonzero(joint == each)
        if behind[of_joint].min() <= TINY:  # the joint stands outside its region: all sides count
            needed[of_joint] = True
            continue
        corners = ConvexHull(np.vstack((normal[of_joint] / behind[of_joint, None], box))).vertices
        needed[of_joint[corners[corners < len(of_joint)]]] = True
    return joint[needed], normal[needed], offset[needed]


def _nearest(places: FloatArray, sides: Sides, most: int) -> Sides:
    """The sides that every joint is nearest to, at most so many for a joint; arguments as of ``_needed``."""
    joint, normal, offset = sides
    inside = offset - np.einsum("md,md->m", normal, places[joint])
    order = np.lexsort((inside, joint))
    in_order = joint[order]
    kept = order[np.arange(len(order)) - np.searchsorted(in_order, in_order) < most]
    return joint[kept], normal[kept], offset[kept]
