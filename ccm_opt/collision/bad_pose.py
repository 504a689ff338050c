"""Whether the whole arm can stand as a problem wants it; a motion is planned only between poses that it can have."""

import numpy as np

from ccm_opt.collision.certificate import Certificate, allowed_contact
from ccm_opt.collision.collision_settings import DEFAULT_CERTIFICATE
from ccm_opt.collision.contact_finder import ContactFinder
from ccm_opt.errors import Diagnosis, UnreachableGoal
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm


def refuse_bad_pose(arm: Arm, workspace: Workspace, pose: FloatArray, which: str, reach: float = 0.02) -> float:
    """The least gap between the arm and anything near it [m]; infinite when nothing is near.

    Args:
        arm: the arm.
        workspace: the room.
        pose: link headings and perhaps the base, shape (links,) or (c,) [rad, link lengths].
        which: names the pose in messages.
        reach: what is nearer than this share of the arm's length is looked at.

    Raises:
        UnreachableGoal: the pose breaks a joint limit or touches something; names joint or link and obstacle.
    """
    _refuse_sharp_bends(arm, arm.bends(pose[: arm.links]), which)
    finder = ContactFinder(arm, workspace.flat_walls, workspace.clearance, 0.0, reach * arm.length)
    points = arm.points(pose)
    contacts = finder.find(points)
    # An axis without width that touched a wall could not be told from one that crosses it.
    may_touch = allowed_contact(arm, workspace) > 0.0
    least = -DEFAULT_CERTIFICATE.rounding if may_touch else DEFAULT_CERTIFICATE.touch
    if np.any(contacts.gap < least) or finder.crosses(points):
        raise UnreachableGoal(_touching(which, finder.describe(contacts)))
    # A pose that stands still is a motion too: its certificate sees links inside obstacles, far from any wall.
    if len(Certificate.allowing_contact(arm, workspace).failures(np.stack((pose, pose)))):
        raise UnreachableGoal(_touching(which, "a link lies inside an obstacle"))
    return float(contacts.gap.min(initial=np.inf))


def _refuse_sharp_bends(arm: Arm, bends: FloatArray, which: str) -> None:
    over = np.abs(bends) - arm.bend_limits
    joint = int(np.argmax(over))
    if over[joint] <= DEFAULT_CERTIFICATE.rounding:
        return
    angle = np.rad2deg(bends[joint])
    limit = np.rad2deg(arm.bend_limits[joint])
    reason = f"the {which} bends joint {joint + 1} by {angle:.2f}°, its limit is {limit:.2f}°"
    raise UnreachableGoal(Diagnosis(reason, which, (f"change the {which}", "raise arm.joint_limit_deg")))


def _touching(which: str, contact: str) -> Diagnosis:
    advice = (f"change the {which}", "use a smaller arm.radius or workspace.clearance")
    return Diagnosis(f"the {which} touches something: {contact}", which, advice)
