"""An arm whose last links are its tool, with which planning and diagnosis need no tools of their own.

A tool becomes further links beyond the last, whose joints are locked: a polyline along the axes of the tool's capsules,
which ends at the tool's tip, in the tool's direction. Each of these *tool links* has a constant rotation relative to
the link before it. Parts of the polyline between capsules are *bare*: they have no body. So goals, distances,
certificates and trees apply to tools as they are.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.polyline import wrap
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.robot.tool import Tool, ToolLinks
from ccm_opt.scene.distances.enclosures import segment_distances

_END = 0.1
"""Length of the last tool link where the tool points another way than its polyline arrives, in mean link lengths.
Heuristic."""
_BALL = 1e-3
"""Length of the axis that a ball gets, in mean link lengths. Heuristic."""
_TOGETHER = 1e-6
"""Distance of points that count as one, in mean link lengths. Derived: far below the tolerance of contact."""
_TURNED = 1e-9
"""Largest 1 - cos of the angle between directions that count as equal. Derived: rounding."""
_APART_AT_REST = 0.05
"""Gap between a body of the tool and a link of the straight arm above which the two are kept apart, as a fraction of
the sum of their radii. Heuristic: bodies that are nearer to each other are neighbours around a bend."""
_MASSLESS = 1e-9
"""Mass and moments of inertia of a tool link [kg, kg m²]: hardly any, since dynamics take the tool itself."""


def tool_line(tool: Tool, unit: float) -> tuple[FloatArray, FloatArray]:
    """Return the polyline that runs along the bodies of a tool, from the end of the last link to the tool's tip.

    Args:
        tool: the tool.
        unit: mean length of the arm's links [m].

    Returns:
        Corners, beginning with the end of the link, shape (k + 1, d) [m], and the radius of each of the k parts, NaN
        for a bare part, shape (k,) [m].
    """
    corners = [np.zeros(len(tool.tip))]
    radii: list[float] = []

    def lead_to(place: FloatArray, radius: float = np.nan) -> None:
        if np.linalg.norm(place - corners[-1]) > _TOGETHER * unit:
            corners.append(place)
            radii.append(radius)

    for body in tool.bodies:
        start, end = body.start, body.end
        if np.linalg.norm(end - start) < _BALL * unit:
            half = 0.5 * _BALL * unit * tool.direction
            start, end = 0.5 * (start + end) - half, 0.5 * (start + end) + half
        if np.linalg.norm(end - corners[-1]) < np.linalg.norm(start - corners[-1]):
            start, end = end, start
        lead_to(start)
        lead_to(end, body.radius)
    last = tool.tip - corners[-1]
    arrives = last if np.linalg.norm(last) > _TOGETHER * unit else _last_direction(corners)
    if arrives @ tool.direction < (1.0 - _TURNED) * np.linalg.norm(arrives):
        lead_to(tool.tip - _END * unit * tool.direction)
    lead_to(tool.tip)
    return np.array(corners), np.array(radii)


def _last_direction(corners: list[FloatArray]) -> FloatArray:
    """Return the direction of the last part of a polyline, or of the link itself if there is none, shape (d,)."""
    return corners[-1] - corners[-2] if len(corners) > 1 else np.eye(len(corners[0]))[0]


def with_tool_links(arm: Arm) -> Arm:
    """Return an arm whose last links are its tool, or the arm itself if it has no tool.

    The tool links have no mass: dynamics are those of the arm with its tool.
    """
    tool = arm.tool
    if tool is None:
        return arm
    corners, thick = tool_line(tool, arm.link_length)
    count = len(thick)
    if count == 0:
        return replace(arm, tool=None)
    lengths = np.concatenate((arm.lengths, np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    radii = np.concatenate((arm.radii, np.nan_to_num(thick)))
    widest = float(np.max(radii))
    k = arm.bends_a_joint
    shares = np.ones(k * arm.links) if arm.proportions is None else arm.proportions.limits
    bare = np.concatenate((np.zeros(arm.links, dtype=bool), np.isnan(thick)))
    turns = _turns(np.diff(corners, axis=0))
    none = np.zeros(arm.links) if arm.dimension == 2 else np.broadcast_to(np.eye(3), (arm.links, 3, 3))
    mean = float(np.mean(lengths))
    return replace(
        arm,
        links=arm.links + count,
        link_length=mean,
        radius=widest,
        masses=np.append(arm.masses, np.full(count, _MASSLESS)),
        inertia_axial=np.append(arm.inertia_axial, np.full(count, _MASSLESS)),
        inertia_transverse=np.append(arm.inertia_transverse, np.full(count, _MASSLESS)),
        rotor_inertia=_with_still_drives(arm.rotor_inertia, count),
        friction=_with_still_drives(arm.friction, count),
        proportions=Proportions(lengths / mean, radii / (widest or 1.0), np.append(shares, np.zeros(k * count))),
        tool=None,
        tool_links=ToolLinks(
            count,
            np.concatenate((none, turns)),
            bare,
            _distant(arm, corners, thick),
            np.concatenate((arm.joint_places[:-1], _near_places(arm, corners))) / mean,
            tool.direction,
        ),
    )


def points_with_tool(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the positions of joints, tip and the corners of the tool's polyline, shape (..., links + k + 1, d) [m].

    Args:
        arm: the arm.
        q: configurations, shape (..., c) [rad, m].
    """
    points = arm.joint_positions_at(q)
    if arm.tool is None:
        return points
    corners, _ = tool_line(arm.tool, arm.link_length)
    frames = arm.link_rotations(q)[..., -1, :, :]
    beyond = np.einsum("...ij,kj->...ki", frames, corners[1:]) + points[..., -1:, :]
    return np.concatenate((points, beyond), axis=-2)


def drawn_radii(arm: Arm) -> FloatArray:
    """Return the radii of the links and the parts of the tool, 0 for bare parts, shape (links + k,) [m]."""
    if arm.tool is None:
        return arm.radii
    return np.concatenate((arm.radii, np.nan_to_num(tool_line(arm.tool, arm.link_length)[1])))


def _with_still_drives(values: FloatArray | float, count: int) -> FloatArray | float:
    """Return one number, or values per revolute, with zeros for the revolutes of ``count`` tool links."""
    return np.append(values, np.zeros(3 * count)) if isinstance(values, np.ndarray) and values.ndim else values


def _turns(parts: FloatArray) -> FloatArray:
    """Return the rotation of each part of a polyline relative to the part before it, the first to the link's frame.

    Args:
        parts: vectors along the k parts, shape (k, d) [m].

    Returns:
        Angles, shape (k,) [rad], in the plane; rotations without roll, shape (k, 3, 3), in space.
    """
    if parts.shape[1] == 2:
        headings = np.arctan2(parts[:, 1], parts[:, 0])
        return np.asarray(wrap(np.diff(headings, prepend=0.0)))
    frame = np.eye(3)
    found = []
    for part in parts:
        found.append(_rotation_of_x(frame.T @ part))
        frame = frame @ found[-1]
    return np.array(found)


def _rotation_of_x(along: FloatArray) -> FloatArray:
    """Return a rotation, shape (3, 3), that turns the x axis into the direction of a vector, shape (3,)."""
    x = along / np.linalg.norm(along)
    beside = np.eye(3)[2] if abs(x[2]) < abs(x[1]) else np.eye(3)[1]
    if x[0] > 0.0 and np.hypot(x[1], x[2]) < _TURNED:
        return np.eye(3)
    y = np.cross(np.cross(x, beside), x)
    y /= np.linalg.norm(y)
    return np.column_stack((x, y, np.cross(x, y)))


def rest_gaps(arm: Arm, starts: FloatArray, ends: FloatArray, radii: FloatArray) -> FloatArray:
    """Return the gaps between links of the straight arm and capsules in the frame of its last link, (links, k) [m].

    Args:
        arm: the arm.
        starts: starts of the axes of k capsules, shape (k, d) [m].
        ends: ends of the axes, shape (k, d) [m].
        radii: radii, shape (k,) [m].
    """
    ahead = np.eye(starts.shape[1])[0]
    places = -arm.places_from_tip[:, None] * ahead
    links, k = arm.links, len(starts)
    pairs = (np.repeat(places[:-1], k, axis=0), np.repeat(places[1:], k, axis=0))
    distances = segment_distances(*pairs, np.tile(starts, (links, 1)), np.tile(ends, (links, 1)))[2]
    return np.asarray(distances.reshape(links, k) - arm.radii[:, None] - radii)


def _near_places(arm: Arm, corners: FloatArray) -> FloatArray:
    """Return arc lengths of tool links and tip that give no link a greater distance than when the arm is straight.

    Args:
        arm: the arm.
        corners: polyline of the tool, shape (k + 1, d) [m].

    Returns:
        Shape (k + 1,) [m].
    """
    apart = rest_gaps(arm, corners[:-1], corners[1:], np.zeros(len(corners) - 1)) + arm.radii[:, None]
    nearest = np.min((arm.joint_places[1:, None] + apart)[: max(arm.links - 2, 1)], axis=0)
    return np.append(nearest, arm.length)


def _distant(arm: Arm, corners: FloatArray, thick: FloatArray) -> BoolArray:
    """Return a mask of the pairs of links i < j, tool links included, that could collide, (links + k, links + k).

    Links of the arm are compared as without a tool. Each but the last two is compared with all bodies of the tool that
    it is clear of when the arm is straight.

    Args:
        arm: the arm, with n links.
        corners: polyline of the tool, shape (k + 1, d) [m].
        thick: radius of each part, NaN for bare parts, shape (k,) [m].
    """
    count = arm.links + len(thick)
    distant = np.zeros((count, count), dtype=bool)
    distant[: arm.links, : arm.links] = arm.distant_links
    gaps = rest_gaps(arm, corners[:-1], corners[1:], thick)
    compared = slice(0, max(arm.links - 2, 0))
    distant[compared, arm.links :] = (gaps > _APART_AT_REST * (arm.radii[:, None] + thick))[compared]
    return distant


def colliding_at_rest(arm: Arm, tool: Tool) -> tuple[int, int] | None:
    """Return a link to which the straight arm's tool is too near to be compared with it later, and the body; or None.

    Both are counted from 0. The last two links are left out: contact of the tool with them is by design. A body on the
    last link may also touch others within two links and π times the greatest radius of arm from there.
    """
    if not tool.bodies:
        return None
    starts, ends = (np.array([getattr(body, name) for body in tool.bodies]) for name in ("start", "end"))
    thick = np.array([body.radius for body in tool.bodies])
    gaps = rest_gaps(arm, starts, ends, thick)
    ahead = np.eye(starts.shape[1])[:1]
    own = rest_gaps(arm, -float(arm.lengths[-1]) * ahead, 0.0 * ahead, arm.radii[-1:])
    between = arm.joint_places[-2] - arm.joint_places[1:]
    reach = np.pi * np.maximum(np.maximum.accumulate(arm.radii[::-1])[::-1, None], thick)
    far = (between[:, None] >= reach) & (np.arange(arm.links)[:, None] < arm.links - 3)
    # What is not clear of a link by this share is not compared with it, neither here nor by the verifier.
    touching = (gaps <= _APART_AT_REST * (arm.radii[:, None] + thick)) & ((own > 0.0) | far)
    touching[max(arm.links - 2, 0) :] = False
    found = np.argwhere(touching)
    return (int(found[0, 0]), int(found[0, 1])) if len(found) else None
