"""Rejection of poses that exceed joint limits or are in contact, with advice on how to correct them."""

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, UnreachableGoal
from ccm_opt.core.length_words import place, short_length
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.certificate import Certificate, allowed_contact
from ccm_opt.scene.contact_finder import DEFAULT_CERTIFICATE, WallFinder
from ccm_opt.scene.workspace import Workspace


def clearance_advice(
    radius: float, clearance: float, lacking: float = 0.0, *, key: str = "arm.radius"
) -> tuple[str, ...]:
    """Return advice to reduce the radius, the clearance or either, so that the arm needs less space.

    Only values larger than ``lacking`` are named; the result is empty if neither is.

    Args:
        radius: radius of the arm [m].
        clearance: required clearance [m].
        lacking: length by which radius plus clearance is known to be too large [m]; 0 if unknown.
        key: key of the radius.
    """
    keys = []
    if radius > lacking:
        keys.append(key)
    if clearance > lacking:
        keys.append("workspace.clearance")
    how = f" by {short_length(lacking)}" if lacking > 0.0 else " (not tried)"
    return (f"reduce {' or '.join(keys)}{how}",) if keys else ()


AT_LIMIT = 0.99
"""Fraction of its limit from which on a joint counts as being at the limit. Heuristic."""
MOST_NAMED = 6
"""Largest number of joints that a message lists one by one. Heuristic."""


def joints_at_limits(arm: Arm, bends: FloatArray) -> tuple[str, tuple[str, ...]]:
    """Return text that names the joints of a pose that are at their limits, and advice; both empty if there are none.

    Args:
        arm: the arm.
        bends: bends of each joint, shape (links,), or in space (links, 2) [rad].
    """
    bent = np.abs(bends.reshape(len(bends), -1))
    allowed = arm.bend_limits.reshape(bent.shape)
    # A locked joint is at its limit in all poses.
    held = np.flatnonzero(((bent >= AT_LIMIT * allowed) & (allowed > 0.0)).any(axis=1))
    if len(held) == 0:
        return "", ()
    named = [str(arm.link_number(joint)) for joint in held[:MOST_NAMED]]
    rest = f"{len(held) - MOST_NAMED} more" if len(held) > MOST_NAMED else named.pop()
    which = f"joints {', '.join(named)} and {rest}" if named else f"joint {rest}"
    limit = float(np.rad2deg(allowed[held[-1]].max()))
    words = f"{which} at the limit of {limit:.4g}°"
    limited = (("arm.base_limit_deg", held == 0), (arm.key("joint_limit_deg"), held > 0))
    keys = [key for key, joints in limited if joints.any()]
    are = "is" if len(held) == 1 else "are"
    return words, tuple(f"raise {key} (not tried): {which} {are} at it where the best attempt ended" for key in keys)


def refuse_bad_pose(arm: Arm, workspace: Workspace, q: FloatArray, which: str, reach: float = 0.02) -> float:
    """Return the least gap between an arm and its surroundings in a pose [m]; raise an error for a forbidden pose.

    The gap is less the required clearance, and infinite if nothing is within the search distance.

    Args:
        arm: the arm.
        workspace: a planar workspace.
        q: configuration, shape (c,) [rad, m].
        which: name of the pose in messages.
        reach: distance, as a fraction of the arm's length, within which obstacles are checked.

    Raises:
        UnreachableGoal: the pose exceeds a joint limit or is in contact; the message names joint or link and obstacle.
    """
    _refuse_sharp_bends(arm, q[: arm.links], which)
    points = arm.joint_positions_at(q)
    # Walls farther away can neither be touched nor contain the arm.
    farthest = arm.radius + workspace.clearance + reach * arm.length
    workspace = workspace.near(shapely.LineString(points), farthest)
    finder = WallFinder(arm, workspace.flat_walls, workspace.clearance, 0.0, reach * arm.length)
    contacts = finder.find(points)
    # For an axis without width, touching a wall cannot be distinguished from crossing it.
    may_touch = allowed_contact(arm, workspace) > 0.0
    least = -DEFAULT_CERTIFICATE.rounding if may_touch else DEFAULT_CERTIFICATE.touch
    crossing = finder.crosses(points)
    touching = bool(np.any(contacts.gap < least)) or crossing
    # A stationary pose is a motion, too: its certificate detects links that lie deep inside obstacles.
    inside = not touching and len(Certificate.allowing_contact(arm, workspace).failures(np.stack((q, q)))) > 0
    if touching or inside:
        if (outside := _outside(arm, workspace, points)) is not None:
            advice = f"move the {which} inside, or widen workspace.bounds"
            raise UnreachableGoal(Diagnosis(f"the {which} {outside}", which, (advice,)))
        # If link axes meet walls, or each other, a thinner arm would not help.
        overlap = -float(contacts.gap.min())
        met = crossing or inside or overlap >= arm.radius + workspace.clearance
        tightest = finder.tightest(contacts)
        # No thinner arm helps a body on it.
        radius = arm.radius if tightest is not None and tightest[0].startswith("link") else 0.0
        room = () if met else clearance_advice(radius, workspace.clearance, overlap, key=arm.key("radius"))
        what = "a link lies inside an obstacle" if inside else finder.describe(contacts)
        raise UnreachableGoal(_touching(which, what, room))
    return float(contacts.gap.min(initial=np.inf))


def _refuse_sharp_bends(arm: Arm, bends: FloatArray, which: str) -> None:
    over = np.abs(bends) - arm.bend_limits
    joint = int(np.argmax(over))
    if over[joint] <= DEFAULT_CERTIFICATE.rounding:
        return
    angle = np.rad2deg(bends[joint])
    limit = np.rad2deg(arm.bend_limits[joint])
    reason = f"the {which} bends joint {arm.link_number(joint)} by {angle:.2f}°, but its limit is {limit:.2f}°"
    key = arm.key("joint_limit_deg") if joint else "arm.base_limit_deg"
    more = (f"raise {key} to {abs(angle):.4g} at least",) if limit > 0.0 else ()
    advice = (f"change the {which}", *more)
    raise UnreachableGoal(Diagnosis(reason, which, advice))


def _touching(which: str, contact: str, room: tuple[str, ...]) -> Diagnosis:
    return Diagnosis(f"the {which} is in contact: {contact}", which, (f"change the {which}", *room))


def _outside(arm: Arm, workspace: Workspace, points: FloatArray) -> str | None:
    """Return text that says where a pose leaves the workspace; None if the pose stays inside.

    Args:
        arm: the arm.
        workspace: a planar workspace.
        points: positions of the joints and the tip, shape (links + 1, 2) [m].
    """
    link, share = arm.mount_end
    behind_mount = np.vstack((points[link] + share * (points[link + 1] - points[link]), points[link + 1 :]))
    out = ~shapely.intersects_xy(workspace.boundary, behind_mount[:, 0], behind_mount[:, 1])
    if not out.any():
        return None
    depth = np.where(out, shapely.distance(shapely.points(behind_mount), workspace.boundary), 0.0)
    worst = int(np.argmax(depth))
    name = arm.link_name(link + max(worst, 1) - 1)
    return (
        f"leaves the workspace: {name} is {short_length(depth[worst])} outside its boundary at "
        f"{place(behind_mount[worst])}"
    )
