"""Lines of sight from tips to places on surfaces: whether they are free, and how far tips may move until they are not.

Places lie on surfaces, so that the end of a line of sight, next to the place, counts less; the verifier's own lines are
those of ``verification.sight``.
"""

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray, in_space
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.enclosures import enclosed, segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.scene.tool_links import points_with_tool, with_tool_links
from ccm_opt.scene.workspace import Workspace

HALF_ANGLE = float(np.deg2rad(1.0))
"""Half angle of the cone about the line of sight that views keep free [rad]. Derived: twice what is verified."""
AT_POSE = float(np.deg2rad(0.55))
"""Likewise of views at which the pose of the arm is known exactly. Derived: a tenth above what is verified."""
END = 0.01
"""Fraction of the cone about the line of sight, at the place, that is not kept free, since the place lies on a
surface."""
ROUNDED = 5e-5
"""Fraction of the line of sight itself, at the place, that does not count. Derived: half of what verifiers omit."""
ERRORS = 3.0
"""Length of the line of sight, at the place, within which a surface does not count, and distance from the place within
which the points of a scan are taken to be of the surface that it lies on, in multiples of the surface's error. Derived:
less than what verifiers leave out."""
_TOUCHING = 1e-9
"""Distance of the line of sight itself from a link that counts as contact, as a fraction of the line. Derived: far
above rounding."""
_PIECES_AT_END = 16
"""Number of pieces of the line of sight between the end of the cone and its own."""
PIECES = 48
"""Number of pieces of the line of sight; each piece is a tenth longer than the one before it."""


def hidden_by_arm(arm: Arm, q: FloatArray, places: FloatArray, half_angle: float = HALF_ANGLE) -> BoolArray:
    """Return which of m places an arm hides from its own tip, or the tip of its tool, shape (m,).

    Links and bodies of the tool that contain the tip carry the camera, and do not hide anything.

    Args:
        arm: the arm.
        q: configuration, shape (c,) [rad, m].
        places: the places that it looks at, shape (m, d) [m].
        half_angle: half angle of the cone about lines of sight that is kept free [rad].
    """
    points = points_with_tool(arm, q)
    whole = with_tool_links(arm)
    tip = points[-1]
    bare = np.zeros(whole.links, dtype=bool) if whole.tool_links is None else whole.tool_links.bare
    one, other = points[:-1][~bare], points[1:][~bare]
    radii = whole.radii[~bare]
    tips = np.broadcast_to(tip, one.shape)
    ahead = segment_distances(tips, tips, one, other)[2] > radii
    one, other, radii = one[ahead], other[ahead], radii[ahead]
    away = np.linalg.norm(places - tip, axis=1)
    # Links beyond the widest part of the cone about the whole line hide nothing.
    place, link = (index.ravel() for index in np.indices((len(places), len(one))))
    lines = np.broadcast_to(tip, (len(place), len(tip)))
    gaps = segment_distances(places[place], lines, one[link], other[link])[2] - radii[link]
    near = gaps <= away[place] * np.tan(half_angle)
    place, link = place[near], link[near]
    starts, ends, shares = line_pieces(places[place], np.broadcast_to(tip, (len(place), len(tip))))
    line = places[place, None] + np.array([ROUNDED, END])[:, None] * (tip - places[place])[:, None]
    starts, ends = (np.concatenate(both, axis=1) for both in ((line[:, :1], starts), (line[:, 1:], ends)))
    wide = np.append(_TOUCHING, shares * np.tan(half_angle)) * away[place, None]
    many = starts.shape[1]
    links = np.repeat(one[link], many, axis=0), np.repeat(other[link], many, axis=0)
    apart = segment_distances(starts.reshape(-1, len(tip)), ends.reshape(-1, len(tip)), *links)[2]
    hidden = np.zeros(len(places), dtype=bool)
    hidden[place[np.any(apart.reshape(-1, many) <= radii[link, None] + wide, axis=1)]] = True
    return hidden


def line_pieces(place: FloatArray, tips: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return starts and ends of the pieces of m lines of sight, shape (m, k, d), and their ends as fractions, (k,).

    Args:
        place: the place, shape (d,), or the place of each line, shape (m, d) [m].
        tips: tip positions, shape (m, d) [m].
    """
    shares = np.geomspace(END, 1.0, PIECES + 1)
    ends = np.broadcast_to(place, tips.shape)[:, None] + shares[:, None] * (tips - place)[:, None]
    return ends[:, :-1], ends[:, 1:], shares[1:]


def clear_tips(problem: Problem, tree: SurfaceTree, tips: FloatArray) -> BoolArray:
    """Return a mask of the tip positions (m, d) at which the tip keeps the required clearance, shape (m,)."""
    kept = problem.arm.tip_radius + problem.workspace.clearance
    clear = tree.distances(np.repeat(in_space(tips)[:, None], 2, axis=1), 2.0 * kept + 1e-9) >= kept
    inside = np.zeros(len(tips), dtype=bool)
    inside[enclosed(problem.workspace, tips, problem.arm.tip_radius)] = True
    return np.asarray(clear & ~inside)


def hiding_surfaces(workspace: Workspace, place: FloatArray) -> TriangleSoup:
    """Return the surfaces that may hide a place (d,): all but points of scans that the surface there may have given."""
    soup = workspace.triangle_soup
    scanned = np.all(soup.triangles == soup.triangles[:, :1], axis=(1, 2))
    near = (
        np.linalg.norm(soup.triangles[:, 0] - in_space(place), axis=1) < ERRORS * workspace.surface_errors[soup.owner]
    )
    kept = ~(scanned & near)
    if np.all(kept):
        return soup
    return TriangleSoup(soup.triangles[kept], soup.rounding[kept], soup.owner[kept], soup.names)


def crossed(tree: SurfaceTree, place: FloatArray, tips: FloatArray) -> BoolArray:
    """Return a mask of the tip positions (m, d) whose lines of sight cross a surface but at the place, shape (m,)."""
    lines = np.stack((in_space(place + END * (tips - place)), in_space(tips)), axis=1)
    return np.asarray(tree.distances(lines, 1e-9) <= 0.0)


def sight_room(
    tree: SurfaceTree, place: FloatArray, tips: FloatArray, most: float, half_angle: float = HALF_ANGLE
) -> tuple[FloatArray, IntArray]:
    """Return the radii of balls about tip positions from all of whose points a place is seen, with the thin cone.

    A tip displaced by r displaces the point at a fraction s of the line of sight, from the place, by s r.

    Args:
        tree: distances from the obstacles.
        place: the place, shape (d,), or the place of each line, shape (m, d) [m].
        tips: tip positions, shape (m, d) [m].
        most: radius above which more does not matter [m].
        half_angle: half angle of the cone about lines of sight that is kept free [rad].

    Returns:
        Radii, negative where the place is hidden, shape (m,) [m], and the piece of each line with the least, (m,).
    """
    if len(tips) == 0:
        return np.zeros(0), np.zeros(0, dtype=np.intp)
    starts, ends, shares = line_pieces(place, tips)
    cone = np.linalg.norm(tips - place, axis=1) * np.tan(half_angle)
    reach = most + float(np.max(cone))
    segments = np.stack((in_space(starts), in_space(ends)), axis=2).reshape(-1, 2, 3)
    gaps = tree.distances(segments, reach).reshape(len(tips), -1)
    rooms = gaps / shares - cone[:, None]
    return np.min(rooms, axis=1), np.argmin(rooms, axis=1)


def room_at_end(
    soup: TriangleSoup, errors: FloatArray, place: FloatArray, tips: FloatArray, most: float
) -> tuple[FloatArray, IntArray]:
    """Return the rooms of lines of sight, without a cone, next to the place, and the obstacle that limits each.

    Rooms and the other arguments are those of ``sight_room``; the end counts up to a rounding of the place, and for
    surfaces with errors up to a few times these.

    Args:
        soup: surfaces that may hide the place.
        errors: how far the true surface of each of their owners may be from it [m].
        place: the place, shape (d,) [m].
        tips: tip positions, shape (m, d) [m].
        most: radius above which more does not matter [m].
    """
    rooms, limiting = np.full(len(tips), np.inf), np.zeros(len(tips), dtype=np.intp)
    if len(tips) == 0:
        return rooms, limiting
    away = np.linalg.norm(tips - place, axis=1)
    middle, reach = in_space(place), END * (float(np.max(away)) + most) + soup.rounding[:, None]
    near = np.all(
        (soup.triangles.min(axis=1) <= middle + reach) & (soup.triangles.max(axis=1) >= middle - reach), axis=1
    )
    for owner in np.unique(soup.owner[near]):
        mine = np.flatnonzero(near & (soup.owner == owner))
        part = TriangleSoup(soup.triangles[mine], soup.rounding[mine], soup.owner[mine], soup.names)
        first = np.clip(ERRORS * float(errors[owner]) / away, ROUNDED, END)
        shares = np.geomspace(first, END, _PIECES_AT_END + 1, axis=1)
        ends = place + shares[:, :, None] * (tips - place)[:, None]
        segments = np.stack((in_space(ends[:, :-1]), in_space(ends[:, 1:])), axis=2).reshape(-1, 2, 3)
        gaps = SurfaceTree.from_triangles(part).distances(segments, END * most + 1e-9).reshape(len(tips), -1)
        # A line that touches is hidden.
        room = np.min(np.where(gaps > 0.0, gaps / shares[:, 1:], -1.0), axis=1)
        limiting[room < rooms] = owner
        rooms = np.minimum(rooms, room)
    return rooms, limiting


def end_room(tree: SurfaceTree, places: FloatArray, tips: FloatArray, blind: FloatArray, most: float) -> FloatArray:
    """Return the rooms of lines of sight, without a cone, next to their places, all surfaces alike, shape (m,) [m].

    Args:
        tree: distances from the obstacles.
        places: the place of each line, shape (m, d) [m].
        tips: tip positions, shape (m, d) [m].
        blind: length next to each place within which surfaces do not count, shape (m,) [m].
        most: radius above which more does not matter [m].
    """
    if len(tips) == 0:
        return np.zeros(0)
    first = np.clip(blind / np.linalg.norm(tips - places, axis=1), ROUNDED, 0.99 * END)
    shares = np.geomspace(first, END, _PIECES_AT_END + 1, axis=1)
    ends = places[:, None] + shares[:, :, None] * (tips - places)[:, None]
    segments = np.stack((in_space(ends[:, :-1]), in_space(ends[:, 1:])), axis=2).reshape(-1, 2, 3)
    gaps = tree.distances(segments, END * most + 1e-9).reshape(len(tips), -1)
    return np.asarray(np.min(np.where(gaps > 0.0, gaps / shares[:, 1:], -1.0), axis=1))
