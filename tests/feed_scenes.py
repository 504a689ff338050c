"""Planar problems of an arm on a feed axis that enters a room through a hole in a wall."""

from typing import TYPE_CHECKING

import numpy as np
import shapely

from ccm_opt.planning.leader import LeaderPath
from ccm_opt.problem import Goal, JointPose, Limits, PlannerOptions, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .arms import plain_arm

if TYPE_CHECKING:
    from ccm_opt.core.arrays import FloatArray

LINKS = 16
LINK = 0.05
"""Link length [m]."""
RADIUS = 0.02
"""Radius of the arm [m]."""


def fed_arm(low: float = 0.0, links: int = LINKS, link: float = LINK, **changes: object) -> Arm:
    """Return an arm with a guide tube on the negative x axis that ends at the origin.

    Args:
        low: lower limit of the feed [m].
        links: number of links.
        link: length of a link [m].
        **changes: further fields of the arm.
    """
    length = links * link
    guided: dict[str, object] = {
        "base": np.array([-length, 0.0]),
        "joint_limit": np.deg2rad(50.0),
        "base_limit": np.deg2rad(50.0),
        "mount_length": RADIUS,
        "masses": np.full(links, 0.05),
        "inertia_axial": np.full(links, 1e-5),
        "inertia_transverse": np.full(links, 2e-5),
        "feed": Feed(low, length, length),
    }
    return plain_arm(links, link, RADIUS, **(guided | changes))


def make_room(*obstacles: Obstacle) -> Workspace:
    """Return a workspace with a wall with a hole at the origin, the guide behind it, and given obstacles."""
    guide = (
        Obstacle("guide, top", PlaneShape(shapely.box(-1.2, 0.03, 0.0, 1.0))),
        Obstacle("guide, bottom", PlaneShape(shapely.box(-1.2, -1.0, 0.0, -0.03))),
    )
    return Workspace(shapely.box(-1.3, -1.2, 1.4, 1.2), (*guide, *obstacles))


def make_problem(arm: Arm, room: Workspace, goal: Goal, start: JointPose | None = None) -> Problem:
    """Return a problem with a given goal; by default the arm starts straight at the lower limit of the feed."""
    count = 3 * arm.links
    least = arm.feed.low if arm.feed is not None else 0.0
    return Problem(
        "feeding",
        room,
        arm,
        Limits(np.full(count, 1.0), np.full(count, 4.0), feed_velocity=0.2, feed_acceleration=0.5),
        start or JointPose(np.zeros(arm.links), least),
        goal,
        planner=PlannerOptions(time_limit=900.0),
    )


def bow(arm: Arm, turn: float, length: float = 0.5, straight: float = 0.1) -> LeaderPath:
    """Return a tip path along the feed axis to a point beyond the hole, then along a circular arc.

    Args:
        arm: the arm.
        turn: angle of the arc [rad].
        length: length of the arc [m].
        straight: length of the straight part beyond the hole [m].
    """
    base = float(arm.feed.hole) if arm.feed is not None else 0.0
    arc = np.concatenate((np.arange(-0.1, base + straight, 0.01), base + straight + np.linspace(0.0, length, 401)))
    along = np.maximum(arc - base - straight, 0.0)
    headings: FloatArray = turn * along / length
    radius = length / turn
    x = np.minimum(arc, base + straight) - arm.length + radius * np.sin(headings)
    return LeaderPath(arc, np.column_stack((x, radius * (1.0 - np.cos(headings)))), headings, base + straight)
