"""Scenes of an arm that a feed axis carries through a hole into a room, for the tests of feeding."""

from typing import TYPE_CHECKING

import numpy as np
import shapely

from ccm_opt.planning.leader import LeaderPath
from ccm_opt.problem import Goal, JointPose, Limits, PlannerOptions, Problem
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .arms import plain_arm

if TYPE_CHECKING:
    from ccm_opt.core.arrays import FloatArray

LINKS = 16
LINK = 0.05
"""Link length [m]."""
RADIUS = 0.02
"""Of the arm [m]."""


def fed_arm(low: float = 0.0, links: int = LINKS, link: float = LINK, **changes: object) -> Arm:
    """An arm whose guide lies on the negative x axis, its hole at the origin; a link is 50 mm long if not given [m]."""
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
    """A room beyond a wall in which the hole is, the guide behind it."""
    guide = (
        Obstacle("guide, top", PlaneShape(shapely.box(-1.2, 0.03, 0.0, 1.0))),
        Obstacle("guide, bottom", PlaneShape(shapely.box(-1.2, -1.0, 0.0, -0.03))),
    )
    return Workspace(shapely.box(-1.3, -1.2, 1.4, 1.2), (*guide, *obstacles))


def make_problem(arm: Arm, room: Workspace, goal: Goal, start: JointPose | None = None) -> Problem:
    """From the least feed and straight, unless a start is given."""
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
    """The feed axis to a little beyond the hole, then an arc of a given turn [rad] and length [m]."""
    base = float(arm.feed.hole) if arm.feed is not None else 0.0
    arc = np.concatenate((np.arange(-0.1, base + straight, 0.01), base + straight + np.linspace(0.0, length, 401)))
    along = np.maximum(arc - base - straight, 0.0)
    headings: FloatArray = turn * along / length
    radius = length / turn
    x = np.minimum(arc, base + straight) - arm.length + radius * np.sin(headings)
    return LeaderPath(arc, np.column_stack((x, radius * (1.0 - np.cos(headings)))), headings, base + straight)
