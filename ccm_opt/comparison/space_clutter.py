"""Seeded random scenes in space: an arm among bodies, with a start and a goal pose that touch nothing.

The arm reaches 1 m with a radius of 15 mm, its base at the origin; the clutter is balls, boxes turned any way, and bars
with flat and with round ends, all in reach of the arm. A seed gives the same scene on every machine.
"""

import numpy as np

from ccm_opt.comparison.space_arms import arm_of_links
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.drive_limits import Limits
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.jointed.space_kinematics import joint_positions, link_rotations
from ccm_opt.space.distances.segment_pairs import segment_distances
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.problem import SpaceJointPose, SpaceProblem, SpaceTipGoal
from ccm_opt.space.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, SphereBody
from ccm_opt.space.scene.rigid_placement import RigidPlacement
from ccm_opt.space.scene.scene import SpaceObstacle, SpaceWorkspace
from ccm_opt.space.scene.surfaces import SurfaceSoup

LENGTH = 1.0
"""Length of the arm [m]."""
RADIUS = 0.015
"""Radius of its links [m]."""
KEPT_OFF = 0.01
"""Least gap between the start or goal pose and a body, or another link [m]."""
BEND = 3.0
"""Standard deviation of the curvature of random poses, in each direction [1/m]."""
VELOCITY = 1.0
"""Limit of every revolute [rad/s]."""
ACCELERATION = 2.0
"""Limit of every revolute [rad/s²]."""


def space_clutter(seed: int, count: int, links: int, name: str) -> SpaceProblem:
    """Start and goal pose drawn first, then bodies within the arm's reach that keep off both.

    Args:
        seed: of the scene.
        count: of bodies.
        links: of the arm.
        name: of the problem.

    Returns:
        The problem: from the start pose to the place and direction of the tip in the goal pose.
    """
    rng = np.random.default_rng(seed)
    arm = arm_of_links(links, LENGTH, RADIUS)
    start = _clear_pose(rng, arm)
    goal = _clear_pose(rng, arm)
    axes = np.concatenate([_axes(joint_positions(arm, pose)) for pose in (start, goal)])
    bodies: list[SpaceObstacle] = []
    while len(bodies) < count:
        body = _random_body(rng, _place_in_reach(rng))
        if _apart(body, axes) > arm.radius + KEPT_OFF:
            bodies.append(SpaceObstacle(f"body {len(bodies)}", body))
    wide = 1.3 * LENGTH
    bounds = np.array([[-wide, -wide, -wide], [wide, wide, wide]])
    tip = SpaceTipGoal(joint_positions(arm, goal)[-1], link_rotations(arm, goal)[-1, :, 0])
    revolutes = 3 * links
    return SpaceProblem(
        name,
        SpaceWorkspace(bounds, tuple(bodies)),
        arm,
        Limits(np.full(revolutes, VELOCITY), np.full(revolutes, ACCELERATION)),
        SpaceJointPose(start.reshape(links, 2)),
        tip,
    )


def _clear_pose(rng: np.random.Generator, arm: SpaceArm) -> FloatArray:
    """Bends of a smooth random pose none of whose links comes near another, shape (2 links,) [rad]."""
    middles = (np.arange(arm.links) + 0.5) / arm.links
    while True:
        # Six normally distributed curvatures each way, linear between them: smooth but arbitrary.
        knots = rng.normal(0.0, BEND, (2, 6))
        bends = [np.interp(middles, np.linspace(0.0, 1.0, 6), row) * arm.link_length for row in knots]
        q = np.column_stack(bends).ravel()
        q[0] = rng.uniform(-np.pi, np.pi)  # the base may point anywhere
        q[1] = np.arcsin(rng.uniform(-1.0, 1.0))
        # A little inside the limits, so that no problem fails for rounding at its start or goal.
        q = np.asarray(np.clip(q, -0.95 * arm.bend_limits, 0.95 * arm.bend_limits))
        points = joint_positions(arm, q)
        i, j = arm.distant_pairs
        apart = segment_distances(points[i], points[i + 1], points[j], points[j + 1])[2]
        if np.all(apart > 2.0 * arm.radius + KEPT_OFF):
            return q


def _axes(points: FloatArray) -> FloatArray:
    """Axes of links, shape (links, 2, 3) [m]."""
    return np.stack((points[:-1], points[1:]), axis=1)


def _place_in_reach(rng: np.random.Generator) -> FloatArray:
    """A place in the ball that the arm reaches, all alike likely, shape (3,) [m]."""
    way = rng.normal(size=3)
    return np.asarray(LENGTH * rng.uniform() ** (1.0 / 3.0) * way / np.linalg.norm(way))


def _random_body(rng: np.random.Generator, middle: FloatArray) -> Body:
    """A ball, a box or a bar about a place: 60 to 180 mm thick, bars 20 to 60 mm thick and 0.1 to 0.4 m long."""
    kind = int(rng.integers(4))
    if kind == 0:
        return SphereBody(middle, float(rng.uniform(0.03, 0.09)))
    if kind == 1:
        half = rng.uniform(0.03, 0.09, 3)
        return BoxBody(-half, half, RigidPlacement.of_quaternion(middle, rng.normal(size=4)))
    way = rng.normal(size=3)
    half_way = 0.5 * rng.uniform(0.1, 0.4) * way / np.linalg.norm(way)
    bar = CylinderBody if kind == 2 else CapsuleBody
    return bar(middle - half_way, middle + half_way, float(rng.uniform(0.01, 0.03)))


def _apart(body: Body, axes: FloatArray) -> float:
    """Least distance of a body from segments, shape (k, 2, 3), or somewhat beyond what matters [m]."""
    tree = SurfaceTree.of(SurfaceSoup.joined([("", body.triangles, body.rounding)]))
    return float(tree.distances(axes, 4.0 * RADIUS).min())
