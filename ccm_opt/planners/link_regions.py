"""A convex free region about every link of a pose: what the goal-pose NLP keeps each link in."""

import numpy as np
from scipy.spatial import ConvexHull

from ccm_opt.collision.neighbour_pairs import closest_on_segments
from ccm_opt.freespace.wall_segments import WallSegments
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.rounding import TINY
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.limits.sweep_regions import sweep_regions
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.swept_motion import Sweep
from ccm_opt.nlp.arm_pose.pose_settings import PoseSettings
from ccm_opt.nlp.arm_pose.pose_task import LinkRegions

Sides = tuple[IntArray, FloatArray, FloatArray]
"""Link, outward normal and offset of every side, shapes (m,), (m, 2), (m,)."""


def link_regions(
    arm: Arm,
    workspace: Workspace,
    headings: FloatArray,
    settings: PoseSettings,
    walls: WallSegments | None = None,
) -> LinkRegions:
    """Half-planes between every link of a pose and the walls, and between links that must be kept apart.

    Between a link and a wall the side touches the wall; between two links it lies half-way, and both get one. A pose
    whose links all keep to their regions touches nothing. Sides that others imply are left out: most of those between
    links, and every row that is left makes every iteration dearer. Of what is left a link gets the nearest sides, as
    many as the settings say.

    Args:
        arm: the arm.
        workspace: the room.
        headings: of the links, shape (links,) [rad].
        settings: how far away walls and links make sides, and numbers of sides that programs are built for.
        walls: of the room, when they are known already.
    """
    walls = workspace.wall_segments if walls is None else walls
    reach = settings.reach * arm.length
    parts = [_wall_sides(arm, walls, workspace.clearance, headings, reach)]
    if arm.self_collision:
        parts.append(_link_sides(arm, headings, reach))
    sides = _needed(arm, headings, _beyond_mount(arm, _joined(parts)), reach)
    sides = _nearest(arm, headings, sides, settings.most_sides)
    return _padded(arm, *sides, settings.region_sizes)


def _wall_sides(arm: Arm, walls: WallSegments, clearance: float, headings: FloatArray, reach: float) -> Sides:
    """Sides before the walls, as the optimisation of motions draws them about a motion that stands still."""
    space, coordinates = LinkSpace.through(arm, headings)
    resting = Sweep(space, np.stack((coordinates, coordinates)))
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
    free = (link + 1) * arm.link_length > arm.mount_length
    return link[free], normal[free], offset[free]


def _needed(arm: Arm, headings: FloatArray, sides: Sides, reach: float) -> Sides:
    """The sides without which a region would be larger, as far as it lies within reach of its link.

    By duality: of half-planes n · x ≤ d with d > 0 those are needed whose n / d are corners of the hull of all n / d.
    """
    link, normal, offset = sides
    points = arm.joint_positions(headings)
    middles = 0.5 * (points[1:] + points[:-1])
    behind = offset - np.einsum("md,md->m", normal, middles[link])
    # Beyond this box there may be walls that no side was made for: what a region is there says nothing.
    box = np.vstack((np.eye(2), -np.eye(2))) / (reach + arm.link_length)
    needed = np.zeros(len(link), dtype=bool)
    for each in np.unique(link):
        of_link = np.flatnonzero(link == each)
        if behind[of_link].min() <= TINY:  # the link stands outside its region: all sides count
            needed[of_link] = True
            continue
        corners = ConvexHull(np.vstack((normal[of_link] / behind[of_link, None], box))).vertices
        needed[of_link[corners[corners < len(of_link)]]] = True
    return link[needed], normal[needed], offset[needed]


def _nearest(arm: Arm, headings: FloatArray, sides: Sides, most: int) -> Sides:
    """The sides that every link is nearest to with one of its ends, at most so many for a link."""
    link, normal, offset = sides
    points = arm.joint_positions(headings)
    ends = np.stack((points[link], points[link + 1]), axis=1)
    inside = offset - np.max(np.einsum("med,md->me", ends, normal), axis=1)
    order = np.lexsort((inside, link))
    place = np.empty(len(link), dtype=np.intp)
    place[order] = _places(link[order])
    kept = place < most
    return link[kept], normal[kept], offset[kept]


def _places(link: IntArray) -> IntArray:
    """The number of each entry among those of its link, which stand together, shape (m,)."""
    count = np.bincount(link)
    return np.arange(len(link)) - np.repeat(np.cumsum(count) - count, count)


def _padded(arm: Arm, link: IntArray, normal: FloatArray, offset: FloatArray, sizes: tuple[int, ...]) -> LinkRegions:
    """The sides in one array for each link, filled up with sides that say nothing."""
    count = np.bincount(link, minlength=arm.links)
    most = int(count.max(initial=1))
    sides = next((size for size in sizes if size >= most), most)
    normals = np.zeros((arm.links, sides, 2))
    offsets = np.full((arm.links, sides), 2.0 * arm.length)
    order = np.argsort(link, kind="stable")
    place = _places(link[order])
    normals[link[order], place] = normal[order]
    offsets[link[order], place] = offset[order]
    return LinkRegions(normals, offsets)
