"""Seeded random work places for snake arms: ducts, tanks, bays, walls with holes, posts; each made about a known way.

A family draws bodies and a route among them which an arm could lie along with some room: so the pose at the goal
exists, and for a fed arm whose links follow its tip the motion nearly does too. All of it is turned at random for odd
seeds. The arm is 0.9 m long with a radius of 12 mm; with few links openings are wider, since chords cut corners.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ccm_opt.comparison import space_bays, space_ducts, space_walls
from ccm_opt.comparison.space_arms import arm_of_links
from ccm_opt.comparison.space_routes import laid_along
from ccm_opt.comparison.space_site import Site
from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.drive_limits import Limits
from ccm_opt.jointed.link_chain import Feed
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.jointed.space_kinematics import joint_positions, link_rotations
from ccm_opt.space.distances.segment_pairs import segment_distances
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.problem import SpaceJointPose, SpaceProblem, SpaceTipGoal
from ccm_opt.space.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, SphereBody
from ccm_opt.space.scene.rigid_placement import RigidPlacement
from ccm_opt.space.scene.scene import SpaceObstacle, SpaceWorkspace

SITES: Mapping[str, Callable[[np.random.Generator, float], Site | None]] = {
    "pipe-two-bends": space_ducts.pipe_of_two_bends,
    "pipe-three-bends": space_ducts.pipe_of_three_bends,
    "tee": space_ducts.tee,
    "tee-pose": space_ducts.tee_pose,
    "tank": space_ducts.tank,
    "hairpin": space_ducts.hairpin,
    "double-back": space_ducts.double_back,
    "u-turn": space_walls.u_turn,
    "holes": space_walls.holes,
    "holes-via": space_walls.holes_via,
    "post": space_walls.post,
    "reach-in": space_walls.reach_in,
    "other-hole": space_walls.other_hole,
    "other-branch": space_ducts.other_branch,
    "frames": space_bays.frames,
    "blades": space_bays.blades,
    "bays": space_bays.bays,
}
"""What draws a site with a given extra room, or None where the draw is of no use."""
LENGTH = 0.9
"""Of the arms [m]."""
TRAVEL = 0.85
"""Of the feed axes [m]."""
SHOWN = 0.02
"""Of a fed arm at the start, beyond its guide tube [m]."""
LEAST_GAP = 0.004
"""Of the arm along the known way [m]."""
BEND_RADIUS = 0.1
"""For which openings are widened where links are long [m]."""
MOST_DRAWS = 400
"""After so many draws of no use something is wrong with a family."""


def site_problem(family: str, seed: int, links: int, name: str) -> SpaceProblem:
    """A problem of a family.

    Args:
        family: its name.
        seed: of the draws.
        links: of the arm.
        name: of the problem.

    Raises:
        ProblemError: no scene with room for such an arm was drawn.
    """
    rng = np.random.default_rng([seed, sum(map(ord, family))])
    # Half of what the chord of a link cuts off a bend, once on each side.
    wider = (LENGTH / links) ** 2 / (8.0 * BEND_RADIUS)
    for _ in range(MOST_DRAWS):
        site = SITES[family](rng, wider)
        if site is None:
            continue
        problem = _problem(site, links, name)
        if problem is not None:
            return problem if seed % 2 == 0 else _turned(problem, _rotation(rng))
    raise ProblemError(f"no scene of the family {family} leaves an arm of {links} links its room")


def _problem(site: Site, links: int, name: str) -> SpaceProblem | None:
    """The problem of a site; None where the arm cannot lie along its routes."""
    arm = replace(arm_of_links(links, LENGTH, site.radius), mount_length=site.radius)
    if site.fed:
        # The guide tube ends at the origin.
        outside = LENGTH - SHOWN
        arm = replace(arm, base=np.array([-outside, 0.0, 0.0]), feed=Feed(0.0, TRAVEL, outside))
    soup_of = SpaceWorkspace(None, tuple(SpaceObstacle(name, body) for name, body in site.bodies))
    tree = SurfaceTree.of(soup_of.soup)
    ends = []
    for route, end in site.routes:
        q = laid_along(arm, route, end)
        if q is None or not _free(tree, arm, q):
            return None
        ends.append(q)
    goal = ends[-1]
    straight = np.append(np.zeros(2 * links), [0.0] * len(arm.base_axes))
    start = ends[0] if len(ends) > 1 else straight
    if not _free(tree, arm, start):
        return None
    position = joint_positions(arm, goal)[-1]
    direction = link_rotations(arm, goal)[-1, :, 0] if site.directed else None
    tip = SpaceTipGoal(position, direction, site.via)
    rates = np.ones(3 * links)
    limits = (
        Limits(rates, 4.0 * rates, feed_velocity=0.1, feed_acceleration=0.5) if site.fed else Limits(rates, 4.0 * rates)
    )
    return SpaceProblem(
        name,
        soup_of,
        arm,
        limits,
        SpaceJointPose.from_configuration(start, links),
        SpaceJointPose.from_configuration(goal, links) if site.whole_pose else tip,
    )


def _free(tree: SurfaceTree, arm: SpaceArm, q: FloatArray) -> bool:
    """Whether a configuration keeps the least gap from bodies, and links from each other."""
    points = joint_positions(arm, q)
    first = int(np.ceil(arm.mount_length / arm.link_length))
    axes = np.stack((points[first:-1], points[first + 1 :]), axis=1)
    i, j = arm.distant_pairs
    apart = segment_distances(points[i], points[i + 1], points[j], points[j + 1])[2]
    kept = arm.radius + LEAST_GAP
    return bool(tree.distances(axes, 2.0 * kept).min() > kept and np.all(apart > 2.0 * kept))


def _rotation(rng: np.random.Generator) -> RigidPlacement:
    return RigidPlacement.of_quaternion(rng.uniform(-0.3, 0.3, 3), rng.normal(size=4))


def _turned(problem: SpaceProblem, by: RigidPlacement) -> SpaceProblem:
    """The problem with everything in it moved."""
    arm = problem.arm
    turned = by.rotation
    workspace = replace(
        problem.workspace,
        obstacles=tuple(SpaceObstacle(each.name, _moved(each.body, by)) for each in problem.workspace.obstacles),
    )
    goal = problem.goal
    if isinstance(goal, SpaceTipGoal):
        direction = None if goal.direction is None else turned @ goal.direction
        via = tuple(by.points(place[None])[0] for place in goal.via)
        goal = SpaceTipGoal(by.points(goal.position[None])[0], direction, via)
    base = by.points(arm.base[None])[0]
    moved = replace(arm, base=base, direction=turned @ arm.direction, up=turned @ arm.up)
    return replace(problem, workspace=workspace, arm=moved, goal=goal)


def _moved(body: Body, by: RigidPlacement) -> Body:
    if isinstance(body, BoxBody):
        own = body.placement
        return replace(body, placement=RigidPlacement(by.points(own.position[None])[0], by.rotation @ own.rotation))
    if isinstance(body, SphereBody):
        return replace(body, center=by.points(body.center[None])[0])
    if isinstance(body, (CapsuleBody, CylinderBody)):
        start, end = by.points(np.stack((body.start, body.end)))
        return replace(body, start=start, end=end)
    return replace(body, vertices=by.points(body.vertices), placement=by)
