"""Random problems in space: random obstacles (clutter), and example problems with perturbed start and goal.

The arm in clutter has a length of 1 m and a radius of 15 mm, with its base at the origin. Clutter consists of spheres,
boxes of any orientation, cylinders and capsules, all within reach of the arm. A seed gives the same scene on every
machine.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.reading import load_problem
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Limits
from ccm_opt.robot.link_bodies import cylinder_inertia
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, RigidPlacement, SphereBody
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.scene.workspace import Obstacle, Workspace

USUAL_LINKS = 24
"""Number of links of the example problems."""
MASS = 0.5
"""Mass of a whole arm [kg]."""
JOINT_LIMIT = float(np.deg2rad(45.0))
"""Joint limit of each bend angle for arms with at least the usual number of links [rad]."""
LENGTH = 1.0
"""Length of the arm [m]."""
RADIUS = 0.015
"""Radius of the arm [m]."""
KEPT_OFF = 0.01
"""Minimum clearance of start and goal pose to obstacles and between links [m]."""
BEND = 3.0
"""Standard deviation of the curvature of random poses, in each direction [1/m]."""
VELOCITY = 1.0
"""Velocity limit of every revolute joint [rad/s]."""
ACCELERATION = 2.0
"""Acceleration limit of every revolute joint [rad/s²]."""


def arm_of_links(links: int, length: float, radius: float) -> Arm:
    """Return an arm in space with its base at the origin, straight along x; the first joint bends in any direction.

    Args:
        links: number of links.
        length: length of the arm [m].
        radius: radius of the arm [m].
    """
    coarse = Arm(
        links=2,
        link_length=0.5 * length,
        radius=radius,
        base=np.zeros(3),
        direction=np.array([1.0, 0.0, 0.0]),
        joint_limit=JOINT_LIMIT,
        base_limit=2.0 * np.pi,
        self_collision=True,
        mount_length=radius,
        masses=np.full(2, 0.5 * MASS),
        inertia_axial=np.zeros(2),
        inertia_transverse=np.zeros(2),
    )
    return with_links(coarse, links)


def with_links(arm: Arm, links: int) -> Arm:
    """Return an arm with another number of equal links; total length, radius and total mass are unchanged.

    Rotor inertia and friction become the means of the given arm's. The fewer the links, the larger the joint limit, up
    to a right angle, so that the arm can follow the same curves.
    """
    masses = np.full(links, float(np.sum(arm.masses)) / links)
    axial, transverse = cylinder_inertia(masses, arm.radius, arm.length / links)
    return replace(
        arm,
        links=links,
        link_length=arm.length / links,
        joint_limit=min(max(JOINT_LIMIT, JOINT_LIMIT * USUAL_LINKS / links), 0.5 * np.pi),
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=transverse,
        rotor_inertia=float(np.mean(arm.rotor_inertia)),
        friction=float(np.mean(arm.friction)),
    )


def random_bends(rng: np.random.Generator, arm: Arm, bend: float = BEND) -> FloatArray:
    """Return the joint angles of a smooth random pose, with c coordinates, shape (c,) [rad].

    Args:
        rng: random generator.
        arm: the arm, planar or in space.
        bend: standard deviation of the curvature in each direction [1/m].
    """
    middles = (np.arange(arm.links) + 0.5) / arm.links
    # Six normally distributed curvatures in each direction, interpolated linearly: smooth but arbitrary.
    knots = rng.normal(0.0, bend, (arm.dimension - 1, 6))
    bends = np.column_stack([np.interp(middles, np.linspace(0.0, 1.0, 6), row) * arm.link_length for row in knots])
    bends[0, 0] = rng.uniform(-np.pi, np.pi)  # the base may point anywhere
    if arm.dimension == 3:
        bends[0, 1] = np.arcsin(rng.uniform(-1.0, 1.0))
    # A little inside the limits, so that no problem fails because of rounding at its start or goal.
    return np.asarray(np.clip(bends.ravel(), -0.95 * arm.bend_limits, 0.95 * arm.bend_limits))


def clear_bends(rng: np.random.Generator, arm: Arm, bend: float = BEND) -> FloatArray:
    """Return the joint angles of a smooth random pose without self-collision, with c coordinates, shape (c,) [rad].

    Arguments are those of ``random_bends``.
    """
    while True:
        q = random_bends(rng, arm, bend)
        if links_apart(arm, arm.joint_positions_at(q), KEPT_OFF):
            return q


def links_apart(arm: Arm, points: FloatArray, gap: float) -> bool:
    """Return whether all pairs of links that are checked for self-collision keep a minimum clearance.

    Args:
        arm: the arm of n links.
        points: positions of joints and tip, shape (n + 1, d) with d = 2 or 3 [m].
        gap: the clearance [m].
    """
    i, j = arm.distant_pairs
    apart = segment_distances(points[i], points[i + 1], points[j], points[j + 1])[2]
    return bool(np.all(apart > 2.0 * arm.radius + gap))


def axes_of(points: FloatArray) -> FloatArray:
    """Return the axes of n links as line segments, shape (n, 2, 3) [m], from joints and tip, shape (n + 1, 3) [m]."""
    return np.stack((points[:-1], points[1:]), axis=1)


def space_clutter(seed: int, count: int, links: int, name: str) -> Problem:
    """Return a random problem in space among random obstacles.

    Start and goal pose are sampled first, then obstacles within the arm's reach that touch neither pose.

    Args:
        seed: seed of the scene.
        count: number of obstacles.
        links: number of links of the arm.
        name: name of the problem.

    Returns:
        The problem of moving from the start pose to the tip position and direction of the goal pose.
    """
    rng = np.random.default_rng(seed)
    arm = arm_of_links(links, LENGTH, RADIUS)
    start, goal = (clear_bends(rng, arm) for _ in range(2))
    axes = np.concatenate([axes_of(arm.joint_positions_at(pose)) for pose in (start, goal)])
    bodies: list[Obstacle] = []
    while len(bodies) < count:
        body = _random_body(rng, LENGTH * _in_ball(rng))
        tree = SurfaceTree.from_triangles(TriangleSoup.joined([("", body.triangles, body.rounding)]))
        if float(tree.distances(axes, 4.0 * RADIUS).min()) > arm.radius + KEPT_OFF:
            bodies.append(Obstacle(f"body {len(bodies)}", body))
    bounds = 1.3 * LENGTH * np.array([[-1.0] * 3, [1.0] * 3])
    return Problem(
        name,
        Workspace(bounds=bounds, obstacles=tuple(bodies)),
        arm,
        Limits(np.full(3 * links, VELOCITY), np.full(3 * links, ACCELERATION)),
        JointPose(start.reshape(links, 2)),
        TipGoal(arm.joint_positions_at(goal)[-1], arm.link_rotations(goal)[-1, :, 0]),
    )


def _random_body(rng: np.random.Generator, middle: FloatArray) -> Body:
    """Return a sphere, box, cylinder or capsule of random size and orientation at a given position, shape (3,) [m].

    Spheres and boxes are 60 to 180 mm thick; cylinders and capsules are 20 to 60 mm thick and 0.1 to 0.4 m long.
    """
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


JOBS: Mapping[str, Mapping[str, float]] = {
    "elbow": {"base": 0.01, "fed": 0.1, "goal": 0.03, "turn": 0.25, "room": 0.004},
    "wing-box": {"base": 0.02, "fed": 0.05, "goal": 0.02, "turn": 0.25, "room": 0.004},
    "blade-row": {"base": 0.003, "fed": 0.1, "goal": 0.01, "turn": 0.15, "room": 0.002},
}
"""Perturbations of example problems, by name. Maximum values: ``base``, across its direction [m]; ``fed``, feed at the
start [m]; ``goal``, position [m]; ``turn``, direction [rad]. Also the minimum clearance of the straight arm at the
start and of the last link at the goal [m]. Heuristic: fractions of the available clearance."""
MOST_DRAWS = 1000
"""Maximum number of samples of start and goal; if all are in contact, the perturbation is too large for the scene."""


def disturbed_job(seed: int, job: str, links: int, folder: Path, name: str) -> Problem:
    """Return an example problem in space with base, start and goal perturbed at random, without contact.

    Args:
        seed: seed of the perturbation.
        job: name of the example problem.
        links: number of links of the arm.
        folder: folder of the example problems in space.
        name: name of the new problem.

    Raises:
        ProblemError: all samples of start and goal are in contact.
    """
    problem, tree = _shipped(folder / f"{job}.toml")
    goal, whole = problem.goal, problem.arm
    if goal.direction is None:
        raise ProblemError(f"the goal of {job} is not a tip position with a direction")
    moved = JOBS[job]
    kept = whole.radius + problem.workspace.clearance + moved["room"]
    rng = np.random.default_rng(seed)
    for _ in range(MOST_DRAWS):
        across = _in_ball(rng)
        base = whole.base + moved["base"] * (across - (across @ whole.direction) * whole.direction)
        arm = with_links(replace(whole, base=base), links)
        start = JointPose(np.zeros((links, 2)), arm.base_range[0] + float(rng.uniform(0.0, moved["fed"])))
        place = goal.tip(whole) + moved["goal"] * _in_ball(rng)
        direction = goal.direction + np.tan(moved["turn"]) * _in_ball(rng)
        direction /= np.linalg.norm(direction)
        # The usual link length whatever the number of links, so that a seed gives the same ends for all of them.
        last = np.stack((place - whole.link_length * direction, place))
        points = arm.joint_positions_at(start.configuration(arm))
        # The mount of the straight arm may touch obstacles.
        straight = np.stack((points[0] + (arm.mount_length + arm.radius) * arm.direction, points[-1]))
        if float(tree.distances(np.stack((last, straight)), kept).min()) >= kept:
            tip = TipGoal(place, direction, goal.via, up=goal.up)
            limits = _limits(problem.limits, links)
            return replace(problem, name=name, arm=arm, start=start, goal=tip, limits=limits, source="")
    raise ProblemError(f"no start and goal near those of {job} keep a gap of {moved['room']} m")


@cache
def _shipped(file: Path) -> tuple[Problem, SurfaceTree]:
    problem = load_problem(file)
    return problem, problem.workspace.surface_tree


def _limits(limits: Limits, links: int) -> Limits:
    """Return limits for another number of links, given limits that are equal for all revolute joints."""
    given = {key: getattr(limits, key) for key in ("velocity", "acceleration", "torque", "jerk")}
    whole = {key: np.full(3 * links, float(values[0])) for key, values in given.items() if values is not None}
    return replace(limits, **whole)  # type: ignore[arg-type]


def _in_ball(rng: np.random.Generator) -> FloatArray:
    """Return a point sampled uniformly from the unit ball, shape (3,)."""
    way = rng.normal(size=3)
    return np.asarray(rng.uniform() ** (1.0 / 3.0) * way / np.linalg.norm(way))
